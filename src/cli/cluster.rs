//! `tesserae cluster`: one mesh file, clustered in this process.

use std::io::Write;
use std::path::PathBuf;
use std::time::Instant;

use super::device::DeviceArguments;
use super::files::{self, Source, Target};
use super::places::{self, Kept, Output};
use super::progress::Progress;
use super::{Failure, say, signals};
use crate::device::Cancel;
use crate::job::{self, Outcome, Request, milliseconds};
use crate::mesh::{Beside, Format, Limits, NoResources, Resources};
use crate::output::{LabelFormat, write_labels};
use crate::parameters::{Parameters, Seeds};
use crate::report::Report;

/// Arguments of `tesserae cluster`.
#[derive(Debug, clap::Args)]
#[command(after_help = "\
Labels are one number from 0 to K - 1 a face, in the order of the file.

Examples:
  tesserae cluster horse.obj --clusters 2000 --labels horse.npy --report horse.json
  tesserae cluster horse.obj -k 2000 --device gpu --seeds random --seed 7 --labels horse.bin
  gunzip -c dragon.glb.gz | tesserae cluster - -k 5000 --labels - > dragon.labels.json")]
pub struct Arguments {
    /// The mesh: .obj, .glb or .gltf, or - for standard input
    #[arg(value_name = "INPUT")]
    input: PathBuf,

    /// Format of the mesh: obj, glb or gltf; by file name, then by content when left out
    #[arg(long, value_name = "FORMAT", value_parser = Format::from_name)]
    format: Option<Format>,

    #[command(flatten)]
    parameters: Parameters,

    #[command(flatten)]
    device: DeviceArguments,

    /// Where to write the labels: OUT.npy, OUT.json, OUT.bin (u32, little-endian), or - for JSON on standard output
    #[arg(long, value_name = "OUT", value_parser = LabelFile::parse)]
    labels: Option<LabelFile>,

    /// Where to write the report (JSON): a file, or - for standard output
    #[arg(long, value_name = "OUT.json")]
    report: Option<PathBuf>,

    /// Largest number of faces that is accepted
    #[arg(long, env = "TESSERAE_MAX_FACES", value_name = "N", default_value_t = Limits::default().max_faces)]
    max_faces: u64,

    /// Largest number of bytes that is accepted, the mesh and its buffers together
    #[arg(long, env = "TESSERAE_MAX_UPLOAD_BYTES", value_name = "BYTES", default_value_t = Limits::default().max_bytes)]
    max_upload_bytes: u64,
}

/// Where and how labels are written.
#[derive(Debug, Clone, PartialEq, Eq)]
struct LabelFile {
    target: Target,
    format: LabelFormat,
}

