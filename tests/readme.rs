//! The README against the code.

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

/// Numbers that the prose of the README repeats from the code.
#[test]
fn the_prose_of_the_readme_has_the_numbers_of_the_code() {
    let readme = std::fs::read_to_string(Path::new(env!("CARGO_MANIFEST_DIR")).join("README.md")).expect("a README");
    let words = readme.split_whitespace().collect::<Vec<_>>().join(" ");
    let qualities = [Quality::Fast, Quality::Default, Quality::Best];
    let [few, more, most] = qualities.map(|quality| quality.start().surplus_percent);
    let [one, two, many] = qualities.map(Quality::iterations_a_round);
    let iterations = Quality::Fast.max_iterations().expect("a limit");
    for phrase in [
        format!("into {more} % more clusters ({few} % with `--quality fast`, {most} % with `best`)"),
        format!("`--quality fast` stops after {iterations} iterations"),
        format!("Once clusters have {} faces on average", Quality::Default.optimised_from()),
        format!("for {two} iterations at most (`fast` {one}, `best` {many};"),
    ] {
        assert!(words.contains(&phrase), "not in the README: {phrase}");
    }
}

/// Fails when the table in the README is not that of the code. `UPDATE_README=1 cargo test --test readme` writes it.
#[test]
fn the_settings_in_the_readme_are_those_of_the_program() {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("README.md");
    let readme = std::fs::read_to_string(&path).expect("a README");
    let (before, rest) = readme.split_once("<!-- settings -->\n").expect("a mark");
    let (table, after) = rest.split_once("<!-- end of settings -->").expect("a mark");
    let now = settings();
    if std::env::var_os("UPDATE_README").is_some() {
        let text = format!("{before}<!-- settings -->\n{now}<!-- end of settings -->{after}");
        std::fs::write(&path, text).expect("written");
    } else {
        assert_eq!(table, now, "the README is out of date: run UPDATE_README=1 cargo test --test readme");
    }
}
