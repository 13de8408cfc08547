//! Names on the command line beside the tables of the engine: parameters, mesh formats, outputs.

use clap::{Command, CommandFactory};
use tesserae_cli::Cli;
use tesserae_mesh::artifacts::{self, Need};
use tesserae_mesh::mesh::Format;
use tesserae_mesh::parameters::names::Name;

/// The help of the argument that `is_wanted` finds.
fn help(command: &Command, is_wanted: impl Fn(&clap::Arg) -> bool) -> Option<String> {
    command.get_arguments().find(|argument| is_wanted(argument))?.get_help().map(ToString::to_string)
}

#[test]
fn every_name_is_a_flag_of_cluster_and_a_parameter_over_http() {
    let yaml = tesserae_service::openapi_yaml().expect("a description");
    let cli = Cli::command();
    let cluster = cli.find_subcommand("cluster").expect("a command");
    for name in Name::ALL {
        let flag = name.spelled(true);
        assert!(help(cluster, |argument| argument.get_long() == Some(&flag[2..])).is_some(), "{flag}");
        let is_part = *name == Name::WEIGHTS;
        assert!(is_part || yaml.contains(&format!("- name: {}\n", name.spelled(false))), "{name}");
    }
}

/// A format that is added to the table is named everywhere; a text that is written by hand and forgets it fails here.
#[test]
fn help_and_guide_list_exactly_the_mesh_formats_of_the_table() {
    let cli = Cli::command();
    let cluster = cli.find_subcommand("cluster").expect("a command");
    let of = |id: &str| help(cluster, |argument| argument.get_id() == id).expect("an explanation");
    assert!(of("input").contains(&format!(": {}, or -", Format::choice("."))), "{}", of("input"));
    assert!(of("format").contains(&format!(": {};", Format::choice(""))), "{}", of("format"));
    let page = include_str!("../../docs/command-line.md");
    let dotted = Format::ALL.map(|format| format!(".{}", format.name())).join(", ");
    assert!(page.contains(&format!("a mesh ({dotted}, or - for standard input)")), "docs/command-line.md");
}

/// An output that is added to the table has its flags with no other change.
#[test]
fn every_output_of_the_table_has_its_flags() {
    let cli = Cli::command();
    for artifact in artifacts::ALL {
        for flag in artifact.flags {
            assert!(flag.forms(artifact).next().is_some(), "{} writes nothing", flag.name);
            let of_mesh = artifact.needs.contains(&Need::Mesh);
            let of_hierarchy = artifact.is_made_of_hierarchy();
            for (command, has_it) in [("cluster", true), ("cut", of_hierarchy), ("export", of_mesh)] {
                let command = cli.find_subcommand(command).expect("a command");
                let found = help(command, |argument| argument.get_long() == Some(flag.long()));
                // labels and hierarchies are inputs of `export`
                assert!(!has_it || found.as_deref() == Some(flag.help), "{} of {command}", flag.name);
                assert!(has_it || found.as_deref() != Some(flag.help), "{} of {command}", flag.name);
            }
        }
    }
}
