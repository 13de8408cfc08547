//! Clusterings by shapes as jobs.

use std::cell::RefCell;
use std::time::{Duration, Instant};

use super::hierarchical::Levels;
use super::iterations::Iterations;
use super::on_device::instead_of_gpu;
use super::{Clustered, Clustering, Prepared, finite};
use crate::cluster::hierarchy::{self, RoundRow};
use crate::cluster::record::Record;
use crate::cluster::seeds;
use crate::device::cpu::CpuDevice;
use crate::device::{Cancel, Device, DeviceInfo, DeviceKind, Ending};
use crate::energy;
use crate::error::{Error, Result};
use crate::mesh::MeshView;
use crate::parameters::{Length, Parameters, Shapes};
use crate::report::{self, Iteration, Row};
use crate::shapes::faces::Faces;
use crate::shapes::kind::Kind;
use crate::shapes::merging::tree;
use crate::shapes::moves::Gpu;
use crate::shapes::proxy::ON_DEVICES;
use crate::shapes::run::{self, Options, Step, Wanted};
use crate::shapes::shape::Shape;
use crate::shapes::table::{ClusterShape, table};
use crate::shapes::tolerance::Tolerance;
use crate::surface::Surface;
use crate::surface::corners::Corners;
use crate::surface::samples::Samples;

/// Resolution where the caller gives none, a share of the diagonal.
pub const RESOLUTION: f64 = 3e-4;

/// A tolerance over the resolution, where the caller gives the tolerance alone.
const IN_TOLERANCE: f64 = 10.0;

/// The faces of a mesh as shapes see them.
#[derive(Debug)]
pub struct Shaped {
    /// Their places, weights and neighbours.
    pub surface: Surface,
    samples: Samples,
    corners: Corners,
    /// Number of clusters that a hierarchy ends with.
    pub target: Option<u64>,
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
#[derive(Debug, Clone, PartialEq)]
pub enum WantedShapes {
    /// So many.
    Clusters(u64),
    /// Few, such that all corners are within this distance.
    Within(Length),
    /// All numbers of a hierarchy.
    Tree(hierarchy::Options),
}

impl ShapesSpec {
    /// Fills in what the parameters leave out.
    pub(super) fn new(parameters: &mut Parameters, tree: Option<hierarchy::Options>) -> Result<Self> {
        let wanted = match (tree, parameters.tolerance) {
            (Some(options), _) => WantedShapes::Tree(options),
            (None, Some(tolerance)) => WantedShapes::Within(tolerance),
            (None, None) => WantedShapes::Clusters(parameters.flat_clusters()?),
        };
        if parameters.energy != energy::Kind::Shapes {
            let Shapes(kinds) = Shapes::planes();
            return Ok(Self { kinds, resolution: None, wanted });
        }
        let usual = parameters.tolerance.map_or(Length::Share(RESOLUTION), |tolerance| tolerance.over(IN_TOLERANCE));
        let resolution = Some(*parameters.resolution.get_or_insert(usual));
        let Shapes(kinds) = parameters.shapes.get_or_insert_default().clone();
        Ok(Self { kinds, resolution, wanted })
    }

    /// The number of clusters; none if a tolerance decides it, and for a whole hierarchy.
    pub fn clusters(&self) -> Option<u64> {
        match &self.wanted {
            WantedShapes::Clusters(clusters) => Some(*clusters),
            WantedShapes::Within(_) => None,
            WantedShapes::Tree(options) => options.clusters,
        }
    }

    /// What to build, of a hierarchy.
    pub fn tree(&self) -> Option<&hierarchy::Options> {
        match &self.wanted {
            WantedShapes::Tree(options) => Some(options),
            WantedShapes::Clusters(_) | WantedShapes::Within(_) => None,
        }
    }
}

/// The shapes that a run ends with.
#[derive(Debug)]
pub(super) struct LastShapes {
    /// One a cluster, in units of moments.
    pub shapes: Vec<Shape>,
    /// F before, if there was a flat clustering, and after; source units.
    pub energies: (Option<f64>, f64),
    /// How far corners may be from them.
    pub tolerance: Option<TakenTolerance>,
}

/// A tolerance as it was given, and in lattice units.
#[derive(Debug, Clone, Copy)]
pub(super) struct TakenTolerance {
    asked: Length,
    distance: f64,
}

/// The device of a job.
struct OpenedForShapes {
    gpu: Gpu,
    info: DeviceInfo,
    /// Why no gpu takes part, where that is known before the run.
    without_gpu: Option<&'static str>,
    upload: Duration,
}

impl OpenedForShapes {
    /// The device for the report, and a warning if a gpu took no part.
    fn reported(self) -> (DeviceInfo, Option<String>) {
        if self.info.kind != DeviceKind::Gpu || self.gpu.has_taken_part {
            return (self.info, None);
        }
        let why = self.without_gpu.unwrap_or("no pass over its faces was long enough for a gpu");
        (CpuDevice::new().info().clone(), Some(instead_of_gpu(why)))
    }
}

impl Shaped {
    /// Refuses numbers of clusters that the mesh cannot have.
    pub(super) fn new(surface: Surface, mesh: MeshView<'_>, clustering: &Clustering) -> Result<Self> {
        let corners = surface.corners(mesh);
        let surface = rayon::scope(|_| surface.with_normals(mesh));
        let samples = rayon::scope(|_| surface.samples(&corners));
        let mut shaped = Self { surface, samples, corners, target: None };
        shaped.replan(clustering)?;
        Ok(shaped)
    }

