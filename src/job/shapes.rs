//! Clusterings by shapes as jobs.

use std::time::{Duration, Instant};

use super::iterations::Iterations;
use super::{Clustered, Clustering, Prepared, finite};
use crate::cluster::record::Record;
use crate::cluster::seeds;
use crate::device::{Cancel, DeviceInfo};
use crate::energy;
use crate::error::{self, Error, Result};
use crate::mesh::MeshView;
use crate::parameters::{Length, Parameters, Shapes};
use crate::report::{self, Iteration, Row};
use crate::shapes::faces::Faces;
use crate::shapes::kind::Kind;
use crate::shapes::run::{self, Options, Step, Wanted};
use crate::shapes::shape::Shape;
use crate::shapes::table::{ClusterShape, table};
use crate::shapes::tolerance::Tolerance;
use crate::surface::Surface;
use crate::surface::corners::Corners;
use crate::surface::samples::Samples;

/// Resolution where the caller gives none.
const RESOLUTION: Length = Length::Share(3e-4);

/// A tolerance over the resolution, where the caller gives the tolerance alone.
const IN_TOLERANCE: f64 = 10.0;

/// The faces of a mesh as shapes see them.
#[derive(Debug)]
pub struct Shaped {
    /// Their places, weights and neighbours.
    pub surface: Surface,
    samples: Samples,
    corners: Corners,
}

/// What shapes clusters may have, and how many there are.
#[derive(Debug, Clone, PartialEq)]
pub struct ShapesSpec {
    /// Types, planes among them.
    pub kinds: Vec<Kind>,
    /// Distances below it are noise; none of planes.
    pub resolution: Option<Length>,
    /// How many clusters.
    pub wanted: WantedShapes,
}

/// How many shapes there are.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum WantedShapes {
    /// So many.
    Clusters(u64),
    /// Few, such that all corners are within this distance.
    Within(Length),
}

impl ShapesSpec {
    /// Fills in what the parameters leave out.
    pub(super) fn new(parameters: &mut Parameters) -> Result<Self> {
        let wanted = match parameters.tolerance {
            Some(tolerance) => WantedShapes::Within(tolerance),
            None => WantedShapes::Clusters(parameters.flat_clusters()?),
        };
        if parameters.energy != energy::Kind::Shapes {
            let Shapes(kinds) = Shapes::planes();
            return Ok(Self { kinds, resolution: None, wanted });
        }
        let usual = parameters.tolerance.map_or(RESOLUTION, |tolerance| tolerance.over(IN_TOLERANCE));
        let resolution = Some(*parameters.resolution.get_or_insert(usual));
        let Shapes(kinds) = parameters.shapes.get_or_insert_default().clone();
        Ok(Self { kinds, resolution, wanted })
    }

    /// The number of clusters; none if a tolerance decides it.
    pub fn clusters(&self) -> Option<u64> {
        match self.wanted {
            WantedShapes::Clusters(clusters) => Some(clusters),
            WantedShapes::Within(_) => None,
        }
    }
}

/// The shapes that a run ends with.
#[derive(Debug)]
pub(super) struct Fitted {
    /// One a cluster, in units of moments.
    pub shapes: Vec<Shape>,
    /// F before and after, source units.
    pub energies: [f64; 2],
    /// How far corners may be from them.
    pub tolerance: Option<TakenTolerance>,
}

/// A tolerance as it was given, and in lattice units.
#[derive(Debug, Clone, Copy)]
pub(super) struct TakenTolerance {
    asked: Length,
    distance: f64,
}

impl Shaped {
    /// Refuses numbers of clusters that the mesh cannot have.
    pub(super) fn new(surface: Surface, mesh: MeshView<'_>, clustering: &Clustering) -> Result<Self> {
        let corners = surface.corners(mesh);
        let samples = rayon::scope(|_| surface.samples(&corners));
        let shaped = Self { surface, samples, corners };
        shaped.check(clustering)?;
        Ok(shaped)
    }

