//! `tesserae cluster`: one mesh file, clustered in this process.

use std::path::PathBuf;
use std::sync::OnceLock;
use std::time::Instant;

use super::device::DeviceArguments;
use super::files::{Source, Target};
use super::mesh_file::MeshFile;
use super::progress::Progress;
use super::results::{ChoiceFlags, OfJob, OutputFile, Outputs, check_places};
use super::{Failure, complain, print_line, say, signals};
use crate::artifacts::{Artifact, Choices, Content, LABELS, LINKAGE_NPY, Labels, Need};
use crate::error::{Error, Kind};
use crate::hierarchy::linkage::no_single_root;
use crate::job::{self, InputFile, Outcome, Plan, Request, milliseconds};
use crate::mesh::Limits;
use crate::parameters::{Parameters, Seeds};
use crate::report::Report;

/// Arguments of `tesserae cluster`.
#[derive(Debug, clap::Args)]
#[command(after_help = "\
Labels are one number from 0 to K - 1 a face, in the order of the file. Hierarchies (pml, ml, hr) may leave --clusters
out: they go to the top, and `tesserae cut` takes labels at any number of clusters from the hierarchy.

A regular file is replaced as a whole. Named pipes, /dev/fd/N and devices are opened once, when the result is there, and
get JSON unless their name says otherwise.

Examples:
  tesserae cluster horse.obj --clusters 2000 --labels horse.npy --report horse.json
  tesserae cluster horse.obj -k 2000 --mesh horse.glb
  tesserae cluster horse.obj -k 2000 --device gpu --seeds random --seed 7 --labels horse.bin
  tesserae cluster horse.obj --algorithm pml --hierarchy horse.tsr --levels 2000,1000 --report horse.json
  tesserae cluster horse.obj --algorithm hr --linkage horse.npy
  tesserae cluster horse.obj -k 2000 --curvature-exponent 2 --labels horse.npy
  tesserae cluster horse.obj -k 2000 --snapshots 0,6,46 --labels horse.npy    (and horse.iteration-0.npy, …)
  gunzip -c dragon.glb.gz | tesserae cluster - -k 5000 --labels - > dragon.labels.json")]
pub struct Arguments {
    #[command(flatten)]
    mesh: MeshFile,

    #[command(flatten)]
    parameters: Parameters,

    /// Multiply the area of each face by a weight, so that clusters are smaller where it is larger: a .npy file with
    /// floats above 0, one a face or one a vertex (whose mean a face takes)
    #[arg(long, value_name = "IN.npy", conflicts_with_all = ["weight_attribute", "subdivide"])]
    weights: Option<PathBuf>,

    #[command(flatten)]
    device: DeviceArguments,

    #[command(flatten)]
    outputs: Outputs<OfJob>,

    #[command(flatten)]
    choices: ChoiceFlags,

    /// Largest number of faces that is accepted
    #[arg(long, env = "TESSERAE_MAX_FACES", value_name = "N", default_value_t = Limits::default().max_faces)]
    max_faces: u64,

    /// Largest number of faces that is accepted for each byte of the mesh and its buffers, beyond the first 524,288:
    /// faces are more than bytes where instances or nodes place a mesh many times. Without it, only --max-faces counts
    #[arg(long, env = "TESSERAE_MAX_FACES_PER_BYTE", value_name = "N")]
    max_faces_per_byte: Option<u64>,

    /// Largest number of bytes that is accepted, the mesh and its buffers together
    #[arg(long, env = "TESSERAE_MAX_UPLOAD_BYTES", value_name = "BYTES", default_value_t = Limits::default().max_bytes)]
    max_upload_bytes: u64,
}