    pub(super) fn replan(&mut self, clustering: &Clustering) -> Result<()> {
        let items = &self.surface.items;
        let tree = clustering.tree_of_shapes();
        self.target = tree.map(|options| hierarchy::check(items, options)).transpose()?;
        match clustering.clusters().filter(|_| tree.is_none()) {
            Some(clusters) => seeds::shares(items, clusters).map(|_| ()),
            None => Ok(()),
        }
    }

    /// The shapes for the report. `labels` are those of the run, `number_of_cluster` what each became.
    pub(super) fn table(&self, fitted: &LastShapes, labels: &[u32], number_of_cluster: &[u32]) -> Vec<ClusterShape> {
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
        fitted: &LastShapes,
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
        self.surface.source_of_lattice(energy as f64, 0) / 3.0
    }

    /// Runs a job.
    pub(super) fn cluster(
        &self,
        prepared: &Prepared,
        device: &mut dyn Device,
        cancel: &Cancel,
        on_row: &mut dyn FnMut(Row),
    ) -> Result<Clustered> {
        if let Some(options) = prepared.spec.clustering.tree_of_shapes() {
            return self.hierarchy(prepared, options, device, cancel, on_row);
        }
        let mut opened = self.open(prepared, device)?;
        let started = Instant::now();
        let parameters = prepared.spec.reported();
        let (options, tolerance) = self.options(prepared)?;
        let mut iterations = Iterations::default();
        let mut record = Record::new(prepared.spec.snapshots.clone());
        let mut number = 0;
        let mut on_step = |step: Step, labels: &[u32]| {
            let row = self.iteration(number, None, step, started);
            on_row(Row::Iteration(row.clone()));
            iterations.add(row);
            if let Some(viewer) = prepared.viewer.as_ref().filter(|viewer| viewer.is_due()) {
                viewer.show(self.surface.in_upload_order(labels));
            }
            if record.wants(number) {
                record.keep(number, labels.to_vec());
            }
            number += 1;
        };
        let run::Clustering { initial, labels, shapes, energies, ending } =
            run::cluster(self.faces(), &options, &mut opened.gpu, cancel, &mut on_step)?;
        let (upload, (device, without_gpu)) = (opened.upload, opened.reported());
        let bounded = super::flat::warnings(parameters.max_iterations, ending, &record);
        Ok(Clustered {
            device,
            clusters: shapes.len(),
            labels,
            initial: Some(initial),
            tree: None,
            iterations: iterations.rows,
            levels: Vec::new(),
            warnings: bounded.into_iter().chain(without_gpu).collect(),
            snapshots: record,
            shapes: Some(LastShapes {
                shapes,
                energies: (Some(self.energy(energies[0])), self.energy(energies[1])),
                tolerance,
            }),
            upload,
            cluster: started.elapsed(),
        })
    }

