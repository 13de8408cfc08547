//! `tesserae evaluate`: measurements that were published, made anew.

use std::path::{Path, PathBuf};
use std::process::Command;

use tesserae_mesh::dev::evaluate::shapes::Given;
use tesserae_mesh::dev::evaluate::{self, Devices};
use tesserae_mesh::dev::sample::{generate_part, write_obj};
use tesserae_mesh::device::Device;
use tesserae_mesh::device::select::{self, AdapterKind, DeviceChoice};
use tesserae_mesh::error::Error;
use tesserae_mesh::job::parse_labels;
use tesserae_mesh::mesh::{self, Format, Limits, PolygonMesh};

use super::files::{Source, Target};
use super::inputs::MeshFile;
use super::progress::Progress;
use super::summary::count;
use super::{Failure, print_line, say, signals};

/// Distances of CGAL's RANSAC, shares of the diagonal.
const EPSILONS: [&str; 3] = ["0.001", "0.003", "0.01"];

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
    /// A table of a clustering by shapes beside labels of other programs: wrong faces, types, L2 and L2,1
    Shapes(Shapes),
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

#[derive(Debug, clap::Args)]
#[command(after_help = "\
Without a mesh: the part of `tesserae sample part --faces 12528` at 0 to 0.5 percent noise. Ours has as many clusters \
as the truth, or else as the first labels.

Example:
  g++ -O2 -std=c++17 benches/cgal_shapes.cpp -o cgal_shapes -lgmp -lmpfr
  tesserae evaluate shapes --cgal ./cgal_shapes
  tesserae evaluate shapes part.obj --truth truth.npy --labels others=others.npy")]
struct Shapes {
    /// The mesh
    #[arg(value_name = "MESH")]
    mesh: Option<PathBuf>,

    /// The right patch of each face, an npy; faces outside the patch of their cluster are wrong
    #[arg(long, value_name = "T.npy", requires = "mesh")]
    truth: Option<PathBuf>,

    /// Labels of another program, an npy, and its name; may be given several times
    #[arg(long, value_name = "NAME=L.npy", requires = "mesh")]
    labels: Vec<String>,

    /// What benches/cgal_shapes.cpp was compiled to: its VSA and its RANSAC take part
    #[arg(long, value_name = "PROGRAM")]
    cgal: Option<PathBuf>,
}

/// Measures and writes.
pub fn run(arguments: &Arguments) -> Result<(), Failure> {
    match &arguments.what {
        What::Paper(paper) => run_paper(paper),
        What::Shapes(shapes) => run_shapes(shapes),
    }
}

/// Prints the tables.
fn run_shapes(shapes: &Shapes) -> Result<(), Failure> {
    let cancel = signals::cancel_when_asked();
    if shapes.cgal.is_none() {
        say("CGAL is absent: --cgal names the program that benches/cgal_shapes.cpp was compiled to");
    }
    let beside = |mesh: &PolygonMesh, truth: Option<Vec<u32>>, mut given: Vec<Given>| {
        if let Some(program) = &shapes.cgal {
            given.extend(by_cgal(program, mesh, evaluate::shapes::clusters(truth.as_deref(), &given))?);
        }
        let table = evaluate::shapes::beside(mesh, truth, given, &cancel)?;
        print_line(table.trim_end())
    };
    let Some(path) = &shapes.mesh else {
        for noise in evaluate::shapes::NOISE {
            let (mesh, truth) = generate_part(evaluate::shapes::FACES, noise)?;
            print_line(&format!("\nPart of {} faces, noise {noise} %\n", count(mesh.faces.len() as u64)))?;
            beside(&mesh, Some(truth), Vec::new())?;
        }
        return Ok(());
    };
    if shapes.truth.is_none() && shapes.labels.is_empty() {
        return Err(Failure::Usage(
            "evaluate",
            "--truth or --labels is missing: say how many clusters there are".into(),
        ));
    }
    let (file, limits) = (MeshFile::at(path), Limits::default());
    let (bytes, format) = file.read_mesh(&limits)?;
    let resources = file.resources(&[]);
    let mesh = mesh::read(&bytes, format, &*resources, &limits).map_err(Failure::about(&file.source))?;
    let truth = shapes.truth.as_deref().map(|path| read_labels(path, &mesh)).transpose()?;
    let mut given = Vec::new();
    for text in &shapes.labels {
        let (name, path) = text.split_once('=').unwrap_or((text, text));
        given.push(Given { name: name.to_owned(), labels: read_labels(Path::new(path), &mesh)? });
    }
    beside(&mesh, truth, given)
}

fn read_labels(path: &Path, mesh: &PolygonMesh) -> Result<Vec<u32>, Failure> {
    let source = Source::from(path.to_owned());
    let bytes = source.read(Limits::default().max_bytes)?;
    Ok(parse_labels(&bytes, mesh.faces.len()).map_err(Failure::about(&source))?.0)
}

/// The labels of CGAL.
fn by_cgal(program: &Path, mesh: &PolygonMesh, clusters: usize) -> Result<Vec<Given>, Failure> {
    let failed = |error| Error::io(format_args!("the program {program:?} cannot be run"), error);
    let folder = tempfile::tempdir().map_err(failed)?;
    let (input, output) = (folder.path().join("mesh.obj"), folder.path().join("labels.npy"));
    Target::File(input.clone()).write(|out| write_obj(out, mesh))?;
    let mut given = Vec::new();
    for (method, value) in
        [("vsa", clusters.to_string())].into_iter().chain(EPSILONS.map(|epsilon| ("ransac", epsilon.to_owned())))
    {
        let status = Command::new(program).args([&input, &output]).args([method, &value]).status().map_err(failed)?;
        if !status.success() {
            return Err(Error::io(
                format_args!("{program:?} {method} {value}"),
                std::io::Error::other(status.to_string()),
            )
            .into());
        }
        given.push(Given { name: format!("CGAL, {method} {value}"), labels: read_labels(&output, mesh)? });
    }
    Ok(given)
}

fn run_paper(paper: &Paper) -> Result<(), Failure> {
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
