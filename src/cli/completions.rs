//! `tesserae completions` and `tesserae man`: what shells and manuals know of this command line, made of it.

use clap::{Command, CommandFactory};
use clap_complete::Shell;
use clap_mangen::Man as Page;

use super::{Cli, Failure, print};

/// Arguments of `tesserae completions`.
#[derive(Debug, clap::Args)]
#[command(after_help = "\
Examples:
  tesserae completions bash \\
    > ~/.local/share/bash-completion/completions/tesserae
  tesserae completions fish > ~/.config/fish/completions/tesserae.fish
  tesserae completions zsh > ~/.zfunc/_tesserae")]
pub struct Completions {
    /// The shell
    #[arg(value_enum)]
    shell: Shell,
}

/// Arguments of `tesserae man`.
#[derive(Debug, clap::Args)]
#[command(after_help = "\
Examples:
  tesserae man > tesserae.1
  tesserae man cluster > tesserae-cluster.1")]
pub struct Man {
    /// The command; the whole program when left out
    #[arg(value_name = "COMMAND")]
    command: Option<String>,
}

/// The whole command line, with names and usages of commands as they are typed.
fn built() -> Command {
    let mut command = Cli::command();
    command.build();
    command
}

/// Writes the completions of a shell to standard output.
pub fn complete(arguments: &Completions) -> Result<(), Failure> {
    let mut script = Vec::new();
    clap_complete::generate(arguments.shell, &mut built(), "tesserae", &mut script);
    print(|out| out.write_all(&script))
}

/// Writes a manual page to standard output.
pub fn man(arguments: &Man) -> Result<(), Failure> {
    let whole = built();
    let command = match &arguments.command {
        None => &whole,
        Some(name) => whole.find_subcommand(name).ok_or_else(|| {
            let names: Vec<&str> = whole.get_subcommands().map(Command::get_name).collect();
            Failure::Usage("man", format!("there is no command {name:?}; there are {}", names.join(", ")))
        })?,
    };
    print(|out| {
        let mut page = Vec::new();
        Page::new(command.clone()).render(&mut page)?;
        out.write_all(&page)
    })
}
