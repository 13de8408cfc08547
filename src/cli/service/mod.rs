//! The commands of the service: `serve`, and those that go with it.

mod backup;
mod health;
mod serve;
mod signals;
mod token;

use super::Failure;

/// The commands of the service.
#[derive(Debug, clap::Subcommand)]
pub enum Command {
    /// Serve jobs over HTTP
    Serve(Box<serve::Arguments>),
    /// Copy the data folder of a service, also while it runs
    Backup(backup::Arguments),
    /// Make, list and take back the tokens of a service
    Token(token::Arguments),
    /// Ask a service whether it is well; the exit status tells
    Health(health::Arguments),
}

/// Runs a command.
pub fn run(command: Command) -> Result<(), Failure> {
    match command {
        Command::Serve(arguments) => serve::run(*arguments),
        Command::Backup(arguments) => backup::run(&arguments),
        Command::Token(arguments) => token::run(&arguments),
        Command::Health(arguments) => health::run(&arguments),
    }
}
