//! `tesserae cluster`: mesh files, clustered in this process, each read once for all numbers of clusters.

mod check;
mod files;
mod run;

use std::path::PathBuf;

use tesserae_mesh::mesh::Limits;
use tesserae_mesh::parameters::{Parameters, heading};

use self::run::Run;
use super::device::DeviceArguments;
use super::inputs::{LimitFlags, Meshes};
use super::progress::Progress;
use super::results::{ChoiceFlags, OfJob, Outputs};
use super::summary::{SummaryRow, table};
use super::{Failure, Quiet, complain, print_line, say};

/// Arguments of `tesserae cluster`.
#[derive(Debug, clap::Args)]
#[command(
    after_help = "\
Examples:
  tesserae cluster horse.obj -k 2000 -o horse.npy
  tesserae cluster horse.obj -k 2000 -o horse.glb
  tesserae cluster *.obj -k 500,2000 -o out/
  tesserae cluster horse.obj --algorithm pml --hierarchy horse.tsr
  tesserae cluster photo.png -k 250 -o superpixels.npy

--help lists all options.",
    after_long_help = "\
Labels are one number from 0 to K - 1 a face, in the order of the file. Hierarchies (pml, ml, hr) may leave \
--clusters out: they go to the top, and `tesserae cut` takes labels at any number of clusters from the hierarchy.

With several meshes, names of outputs have {name} in place of the name of the mesh, with several numbers of clusters \
{k}; -o DIR/ is DIR/{name}-{k}.npy and DIR/{name}-{k}.json. A mesh is read once. A hierarchy is made once: it is cut \
at each number.

A regular file is replaced as a whole. Named pipes, /dev/fd/N and devices are opened once, when the result is there, \
and get JSON unless their name says otherwise.

Examples:
  tesserae cluster horse.obj -k 2000 -o horse.npy -o horse.glb
  tesserae cluster horse.obj dragon.ply.gz -k 500,2000 -o {name}-{k}.csv
  tesserae cluster horse.obj -k 2000 --labels horse.npy --report horse.json
  tesserae cluster horse.obj -k 2000 --device gpu --seeds random -o horse.bin
  tesserae cluster horse.obj --algorithm pml --levels 2000,1000 -o horse.tsr
  tesserae cluster horse.obj --algorithm pml -k 2000,1000 -o horse-{k}.npy
  tesserae cluster horse.obj --algorithm hr --linkage horse.npy
  tesserae cluster horse.obj -k 2000 --curvature-exponent 2 --remesh horse.stl
  tesserae cluster horse.obj -k 2000 --snapshots 0,6,46 --labels horse.npy
  gunzip -c dragon.glb.gz | tesserae cluster - -k 5000 --labels - > dragon.json"
)]
pub struct Arguments {
    // headings of the help are in the order in which they come here first
    #[command(flatten)]
    meshes: Meshes,

    /// Number of clusters; of several, K1,K2,…, each gives a result
    ///
    /// It may be left out when seeds of a mesh or an array are listed, and for hierarchies, which then go to the top.
    #[arg(long, short = 'k', value_name = "K", value_delimiter = ',', allow_negative_numbers = true,
          help_heading = heading::CLUSTERS)]
    clusters: Vec<u64>,

    #[command(flatten)]
    outputs: Outputs<OfJob>,

    #[command(flatten)]
    choices: ChoiceFlags,

    #[command(flatten)]
    limits: LimitFlags,

    /// Largest number of faces that is accepted for each byte of the mesh and its buffers, beyond the first 524,288:
    /// faces are more than bytes where instances or nodes place a mesh many times. Without it, only --max-faces counts
    #[arg(long, env = "TESSERAE_MAX_FACES_PER_BYTE", value_name = "N", help_heading = heading::LIMITS,
          hide_short_help = true)]
    max_faces_per_byte: Option<u64>,

    #[command(flatten)]
    parameters: Parameters,

    /// Multiply the area of each face by a weight, so that clusters are smaller where it is larger: a .npy file with
    /// floats above 0, one a face or one a vertex (whose mean a face takes)
    #[arg(long, value_name = "IN.npy", conflicts_with_all = ["weight_attribute", "subdivide"],
          help_heading = heading::CLUSTERS, hide_short_help = true)]
    weights: Option<PathBuf>,

    #[command(flatten)]
    device: DeviceArguments,

    #[command(flatten)]
    quiet: Quiet,
}

impl Arguments {
    fn limits(&self) -> Limits {
        Limits { max_faces_per_byte: self.max_faces_per_byte, ..self.limits.limits() }
    }

    /// Whether one hierarchy is cut at several numbers of clusters.
    fn is_cut(&self) -> bool {
        self.parameters.algorithm.is_hierarchical() && self.clusters.len() > 1
    }

    /// The parameters of the first or only run on a mesh.
    fn first(&self) -> Parameters {
        let mut parameters = self.of_clusters(self.clusters.first().copied());
        if self.is_cut() {
            parameters.clusters = self.clusters.iter().min().copied();
            let others = self.clusters.iter().filter(|&&clusters| Some(clusters) != parameters.clusters);
            parameters.levels.get_or_insert_default().0.extend(others);
        }
        parameters
    }

    /// The parameters with this number of clusters.
    fn of_clusters(&self, clusters: Option<u64>) -> Parameters {
        Parameters { clusters, ..self.parameters.clone() }
    }
}

/// Reads, clusters, writes, and says what came out: one result in a line, several in a table. A mesh that fails among
/// several does not stop the others.
pub fn run(arguments: &Arguments) -> Result<(), Failure> {
    let choices = check::check(arguments)?;
    let meshes = arguments.meshes.files();
    let mut run = Run {
        arguments,
        choices,
        progress: Progress::new(arguments.parameters.max_iterations, arguments.quiet.quiet),
        rows: Vec::new(),
    };
    let mut some_failed = false;
    for mesh in &meshes {
        match run.mesh(mesh, meshes.len() > 1) {
            Err(Failure::Failed(error)) if meshes.len() > 1 => {
                run.progress.pause(|| complain(&error.message));
                some_failed = true;
            }
            outcome => outcome?,
        }
    }
    run.progress.finish();
    if !arguments.quiet.quiet {
        summarise(arguments, &run.rows)?;
    }
    if some_failed { Err(Failure::Said) } else { Ok(()) }
}

/// Writes what came out to standard output, or to standard error where a result goes to standard output.
fn summarise(arguments: &Arguments, rows: &[SummaryRow]) -> Result<(), Failure> {
    let is_single = arguments.clusters.len() < 2 && arguments.meshes.files().len() < 2;
    let mut lines = match rows {
        [row] if is_single => row.lines(),
        rows => table(rows),
    };
    if arguments.outputs.are_none() {
        lines.push(files::advice(arguments, rows));
    }
    match arguments.outputs.use_stdout() {
        true => lines.iter().for_each(|line| say(line)),
        false => lines.iter().try_for_each(|line| print_line(line))?,
    }
    Ok(())
}
