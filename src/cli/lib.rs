//! The command line.
//!
//! One file a command, those of the service in `service`; what they share is in `device`, `inputs`, `files`, `places`,
//! `results` (with `by_extension` and `patterns`), `summary`, `progress` and `signals`. Exit status: 0; 2 for a
//! command line that is wrong in itself, with the parser's form of message (`error: …`, the usage of the command, a
//! hint at `--help`); 1 for everything else, with one line on standard error that begins with `tesserae: ` (graphics
//! drivers may add lines of their own). Progress goes to standard error, and only to a terminal. A reader of standard
//! output that stops reading before the end gives status 1 without a message.
//!
//! A message begins with the name of the program and, where it is about an input, with the name of that file
//! ([`Failure::about`]). Parameters are spelled as flags ([`names::spell_as_flags`]).

mod bench;
mod by_extension;
mod cluster;
mod completions;
mod cut;
mod device;
mod devices;
mod evaluate;
mod export;
mod files;
mod inputs;
#[cfg_attr(not(feature = "service"), expect(dead_code, reason = "a part is for the service"))]
mod memory;
mod patterns;
mod places;
mod plot;
mod progress;
mod results;
mod sample;
#[cfg(feature = "service")]
mod service;
mod signals;
mod summary;

use std::error::Error as _;
use std::ffi::OsString;
use std::fmt::Display;
use std::io::{self, Write};
use std::process::ExitCode;

use clap::error::ErrorKind;
use clap::{CommandFactory, Parser, Subcommand};
use tesserae_mesh::error::{Error, Kind, what_it_must_be};
use tesserae_mesh::parameters::names;

use self::files::Target;

/// The first steps.
macro_rules! examples {
    () => {
        "\
Examples:
  tesserae sample knot --faces 100000 knot.glb
  tesserae cluster knot.glb -k 500 -o knot.npy -o knot-500.glb
  tesserae cluster knot.glb --algorithm pml -o knot.tsr
  tesserae cut knot.tsr -k 250 -o knot-250.npy
  tesserae export knot.glb --labels knot-250.npy -o knot-250.ply"
    };
}

/// The command line of `tesserae`.
#[derive(Debug, Parser)]
#[command(name = "tesserae", version, about = ABOUT, max_term_width = COLUMNS, after_help = EXAMPLES)]
pub struct Cli {
    #[command(subcommand)]
    command: Command,
}

/// What is in this program.
const ABOUT: &str = match (cfg!(feature = "service"), cfg!(feature = "gpu")) {
    (true, true) => "Clusters the faces of polygon meshes, on the CPU or GPU: a command line and a service",
    (true, false) => "Clusters the faces of polygon meshes, on the CPU: a command line and a service",
    (false, true) => "Clusters the faces of polygon meshes, on the CPU or GPU",
    (false, false) => "Clusters the faces of polygon meshes, on the CPU",
};

/// Columns of the help at most.
const COLUMNS: usize = 98;

#[cfg(feature = "service")]
const EXAMPLES: &str = concat!(examples!(), "\n  tesserae serve");
#[cfg(not(feature = "service"))]
const EXAMPLES: &str = examples!();

#[derive(Debug, Subcommand)]
enum Command {
    /// Cluster the faces of mesh files
    Cluster(Box<cluster::Arguments>),
    /// Take labels at any number of clusters from a hierarchy that `cluster` wrote
    Cut(Box<cut::Arguments>),
    /// Write meshes of clusters and other outputs, of a mesh and labels that were made before
    Export(Box<export::Arguments>),
    /// Draw the energies of reports: against the number of clusters, and per iteration
    Plot(plot::Arguments),
    /// Make measurements anew that were published, to compare
    Evaluate(evaluate::Arguments),
    /// Measure what a device takes for each stage of a job
    Bench(bench::Arguments),
    #[cfg(feature = "service")]
    #[command(flatten)]
    Service(service::Command),
    /// Make a mesh from nothing, for trying out and testing
    Sample(sample::Arguments),
    /// List every device, usable or why not, and which one `--device auto` takes
    Devices(devices::Arguments),
    /// Write what makes a shell complete this command line
    Completions(completions::Completions),
    /// Write the manual page of this program or of a command
    Man(completions::Man),
}

/// Whether a command says what it did.
#[derive(Debug, Clone, Copy, clap::Args)]
struct Quiet {
    /// Say nothing but errors: no progress, no warnings, no summary
    #[arg(long, short)]
    quiet: bool,
}

/// Runs the command that the arguments of this process name.
pub fn main() -> ExitCode {
    ExitCode::from(main_of(std::env::args_os()))
}

