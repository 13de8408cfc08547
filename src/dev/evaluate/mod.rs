//! The paper's evaluation anew: Tables 1 and 2 and Figure 6 of "Parallel Mesh Clustering" on the meshes that are there,
//! its printed figures beside ours, and whether what it says of them (P§7) holds.
//!
//! | what | where |
//! |---|---|
//! | what the paper printed | [`printed`] |
//! | finding meshes, running and timing jobs | `runs` |
//! | energy against the number of clusters | `figure` |
//! | what the paper says about it | `statements` |
//! | the report as Markdown | `markdown` |
//! | clusterings by shapes beside those of other programs | [`shapes`] |
//!
//! It uses [`crate::job`] as any other caller could.

mod figure;
mod markdown;
pub mod printed;
mod runs;
pub mod shapes;
mod statements;

use std::path::Path;

pub use runs::Devices;

use crate::device::Cancel;
use crate::error::{Error, Result};
use crate::parameters::{Algorithm, Parameters, Refine, Seeds};
use figure::Figure;
use printed::{TABLE_1, TABLE_2};
use runs::{MeshFile, Runner, Timed};
use statements::Statement;

/// What came out: a report in Markdown, and Figure 6 as SVG.
#[derive(Debug)]
pub struct Evaluation {
    /// The report; it shows the figure as `figure-6.svg`, beside it.
    pub markdown: String,
    /// The figure.
    pub figure: String,
}

/// A way of flat clustering that is compared.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Flat {
    Acvd,
    Vc,
    BoundaryBased,
    Refined,
    Default,
}

impl Flat {
    /// All of them, in the order of the columns.
    const ALL: [Flat; 5] = [Flat::Acvd, Flat::Vc, Flat::BoundaryBased, Flat::Refined, Flat::Default];

    /// As it is called in tables and in the figure.
    fn name(self) -> &'static str {
        match self {
            Flat::Acvd => "ACVD",
            Flat::Vc => "VC",
            Flat::BoundaryBased => "BB",
            Flat::Refined => "BB refined",
            Flat::Default => "default settings",
        }
    }

    /// The parameters; random seeds (P§5.3) with this number, except for the default settings.
    fn parameters(self, clusters: u64, seed: u64) -> Parameters {
        let random = Parameters { clusters: Some(clusters), seeds: Seeds::Random, seed, ..Parameters::default() };
        match self {
            Flat::Acvd => Parameters { algorithm: Algorithm::Acvd, ..random },
            Flat::Vc => Parameters { algorithm: Algorithm::Vc, ..random },
            Flat::BoundaryBased => Parameters { refine: Refine::None, ..random },
            Flat::Refined => random,
            Flat::Default => Parameters { clusters: Some(clusters), ..Parameters::default() },
        }
    }

    /// Whether it runs on the cpu only.
    fn is_sequential(self) -> bool {
        matches!(self, Flat::Acvd | Flat::Vc)
    }
}

/// A row of Table 1 as it came out here.
struct FlatRow<'a> {
    printed: &'a printed::FlatRow,
    /// None where the mesh is not there.
    runs: Option<Vec<(Flat, usize, Timed)>>,
}

/// A row of Table 2 as it came out here.
struct TreeRow<'a> {
    printed: &'a printed::TreeRow,
    /// None where the mesh is not there.
    runs: Option<Vec<(Algorithm, usize, Timed)>>,
}

/// Runs everything on the meshes in a folder. `on_stage` receives the name of each stage.
pub fn paper(
    meshes: &Path,
    devices: &mut Devices,
    repeats: u32,
    cancel: &Cancel,
    on_stage: &mut dyn FnMut(String),
) -> Result<Evaluation> {
    let files = runs::find(meshes)?;
    let Some(first) = files.iter().flatten().next() else {
        return Err(Error::not_found(format_args!(
            "no mesh of the paper is here: a file {} whose name contains bunny, horse or armadillo, in {meshes:?}",
            crate::mesh::Format::choice(".")
        )));
    };
    let found = |model: &str| {
        let at = printed::MODELS.iter().position(|printed| printed.name == model);
        at.and_then(|at| files[at].as_ref())
    };
    let mut runner = Runner { devices, repeats, cancel, on_stage };
    let mut flat = Vec::new();
    for printed in &TABLE_1 {
        let runs = found(printed.model).map(|mesh| table_1(&mut runner, mesh, printed.clusters)).transpose()?;
        flat.push(FlatRow { printed, runs });
    }
    let mut trees = Vec::new();
    for printed in &TABLE_2 {
        let runs = found(printed.model).map(|mesh| table_2(&mut runner, mesh)).transpose()?;
        trees.push(TreeRow { printed, runs });
    }
    let mesh = found("Bunny").unwrap_or(first);
    let figure = Figure::measure(&mut runner, mesh)?;
    let cube = statements::cube(&mut runner)?;
    let statements: Vec<Statement> = statements::check(&figure, cube, &flat, &trees, &runner.devices.infos());
    let markdown = markdown::report(&files, &runner, &flat, &trees, &figure, &statements);
    Ok(Evaluation { markdown, figure: figure.draw()? })
}

/// One row of Table 1.
fn table_1(runner: &mut Runner<'_>, mesh: &MeshFile, clusters: u64) -> Result<Vec<(Flat, usize, Timed)>> {
    let mut runs = Vec::new();
    for flat in Flat::ALL {
        let devices = if flat.is_sequential() { 1 } else { runner.devices.len() };
        for device in 0..devices {
            let repeats = runner.repeats;
            runs.push((flat, device, runner.run(mesh, &flat.parameters(clusters, 0), device, repeats)?));
        }
    }
    Ok(runs)
}

/// One row of Table 2: whole hierarchies.
fn table_2(runner: &mut Runner<'_>, mesh: &MeshFile) -> Result<Vec<(Algorithm, usize, Timed)>> {
    let mut runs = Vec::new();
    for algorithm in [Algorithm::Ml, Algorithm::Pml, Algorithm::Hr] {
        let devices = if algorithm == Algorithm::Pml { runner.devices.len() } else { 1 };
        for device in 0..devices {
            let parameters = Parameters { algorithm, ..Parameters::default() };
            runs.push((algorithm, device, runner.run(mesh, &parameters, device, 1)?));
        }
    }
    Ok(runs)
}
