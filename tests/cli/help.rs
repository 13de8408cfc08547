//! The help of every command, completions and manual pages.

use clap::{Command, CommandFactory, Parser};
use tesserae_cli::Cli;

use crate::command::Folder;

/// Columns that a line of the help has at most.
const COLUMNS: usize = 98;

/// Columns of a narrow terminal, where examples still are lines.
const NARROW: usize = 80;

/// Lines of a screen.
const SCREEN: usize = 50;

/// Every command with the words that name it.
fn commands() -> Vec<(Vec<String>, Command)> {
    fn add(words: &[String], command: &Command, all: &mut Vec<(Vec<String>, Command)>) {
        let words = [words, &[command.get_name().to_owned()]].concat();
        command.get_subcommands().filter(|command| command.get_name() != "help").for_each(|sub| add(&words, sub, all));
        all.push((words, command.clone()));
    }
    let mut all = Vec::new();
    let mut cli = Cli::command();
    cli.build();
    add(&[], &cli, &mut all);
    all
}

/// What a command line prints, with as many columns as the help may have, and fewer.
fn helps(words: &[String], flag: &str) -> [String; 2] {
    let folder = Folder::new();
    [200, NARROW].map(|columns| {
        let arguments: Vec<&str> = words[1..].iter().map(String::as_str).chain([flag]).collect();
        let output = folder.tesserae(&arguments).env("COLUMNS", columns.to_string()).output().expect("the binary runs");
        String::from_utf8(output.stdout).expect("text")
    })
}

#[test]
fn no_line_of_the_help_is_too_long() {
    let commands = commands();
    assert!(commands.len() > 15, "{}", commands.len());
    for (words, _) in commands {
        for flag in ["-h", "--help"] {
            for (help, most) in helps(&words, flag).iter().zip([COLUMNS, NARROW]) {
                assert!(help.contains("Usage: "), "{words:?} {flag}: {help}");
                let long: Vec<&str> = help.lines().filter(|line| line.chars().count() > most).collect();
                assert!(long.is_empty(), "{words:?} {flag}: {long:#?}");
            }
        }
    }
}

#[test]
fn the_short_help_is_one_screen_and_the_long_one_has_headings() {
    let [short, long] = of_command("cluster");
    for flag in
        ["INPUT", "-k", "-o", "--algorithm", "--quality", "--remesh", "--hierarchy", "--report", "--device", "-q"]
    {
        assert!(short.contains(flag), "{flag}: {short}");
    }
    for heading in [
        "Input:",
        "Clusters:",
        "Outputs:",
        "Hierarchies:",
        "Remesh:",
        "Limits:",
        "Comparison with the paper:",
        "Options:",
    ] {
        assert!(long.lines().any(|line| line == heading), "{heading}: {long}");
    }
    assert!(long.lines().count() > 2 * short.lines().count());
    let [short, long] = of_command("serve");
    for flag in ["--listen", "--data-dir", "--tokens", "--max-upload-bytes", "--retention", "--device", "--log"] {
        assert!(short.contains(flag), "{flag}: {short}");
    }
    for heading in ["Places:", "Access:", "Work:", "Limits:", "Room:", "Stop:", "Webhooks:", "Log:"] {
        assert!(long.lines().any(|line| line == heading), "{heading}: {long}");
    }
    assert!(!long.contains("--crash-pause"), "it is for tests: {long}");
}

/// The short help of a command, which is one screen, and the long one.
fn of_command(name: &str) -> [String; 2] {
    let words = ["tesserae", name].map(str::to_owned);
    let [short, long] = ["-h", "--help"].map(|flag| helps(&words, flag)[0].clone());
    assert!(short.lines().count() <= SCREEN, "{}: {short}", short.lines().count());
    [short, long]
}

/// Settings that `tesserae serve` may have.
const MOST_SETTINGS: usize = 28;

/// Flags that are hidden, for tests that kill the process.
const HIDDEN: [&str; 2] = ["max-attempts", "crash-pause"];

#[test]
fn the_service_has_few_settings_and_each_is_a_variable() {
    let cli = Cli::command();
    let serve = cli.find_subcommand("serve").expect("a command");
    let (hidden, settings): (Vec<_>, Vec<_>) = serve.get_arguments().partition(|argument| argument.is_hide_set());
    let names: Vec<&str> = hidden.iter().filter_map(|argument| argument.get_long()).collect();
    assert_eq!(names, HIDDEN);
    assert!(hidden.iter().all(|argument| argument.get_env().is_none()), "{hidden:?}");
    for setting in &settings {
        let name = setting.get_long().expect("a flag").replace('-', "_").to_uppercase();
        assert_eq!(setting.get_env(), Some(format!("TESSERAE_{name}").as_ref()));
    }
    assert!(settings.len() <= MOST_SETTINGS, "{}: make a constant of one, or compute it", settings.len());
}

/// Lines below "Example" can be copied: with ends that are joined, each is a command line that the parser takes.
#[test]
fn examples_are_command_lines() {
    let mut seen = 0;
    for (words, command) in commands() {
        for help in [command.get_after_help(), command.get_after_long_help()].into_iter().flatten() {
            let text = help.to_string();
            let Some((_, examples)) = text.split_once("Example") else { continue };
            let long: Vec<&str> = examples.lines().filter(|line| line.len() > NARROW).collect();
            assert!(long.is_empty(), "{words:?}: {long:?}");
            let examples = examples.split_once(":\n").expect("lines").1.replace("\\\n", " ");
            for line in examples.lines().take_while(|line| line.starts_with("  ")) {
                for part in line.split(" | ").map(str::trim).filter(|part| part.starts_with("tesserae ")) {
                    let part = part.split(" > ").next().expect("a part");
                    let parsed = Cli::try_parse_from(part.split_whitespace());
                    assert!(parsed.is_ok(), "{words:?}: {part}: {}", parsed.expect_err("refused"));
                    seen += 1;
                }
            }
        }
    }
    assert!(seen > 30, "{seen}");
}

#[test]
fn shells_and_manuals_know_the_commands() {
    let folder = Folder::new();
    for (shell, begin) in [("bash", "_tesserae()"), ("zsh", "#compdef tesserae"), ("fish", "# Print an optspec")] {
        let script = String::from_utf8(folder.run(&["completions", shell]).expect_success()).expect("text");
        assert!(script.starts_with(begin), "{shell}: {}", &script[..80]);
        for word in ["cluster", "curvature-exponent", "completions"] {
            assert!(script.contains(word), "{shell}: {word}");
        }
    }
    folder.run(&["completions", "cmd"]).expect_usage_error(&["bash", "fish", "zsh"]);
    let page = |arguments: &[&str]| {
        let page = folder.run(&[&["man"], arguments].concat()).expect_success();
        String::from_utf8(page).expect("text")
    };
    assert!(page(&[]).contains(".TH tesserae 1") && page(&[]).contains("tesserae\\-cluster(1)"), "{}", page(&[]));
    let cluster = page(&["cluster"]);
    assert!(cluster.contains(".TH tesserae-cluster 1") && cluster.contains("\\-\\-curvature\\-exponent"), "{cluster}");
    folder.run(&["man", "clusters"]).expect_usage_error(&["there is no command \"clusters\"", "cluster, cut"]);
}
