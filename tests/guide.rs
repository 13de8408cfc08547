//! The guide in `docs/` against the code: the table of settings, and numbers that its prose repeats.

use std::fmt::Write;
use std::path::Path;

use clap::CommandFactory;
use tesserae::cli::Cli;
use tesserae::cluster::quality::Quality;

/// The settings of the service as a table, from the flags that the program has.
fn settings() -> String {
    let command = Cli::command();
    let serve = command.find_subcommand("serve").expect("a command");
    let mut table = "| flag | variable | default | |\n|---|---|---|---|\n".to_owned();
    for argument in serve.get_arguments() {
        let flag = argument.get_long().expect("a flag");
        let variable = argument.get_env().expect("a variable").to_string_lossy();
        let defaults: Vec<_> = argument.get_default_values().iter().map(|value| value.to_string_lossy()).collect();
        let default = if defaults.is_empty() { String::new() } else { format!("`{}`", defaults.join(" ")) };
        let help = argument.get_help().expect("an explanation");
        let choices: Vec<String> =
            argument.get_possible_values().iter().map(|value| format!("`{}`", value.get_name())).collect();
        let choices = if choices.is_empty() { String::new() } else { format!(" ({})", choices.join(", ")) };
        writeln!(table, "| `--{flag}` | `{variable}` | {default} | {help}{choices} |").expect("a string");
    }
    table
}

fn page(name: &str) -> String {
    std::fs::read_to_string(Path::new(env!("CARGO_MANIFEST_DIR")).join("docs").join(name)).expect("a page")
}

#[test]
fn the_guide_has_the_numbers_of_the_code() {
    let qualities = [Quality::Fast, Quality::Default, Quality::Best];
    let [few, more, most] = qualities.map(|quality| quality.start().surplus_percent);
    let [one, two, many] = qualities.map(Quality::iterations_a_round);
    let iterations = Quality::Fast.max_iterations().expect("a limit");
    let from = Quality::Default.optimised_from();
    for (name, phrase) in [
        ("command-line.md", format!("{more} % more clusters than *k*")),
        ("command-line.md", format!("({few} % with `--quality fast`, {most} % with `best`)")),
        ("command-line.md", format!("| `fast` | {iterations} iterations a phase")),
        ("hierarchies.md", format!("once clusters have {from} faces on average")),
        ("hierarchies.md", format!("has at most {two} iterations (`fast` {one}, `best` {many},")),
    ] {
        let words = page(name).split_whitespace().collect::<Vec<_>>().join(" ");
        assert!(words.contains(&phrase), "not in {name}: {phrase}");
    }
}

/// `UPDATE_PAGES=1 cargo test --test guide` writes the table.
#[test]
fn the_documented_settings_are_those_of_the_program() {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("docs/operations.md");
    let page = std::fs::read_to_string(&path).expect("a page");
    let (before, rest) = page.split_once("<!-- settings -->\n").expect("a mark");
    let (table, after) = rest.split_once("<!-- end of settings -->").expect("a mark");
    let now = settings();
    if std::env::var_os("UPDATE_PAGES").is_some() {
        let text = format!("{before}<!-- settings -->\n{now}<!-- end of settings -->{after}");
        std::fs::write(&path, text).expect("written");
    } else {
        assert_eq!(table, now, "out of date: run UPDATE_PAGES=1 cargo test --test guide");
    }
}
