//! The files that results go to: labels and hierarchies, for every command that has them.

use std::path::PathBuf;

use super::Failure;
use super::files::{Extension, Source, Target, path_parser};
use super::places::{self, Output};
use crate::hierarchy::json::Limits;
use crate::hierarchy::stored::Stored;
use crate::output::LabelFormat;

/// Where and how labels are written.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct LabelFile {
    /// Where.
    pub target: Target,
    /// How.
    pub format: LabelFormat,
}

impl LabelFile {
    /// Takes a file name, whose extension says the format, or `-`.
    pub fn parse(path: PathBuf) -> Result<Self, String> {
        let target = Target::from(path);
        let format = match target.extension() {
            Extension::None => Some(LabelFormat::Json),
            Extension::Is(extension) => {
                LabelFormat::ALL.into_iter().find(|format| extension.eq_ignore_ascii_case(format.extension()))
            }
            Extension::Missing => None,
        };
        match format {
            Some(format) => Ok(Self { target, format }),
            None => Err(format!(
                "the name must end in {}",
                LabelFormat::ALL.map(|format| format!(".{}", format.extension())).join(", ")
            )),
        }
    }
}

impl LabelFile {
    /// Where the labels of an iteration go, beside these: `out.npy` becomes `out.iteration-6.npy`. None on standard
    /// output.
    pub fn of_iteration(&self, iteration: u32) -> Option<Self> {
        let Target::File(path) = &self.target else { return None };
        let mut name = path.file_stem()?.to_owned();
        name.push(format!(".iteration-{iteration}."));
        name.push(path.extension()?);
        Some(Self { target: Target::File(path.with_file_name(name)), format: self.format })
    }
}

/// Where hierarchies are written.
#[derive(Debug, clap::Args)]
pub struct TreeFiles {
    /// Where to write the hierarchy: OUT.tsr, from which `tesserae cut` takes labels, OUT.json, or - for JSON on
    /// standard output
    #[arg(long, value_name = "OUT", value_parser = path_parser(TreeFile::parse))]
    pub hierarchy: Option<TreeFile>,

    /// Where to write scipy's linkage matrix of a nested tree with one root: OUT.npy
    #[arg(long, value_name = "OUT.npy", value_parser = path_parser(linkage_file))]
    pub linkage: Option<Target>,

    /// JSON hierarchies: leave out what comes after fewer clusters than this are left
    #[arg(long, value_name = "K")]
    pub min_clusters: Option<u64>,

    /// JSON hierarchies: leave out what comes before as few clusters as this are left
    #[arg(long, value_name = "K")]
    pub max_clusters: Option<u64>,
}

impl TreeFiles {
    /// Refuses flags that contradict each other.
    pub fn check(&self, command: &'static str) -> Result<(), Failure> {
        let limits = self.limits();
        limits.check().map_err(|error| Failure::Usage(command, error.message))?;
        let is_json = self.hierarchy.as_ref().is_some_and(|file| file.format == TreeFormat::Json);
        if limits.are_given() && !is_json {
            let message = "--min-clusters and --max-clusters go with --hierarchy OUT.json";
            return Err(Failure::Usage(command, message.to_owned()));
        }
        Ok(())
    }

    /// The name of the first flag that was given.
    pub fn first(&self) -> Option<&'static str> {
        self.targets().map(|(name, _)| name).next()
    }

    /// Everything that is written, by flag.
    pub fn targets(&self) -> impl Iterator<Item = (&'static str, &Target)> {
        let hierarchy = self.hierarchy.iter().map(|file| ("--hierarchy", &file.target));
        hierarchy.chain(self.linkage.iter().map(|target| ("--linkage", target)))
    }

    /// Writes all outputs of the command; `input` is the source of the mesh.
    pub fn write(&self, stored: &Stored, input: &Source) -> Result<(), Failure> {
        if let Some(file) = &self.hierarchy {
            file.target.write(|out| match file.format {
                TreeFormat::Stored => stored.write(out),
                TreeFormat::Json => stored.write_json(out, self.limits()),
            })?;
        }
        if let Some(target) = &self.linkage {
            let linkage = stored.linkage().map_err(Failure::about(input))?;
            target.write(|out| linkage.write_npy(out))?;
        }
        Ok(())
    }

    fn limits(&self) -> Limits {
        Limits { min_clusters: self.min_clusters, max_clusters: self.max_clusters }
    }
}

/// Where and how a hierarchy is written.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct TreeFile {
    target: Target,
    format: TreeFormat,
}

/// Forms of hierarchies.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum TreeFormat {
    /// `.tsr`.
    Stored,
    /// `.json`.
    Json,
}

impl TreeFile {
    fn parse(path: PathBuf) -> Result<Self, String> {
        let target = Target::from(path);
        let format = match target.extension() {
            Extension::None => TreeFormat::Json,
            Extension::Is(extension) if extension.eq_ignore_ascii_case("tsr") => TreeFormat::Stored,
            Extension::Is(extension) if extension.eq_ignore_ascii_case("json") => TreeFormat::Json,
            Extension::Is(_) | Extension::Missing => return Err("the name must end in .tsr or .json".to_owned()),
        };
        Ok(Self { target, format })
    }
}

fn linkage_file(path: PathBuf) -> Result<Target, String> {
    let target = Target::from(path);
    let is_npy = match target.extension() {
        Extension::Is(extension) => extension.eq_ignore_ascii_case("npy"),
        Extension::None => target != Target::Stdout,
        Extension::Missing => false,
    };
    if is_npy { Ok(target) } else { Err("the name must end in .npy".to_owned()) }
}

/// Refuses two results in one place, results in the place of inputs (named by what they are), and places that cannot be
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