impl LabelFile {
    fn parse(text: &str) -> Result<Self, String> {
        let target = Target::from(PathBuf::from(text));
        let format = match &target {
            Target::Stdout => Some(LabelFormat::Json),
            Target::File(path) => path.extension().and_then(|extension| {
                LabelFormat::ALL.into_iter().find(|format| extension.eq_ignore_ascii_case(format.extension()))
            }),
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

/// Reads, clusters, writes, and says in one line what came out.
pub fn run(arguments: &Arguments) -> Result<(), Failure> {
    let begin = Instant::now();
    let report_target = arguments.report.clone().map(Target::from);
    let outputs = outputs(arguments, report_target.as_ref());
    check(arguments, &outputs)?;

    let mut progress = Progress::new(arguments.parameters.max_iterations);
    let mut outcome = cluster(arguments, &outputs, &mut progress)?;

    progress.stage("writing");
    let writing = Instant::now();
    if let Some(labels) = &arguments.labels {
        let clusters = outcome.report.clusters;
        labels.target.write(|out| write_labels(out, labels.format, clusters, &outcome.labels))?;
    }
    outcome.report.timings_ms.write = milliseconds(writing.elapsed());
    outcome.report.timings_ms.total = milliseconds(begin.elapsed());
    if let Some(target) = &report_target {
        target.write(|out| {
            serde_json::to_writer_pretty(&mut *out, &outcome.report)?;
            out.write_all(b"\n")
        })?;
    }
    progress.finish();

    for warning in &outcome.report.warnings {
        say(&format!("warning: {warning}"));
    }
    let summary = summary(&outcome.report);
    if outputs.iter().any(|(_, target)| **target == Target::Stdout) {
        say(&summary);
        Ok(())
    } else {
        writeln!(std::io::stdout(), "{summary}").map_err(Failure::stdout)
    }
}

/// Refuses what needs no mesh to be refused.
fn check(arguments: &Arguments, outputs: &[Output<'_>]) -> Result<(), Failure> {
    let listed = matches!(arguments.parameters.seeds, Seeds::File(_));
    arguments.parameters.check(listed).map_err(|error| Failure::Usage("cluster", error.message))?;
    if let Some(message) = arguments.device.contradiction() {
        return Err(Failure::Usage("cluster", message));
    }
    let mut inputs = vec![("the mesh", Source::from(arguments.input.clone()))];
    if let Seeds::File(path) = &arguments.parameters.seeds {
        inputs.push(("the list of seeds", Source::from(path.clone())));
    }
    let inputs: Vec<_> = inputs.iter().map(|(what, source)| (*what, source)).collect();
    places::check(&inputs, outputs).map_err(|message| Failure::Usage("cluster", message))?;
    for (_, target) in outputs {
        target.check()?;
    }
    Ok(())
}

/// Where results go.
fn outputs<'a>(arguments: &'a Arguments, report: Option<&'a Target>) -> Vec<Output<'a>> {
    let labels = arguments.labels.as_ref().map(|labels| ("labels", &labels.target));
    labels.into_iter().chain(report.map(|target| ("report", target))).collect()
}

/// From the input to labels and report.
fn cluster(arguments: &Arguments, outputs: &[Output<'_>], progress: &mut Progress) -> Result<Outcome, Failure> {
    let limits = Limits { max_bytes: arguments.max_upload_bytes, max_faces: arguments.max_faces };
    progress.stage("reading");
    let reading = Instant::now();
    let input = Source::from(arguments.input.clone());
    let bytes = input.read(limits.max_bytes)?;
    limits.check_bytes(bytes.len() as u64)?;
    let seeds = match &arguments.parameters.seeds {
        Seeds::File(path) => Some(Source::from(path.clone()).read(limits.max_bytes)?),
        Seeds::Morton | Seeds::Random | Seeds::Listed => None,
    };
    let read = milliseconds(reading.elapsed());

    let name = match &input {
        Source::Stdin => None,
        Source::File(path) => path.to_str(),
    };
    let format = match arguments.format {
        Some(format) => format,
        None => Format::recognise(name, &bytes)?,
    };
    let resources: Box<dyn Resources> = match &input {
        Source::Stdin => Box::new(NoResources),
        Source::File(path) => Box::new(Kept { beside: Beside { folder: files::folder(path).to_owned() }, outputs }),
    };

    // Until here there is nothing to end in order, and a read that waits for input could not be told to stop.
    let cancel = Cancel::default();
    signals::cancel_when_asked(cancel.clone());
    progress.stage("preparing");
    let mut prepared = job::prepare(&Request {
        bytes: &bytes,
        format,
        resources: &*resources,
        limits,
        parameters: &arguments.parameters,
        seeds: seeds.as_deref(),
    })?;
    prepared.timings.read = read;
    drop(bytes);
    cancel.check()?;
    let mut device = arguments.device.open(Some(prepared.input.faces))?;
    progress.stage("clustering");
    Ok(job::run(&prepared, device.as_mut(), &cancel, &mut |row| {
        progress.iteration(row);
    })?)
}

/// What came out, in one line.
fn summary(report: &Report) -> String {
    let energy = report.energy.final_.map_or("unknown".into(), |energy| format!("{energy:.9e}"));
    let ratio = report.energy.hexagon_ratio.map_or("none".into(), |ratio| format!("{ratio:.4}"));
    format!(
        "{} faces, {} clusters, energy {energy}, hexagon ratio {ratio}, {} iterations, {:.3} s on {}",
        report.input.faces,
        report.clusters,
        report.iterations.last().map_or(0, |row| row.iteration),
        report.timings_ms.total / 1000.0,
        report.device.name,
    )
}
