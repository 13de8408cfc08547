//! `tesserae bench`: what a device takes for each stage of a job.

use std::path::{Path, PathBuf};

use tesserae_mesh::cluster::quality::Quality;
use tesserae_mesh::dev::bench::{self, Mesh, Plan, Work};
use tesserae_mesh::dev::sample::MAX_FACES;
use tesserae_mesh::device::Device;
use tesserae_mesh::device::cpu::CpuDevice;
use tesserae_mesh::device::select::{self, AdapterKind, DeviceChoice, Tuning};
use tesserae_mesh::parameters::Optimize;

use super::device::DeviceArguments;
use super::files::{Source, Target, path_parser};
use super::progress::Progress;
use super::results::check_places;
use super::{Failure, print, signals};

/// Faces of the samples on a gpu: as far as it holds them.
const ON_GPU: [u64; 5] = [100_000, 1_000_000, 4_000_000, 10_000_000, 28_000_000];

/// Faces of the samples on processors.
const ON_CPU: [u64; 2] = [100_000, 1_000_000];

/// Faces of the samples on a software gpu.
const ON_SOFTWARE: [u64; 1] = [20_000];

/// Largest sample of which a whole hierarchy is made.
const MOST_FOR_HIERARCHY: u64 = 1_000_000;

/// Arguments of `tesserae bench`.
#[derive(Debug, clap::Args)]
#[command(after_help = "\
Measures flat clusterings and whole hierarchies of samples of growing size, and of the meshes that are named: the \
time of reading, topology, transfers and clustering, the gpu's own times of its passes (timestamp queries), the \
dispatches of each kernel and the bytes that it reads and writes, and a pass over all faces (sums and lists from \
labels) beside the card's own copies. Labels of a gpu that differ from the cpu's are an error. Sizes that do not fit \
are reported as such. Needs no \
network and no other file.

Examples:
  tesserae bench --device gpu --markdown gpu.md --json gpu.json
  tesserae bench --device gpu --mesh bunny.glb:1000 --mesh horse.obj:2000
  tesserae bench --device cpu --faces 100000,1000000")]
pub struct Arguments {
    #[command(flatten)]
    device: DeviceArguments,

    /// Faces of the samples, about; by default as many sizes as suit the device
    #[arg(long, value_name = "N,…", value_delimiter = ',',
          value_parser = clap::value_parser!(u64).range(100..=MAX_FACES))]
    faces: Option<Vec<u64>>,

    /// A mesh file, and the number of clusters to cut it into; may be given several times
    #[arg(long = "mesh", value_name = "FILE:K", value_parser = path_parser(mesh_and_clusters))]
    meshes: Vec<(PathBuf, u64)>,

    /// How much work clusterings are
    #[arg(long, value_enum, default_value_t)]
    quality: Quality,

    /// How often each job is run; the fastest run counts
    #[arg(long, value_name = "N", default_value_t = 3, value_parser = clap::value_parser!(u32).range(1..=100))]
    repeats: u32,

    /// Largest mesh, in faces, that is clustered on the cpu too, to compare the labels
    #[arg(long, value_name = "N", default_value_t = 4_000_000)]
    compare_up_to: u64,

    /// Other constants of the gpu device, name=value,…
    #[arg(long, hide = true, value_name = "NAME=VALUE,…", default_value = "")]
    tuning: Tuning,

    /// Measure dispatches, round trips and transfers of the gpu alone, and print them as JSON
    #[arg(long, hide = true)]
    probe: bool,

    /// Where to write the tables: a file, or - for standard output, where they go when left out unless --json does
    #[arg(long, value_name = "OUT.md")]
    markdown: Option<PathBuf>,

    /// Where to write all figures (JSON): a file, or - for standard output
    #[arg(long, value_name = "OUT.json")]
    json: Option<PathBuf>,
}

/// Takes `FILE:K` apart.
fn mesh_and_clusters(argument: PathBuf) -> Result<(PathBuf, u64), String> {
    let apart = split_at_last_colon(&argument).and_then(|(file, clusters)| Some((file, clusters.parse().ok()?)));
    match apart {
        Some((file, clusters)) if clusters > 0 && !file.as_os_str().is_empty() => Ok((file, clusters)),
        _ => Err("a mesh is FILE:K, with the number of clusters after the colon".to_owned()),
    }
}

/// What is before and after the last colon.
#[cfg(unix)]
fn split_at_last_colon(argument: &Path) -> Option<(PathBuf, &str)> {
    use std::ffi::OsStr;
    use std::os::unix::ffi::OsStrExt;
    let bytes = argument.as_os_str().as_bytes();
    let colon = bytes.iter().rposition(|byte| *byte == b':')?;
    Some((OsStr::from_bytes(&bytes[..colon]).into(), std::str::from_utf8(&bytes[colon + 1..]).ok()?))
}

