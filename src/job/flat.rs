//! Flat clusterings as jobs.

use std::time::Instant;

use super::iterations::Iterations;
use super::{Clustered, Method, Prepared, finite};
use crate::cluster::coarse::{CoarseStart, Start};
use crate::cluster::flat::{self, Clustering, Options};
use crate::cluster::record::Record;
use crate::cluster::reference::acvd::acvd;
use crate::cluster::reference::variational::variational;
use crate::cluster::run;
use crate::cluster::seeds::SeedFaces;
use crate::device::{Cancel, Device, Ending, Steps};
use crate::error::{Error, Kind, Result};
use crate::parameters::Name;
use crate::report::{DeviceKind, Iteration, Row};

/// Runs boundary-based clustering, coarse to fine.
pub(super) fn run_coarse(
    prepared: &Prepared,
    start: &CoarseStart,
    options: Options,
    device: &mut dyn Device,
    cancel: &Cancel,
    on_row: &mut dyn FnMut(Row),
) -> Result<Clustered> {
    let started = Instant::now();
    let start = start.labels(&prepared.surface, device, cancel)?;
    run(prepared, started, &start, device, on_row, |steps, keep, record| {
        flat::boundary_based(&start.labels, options, steps, cancel, keep, record)
    })
}

/// Runs a flat algorithm from seeds.
pub(super) fn run_seeded(
    prepared: &Prepared,
    method: Method,
    seeds: &SeedFaces,
    options: Options,
    device: &mut dyn Device,
    cancel: &Cancel,
    on_row: &mut dyn FnMut(Row),
) -> Result<Clustered> {
    let Prepared { surface, parameters, .. } = prepared;
    if method != Method::BoundaryBased && device.info().kind == DeviceKind::Gpu {
        return Err(Error::new(
            Kind::DeviceUnsuitable,
            format_args!(
                "the device must be cpu or auto for this algorithm, a sequential reference that no gpu runs: {}",
                parameters.algorithm.name()
            ),
        ));
    }
    let started = Instant::now();
    let start = Start::from_seeds(seeds.clone(), surface.faces());
    run(prepared, started, &start, device, on_row, |steps, keep, record| match method {
        Method::BoundaryBased => flat::boundary_based(&start.labels, options, steps, cancel, keep, record),
        Method::Acvd => acvd(surface, seeds, options, steps, cancel, keep, record),
        Method::Variational => variational(surface, seeds, options, cancel, keep, record),
    })
}

/// Runs `cluster` on a device that is opened with the clusters of a start, and gathers what it reports.
fn run(
    prepared: &Prepared,
    started: Instant,
    start: &Start,
    device: &mut dyn Device,
    on_row: &mut dyn FnMut(Row),
    cluster: impl FnOnce(&mut dyn Steps, &mut dyn FnMut(run::Row), &mut Record) -> Result<Clustering>,
) -> Result<Clustered> {
    let Prepared { surface, parameters, .. } = prepared;
    let opened = Instant::now();
    let mut steps = device.open(surface, &start.component_of_cluster)?;
    let upload = opened.elapsed();

    let mut iterations = Iterations::default();
    let mut keep = |row: run::Row| {
        let row = iteration(row, finite(surface.energy(row.energy)), started);
        on_row(Row::Iteration(row.clone()));
        iterations.add(row);
    };
    let mut record = Record::new(parameters.snapshots.clone());
    let clustering = cluster(steps.as_mut(), &mut keep, &mut record)?;
    drop(steps);
    let cluster = started.elapsed() - upload;
    Ok(Clustered {
        device: device.info().clone(),
        clusters: start.component_of_cluster.len(),
        tree: None,
        iterations: iterations.rows,
        levels: Vec::new(),
        warnings: warnings(parameters.max_iterations, &clustering, &record),
        snapshots: record,
        upload,
        cluster,
        initial: Some(clustering.initial),
        labels: clustering.labels,
    })
}

/// A row of a run as a row of the report; `energy` in source units.
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
fn warnings(max_iterations: Option<u32>, clustering: &Clustering, record: &Record) -> Vec<String> {
    let mut warnings = match (clustering.ending, max_iterations) {
        (Ending::IterationLimit, Some(limit)) => {
            vec![format!("stopped by {}, maybe before it had converged: {limit}", Name::MAX_ITERATIONS)]
        }
        (Ending::IterationLimit, None) | (Ending::Converged, _) => Vec::new(),
    };
    if let Some(first) = record.beyond().first() {
        warnings
            .push(format!("the run ended before iterations whose labels were to be kept, the first of them {first}"));
    }
    if record.left_out > 0 {
        warnings.push(format!(
            "there was no room for the labels of all iterations that were asked for, ask for fewer; left out: {}",
            record.left_out
        ));
    }
    warnings
}
