//! The files that outputs go to: the flags of the [table](tesserae_mesh::artifacts::ALL), for every command that has
//! outputs.

use std::ffi::OsStr;
use std::fmt::Debug;
use std::marker::PhantomData;
use std::path::PathBuf;

use clap::{Arg, ArgAction, ArgMatches, Command};
use tesserae_mesh::artifacts::{ALL, Artifact, Choice, Choices, Content, Flag, Form, HIERARCHY_JSON, LABELS, Need};
use tesserae_mesh::hierarchy::json::Limits;
use tesserae_mesh::parameters::heading;
use tesserae_mesh::remesh::Placement;

use super::by_extension::{self, FLAG, Named};
use super::files::{Extension, Source, Target, path_parser};
use super::places::{self, Output};
use super::{Failure, patterns};

/// Where outputs go, of a command whose outputs may be hierarchies.
#[derive(Debug, clap::Args)]
pub struct Outputs<W: Writes> {
    #[command(flatten)]
    files: OutputFiles<W>,

    /// JSON hierarchies: leave out what comes after fewer clusters than this are left
    #[arg(long, value_name = "K", help_heading = heading::HIERARCHIES, hide_short_help = true)]
    min_clusters: Option<u64>,

    /// JSON hierarchies: leave out what comes before as few clusters as this are left
    #[arg(long, value_name = "K", help_heading = heading::HIERARCHIES, hide_short_help = true)]
    max_clusters: Option<u64>,
}

/// Which outputs a command has flags for.
pub trait Writes: Debug + Send + Sync + 'static {
    /// Whether `-o` takes folders, for several meshes.
    const TAKES_FOLDERS: bool = false;

    /// Whether it has those of an output.
    fn writes(artifact: &Artifact) -> bool;
}

/// A command that reads and clusters a mesh has all outputs.
#[derive(Debug)]
pub struct OfJob;

/// A command that reads a hierarchy has those that need no mesh.
#[derive(Debug)]
pub struct OfHierarchy;

/// A command that reads a mesh and labels has those that are made of both.
#[derive(Debug)]
pub struct OfMesh;

impl Writes for OfJob {
    const TAKES_FOLDERS: bool = true;

    fn writes(_: &Artifact) -> bool {
        true
    }
}

impl Writes for OfHierarchy {
    fn writes(artifact: &Artifact) -> bool {
        artifact.is_made_of_hierarchy()
    }
}

impl Writes for OfMesh {
    fn writes(artifact: &Artifact) -> bool {
        artifact.needs(Need::Mesh)
    }
}

/// The requested outputs: those of flags in the order of the table, then those of `-o`.
#[derive(Debug)]
pub struct OutputFiles<W> {
    files: Vec<OutputFile>,
    /// Folders for labels, report and hierarchy.
    folders: Vec<PathBuf>,
    of: PhantomData<W>,
}

/// Flags of what outputs may choose.
#[derive(Debug, clap::Args)]
pub struct ChoiceFlags {
    /// Where the vertices of the remesh are placed
    #[arg(long, value_enum, help_heading = heading::REMESH, hide_short_help = true)]
    placement: Option<Placement>,

    /// Colour the vertices of OUT.ply instead of its faces, for readers that know no colours of faces, such as Blender:
    /// vertices are split where clusters meet
    #[arg(long, help_heading = heading::OUTPUTS, hide_short_help = true)]
    ply_vertex_colours: bool,

    /// Write submeshes as OUT.glb although they are more than readers load within seconds
    #[arg(long, help_heading = heading::OUTPUTS, hide_short_help = true)]
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
        let mut files: Vec<OutputFile> = flags.filter_map(|(_, flag)| matches.get_one(flag.long()).cloned()).collect();
        let mut folders = Vec::new();
        for named in matches.get_many::<Named>(OUTPUT).into_iter().flatten().cloned() {
            match named {
                Named::File(artifact, form, target) => files.push(OutputFile { flag: FLAG, artifact, form, target }),
                Named::Folder(folder) => folders.push(folder),
            }
        }
        Ok(Self { files, folders, of: PhantomData })
    }

    fn update_from_arg_matches(&mut self, matches: &ArgMatches) -> Result<(), clap::Error> {
        *self = Self::from_arg_matches(matches)?;
        Ok(())
    }
}

impl<W: Writes> clap::Args for OutputFiles<W> {
    fn augment_args(command: Command) -> Command {
        let parser = path_parser(|path| by_extension::parse(path, W::writes, W::TAKES_FOLDERS));
        let help = match W::TAKES_FOLDERS {
            true => {
                "Where to write; the extension says what: labels (.npy, .txt, .csv), the mesh with its clusters in \
                 colour (.glb, .ply, .obj, .vtp), a hierarchy (.tsr), the report (.json); or a folder, DIR/, for \
                 labels, report and hierarchy of each mesh"
            }
            false => "Where to write; the extension says what, where only one output has it",
        };
        let output = Arg::new(OUTPUT).short('o').long(OUTPUT).value_name("OUT").action(ArgAction::Append);
        let command = command.arg(output.help(help).help_heading(heading::OUTPUTS).value_parser(parser));
        flags().filter(|(artifact, _)| W::writes(artifact)).fold(command, |command, (artifact, flag)| {
            let parser = path_parser(move |path| OutputFile::parse(artifact, flag, path));
            let argument = Arg::new(flag.long()).long(flag.long()).value_name(flag.value).help(flag.help);
            let argument = argument.help_heading(heading::OUTPUTS).hide_short_help(!SHORT_HELP.contains(&flag.name));
            command.arg(argument.value_parser(parser))
        })
    }

    fn augment_args_for_update(command: Command) -> Command {
        Self::augment_args(command)
    }
}

/// The long name of `-o`.
const OUTPUT: &str = "output";

/// Flags that the short help has.
const SHORT_HELP: [&str; 3] = ["--remesh", "--hierarchy", "--report"];

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
            None if matches!(&target, Target::File(path) if path.is_dir()) => {
                let forms = forms.first().map_or("", |form| form.extension());
                Err(format!("it is a folder: give the name of a file in it, as {{name}}.{forms}"))
            }
            None => {
                let extensions: Vec<String> = forms.iter().map(|form| format!(".{}", form.extension())).collect();
                Err(format!("the name must end in {}", extensions.join(" or ")))
            }
        }
    }

    /// The flag, with the place if it is `-o`, which may be there several times.
    pub fn named(&self) -> String {
        if self.flag == FLAG { format!("{FLAG} {}", self.target) } else { self.flag.to_owned() }
    }

    /// Whether labels are written.
    pub fn is_labels(&self) -> bool {
        self.artifact.name == LABELS.name
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

    /// The same for a mesh of this name and this number of clusters, if there is one: with both in place of their
    /// patterns.
    pub fn filled(&self, name: &OsStr, clusters: Option<u64>) -> Self {
        let target = match &self.target {
            Target::Stdout => Target::Stdout,
            Target::File(path) => Target::File(patterns::filled(path, name, clusters)),
        };
        Self { target, ..self.clone() }
    }

    /// Whether its name has a pattern.
    pub fn has_pattern(&self, pattern: &str) -> bool {
        matches!(&self.target, Target::File(path) if patterns::has(path, pattern))
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
        &self.files
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

    /// Whether nothing is written.
    pub fn are_none(&self) -> bool {
        self.files().is_empty() && self.folders().is_empty()
    }

    /// Folders for labels, report and hierarchy.
    pub fn folders(&self) -> &[PathBuf] {
        &self.files.folders
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
