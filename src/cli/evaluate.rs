//! `tesserae evaluate`: measurements that were published, made anew.

use std::path::PathBuf;

use tesserae_mesh::dev::evaluate::{self, Devices};
use tesserae_mesh::device::Device;
use tesserae_mesh::device::select::{self, AdapterKind, DeviceChoice};
use tesserae_mesh::error::Error;
use tesserae_mesh::mesh::Format;

use super::Failure;
use super::files::Target;
use super::progress::Progress;
use super::signals;

/// Arguments of `tesserae evaluate`.
#[derive(Debug, clap::Args)]
pub struct Arguments {
    #[command(subcommand)]
    what: What,
}

#[derive(Debug, clap::Subcommand)]
enum What {
    /// Tables 1 and 2 and Figure 6 of "Parallel Mesh Clustering", on the meshes that are there, with the paper's
    /// figures beside ours: report.md and figure-6.svg
    Paper(Paper),
}

#[derive(Debug, clap::Args)]
#[command(after_help = format!("\
Meshes are found by name: {} files whose names contain bunny, horse or armadillo. A gpu takes part where \
there is one; software drivers are none.

Example:
  tesserae evaluate paper --meshes meshes/ evaluation/", Format::choice(".")))]
struct Paper {
    /// Folder with the meshes
    #[arg(long, value_name = "DIR")]
    meshes: PathBuf,

    /// Folder to write report.md and figure-6.svg to; made if it is not there
    #[arg(value_name = "OUT_DIR")]
    out: PathBuf,

    /// How often each time of Table 1 is measured; the least counts
    #[arg(long, value_name = "N", default_value_t = 3, value_parser = clap::value_parser!(u32).range(1..=100))]
    repeats: u32,

    /// Let a software driver take part as the gpu, which says nothing about gpus
    #[arg(long)]
    software_gpu: bool,
}

/// Measures and writes.
pub fn run(arguments: &Arguments) -> Result<(), Failure> {
    let What::Paper(paper) = &arguments.what;
    std::fs::create_dir_all(&paper.out)
        .map_err(|error| Error::io(format_args!("the folder {:?} cannot be made", paper.out), error))?;
    let report = Target::File(paper.out.join("report.md"));
    let figure = Target::File(paper.out.join("figure-6.svg"));
    report.check()?;
    figure.check()?;
    let cancel = signals::cancel_when_asked();
    let mut progress = Progress::new(None, false);
    let mut devices = Devices::new(gpu(paper.software_gpu)?);
    let mut on_stage = |stage: String| progress.stage(stage, 0.0..1.0);
    let evaluation = evaluate::paper(&paper.meshes, &mut devices, paper.repeats, &cancel, &mut on_stage)?;
    progress.finish();
    figure.write(|out| out.write_all(evaluation.figure.as_bytes()))?;
    report.write(|out| out.write_all(evaluation.markdown.as_bytes()))
}

/// The gpu that `auto` would take, or with `software` a software driver where there is no other.
fn gpu(software: bool) -> Result<Option<Box<dyn Device>>, Failure> {
    let adapters = select::adapters();
    let is_there = adapters.iter().any(|report| report.usable && (software || report.kind != AdapterKind::Software));
    Ok(if is_there { Some(select::open(DeviceChoice::Gpu, None, None)?) } else { None })
}