    pub(super) fn check(&self, clustering: &Clustering) -> Result<()> {
        match clustering.clusters() {
            Some(clusters) => seeds::shares(&self.surface.items, clusters).map(|_| ()),
            None => Ok(()),
        }
    }

    /// The shapes for the report. `labels` are those of the run, `number_of_cluster` what each became.
    pub(super) fn table(&self, fitted: &Fitted, labels: &[u32], number_of_cluster: &[u32]) -> Vec<ClusterShape> {
        let labels: Vec<u32> = labels.iter().map(|&label| number_of_cluster[label as usize]).collect();
        let mut numbered: Vec<(u32, Shape)> = number_of_cluster.iter().copied().zip(fitted.shapes.clone()).collect();
        numbered.sort_unstable_by_key(|&(number, _)| number);
        let shapes: Vec<Shape> = numbered.into_iter().map(|(_, shape)| shape).collect();
        let tolerance = fitted.tolerance.map(|TakenTolerance { distance, .. }| self.within(distance));
        table(&self.surface, &self.corners, &labels, &shapes, tolerance)
    }

    /// What the report says of a tolerance, and a warning about single faces beyond it.
    pub(super) fn tolerance(
        &self,
        fitted: &Fitted,
        table: &[ClusterShape],
    ) -> Option<(report::Tolerance, Option<String>)> {
        let TakenTolerance { asked, distance } = fitted.tolerance?;
        let length = libm::ldexp(distance, -self.surface.frame().exponent);
        let largest = table.iter().fold(0.0, |most: f64, shape| most.max(shape.residual.max));
        let beyond = table.iter().filter(|shape| shape.residual.max > length).count();
        let warning = (beyond > 0).then(|| {
            format!("faces with corners beyond the tolerance of their plane, clusters of their own: {beyond}")
        });
        Some((report::Tolerance { asked, length, largest }, warning))
    }

    /// A tolerance of this distance, in lattice units.
    fn within(&self, distance: f64) -> Tolerance<'_> {
        Tolerance { corners: &self.corners, distance }
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
        let (options, tolerance) = self.options(prepared)?;
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
        let run::Clustering { initial, labels, shapes, energies, ending } =
            run::cluster(faces, &options, cancel, &mut on_step)?;
        Ok(Clustered {
            device: device.clone(),
            clusters: shapes.len(),
            labels,
            initial: Some(initial),
            tree: None,
            iterations: iterations.rows,
            levels: Vec::new(),
            warnings: super::flat::warnings(parameters.max_iterations, ending, &record),
            snapshots: record,
            shapes: Some(Fitted { shapes, energies: energies.map(|energy| self.energy(energy)), tolerance }),
            upload: Duration::ZERO,
            cluster: started.elapsed(),
        })
    }

    fn options<'a>(&'a self, prepared: &'a Prepared) -> Result<(Options<'a>, Option<TakenTolerance>)> {
        let Clustering::Shapes(spec) = &prepared.spec.clustering else {
            return Err(Error::new(error::Kind::Internal, "a job of shapes has another clustering"));
        };
        let on_lattice = |length: Length| self.surface.on_lattice(|diagonal| length.share_of(diagonal));
        let (wanted, tolerance) = match spec.wanted {
            WantedShapes::Clusters(clusters) => (Wanted::Clusters(clusters as usize), None),
            WantedShapes::Within(asked) => {
                let distance = on_lattice(asked);
                let tolerance = TakenTolerance { asked, distance };
                (Wanted::Within(self.within(distance)), Some(tolerance))
            }
        };
        let options = Options {
            wanted,
            kinds: spec.kinds.clone(),
            resolution: spec.resolution.map_or(0.0, on_lattice),
            most_steps: prepared.spec.reported().max_iterations,
        };
        Ok((options, tolerance))
    }
}