/// Reads, clusters, writes, and says in one line what came out.
pub fn run(arguments: &Arguments) -> Result<(), Failure> {
    let begin = Instant::now();
    let choices = check(arguments)?;

    let mut progress = Progress::new(arguments.parameters.max_iterations);
    let mut outcome = cluster(arguments, &mut progress)?;

    progress.stage("writing");
    let writing = Instant::now();
    let input = arguments.mesh.source();
    let (with_report, others): (Vec<&OutputFile>, Vec<&OutputFile>) =
        arguments.outputs.files().iter().partition(|file| file.needs(Need::Report));
    let remesh = OnceLock::new();
    let write = |files: &[&OutputFile], outcome: &Outcome| {
        let limits = arguments.outputs.limits();
        files.iter().try_for_each(|file| {
            file.write(
                &Content { limits, choices, is_indented: true, remesh: Some(&remesh), ..outcome.content() },
                &input,
            )
        })
    };
    write(&others, &outcome)?;
    write_iterations(arguments, &outcome, &input)?;
    outcome.report.remesh = remesh.get().map(|remesh| remesh.summary);
    outcome.report.timings_ms.write = milliseconds(writing.elapsed());
    outcome.report.timings_ms.total = milliseconds(begin.elapsed());
    write(&with_report, &outcome)?;
    progress.finish();

    for warning in &outcome.report.warnings {
        complain(&format!("{input}: warning: {warning}"));
    }
    let summary = summary(&outcome.report);
    if arguments.outputs.use_stdout() {
        say(&summary);
        Ok(())
    } else {
        print_line(&summary)
    }
}

/// Refuses what needs no mesh to be refused.
fn check(arguments: &Arguments) -> Result<Choices, Failure> {
    let usage = |message: String| Err(Failure::Usage("cluster", message));
    let (parameters, outputs) = (&arguments.parameters, &arguments.outputs);
    let listed = matches!(parameters.seeds, Seeds::File(_));
    parameters.check(listed).map_err(|error| Failure::Usage("cluster", error.message))?;
    if let Some(message) = arguments.device.contradiction() {
        return usage(message);
    }
    if parameters.algorithm.is_reference() && arguments.device.choice().wants_gpu() {
        let name = parameters.algorithm.name();
        return usage(format!(
            "the algorithm {name} is a sequential reference that no gpu runs: take --device cpu or auto"
        ));
    }
    outputs.check("cluster")?;
    let choices = arguments.choices.choices("cluster", outputs.files())?;
    if let Some(file) = outputs.that_needs(Need::Hierarchy).filter(|_| !Need::Hierarchy.is_met(parameters)) {
        let (flag, name) = (file.flag, parameters.algorithm.name());
        return usage(format!("{flag} goes with hierarchies (pml, ml, hr), not with the algorithm {name}"));
    }
    let has_file = labels(arguments).is_some_and(|file| file.target != Target::Stdout);
    if parameters.snapshots.is_some() && !has_file {
        return usage(
            "--snapshots needs --labels OUT, a file, beside which the labels of iterations are written, as \
             OUT.iteration-6.npy"
                .to_owned(),
        );
    }
    if outputs.that_needs(Need::Labels).is_some() && !Need::Labels.is_met(parameters) {
        return usage(
            "a whole hierarchy has labels at every number of clusters: give --clusters as well, or write the hierarchy \
             with --hierarchy OUT.tsr and take labels from it with `tesserae cut`"
                .to_owned(),
        );
    }
    if let Some(file) = outputs.that_needs(Need::Faces).filter(|_| !Need::Faces.is_met(parameters)) {
        let flag = file.flag;
        return usage(format!(
            "{flag} is about the faces of the mesh, which --subdivide divides: leave one of them out"
        ));
    }
    if outputs.includes(&LINKAGE_NPY) {
        if parameters.optimizes() {
            return usage("--linkage needs a nested tree, in which no face moves: add --optimize none".to_owned());
        }
        if parameters.clusters.is_some_and(|clusters| clusters > 1) {
            return usage("--linkage needs a whole tree: leave --clusters out".to_owned());
        }
    }
    check_places("cluster", &inputs(arguments), &outputs.places())?;
    Ok(choices)
}

/// Where everything comes from, after what it is.
fn inputs(arguments: &Arguments) -> Vec<(&'static str, Source)> {
    let mut inputs = vec![("the mesh", arguments.mesh.source())];
    if let Seeds::File(path) = &arguments.parameters.seeds {
        inputs.push(("the list of seeds", Source::from(path.clone())));
    }
    if let Some(path) = &arguments.weights {
        inputs.push(("the weights", Source::from(path.clone())));
    }
    inputs
}

/// Where the labels go.
fn labels(arguments: &Arguments) -> Option<&OutputFile> {
    arguments.outputs.files().iter().find(|file| file.artifact.name == LABELS.name)
}

