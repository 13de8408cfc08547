//! What a job clusters: the faces of a mesh, or points of any number of coordinates.

use super::flat::Job;
use super::plan::plan;
use super::watched::Watched;
use super::{Clustered, Clustering, InputFile, JobSpec, Plan, Prepared, Refusal, Shaped, flat, hierarchical};
use crate::data::{Members, PointSet};
use crate::device::cpu::CpuDevice;
use crate::device::{Cancel, Device};
use crate::energy::{Functional, Normals, OfPoints, Words};
use crate::error::{Error, Result};
use crate::mesh::MeshView;
use crate::report::{DeviceKind, Row};
use crate::surface::{Items, Surface};

/// What is clustered, and how to go about it.
#[derive(Debug)]
pub enum Subject {
    /// The faces of a mesh, or its vertices.
    Mesh(Box<Surface>, Plan),
    /// The faces of a mesh by their normals.
    Normals(Box<Surface<Normals>>, Plan<Normals>),
    /// The faces of a mesh beside shapes.
    Shapes(Box<Shaped>),
    /// Points with neighbours.
    Points(Box<Points>),
}

/// Points with neighbours, and how to go about them.
#[derive(Debug)]
pub struct Points {
    /// As they were uploaded.
    pub set: PointSet,
    /// Those that take part.
    pub members: Members,
    /// On the lattice.
    pub planned: Width,
}

/// Items whose points have room for so many coordinates. Those beyond the points' own are 0.
#[derive(Debug)]
#[allow(clippy::large_enum_variant, reason = "there is one a job, in a box")]
pub enum Width {
    /// Up to 3.
    D3(Planned<OfPoints<3>>),
    /// Up to 8.
    D8(Planned<OfPoints<8>>),
    /// Up to 64.
    D64(Planned<OfPoints<64>>),
}

/// Items, and how to go about them.
#[derive(Debug)]
pub struct Planned<E: Functional> {
    /// The lattice and the neighbours.
    pub items: Items<E>,
    /// How to go about them.
    pub plan: Plan<E>,
}

/// Evaluates an expression with what is planned, whatever its width.
macro_rules! with_planned {
    ($width:expr, |$planned:ident| $body:expr) => {
        match $width {
            $crate::job::Width::D3($planned) => $body,
            $crate::job::Width::D8($planned) => $body,
            $crate::job::Width::D64($planned) => $body,
        }
    };
}
pub(super) use with_planned;

/// Evaluates an expression with the items of a subject, whatever their energy.
macro_rules! with_items {
    ($subject:expr, |$items:ident| $body:expr) => {
        match $subject {
            $crate::job::Subject::Mesh(surface, _) => {
                let $items = &surface.items;
                $body
            }
            $crate::job::Subject::Normals(surface, _) => {
                let $items = &surface.items;
                $body
            }
            $crate::job::Subject::Shapes(shaped) => {
                let $items = &shaped.surface.items;
                $body
            }
            $crate::job::Subject::Points(points) => $crate::job::subject::with_planned!(&points.planned, |planned| {
                let $items = &planned.items;
                $body
            }),
        }
    };
}
pub(super) use with_items;

/// The faces of a mesh as the energy of a job sees them, before it is planned.
#[derive(Debug)]
pub(super) enum Seen {
    /// By their places.
    Mesh(Box<Surface>),
    /// By their normals.
    Normals(Box<Surface<Normals>>),
    /// Beside shapes.
    Shapes(Box<Shaped>),
}

impl Seen {
    pub fn of(surface: Surface, mesh: MeshView<'_>, spec: &JobSpec) -> Result<Self, Refusal> {
        if spec.energy.is_of_shapes() {
            let shaped = Shaped::new(surface, mesh, &spec.clustering);
            return Ok(Self::Shapes(Box::new(shaped.map_err(Refusal::of(InputFile::Mesh))?)));
        }
        Ok(match spec.energy.is_of_normals() {
            true => Self::Normals(Box::new(surface.with_normals(mesh).seen_by(spec.moves()))),
            false => Self::Mesh(Box::new(surface)),
        })
    }

    /// Chooses how to go about them.
    pub fn planned(self, clustering: &Clustering) -> Result<Subject, Refusal> {
        Ok(match self {
            Self::Mesh(surface) => {
                let plan = plan(&surface.items, clustering)?;
                Subject::Mesh(surface, plan)
            }
            Self::Normals(surface) => {
                let plan = plan(&surface.items, clustering)?;
                Subject::Normals(surface, plan)
            }
            Self::Shapes(shaped) => Subject::Shapes(shaped),
        })
    }
}

impl Subject {
    /// Number of items that are clustered.
    pub fn items(&self) -> usize {
        with_items!(self, |items| items.faces())
    }

    /// Number of clusters that a hierarchy ends with.
    pub fn target(&self) -> Option<u64> {
        match self {
            Self::Mesh(_, plan) => plan.target(),
            Self::Normals(_, plan) => plan.target(),
            Self::Shapes(shaped) => shaped.target,
            Self::Points(points) => with_planned!(&points.planned, |planned| planned.plan.target()),
        }
    }

