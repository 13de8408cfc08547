//! The guide in `docs/` against the code: the tables of settings and outputs, and numbers that its prose repeats.

use std::fmt::Write;
use std::path::Path;

use clap::CommandFactory;
use tesserae_cli::Cli;
use tesserae_mesh::artifacts::Artifact;
use tesserae_mesh::cluster::quality::Quality;
use tesserae_mesh::surface::Moves;

/// The settings of the service as a table, from the flags that the program has.
fn settings() -> String {
    let command = Cli::command();
    let serve = command.find_subcommand("serve").expect("a command");
    let mut groups: Vec<(&str, Vec<&clap::Arg>)> = Vec::new();
    for argument in serve.get_arguments().filter(|argument| !argument.is_hide_set()) {
        let heading = argument.get_help_heading().expect("a heading");
        match groups.iter_mut().find(|(name, _)| *name == heading) {
            Some((_, arguments)) => arguments.push(argument),
            None => groups.push((heading, vec![argument])),
        }
    }
    let mut table = "| flag, variable | default | |\n|---|---|---|\n".to_owned();
    for (heading, arguments) in groups {
        writeln!(table, "| **{heading}** | | |").expect("a string");
        arguments.into_iter().for_each(|argument| table += &row(argument));
    }
    table
}

/// The row of a setting.
fn row(argument: &clap::Arg) -> String {
    let flag = argument.get_long().expect("a flag");
    let variable = argument.get_env().expect("a variable").to_string_lossy();
    let defaults: Vec<_> = argument.get_default_values().iter().map(|value| value.to_string_lossy()).collect();
    let default = if defaults.is_empty() { String::new() } else { format!("`{}`", defaults.join(" ")) };
    let help = argument.get_help().expect("an explanation");
    let choices: Vec<String> =
        argument.get_possible_values().iter().map(|value| format!("`{}`", value.get_name())).collect();
    let choices = if choices.is_empty() { String::new() } else { format!(" ({})", choices.join(", ")) };
    format!("| `--{flag}` `{variable}` | {default} | {help}{choices} |\n")
}

fn page(name: &str) -> String {
    std::fs::read_to_string(Path::new(env!("CARGO_MANIFEST_DIR")).join("../../docs").join(name)).expect("a page")
}

#[test]
fn the_guide_has_the_numbers_of_the_code() {
    let qualities = [Quality::Fast, Quality::Default, Quality::Best];
    let [few, more, most] = qualities.map(|quality| quality.start(Moves::Free).surplus_percent);
    let [one, two, many] = qualities.map(Quality::iterations_a_round);
    let limit = |moves| Quality::Fast.max_iterations(moves).expect("a limit");
    let [iterations, connected] = [Moves::Free, Moves::Connected].map(limit);
    let from = Quality::Default.optimised_from();
    for (name, phrase) in [
        ("command-line.md", format!("{more} % more clusters than *k*")),
        ("command-line.md", format!("({few} % with `--quality fast`, {most} % with `best`)")),
        ("command-line.md", format!("| `fast` | {iterations} iterations a phase (points and normals: {connected})")),
        ("hierarchies.md", format!("once clusters have {from} faces on average")),
        ("hierarchies.md", format!("has at most {two} iterations (`fast` {one}, `best` {many},")),
    ] {
        let words = page(name).split_whitespace().collect::<Vec<_>>().join(" ");
        assert!(words.contains(&phrase), "not in {name}: {phrase}");
    }
}

/// The outputs as a table.
fn outputs() -> String {
    let mut table = "| output | | flags | route | files |\n|---|---|---|---|---|\n".to_owned();
    for artifact in tesserae_mesh::artifacts::ALL {
        let Artifact { name, about, .. } = artifact;
        let flags: Vec<String> = artifact.flags.iter().map(|flag| format!("`{} {}`", flag.name, flag.value)).collect();
        let route = if artifact.is_served { format!("`GET …/{name}`") } else { String::new() };
        let files: Vec<String> =
            artifact.forms.iter().map(|form| format!("`{}` (`{}`)", form.file, form.media_type)).collect();
        let (flags, files) = (flags.join(", "), files.join(", "));
        writeln!(table, "| {name} | {about} | {flags} | {route} | {files} |").expect("a string");
    }
    table
}

/// `UPDATE_PAGES=1 cargo test --test guide` writes the tables.
#[test]
fn the_documented_tables_are_those_of_the_program() {
    for (name, mark, now) in [("operations.md", "settings", settings()), ("results.md", "outputs", outputs())] {
        let (begin, end) = (format!("<!-- {mark} -->\n"), format!("<!-- end of {mark} -->"));
        let text = page(name);
        let (before, rest) = text.split_once(&begin).expect("a mark");
        let (table, after) = rest.split_once(&end).expect("a mark");
        if std::env::var_os("UPDATE_PAGES").is_some() {
            let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../docs").join(name);
            std::fs::write(&path, format!("{before}{begin}{now}{end}{after}")).expect("written");
        } else {
            assert_eq!(table, now, "{name} is out of date: run UPDATE_PAGES=1 cargo test --test guide");
        }
    }
}

#[test]
fn the_guide_explains_every_alert() {
    let rules = [include_str!("../deploy/alerts.yaml"), include_str!("../deploy/farm-alerts.yaml")].concat();
    let alerts: Vec<&str> = rules.lines().filter_map(|line| line.trim().strip_prefix("- alert: ")).collect();
    assert!(alerts.len() > 20, "{alerts:?}");
    let guide = page("farm.md");
    let left_out = |guide: &str| alerts.iter().filter(|name| !guide.contains(&format!("`{name}`"))).count();
    assert_eq!(left_out(&guide), 0, "{alerts:?}");
    assert_eq!(left_out(&guide.replace("`TesseraeDeviceWrong`", "")), 1);
}