    /// Runs a job that makes a hierarchy.
    fn hierarchy(
        &self,
        prepared: &Prepared,
        options: &hierarchy::Options,
        device: &mut dyn Device,
        cancel: &Cancel,
        on_row: &mut dyn FnMut(Row),
    ) -> Result<Clustered> {
        let mut opened = self.open(prepared, device)?;
        let started = Instant::now();
        let spec = self.spec(prepared)?;
        let input = tree::Input {
            surface: &self.surface,
            faces: self.faces(),
            kinds: &spec.kinds,
            resolution: self.resolution(spec),
            options,
        };
        let target = hierarchy::check(&self.surface.items, options)?;
        let mut levels = Levels::new(self.surface.faces() as u64, target);
        let (mut iterations, mut number) = (Iterations::default(), 0);
        let on_row = RefCell::new(on_row);
        let mut on_step = |round: u32, step: Step| {
            number += 1;
            let row = self.iteration(number, Some(round), step, started);
            (on_row.borrow_mut())(Row::Iteration(row.clone()));
            iterations.add(row);
        };
        let mut on_round = |row: RoundRow<f64>| {
            if let Some(level) = levels.add(&row, || finite(row.energy)) {
                (on_row.borrow_mut())(Row::Round(level));
            }
        };
        let tree::Hierarchy { tree, labels, shapes, energy, ending } =
            tree::hierarchy(input, &mut opened.gpu, cancel, &mut on_step, &mut on_round)?;
        let (upload, (device, without_gpu)) = (opened.upload, opened.reported());
        let bounded = (ending == Ending::WorkLimit).then(|| {
            "a bound on work was reached: many pairs merged in a round, or faces moved at levels alone; clusters with \
            long detours, or faces with very many neighbours, cause this"
                .to_owned()
        });
        Ok(Clustered {
            device,
            clusters: shapes.len(),
            labels,
            initial: None,
            tree: Some(tree),
            iterations: iterations.rows,
            levels: levels.rows,
            warnings: bounded.into_iter().chain(without_gpu).collect(),
            snapshots: Record::default(),
            shapes: Some(LastShapes { shapes, energies: (None, self.energy(energy)), tolerance: None }),
            upload,
            cluster: started.elapsed(),
        })
    }

    /// The gpu that takes part in a job: in passes of flat runs and at stops, without a tolerance.
    fn open(&self, prepared: &Prepared, device: &mut dyn Device) -> Result<OpenedForShapes> {
        let (started, spec) = (Instant::now(), self.spec(prepared)?);
        let without_gpu = match &spec.wanted {
            _ if !spec.kinds.iter().all(|kind| ON_DEVICES.contains(kind)) => Some("no gpu takes part with cones"),
            WantedShapes::Within(_) => Some("no gpu takes part with a tolerance"),
            WantedShapes::Tree(options) if !options.optimise => Some("no gpu takes part where no face moves"),
            WantedShapes::Clusters(_) | WantedShapes::Tree(_) => None,
        };
        let steps = match without_gpu {
            Some(_) => None,
            None => device.open_shapes(&self.surface.graph, &self.samples)?,
        };
        let gpu = Gpu { steps, ..Gpu::default() };
        Ok(OpenedForShapes { gpu, info: device.info().clone(), without_gpu, upload: started.elapsed() })
    }

    fn faces(&self) -> Faces<'_> {
        Faces { graph: &self.surface.graph, samples: &self.samples }
    }

    fn iteration(&self, number: u32, round: Option<u32>, step: Step, started: Instant) -> Iteration {
        Iteration {
            iteration: number,
            phase: step.phase,
            round,
            energy: finite(self.energy(step.energy)),
            moves: step.moves,
            elapsed_us: started.elapsed().as_micros() as u64,
        }
    }

    fn spec<'a>(&self, prepared: &'a Prepared) -> Result<&'a ShapesSpec> {
        match &prepared.spec.clustering {
            Clustering::Shapes(spec) => Ok(spec),
            _ => Err(Error::internal("a job of shapes has another clustering")),
        }
    }

    fn on_lattice(&self, length: Length) -> f64 {
        self.surface.on_lattice(|diagonal| length.share_of(diagonal))
    }

    fn resolution(&self, spec: &ShapesSpec) -> f64 {
        spec.resolution.map_or(0.0, |length| self.on_lattice(length))
    }

    fn options<'a>(&'a self, prepared: &'a Prepared) -> Result<(Options<'a>, Option<TakenTolerance>)> {
        let spec = self.spec(prepared)?;
        let (wanted, tolerance) = match spec.wanted {
            WantedShapes::Clusters(clusters) => (Wanted::Clusters(clusters as usize), None),
            WantedShapes::Within(asked) => {
                let distance = self.on_lattice(asked);
                let tolerance = TakenTolerance { asked, distance };
                (Wanted::Within(self.within(distance)), Some(tolerance))
            }
            WantedShapes::Tree(_) => {
                return Err(Error::internal("a hierarchy is no flat clustering"));
            }
        };
        let options = Options {
            wanted,
            kinds: spec.kinds.clone(),
            resolution: self.resolution(spec),
            most_steps: prepared.spec.reported().max_iterations,
        };
        Ok((options, tolerance))
    }
}