/// Writes the labels of iterations beside those of the end.
fn write_iterations(arguments: &Arguments, outcome: &Outcome, input: &Source) -> Result<(), Failure> {
    let Some(labels) = labels(arguments) else { return Ok(()) };
    outcome.snapshots.replay(|iteration, labels_then| {
        let Some(file) = labels.of_iteration(iteration) else { return Ok(()) };
        let places = [arguments.outputs.places(), vec![file.place()]].concat();
        check_places("cluster", &inputs(arguments), &places)?;
        let labels = Labels::new(outcome.report.clusters, labels_then);
        file.write(&Content { labels: Some(labels), ..Content::default() }, input)
    })
}

/// From the input to labels and report.
fn cluster(arguments: &Arguments, progress: &mut Progress) -> Result<Outcome, Failure> {
    let limits = Limits {
        max_bytes: arguments.max_upload_bytes,
        max_faces: arguments.max_faces,
        max_faces_per_byte: arguments.max_faces_per_byte,
    };
    progress.stage("reading");
    let reading = Instant::now();
    let input = arguments.mesh.source();
    let bytes = input.read(limits.max_bytes)?;
    limits.check_bytes(bytes.len() as u64).map_err(Failure::about(&input))?;
    let seeds = match &arguments.parameters.seeds {
        Seeds::File(path) => Some(Source::from(path.clone())),
        Seeds::Coarse | Seeds::Morton | Seeds::Random | Seeds::Listed => None,
    };
    let weights = arguments.weights.clone().map(Source::from);
    let content = |source: &Option<Source>| source.as_ref().map(|source| source.read(limits.max_bytes)).transpose();
    let (seed_bytes, weight_bytes) = (content(&seeds)?, content(&weights)?);
    let read = milliseconds(reading.elapsed());

    let format = arguments.mesh.format(&bytes)?;
    let places = arguments.outputs.places();
    let resources = arguments.mesh.resources(&places);

    // Until here there is nothing to end in order, and a read that waits for input could not be told to stop.
    let cancel = signals::cancel_when_asked();
    progress.stage("preparing");
    let outputs: Vec<&Artifact> = arguments.outputs.files().iter().map(|file| file.artifact).collect();
    let request = Request {
        bytes: &bytes,
        format,
        resources: &*resources,
        limits,
        parameters: &arguments.parameters,
        seeds: seed_bytes.as_deref(),
        weights: weight_bytes.as_deref(),
        outputs: &outputs,
    };
    // ends with its thread joined: a process must not end while a driver is being opened
    let (prepared, ahead) = std::thread::scope(|scope| {
        let ahead = scope.spawn(|| arguments.device.choice().open_ahead(bytes.len()));
        (job::prepare_naming_files(&request), ahead.join().ok().flatten())
    });
    let mut prepared = prepared.map_err(|refusal| {
        let file = match refusal.file {
            Some(InputFile::Mesh) => Some(&input),
            Some(InputFile::Seeds) => seeds.as_ref(),
            Some(InputFile::Weights) => weights.as_ref(),
            None => None,
        };
        match file {
            Some(file) => Failure::about(file)(refusal.error),
            None => refusal.error.into(),
        }
    })?;
    prepared.timings.read = read;
    drop(bytes);
    cancel.check()?;
    if let Plan::Hierarchy { target, .. } = prepared.plan {
        if arguments.outputs.includes(&LINKAGE_NPY) && target > 1 {
            return Err(Failure::about(&input)(Error::new(Kind::Conflict, no_single_root(target))));
        }
        progress.hierarchy(prepared.input.faces, target);
    }
    progress.stage("clustering");
    Ok(job::run_on(arguments.device.choice(), ahead, &prepared, &cancel, &mut |row| progress.row(&row))?)
}

/// What came out, in one line.
fn summary(report: &Report) -> String {
    let energy = report.energy.final_.map_or("unknown".into(), |energy| format!("{energy:.9e}"));
    let ratio = report.energy.hexagon_ratio.map_or("none".into(), |ratio| format!("{ratio:.4}"));
    let steps = match report.levels.last() {
        Some(level) => format!("{} rounds", level.round),
        None => format!("{} iterations", report.iterations.last().map_or(0, |row| row.iteration)),
    };
    format!(
        "{} faces, {} clusters, energy {energy}, hexagon ratio {ratio}, {steps}, {:.3} s on {}",
        report.input.faces,
        report.clusters,
        report.timings_ms.total / 1000.0,
        report.device.name,
    )
}