    /// The surface, of a mesh whose faces are seen by their places.
    pub fn mesh(&self) -> Option<&Surface> {
        match self {
            Self::Mesh(surface, _) => Some(surface),
            Self::Normals(..) | Self::Shapes(_) | Self::Points(_) => None,
        }
    }

    /// Feature edges of a mesh that have one cluster on both sides; labels in internal order.
    pub(super) fn feature_edges_inside(&self, labels: &[u32]) -> u64 {
        match self {
            Self::Mesh(surface, _) => surface.feature_edges_inside(labels),
            Self::Normals(surface, _) => surface.feature_edges_inside(labels),
            Self::Shapes(shaped) => shaped.surface.feature_edges_inside(labels),
            Self::Points(_) => 0,
        }
    }

    /// Whether only the cpu has code for it.
    pub fn is_for_cpu(&self) -> bool {
        match self {
            Self::Mesh(..) | Self::Normals(..) | Self::Shapes(_) => false,
            Self::Points(points) => !matches!(points.planned, Width::D3(_) | Width::D8(_)),
        }
    }

    /// The points, of points.
    pub fn points(&self) -> Option<&Points> {
        match self {
            Self::Mesh(..) | Self::Normals(..) | Self::Shapes(_) => None,
            Self::Points(points) => Some(points),
        }
    }

    /// Labels of what takes part as labels of all that was read.
    pub(super) fn with_masked(&self, labels: Vec<u32>) -> Vec<u32> {
        match self {
            Self::Mesh(..) | Self::Normals(..) | Self::Shapes(_) => labels,
            Self::Points(points) => points.with_masked(labels),
        }
    }

    /// Goes about it in another way. On an error, nothing has changed.
    pub(super) fn replan(&mut self, clustering: &Clustering) -> Result<(), Refusal> {
        match self {
            Self::Mesh(surface, of_mesh) => *of_mesh = plan(&surface.items, clustering)?,
            Self::Normals(surface, of_mesh) => *of_mesh = plan(&surface.items, clustering)?,
            Self::Shapes(shaped) => shaped.replan(clustering).map_err(Refusal::of(InputFile::Mesh))?,
            Self::Points(points) => with_planned!(&mut points.planned, |planned| {
                planned.plan = plan(&planned.items, clustering)?;
            }),
        }
        Ok(())
    }

    /// Clusters it on a device, or on the cpu if only that has code for it.
    pub(super) fn cluster(
        &self,
        prepared: &Prepared,
        device: &mut dyn Device,
        cancel: &Cancel,
        on_row: &mut (dyn FnMut(Row) + Send),
    ) -> Result<Clustered> {
        if self.is_for_cpu() && device.info().kind == DeviceKind::Gpu {
            return Err(Error::unsuitable("the device must be cpu or auto for points of more than 8 coordinates"));
        }
        let mut cpu = CpuDevice::new();
        match self {
            Self::Mesh(surface, plan) => cluster(prepared, &surface.items, plan, device, cancel, on_row),
            Self::Normals(surface, plan) => {
                cluster(prepared, &surface.items, plan, like(device, &mut cpu), cancel, on_row)
            }
            Self::Shapes(shaped) => shaped.cluster(prepared, device, cancel, on_row),
            Self::Points(points) => match &points.planned {
                Width::D3(planned) => cluster(prepared, &planned.items, &planned.plan, device, cancel, on_row),
                Width::D8(planned) => {
                    cluster(prepared, &planned.items, &planned.plan, like(device, &mut cpu), cancel, on_row)
                }
                wider => with_planned!(wider, |planned| {
                    cluster(prepared, &planned.items, &planned.plan, &mut cpu, cancel, on_row)
                }),
            },
        }
    }
}

/// The device for points of another number of coordinates: a gpu itself, otherwise the cpu.
fn like<'a, E: Words>(device: &'a mut dyn Device, cpu: &'a mut CpuDevice) -> &'a mut dyn Device<E> {
    match device.as_gpu() {
        Some(gpu) => gpu,
        None => cpu,
    }
}

fn cluster<E: Functional>(
    prepared: &Prepared,
    items: &Items<E>,
    plan: &Plan<E>,
    device: &mut dyn Device<E>,
    cancel: &Cancel,
    on_row: &mut (dyn FnMut(Row) + Send),
) -> Result<Clustered> {
    let device =
        &mut Watched::new(device, items, prepared.viewer.as_deref(), prepared.spec.clustering.is_hierarchical());
    let job = Job { prepared, items };
    match plan {
        Plan::Coarse(coarse) => flat::run_coarse(job, coarse, device, cancel, on_row),
        Plan::Seeded(method, seeds, options) => flat::run_seeded(job, *method, seeds, *options, device, cancel, on_row),
        Plan::Hierarchy { options, target } => hierarchical::run(items, options, *target, device, cancel, on_row),
    }
}
