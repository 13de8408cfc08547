//! Clusterings by shapes on the device: proposals of moves ([`ShapeSteps`]).
//!
//! The device holds what does not change: neighbours and samples of faces. A call brings labels, shapes and a list of
//! faces along, and waits for its proposals. The kernel has buffers of its own, which no other kernel sees, so it is in
//! none of the tables; it is compiled when the first clustering by shapes begins.

use std::cell::Cell;
use std::sync::Arc;

use bytemuck::{cast_slice, pod_collect_to_vec};

use super::connection::Connection;
use super::memory::storage;
use super::pages::Pages;
use super::pipeline::{Compiled, with_own_layout};
use super::readback::read;
use super::upload::{upload, upload_rows};
use super::{FaultPoint, lock};
use crate::device::{KernelWork, ShapeSteps, ShapeWords};
use crate::energy::Functional;
use crate::error::Result;
use crate::surface::DualGraph;
use crate::surface::samples::Samples;

/// Name of the kernel and its passes.
const NAME: &str = "shape_propose";

/// The kernel.
pub const WGSL: &str = include_str!("../../../shaders/shapes/shape_propose.wgsl");

/// Threads of a workgroup of the kernel.
const WORKGROUP: u32 = 64;

/// The faces of a mesh on the device.
pub(super) struct GpuShapes {
    connection: Arc<Connection>,
    pipeline: Compiled,
    neighbours: Pages,
    samples: Pages,
    labels: Pages,
    listed: Pages,
    proposals: Pages,
    /// As many as there were clusters at most.
    shapes: Pages,
    /// What the host reads results through.
    host_buffer: Cell<Option<wgpu::Buffer>>,
}

impl GpuShapes {
    /// Uploads neighbours and samples. Errors are those of other surfaces.
    pub(super) fn new<E: Functional>(
        connection: Arc<Connection>,
        graph: &DualGraph<E>,
        samples: &Samples,
    ) -> Result<Self> {
        connection.reach(FaultPoint::Upload);
        let (faces, points) = (graph.faces(), cast_slice(samples.points()));
        let words = |name: &str, words: usize| storage(&connection, name, 4 * words as u64).map(Pages::from);
        let of_neighbours = words("neighbours", faces + 1 + graph.neighbours.items.len())?;
        let of_samples = words("samples", faces + 1 + points.len())?;
        upload_rows(&connection, &of_neighbours, &graph.neighbours.offsets, 1, &graph.neighbours.items)?;
        upload_rows(&connection, &of_samples, &samples.offsets, 3, points)?;
        let compiled = || with_own_layout(&connection.device, NAME, WGSL);
        let pipeline = lock(&connection.pipelines).entry((NAME, 0, false)).or_insert_with(compiled).clone();
        let steps = Self {
            pipeline,
            neighbours: of_neighbours,
            samples: of_samples,
            labels: words("labels", faces)?,
            listed: words("listed faces", faces)?,
            proposals: words("proposals", faces)?,
            shapes: words("shapes", size_of::<ShapeWords>() / 4)?,
            host_buffer: Cell::default(),
            connection,
        };
        steps.connection.check()?;
        Ok(steps)
    }
}

impl ShapeSteps for GpuShapes {
    fn propose(&mut self, labels: &[u32], shapes: &[ShapeWords], listed: &[u32]) -> Result<Vec<u32>> {
        let connection = &self.connection;
        connection.reach(FaultPoint::Boundary);
        if self.shapes.bytes() < size_of_val(shapes) as u64 {
            self.shapes = storage(connection, "shapes", size_of_val(shapes) as u64)?.into();
        }
        upload(connection, &self.labels, labels);
        upload(connection, &self.shapes, shapes);
        upload(connection, &self.listed, listed);
        let bytes = size_of_val(listed) as u64;
        let buffers = [&self.neighbours, &self.samples, &self.labels, &self.shapes, &self.listed, &self.proposals];
        let resources = buffers.map(Pages::first).map(|buffer| {
            // the kernel takes the number of listed faces from their size
            let size = if buffer == self.listed.first() { wgpu::BufferSize::new(bytes) } else { None };
            wgpu::BindingResource::Buffer(wgpu::BufferBinding { buffer, offset: 0, size })
        });
        let (layout, pipeline) = &self.pipeline;
        let bind_group = connection.bind_group(NAME, layout, resources);
        let mut encoder = connection.encoder();
        {
            let mut pass = connection.pass(&mut encoder, NAME);
            connection.count(NAME, KernelWork { dispatches: 1, items: listed.len() as u64, ..KernelWork::default() });
            let groups = (listed.len() as u32).div_ceil(WORKGROUP);
            pass.set_pipeline(pipeline);
            pass.set_bind_group(0, &bind_group, &[]);
            pass.dispatch_workgroups(groups.min(connection.limits.max_compute_workgroups_per_dimension), 1, 1);
        }
        read(connection, &self.host_buffer, encoder, &[(self.proposals.first(), 0, bytes)], pod_collect_to_vec)
    }
}
