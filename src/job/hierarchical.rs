//! Hierarchies as jobs.

use std::time::Instant;

use serde_json::{Value, json};

use super::iterations::Iterations;
use super::{Clustered, finite};
use crate::cluster::hierarchy::{Hierarchy, Options, RoundRow, hierarchical};
use crate::cluster::record::Record;
use crate::cluster::run;
use crate::device::{Cancel, Device};
use crate::energy::Functional;
use crate::error::{Error, Result};
use crate::hierarchy::stored::Header;
use crate::parameters::Parameters;
use crate::report::{Input, Level, Row};
use crate::surface::Items;

/// Number of clusters from which on every round has a row.
const EVERY_ROUND_AT: u64 = 10_000;

/// Above that, a row for every such part of the clusters that has gone.
const PART: u64 = 1000;

/// Runs a hierarchical algorithm that ends with `target` clusters.
pub(super) fn run<E: Functional>(
    items: &Items<E>,
    options: &Options,
    target: u64,
    device: &mut dyn Device<E>,
    cancel: &Cancel,
    on_row: &mut dyn FnMut(Row),
) -> Result<Clustered> {
    let started = Instant::now();
    let mut iterations = Iterations::default();
    let mut levels = Levels::new(items.faces() as u64, target);
    let told = std::cell::RefCell::new(on_row);
    let mut keep_iteration = |row: run::Row| {
        let row = super::flat::iteration(row, finite(items.energy(row.energy)), started);
        (told.borrow_mut())(Row::Iteration(row.clone()));
        iterations.add(row);
    };
    let mut keep_round = |row: RoundRow| {
        if let Some(level) = levels.add(&row, || finite(items.energy(row.energy))) {
            (told.borrow_mut())(Row::Round(level));
        }
    };
    let hierarchy = hierarchical(items, options, device, cancel, &mut keep_iteration, &mut keep_round)?;
    let cluster = started.elapsed() - hierarchy.upload;
    let Hierarchy { tree, mut labels, bounded_at, upload } = hierarchy;
    number(&mut labels, target as usize)?;
    let warning = |clusters: u64| {
        format!(
            "merged many pairs at a time from a bound on work on: faces have very many neighbours, or move very often; \
             clusters then: {clusters}"
        )
    };
    Ok(Clustered {
        device: device.info().clone(),
        labels,
        clusters: target as usize,
        initial: None,
        tree: Some(tree),
        iterations: iterations.rows,
        levels: levels.rows,
        shapes: None,
        snapshots: Record::default(),
        warnings: bounded_at.map(warning).into_iter().collect(),
        upload,
        cluster,
    })
}

/// What a stored hierarchy says about itself.
pub(super) fn header(input: &Input, parameters: &Parameters) -> Result<Header> {
    let not_json = |error| Error::internal(format_args!("parameters cannot be written as JSON: {error}"));
    Ok(Header {
        version: env!("CARGO_PKG_VERSION").to_owned(),
        algorithm: parameters.algorithm.name().to_owned(),
        parameters: match serde_json::to_value(parameters).map_err(not_json)? {
            Value::Object(parameters) => parameters,
            other => return Err(Error::internal(format_args!("parameters are no object: {other}"))),
        },
        input: match input {
            Input::Mesh(mesh) => json!({
                "format": mesh.format,
                "vertices": mesh.vertices,
                "faces": mesh.faces,
                "components": mesh.components,
            }),
            Input::Points(points) => json!({
                "format": points.format,
                "items": points.items,
                "dimensions": points.dimensions,
                "shape": points.shape,
                "components": points.components,
            }),
        },
    })
}

/// Gives clusters the numbers 0 … K − 1, by the first face that carries them. Checks that there are as many as
/// expected.
fn number(labels: &mut [u32], expected: usize) -> Result<()> {
    let mut number_of_cluster: Vec<Option<u32>> = vec![None; labels.len()];
    let mut seen = 0;
    for label in labels {
        *label = *number_of_cluster[*label as usize].get_or_insert_with(|| {
            seen += 1;
            seen - 1
        });
    }
    if seen as usize != expected {
        return Err(Error::internal(format_args!("{seen} of {expected} clusters have faces")));
    }
    Ok(())
}

/// The rows of the report: every round while there are few clusters, and enough of them above.
pub(super) struct Levels {
    pub(super) rows: Vec<Level>,
    /// Clusters left in the last row.
    listed: u64,
    /// Clusters left at the end.
    target: u64,
    /// Merges and moves of the rounds since the last row.
    merges: u64,
    moves: u64,
}

impl Levels {
    pub(super) fn new(faces: u64, target: u64) -> Self {
        Self { rows: Vec::new(), listed: faces, target, merges: 0, moves: 0 }
    }

    /// Adds a round; gives the row that it completes, if any.
    pub(super) fn add<E>(&mut self, row: &RoundRow<E>, energy: impl FnOnce() -> Option<f64>) -> Option<Level> {
        self.merges += row.merges;
        self.moves += row.moves;
        let is_listed = row.clusters <= EVERY_ROUND_AT
            || row.is_level
            || row.clusters <= self.target
            || row.clusters <= self.listed - self.listed / PART;
        if !is_listed {
            return None;
        }
        let level = Level {
            round: row.round,
            clusters: row.clusters,
            energy: energy(),
            merges: std::mem::take(&mut self.merges),
            moves: std::mem::take(&mut self.moves),
        };
        self.listed = row.clusters;
        self.rows.push(level);
        Some(level)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::energy::LatticeEnergy;

    #[test]
    fn few_rows_tell_of_many_rounds_and_nothing_is_lost_between_them() {
        let mut levels = Levels::new(1_000_000, 1);
        for round in 1..1_000_000u32 {
            let clusters = 1_000_000 - u64::from(round);
            let energy = LatticeEnergy { explained: 0 };
            let row = RoundRow { round, clusters, energy, merges: 1, moves: 2, is_level: clusters == 777_777 };
            levels.add(&row, || Some(1.0));
        }
        let rows = &levels.rows;
        assert!(rows.len() < 15_000, "{} rows", rows.len());
        assert!(rows.iter().any(|row| row.clusters == 777_777));
        assert_eq!(rows.iter().filter(|row| row.clusters <= EVERY_ROUND_AT).count(), EVERY_ROUND_AT as usize);
        let mut left = 1_000_000;
        for row in rows {
            left -= row.merges;
            assert_eq!((left, row.moves), (row.clusters, 2 * row.merges));
        }
        assert_eq!(left, 1);
    }

    #[test]
    fn clusters_are_numbered_by_their_first_faces() {
        let mut labels = [4, 4, 1, 0, 1];
        assert_eq!(number(&mut labels, 3), Ok(()));
        assert_eq!(labels, [0, 0, 1, 2, 1]);
        let error = number(&mut labels, 4).expect_err("there are three");
        assert!(error.message.contains("3 of 4"), "{error}");
    }
}
