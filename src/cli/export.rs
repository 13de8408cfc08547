//! `tesserae export`: what is made of a mesh and labels, which may come from anywhere.

use std::path::PathBuf;
use std::sync::OnceLock;

use tesserae_mesh::artifacts::{Choices, Content, Labels};
use tesserae_mesh::error::Error;
use tesserae_mesh::hierarchy::stored;
use tesserae_mesh::job::parse_labels;
use tesserae_mesh::mesh::{self, PolygonMesh};

use super::files::Source;
use super::inputs::{LimitFlags, MeshFile, OneMesh};
use super::results::{ChoiceFlags, OfMesh, OutputFiles, check_places, places, use_stdout};
use super::summary::{clusters_of, count};
use super::{Failure, Quiet, print_line, say, signals};

/// Arguments of `tesserae export`.
#[derive(Debug, clap::Args)]
#[command(after_help = "\
Labels are one whole number a face, in the order of the file; cluster 7 has the faces with label 7.

Examples:
  tesserae export horse.obj --labels horse.npy -o horse-clusters.glb
  tesserae export horse.obj --hierarchy horse.tsr -k 750 -o horse.zip")]
pub struct Arguments {
    #[command(flatten)]
    mesh: OneMesh,

    /// The labels: a .npy file with one whole number a face, or - for standard input
    #[arg(long, value_name = "IN.npy", required_unless_present = "hierarchy")]
    labels: Option<PathBuf>,

    /// A hierarchy of the mesh, which is cut at --clusters, or - for standard input
    #[arg(long, value_name = "IN.tsr", conflicts_with = "labels", requires = "clusters")]
    hierarchy: Option<PathBuf>,

    /// Number of clusters that the hierarchy is cut at
    #[arg(long, short = 'k', value_name = "K", requires = "hierarchy", conflicts_with = "labels")]
    clusters: Option<u64>,

    #[command(flatten)]
    outputs: OutputFiles<OfMesh>,

    #[command(flatten)]
    choices: ChoiceFlags,

    #[command(flatten)]
    limits: LimitFlags,

    #[command(flatten)]
    quiet: Quiet,
}

/// Reads, writes, and says in one line what there was.
pub fn run(arguments: &Arguments) -> Result<(), Failure> {
    let choices = check(arguments)?;
    signals::cancel_when_asked();
    let file = arguments.mesh.file();
    let input = &file.source;
    let mesh = read_mesh(arguments, &file)?;
    let (labels, clusters) = read_labels(arguments, mesh.faces.len())?;
    let labels = Labels::new(clusters, &labels);
    let remesh = OnceLock::new();
    let content =
        Content { labels: Some(labels), mesh: Some(&mesh), choices, remesh: Some(&remesh), ..Content::default() };
    arguments.outputs.iter().try_for_each(|file| file.write(&content, input))?;
    if arguments.quiet.quiet {
        return Ok(());
    }
    let summary = clusters_of(clusters, &format!("{} faces", count(mesh.faces.len() as u64)));
    if use_stdout(&arguments.outputs) {
        say(&summary);
        Ok(())
    } else {
        print_line(&summary)
    }
}

/// Where the labels come from, after what it is.
fn labels_source(arguments: &Arguments) -> (&'static str, Source) {
    let path = arguments.labels.as_ref().or(arguments.hierarchy.as_ref());
    let what = if arguments.labels.is_some() { "the labels" } else { "the hierarchy" };
    (what, Source::from(path.cloned().unwrap_or_default()))
}

/// Refuses what needs no mesh to be refused.
fn check(arguments: &Arguments) -> Result<Choices, Failure> {
    let usage = |message: &str| Err(Failure::Usage("export", message.to_owned()));
    if arguments.outputs.is_empty() {
        return usage("no output is named: give -o OUT.glb, --mesh, --submeshes or another output");
    }
    let choices = arguments.choices.choices("export", &arguments.outputs)?;
    let (what, labels) = labels_source(arguments);
    let input = arguments.mesh.file().source;
    if input == Source::Stdin && labels == Source::Stdin {
        return usage("mesh and labels cannot both come from standard input");
    }
    check_places("export", &[("the mesh", input), (what, labels)], &places(&arguments.outputs))?;
    Ok(choices)
}

fn read_mesh(arguments: &Arguments, file: &MeshFile) -> Result<PolygonMesh, Failure> {
    let limits = arguments.limits.limits();
    let (bytes, format) = file.read_mesh(&limits)?;
    let outputs = places(&arguments.outputs);
    let resources = file.resources(&outputs);
    mesh::read(&bytes, format, &*resources, &limits).map_err(Failure::about(&file.source))
}

/// The labels of the faces, and the number of clusters.
fn read_labels(arguments: &Arguments, faces: usize) -> Result<(Vec<u32>, u64), Failure> {
    let (_, source) = labels_source(arguments);
    let about_labels = || Failure::about(&source);
    match arguments.clusters {
        None => {
            // a header, and eight bytes a label
            let most = arguments.limits.max_faces.saturating_mul(8).saturating_add(1 << 16);
            parse_labels(&source.read(most)?, faces).map_err(about_labels())
        }
        Some(clusters) => {
            let (file, length) = source.open()?;
            let (_, cut) = stored::cut(file, length, arguments.limits.max_faces, clusters).map_err(about_labels())?;
            if cut.labels.len() != faces {
                let message = format!("the mesh has {faces} faces, the hierarchy is of another: {}", cut.labels.len());
                return Err(about_labels()(Error::parameter(message)));
            }
            Ok((cut.labels, clusters))
        }
    }
}