/// What is before and after the last colon.
#[cfg(not(unix))]
fn split_at_last_colon(argument: &Path) -> Option<(PathBuf, &str)> {
    argument.to_str()?.rsplit_once(':').map(|(file, rest)| (file.into(), rest))
}

/// Measures and writes.
pub fn run(arguments: &Arguments) -> Result<(), Failure> {
    if let Some(message) = arguments.device.contradiction() {
        return Err(Failure::Usage("bench", message));
    }
    if arguments.probe {
        let figures = select::probe(arguments.device.adapter.as_deref())?;
        let figures: serde_json::Map<String, serde_json::Value> =
            figures.into_iter().map(|(name, figure)| (name.to_owned(), figure.into())).collect();
        return print(|out| writeln!(out, "{:#}", serde_json::Value::Object(figures)));
    }
    let json = arguments.json.clone().map(Target::from);
    let usual = (!matches!(json, Some(Target::Stdout))).then(|| "-".into());
    let markdown = arguments.markdown.clone().or(usual).map(Target::from);
    let inputs: Vec<_> = arguments.meshes.iter().map(|(path, _)| ("a mesh", Source::File(path.clone()))).collect();
    let outputs = [("--json", &json), ("--markdown", &markdown)];
    let outputs: Vec<_> = outputs.into_iter().filter_map(|(flag, target)| Some((flag, target.as_ref()?))).collect();
    check_places("bench", &inputs, &outputs)?;
    let cancel = signals::cancel_when_asked();
    let (mut device, sizes) = open(&arguments.device, arguments.tuning)?;
    let sizes = arguments.faces.as_deref().unwrap_or(sizes);
    let is_auto = arguments.device.choice().is_auto();
    let faces_for_gpu = if is_auto { arguments.tuning.faces_for_gpu.into() } else { 0 };
    let plan = Plan { repeats: arguments.repeats, compare_up_to: arguments.compare_up_to, faces_for_gpu };
    let mut progress = Progress::new(None, false);
    let mut work = work(sizes, &arguments.meshes);
    work.iter_mut().for_each(|work| work.parameters.quality = arguments.quality);
    let (measurements, outcome) =
        bench::run(&work, device.as_mut(), plan, &cancel, &mut |stage| progress.stage(stage, 0.0..1.0));
    progress.finish();
    if measurements.rows.is_empty() {
        outcome?;
        return Ok(());
    }
    if let Some(json) = json {
        json.write(|out| {
            serde_json::to_writer_pretty(&mut *out, &measurements)?;
            out.write_all(b"\n")
        })?;
    }
    if let Some(markdown) = markdown {
        markdown.write(|out| out.write_all(measurements.markdown().as_bytes()))?;
    }
    Ok(outcome.and_then(|()| measurements.check())?)
}

/// The device, and the sizes of samples that suit it. `auto` takes a gpu where there is one.
fn open(device: &DeviceArguments, tuning: Tuning) -> Result<(Box<dyn Device>, &'static [u64]), Failure> {
    let has_gpu = || select::auto_adapter(&select::adapters()).is_some();
    if device.device == DeviceChoice::Cpu || device.choice().is_auto() && !has_gpu() {
        return Ok((Box::new(CpuDevice::new()), &ON_CPU));
    }
    let (kind, gpu) = select::open_timed(device.adapter.as_deref(), tuning)?;
    Ok((gpu, if kind == AdapterKind::Software { &ON_SOFTWARE } else { &ON_GPU }))
}

/// Everything that is run: the files first.
fn work(sizes: &[u64], meshes: &[(PathBuf, u64)]) -> Vec<Work> {
    let mut work = Vec::new();
    for (path, clusters) in meshes {
        let mesh = Mesh::File(path.clone());
        work.push(Work::flat(mesh.clone(), Some(*clusters), 1));
        work.push(Work::hierarchy(mesh.clone(), Optimize::None));
        work.push(Work::hierarchy(mesh, Optimize::On));
    }
    for &faces in sizes {
        work.extend([100, 1000].map(|faces_a_cluster| Work::flat(Mesh::Knot(faces), None, faces_a_cluster)));
        if faces <= MOST_FOR_HIERARCHY {
            work.extend([Optimize::None, Optimize::On].map(|optimize| Work::hierarchy(Mesh::Knot(faces), optimize)));
        }
    }
    work
}