/// Runs the command of these arguments, the first of which is the name of the program; gives the exit status.
pub fn main_of(arguments: impl IntoIterator<Item = OsString>) -> u8 {
    names::spell_as_flags(true);
    let outcome = match Cli::try_parse_from(arguments) {
        Ok(cli) => run(cli.command),
        Err(wrong) if wrong.use_stderr() => return usage_error(&wrong),
        Err(help) => print(|_| help.print()),
    };
    match outcome {
        Ok(()) => 0,
        Err(Failure::Usage(command, message)) => usage_error(&as_parser_says(command, &message)),
        Err(Failure::Failed(error)) => {
            complain(&error.message);
            1
        }
        Err(Failure::Stopped) => {
            signals::say_stopped();
            1
        }
        Err(Failure::Said | Failure::BrokenPipe) => 1,
    }
}

/// Runs a command.
fn run(command: Command) -> Result<(), Failure> {
    match &command {
        #[cfg(feature = "service")]
        Command::Service(service::Command::Serve(_)) => {
            names::spell_as_flags(false);
            memory::keep_between_jobs();
        }
        _ => memory::keep(),
    }
    match command {
        Command::Cluster(arguments) => cluster::run(&arguments),
        Command::Cut(arguments) => cut::run(&arguments),
        Command::Export(arguments) => export::run(&arguments),
        Command::Plot(arguments) => plot::run(&arguments),
        Command::Evaluate(arguments) => evaluate::run(&arguments),
        Command::Bench(arguments) => bench::run(&arguments),
        #[cfg(feature = "service")]
        Command::Service(command) => service::run(command),
        Command::Sample(arguments) => sample::run(&arguments),
        Command::Devices(arguments) => devices::run(&arguments),
        Command::Completions(arguments) => completions::complete(&arguments),
        Command::Man(arguments) => completions::man(&arguments),
    }
}

/// Writes an error or a warning to standard error.
fn complain(message: &str) {
    say(&format!("tesserae: {message}"));
}

/// Writes one line to standard error, whatever a file name or a driver put into it; lost when standard error is closed.
fn say(line: &str) {
    let _ = writeln!(io::stderr(), "{}", line.replace(['\n', '\r'], " "));
}

/// Writes what a command is run for to standard output.
fn print(content: impl FnOnce(&mut dyn Write) -> io::Result<()>) -> Result<(), Failure> {
    Target::Stdout.write(content)
}

/// Writes one line about the outcome to standard output.
fn print_line(line: &str) -> Result<(), Failure> {
    let written = signals::Blocking::begin().and_then(|_blocking| writeln!(io::stdout(), "{line}"));
    written.map_err(|error| if signals::is_stopped() { Failure::Stopped } else { Failure::stdout(error) })
}

/// Why a command ended early.
enum Failure {
    /// The command line is wrong in itself: name of the command, and what is wrong.
    Usage(&'static str, String),
    /// Anything else.
    Failed(Error),
    /// Some of several inputs failed, and each was complained about.
    Said,
    /// A signal asked the command to stop.
    Stopped,
    /// The reader of standard output closed it before the end.
    BrokenPipe,
}

impl From<Error> for Failure {
    fn from(error: Error) -> Self {
        if error.kind == Kind::Cancelled { Failure::Stopped } else { Failure::Failed(error) }
    }
}

impl Failure {
    /// Makes a failure of any error about an input or output of that name.
    fn about(name: impl Display) -> impl Fn(Error) -> Failure {
        move |error| match error.kind {
            Kind::Cancelled => Failure::Stopped,
            kind => Failure::Failed(Error::new(kind, format_args!("{name}: {}", error.message))),
        }
    }

    /// A failure to write to standard output.
    fn stdout(error: io::Error) -> Self {
        if error.kind() == io::ErrorKind::BrokenPipe {
            Failure::BrokenPipe
        } else {
            Failure::Failed(Error::io("cannot write to standard output", error))
        }
    }
}

/// What is wrong with the command line of a command, as the parser would say it.
fn as_parser_says(command: &str, message: &str) -> clap::Error {
    let mut cli = Cli::command();
    cli.build();
    match cli.find_subcommand_mut(command) {
        Some(command) => command.error(ErrorKind::ValueValidation, message),
        None => cli.error(ErrorKind::ValueValidation, message),
    }
}

/// Says what is wrong with the command line. Exit status 2.
fn usage_error(wrong: &clap::Error) -> u8 {
    let cause = wrong.source().map(ToString::to_string).unwrap_or_default();
    // Where even that cannot be said, the status is all that is left.
    let _ = match what_it_must_be(&cause) {
        Some(must) => io::stderr().write_all(wrong.render().to_string().replacen(&cause, must, 1).as_bytes()),
        None => wrong.print(),
    };
    2
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_command_line_is_consistent() {
        Cli::command().debug_assert();
    }
}
