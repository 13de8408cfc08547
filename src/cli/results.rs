//! The files that outputs go to: the flags of the [table](crate::artifacts::ALL), for every command that has outputs.

use std::path::PathBuf;

use clap::{Arg, ArgMatches, Command};

use super::Failure;
use super::files::{Extension, Source, Target, path_parser};
use super::places::{self, Output};
use crate::artifacts::{ALL, Artifact, Content, Flag, Form, HIERARCHY_JSON, Need};
use crate::hierarchy::json::Limits;

/// Where outputs go.
#[derive(Debug, clap::Args)]
pub struct Outputs {
    #[command(flatten)]
    files: OutputFiles,

    /// JSON hierarchies: leave out what comes after fewer clusters than this are left
    #[arg(long, value_name = "K")]
    min_clusters: Option<u64>,

    /// JSON hierarchies: leave out what comes before as few clusters as this are left
    #[arg(long, value_name = "K")]
    max_clusters: Option<u64>,
}

/// The requested outputs, in the order of the table.
#[derive(Debug)]
struct OutputFiles(Vec<OutputFile>);

/// A requested output.
#[derive(Debug, Clone)]
pub struct OutputFile {
    /// By this flag.
    pub flag: &'static str,
    /// What is written.
    pub artifact: &'static Artifact,
    /// How.
    pub form: &'static Form,
    /// Where.
    pub target: Target,
}

impl clap::FromArgMatches for OutputFiles {
    fn from_arg_matches(matches: &ArgMatches) -> Result<Self, clap::Error> {
        Ok(Self(flags().filter_map(|(_, flag)| matches.get_one(flag.long()).cloned()).collect()))
    }

    fn update_from_arg_matches(&mut self, matches: &ArgMatches) -> Result<(), clap::Error> {
        *self = Self::from_arg_matches(matches)?;
        Ok(())
    }
}

impl clap::Args for OutputFiles {
    fn augment_args(command: Command) -> Command {
        flags().fold(command, |command, (artifact, flag)| {
            let parser = path_parser(move |path| OutputFile::parse(artifact, flag, path));
            let argument = Arg::new(flag.long()).long(flag.long()).value_name(flag.value).help(flag.help);
            command.arg(argument.value_parser(parser))
        })
    }

    fn augment_args_for_update(command: Command) -> Command {
        Self::augment_args(command)
    }
}

/// Every flag, with what it writes.
fn flags() -> impl Iterator<Item = (&'static Artifact, &'static Flag)> {
    ALL.into_iter().flat_map(|artifact| artifact.flags.iter().map(move |flag| (artifact, flag)))
}

impl OutputFile {
    /// Takes a file name, whose extension says the form, or `-` for JSON.
    fn parse(artifact: &'static Artifact, flag: &'static Flag, path: PathBuf) -> Result<Self, String> {
        let target = Target::from(path);
        let forms: Vec<&Form> = flag.forms(artifact).collect();
        let json = forms.iter().find(|form| form.extension() == "json");
        let form = match target.extension() {
            _ if forms.len() == 1 && json.is_some() => json,
            Extension::Is(extension) => forms.iter().find(|form| extension.eq_ignore_ascii_case(form.extension())),
            Extension::None => json.or(forms.first().filter(|_| target != Target::Stdout)),
            Extension::Missing => None,
        };
        match form {
            Some(form) => Ok(Self { flag: flag.name, artifact, form, target }),
            None => {
                let extensions: Vec<String> = forms.iter().map(|form| format!(".{}", form.extension())).collect();
                Err(format!("the name must end in {}", extensions.join(" or ")))
            }
        }
    }

    /// Whether this is made of something.
    pub fn needs(&self, need: Need) -> bool {
        self.artifact.needs.contains(&need)
    }

    /// Where the labels of an iteration go, beside these: `out.npy` becomes `out.iteration-6.npy`. None on standard
    /// output.
    pub fn of_iteration(&self, iteration: u32) -> Option<Self> {
        let Target::File(path) = &self.target else { return None };
        let mut name = path.file_stem()?.to_owned();
        name.push(format!(".iteration-{iteration}."));
        name.push(path.extension()?);
        Some(Self { flag: "--snapshots", target: Target::File(path.with_file_name(name)), ..self.clone() })
    }

    /// Flag and place.
    pub fn place(&self) -> Output<'_> {
        (self.flag, &self.target)
    }

    /// Writes the output of what `input` became.
    pub fn write(&self, content: &Content<'_>, input: &Source) -> Result<(), Failure> {
        self.target.write((self.form.encode)(content).map_err(Failure::about(input))?)
    }
}

impl Outputs {
    /// Refuses flags that contradict each other.
    pub fn check(&self, command: &'static str) -> Result<(), Failure> {
        let limits = self.limits();
        limits.check().map_err(|error| Failure::Usage(command, error.message))?;
        if limits.are_given() && !self.includes(&HIERARCHY_JSON) {
            let message = "--min-clusters and --max-clusters go with --hierarchy OUT.json";
            return Err(Failure::Usage(command, message.to_owned()));
        }
        Ok(())
    }

    /// What is written, in the order of the table.
    pub fn files(&self) -> &[OutputFile] {
        &self.files.0
    }

    /// Whether something is written in this form.
    pub fn includes(&self, form: &Form) -> bool {
        self.files().iter().any(|file| file.form.file == form.file)
    }

    /// The first output that is made of something.
    pub fn that_needs(&self, need: Need) -> Option<&OutputFile> {
        self.files().iter().find(|file| file.needs(need))
    }

    /// Every flag and place.
    pub fn places(&self) -> Vec<Output<'_>> {
        self.files().iter().map(OutputFile::place).collect()
    }

    /// Whether something goes to standard output.
    pub fn use_stdout(&self) -> bool {
        self.files().iter().any(|file| file.target == Target::Stdout)
    }

    /// Which part of a hierarchy is written as JSON.
    pub fn limits(&self) -> Limits {
        Limits { min_clusters: self.min_clusters, max_clusters: self.max_clusters }
    }
}

/// Refuses two outputs in one place, outputs in the place of inputs (named by what they are), and places that cannot be
/// written.
pub fn check_places(
    command: &'static str,
    inputs: &[(&'static str, Source)],
    outputs: &[Output<'_>],
) -> Result<(), Failure> {
    let inputs: Vec<_> = inputs.iter().map(|(what, source)| (*what, source)).collect();
    places::check(&inputs, outputs).map_err(|message| Failure::Usage(command, message))?;
    for (_, target) in outputs {
        target.check()?;
    }
    Ok(())
}
