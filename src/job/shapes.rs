//! Clusterings by shapes as jobs.

use std::time::{Duration, Instant};

use super::iterations::Iterations;
use super::{Clustered, Prepared, finite};
use crate::cluster::record::Record;
use crate::cluster::seeds;
use crate::device::{Cancel, DeviceInfo};
use crate::error::Result;
use crate::mesh::MeshView;
use crate::parameters::Length;
use crate::report::{Iteration, Row};
use crate::shapes::faces::Faces;
use crate::shapes::kind::Kind;
use crate::shapes::run::{self, Clustering, Options, Step};
use crate::shapes::shape::Shape;
use crate::shapes::table::{ClusterShape, table};
use crate::surface::Surface;
use crate::surface::corners::Corners;
use crate::surface::samples::Samples;

/// Resolution where the caller gives none.
pub(super) const RESOLUTION: Length = Length::Share(3e-4);

/// The faces of a mesh as shapes see them.
#[derive(Debug)]
pub struct Shaped {
    /// Their places, weights and neighbours.
    pub surface: Surface,
    samples: Samples,
    corners: Corners,
}

/// What shapes clusters may have.
#[derive(Debug, Clone, PartialEq)]
pub struct ShapesSpec {
    /// Types, planes among them.
    pub kinds: Vec<Kind>,
    /// Distances below it are noise.
    pub resolution: Length,
}

/// The shapes that a run ends with.
#[derive(Debug)]
pub(super) struct Fitted {
    /// One a cluster, in units of moments.
    pub shapes: Vec<Shape>,
    /// F before and after, source units.
    pub energies: [f64; 2],
}

impl Shaped {
    /// Refuses numbers of clusters that the mesh cannot have.
    pub(super) fn new(surface: Surface, mesh: MeshView<'_>, clusters: Option<u64>) -> Result<Self> {
        let corners = surface.corners(mesh);
        let samples = rayon::scope(|_| surface.samples(&corners));
        let shaped = Self { surface, samples, corners };
        shaped.check(clusters)?;
        Ok(shaped)
    }

    pub(super) fn check(&self, clusters: Option<u64>) -> Result<()> {
        seeds::shares(&self.surface.items, clusters.unwrap_or(0)).map(|_| ())
    }

    /// The shapes for the report. `labels` are those of the run, `number_of_cluster` what each became.
    pub(super) fn table(&self, fitted: &Fitted, labels: &[u32], number_of_cluster: &[u32]) -> Vec<ClusterShape> {
        let labels: Vec<u32> = labels.iter().map(|&label| number_of_cluster[label as usize]).collect();
        let mut numbered: Vec<(u32, Shape)> = number_of_cluster.iter().copied().zip(fitted.shapes.clone()).collect();
        numbered.sort_unstable_by_key(|&(number, _)| number);
        let shapes: Vec<Shape> = numbered.into_iter().map(|(_, shape)| shape).collect();
        table(&self.surface, &self.corners, &labels, &shapes)
    }

    /// F in source units. It counts the squared distance of a triangle three times.
    fn energy(&self, energy: i128) -> f64 {
        self.surface.source_of_lattice(energy) / 3.0
    }

    /// Runs a job.
    pub(super) fn cluster(
        &self,
        prepared: &Prepared,
        device: &DeviceInfo,
        cancel: &Cancel,
        on_row: &mut dyn FnMut(Row),
    ) -> Result<Clustered> {
        let started = Instant::now();
        let parameters = prepared.spec.reported();
        let faces = Faces { graph: &self.surface.graph, samples: &self.samples };
        let options = self.options(prepared);
        let mut iterations = Iterations::default();
        let mut record = Record::new(prepared.spec.snapshots.clone());
        let mut number = 0;
        let mut on_step = |step: Step, labels: &[u32]| {
            let row = Iteration {
                iteration: number,
                phase: step.phase,
                round: None,
                energy: finite(self.energy(step.energy)),
                moves: step.moves,
                elapsed_us: started.elapsed().as_micros() as u64,
            };
            on_row(Row::Iteration(row.clone()));
            iterations.add(row);
            if let Some(viewer) = prepared.viewer.as_ref().filter(|viewer| viewer.is_due()) {
                viewer.show(self.surface.in_upload_order(labels));
            }
            let Ok(()) = record.offer(number, || Ok::<_, std::convert::Infallible>(labels.to_vec()));
            number += 1;
        };
        let Clustering { initial, labels, shapes, energies, ending } =
            run::cluster(faces, &options, cancel, &mut on_step)?;
        Ok(Clustered {
            device: device.clone(),
            clusters: options.clusters,
            labels,
            initial: Some(initial),
            tree: None,
            iterations: iterations.rows,
            levels: Vec::new(),
            warnings: super::flat::warnings(parameters.max_iterations, ending, &record),
            snapshots: record,
            shapes: Some(Fitted { shapes, energies: energies.map(|energy| self.energy(energy)) }),
            upload: Duration::ZERO,
            cluster: started.elapsed(),
        })
    }

    fn options(&self, prepared: &Prepared) -> Options {
        let spec = &prepared.spec;
        let (kinds, resolution) = match &spec.shapes {
            Some(shapes) => {
                (shapes.kinds.clone(), self.surface.on_lattice(|diagonal| shapes.resolution.share_of(diagonal)))
            }
            None => (vec![Kind::Plane], 0.0),
        };
        Options {
            clusters: spec.clustering.clusters().unwrap_or(0) as usize,
            kinds,
            resolution,
            most_steps: spec.reported().max_iterations,
        }
    }
}
