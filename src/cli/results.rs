//! The files that outputs go to: the flags of the [table](crate::artifacts::ALL), for every command that has outputs.

use std::fmt::Debug;
use std::marker::PhantomData;
use std::path::PathBuf;

use clap::{Arg, ArgMatches, Command};

use super::Failure;
use super::files::{Extension, Source, Target, path_parser};
use super::places::{self, Output};
use crate::artifacts::{ALL, Artifact, Choice, Choices, Content, Flag, Form, HIERARCHY_JSON, Need};
use crate::hierarchy::json::Limits;
use crate::remesh::Placement;

/// Where outputs go, of a command whose outputs may be hierarchies.
#[derive(Debug, clap::Args)]
pub struct Outputs<W: Writes> {
    #[command(flatten)]
    files: OutputFiles<W>,

    /// JSON hierarchies: leave out what comes after fewer clusters than this are left
    #[arg(long, value_name = "K")]
    min_clusters: Option<u64>,

    /// JSON hierarchies: leave out what comes before as few clusters as this are left
    #[arg(long, value_name = "K")]
    max_clusters: Option<u64>,
}

/// Which outputs a command has flags for.
pub trait Writes: Debug + Send + Sync + 'static {
    /// Whether it has those of an output.
    fn writes(artifact: &Artifact) -> bool;
}

/// A command that reads and clusters a mesh has all outputs.
#[derive(Debug)]
pub struct OfJob;

/// A command that reads a hierarchy has those that are not made of a mesh.
#[derive(Debug)]
pub struct OfHierarchy;

/// A command that reads a mesh and labels has those that are made of both.
#[derive(Debug)]
pub struct OfMesh;

impl Writes for OfJob {
    fn writes(_: &Artifact) -> bool {
        true
    }
}

impl Writes for OfHierarchy {
    fn writes(artifact: &Artifact) -> bool {
        !artifact.needs(Need::Mesh)
    }
}

impl Writes for OfMesh {
    fn writes(artifact: &Artifact) -> bool {
        artifact.needs(Need::Mesh)
    }
}

/// The requested outputs, in the order of the table.
#[derive(Debug)]
pub struct OutputFiles<W>(Vec<OutputFile>, PhantomData<W>);

/// Flags of what outputs may choose.
#[derive(Debug, clap::Args)]
pub struct ChoiceFlags {
    /// Where the vertices of the remesh are placed
    #[arg(long, value_enum)]
    placement: Option<Placement>,

    /// Colour the vertices of OUT.ply instead of its faces, for readers that know no colours of faces, such as Blender:
    /// vertices are split where clusters meet
    #[arg(long)]
    ply_vertex_colours: bool,

    /// Write submeshes as OUT.glb although they are more than readers load within seconds
    #[arg(long)]
    force: bool,
}

impl ChoiceFlags {
    /// What was chosen. Refuses what belongs to no requested output.
    pub fn choices(&self, command: &'static str, files: &[OutputFile]) -> Result<Choices, Failure> {
        let given = [
            (Choice::Placement, self.placement.is_some()),
            (Choice::PlyVertexColours, self.ply_vertex_colours),
            (Choice::Force, self.force),
        ];
        for (choice, _) in given.into_iter().filter(|(_, is_given)| *is_given) {
            if !files.iter().any(|file| file.artifact.choices.contains(&choice)) {
                let with = flags().filter(|(artifact, _)| artifact.choices.contains(&choice));
                let with: Vec<&str> = with.map(|(_, flag)| flag.name).collect();
                let message = format!("--{} goes with {}", choice.name().replace('_', "-"), with.join(" or "));
                return Err(Failure::Usage(command, message));
            }
        }
        let Self { placement, ply_vertex_colours, force } = *self;
        Ok(Choices { placement: placement.unwrap_or_default(), ply_vertex_colours, force, is_plain: false })
    }
}

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

impl<W: Writes> clap::FromArgMatches for OutputFiles<W> {
    fn from_arg_matches(matches: &ArgMatches) -> Result<Self, clap::Error> {
        let flags = flags().filter(|(artifact, _)| W::writes(artifact));
        Ok(Self(flags.filter_map(|(_, flag)| matches.get_one(flag.long()).cloned()).collect(), PhantomData))
    }

    fn update_from_arg_matches(&mut self, matches: &ArgMatches) -> Result<(), clap::Error> {
        *self = Self::from_arg_matches(matches)?;
        Ok(())
    }
}

impl<W: Writes> clap::Args for OutputFiles<W> {
    fn augment_args(command: Command) -> Command {
        flags().filter(|(artifact, _)| W::writes(artifact)).fold(command, |command, (artifact, flag)| {
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
            Extension::Is(_) => {
                forms.iter().filter(|form| target.ends_in(form.extension())).max_by_key(|form| form.extension().len())
            }
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
        self.artifact.needs(need)
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

impl<W> std::ops::Deref for OutputFiles<W> {
    type Target = [OutputFile];

    fn deref(&self) -> &[OutputFile] {
        &self.0
    }
}

/// Every flag and place.
pub fn places(files: &[OutputFile]) -> Vec<Output<'_>> {
    files.iter().map(OutputFile::place).collect()
}

/// Whether something goes to standard output.
pub fn use_stdout(files: &[OutputFile]) -> bool {
    files.iter().any(|file| file.target == Target::Stdout)
}

impl<W: Writes> Outputs<W> {
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
        &self.files
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
        places(self.files())
    }

    /// Whether something goes to standard output.
    pub fn use_stdout(&self) -> bool {
        use_stdout(self.files())
    }

    /// Which part of a hierarchy is written as JSON.
    pub fn limits(&self) -> Limits {
        Limits { min_clusters: self.min_clusters, max_clusters: self.max_clusters, clusters: None }
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
