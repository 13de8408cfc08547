//! Flat clusterings as jobs.

use std::time::Instant;

use super::{Clustered, Prepared, finite};
use crate::cluster::flat::{self, Clustering, Options};
use crate::cluster::reference::acvd::acvd;
use crate::cluster::reference::variational::variational;
use crate::cluster::run;
use crate::cluster::seeds::SeedFaces;
use crate::device::{Cancel, Device, Ending};
use crate::error::{Error, Kind, Result};
use crate::parameters::{Algorithm, Refine};
use crate::report::{DeviceKind, Iteration, Row};

/// Runs a flat algorithm.
pub(super) fn run(
    prepared: &Prepared,
    seeds: &SeedFaces,
    device: &mut dyn Device,
    cancel: &Cancel,
    on_row: &mut dyn FnMut(Row),
) -> Result<Clustered> {
    let Prepared { surface, parameters, .. } = prepared;
    if parameters.algorithm.is_reference() && device.info().kind == DeviceKind::Gpu {
        return Err(Error::new(
            Kind::DeviceUnsuitable,
            format_args!(
                "the device must be cpu or auto for this algorithm, a sequential reference that no gpu runs: {}",
                parameters.algorithm.name()
            ),
        ));
    }
    let opened = Instant::now();
    let mut steps = device.open(surface, &seeds.component_of_cluster)?;
    let upload = opened.elapsed();

    let started = Instant::now();
    let mut iterations = Vec::new();
    let options = Options {
        max_iterations: parameters.max_iterations,
        refine: parameters.refine == Refine::On,
        allow_disconnected: parameters.allow_disconnected,
    };
    let mut keep = |row: run::Row| {
        let row = iteration(row, finite(surface.energy(row.energy)), started);
        on_row(Row::Iteration(row.clone()));
        iterations.push(row);
    };
    let clustering = match parameters.algorithm {
        Algorithm::Acvd => acvd(surface, seeds, options, steps.as_mut(), cancel, &mut keep)?,
        Algorithm::Vc => variational(surface, seeds, options, cancel, &mut keep)?,
        // the others are no flat ones
        Algorithm::Bb | Algorithm::Pml | Algorithm::Ml | Algorithm::Hr => {
            flat::boundary_based(surface, seeds, options, steps.as_mut(), cancel, &mut keep)?
        }
    };
    drop(steps);
    let cluster = started.elapsed();
    let clusters = seeds.face_of_cluster.len();
    Ok(Clustered {
        clusters,
        initial_energy: Some(surface.source_energy(&clustering.initial, clusters)),
        tree: None,
        iterations,
        levels: Vec::new(),
        warnings: warnings(parameters.max_iterations, &clustering),
        upload,
        cluster,
        labels: clustering.labels,
    })
}

/// A row of a run as it is told; `energy` in source units.
pub(super) fn iteration(row: run::Row, energy: Option<f64>, started: Instant) -> Iteration {
    Iteration {
        iteration: row.iteration,
        phase: row.phase,
        round: row.round,
        energy,
        moves: row.moves,
        elapsed_us: started.elapsed().as_micros() as u64,
    }
}

/// What is unusual about the run.
fn warnings(max_iterations: Option<u32>, clustering: &Clustering) -> Vec<String> {
    match (clustering.ending, max_iterations) {
        (Ending::IterationLimit, Some(limit)) => {
            vec![format!("stopped by max_iterations, maybe before it had converged: {limit}")]
        }
        (Ending::IterationLimit, None) | (Ending::Converged, _) => Vec::new(),
    }
}
