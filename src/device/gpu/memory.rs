//! A surface on the device: its buffers, the bind groups over them, and the sizes of dispatches.

use std::cell::RefCell;
use std::collections::HashMap;
use std::mem::size_of;

use bytemuck::Zeroable;

use super::adapter::MOST_FACES;
use super::buffers::{BATCH, Buffer, Sizes};
use super::connection::Connection;
use super::kernels::{self, Kernel, Threads};
use super::layout::{Dispatch, Iteration};
use super::upload::{upload, upload_graph};
use super::{FaultPoint, Tuning};
use crate::device::dual_edge::Ties;
use crate::energy::words::Proxy;
use crate::error::{Error, Kind, Result};
use crate::surface::DualGraph;

/// The iteration, and the entry of the statistics, of what is done between batches.
pub(super) const BETWEEN: u32 = BATCH;

/// A surface on the device.
#[derive(Debug)]
pub(super) struct SurfaceMemory {
    /// By number of the [`Buffer`].
    storage: Vec<wgpu::Buffer>,
    /// The iterations of a batch and then the one between batches; a uniform that dispatches see at different offsets.
    iterations: wgpu::Buffer,
    /// Bytes from one iteration to the next.
    stride: u32,
    /// How threads are grouped.
    tuning: Tuning,
    /// What all iterations have in common.
    common: Iteration,
    /// Pipelines and buffers of kernels that were dispatched, by name.
    bound: RefCell<HashMap<&'static str, (wgpu::ComputePipeline, wgpu::BindGroup)>>,
}

impl SurfaceMemory {
    /// Uploads a surface, without labels. Errors: the surface exceeds a limit of the device
    /// ([`Kind::DeviceUnsuitable`]), or there is no memory for it ([`Kind::DeviceLost`]).
    pub(super) fn new(
        connection: &Connection,
        graph: &DualGraph,
        component_of_cluster: &[u32],
        is_merging: bool,
    ) -> Result<Self> {
        let proxies = proxies(graph, component_of_cluster)?;
        check_counts(connection, graph)?;
        let row = connection.limits.max_compute_workgroups_per_dimension;
        let tuning = connection.tuning;
        let [columns, rows, _] = groups(graph.faces() as u64, tuning.workgroup, row);
        let sizes = Sizes {
            faces: graph.faces() as u64,
            neighbours: graph.neighbours.len() as u64,
            clusters: proxies.len() as u64,
            face_groups: u64::from(columns) * u64::from(rows),
        };
        connection.reach(FaultPoint::Upload);
        let needed = kernels::needed(is_merging);
        let create = |buffer: &Buffer| create(connection, *buffer, needed.contains(buffer).then_some(&sizes));
        let storage = Buffer::ALL.iter().map(create).collect::<Result<Vec<_>>>()?;
        let stride = connection.limits.min_uniform_buffer_offset_alignment.max(size_of::<Iteration>() as u32);
        let bytes = u64::from(BATCH + 1) * u64::from(stride);
        let iterations =
            connection.buffer("iterations", bytes, wgpu::BufferUsages::UNIFORM | wgpu::BufferUsages::COPY_DST)?;
        let common = Iteration { faces: sizes.faces as u32, row, ..Iteration::zeroed() };
        let mut memory = Self { storage, iterations, stride, tuning, common, bound: RefCell::default() };
        upload_graph(connection, graph, memory.get(Buffer::Faces), memory.get(Buffer::Neighbours))?;
        upload(&connection.queue, memory.get(Buffer::Proxies), 0, &proxies);
        let all: Vec<u32> = (0..sizes.clusters as u32).collect();
        memory.list_clusters(&connection.queue, &all);
        connection.check()?;
        Ok(memory)
    }

    /// A storage buffer.
    pub(super) fn get(&self, buffer: Buffer) -> &wgpu::Buffer {
        &self.storage[buffer as usize]
    }

    /// Items that a buffer has room for.
    pub(super) fn capacity(&self, buffer: Buffer) -> usize {
        self.get(buffer).size() as usize / buffer.spec().stride
    }

    /// Number of faces.
    pub(super) fn faces(&self) -> u32 {
        self.common.faces
    }

    /// Lets dispatches with a thread a cluster go over these only.
    pub(super) fn list_clusters(&mut self, queue: &wgpu::Queue, living: &[u32]) {
        upload(queue, self.get(Buffer::LivingClusters), 0, living);
        self.common.clusters = living.len() as u32;
        self.number(queue, 1);
    }

    /// Numbers the iterations of the next batch.
    pub(super) fn number(&self, queue: &wgpu::Queue, first: u32) {
        let stride = self.stride as usize;
        let mut bytes = vec![0u8; stride * (BATCH as usize + 1)];
        for (slot, entry) in (0..=BATCH).zip(bytes.chunks_mut(stride)) {
            let number = first.wrapping_add(slot);
            let iteration = Iteration { slot, number, between: u32::from(slot == BETWEEN), ..self.common };
            entry[..size_of::<Iteration>()].copy_from_slice(bytemuck::bytes_of(&iteration));
        }
        queue.write_buffer(&self.iterations, 0, &bytes);
    }

    /// Sets, for the next submission between batches, the length of the host's list and the order of equally cheap
    /// edges.
    pub(super) fn announce(&mut self, queue: &wgpu::Queue, entries: u32, ties: Ties) {
        self.announce_for_batch(entries, ties);
        self.number(queue, 1);
    }

    /// The same for what is done after the next batch, in the same submission; before the batch is numbered.
    pub(super) fn announce_for_batch(&mut self, entries: u32, ties: Ties) {
        self.common.entries = entries;
        self.common.prefers_largest_id = u32::from(ties == Ties::LargestId);
    }

    /// Encodes one dispatch of a kernel, in an iteration of a batch or [`BETWEEN`] batches.
    pub(super) fn dispatch(
        &self,
        connection: &Connection,
        pass: &mut wgpu::ComputePass<'_>,
        kernel: &Kernel,
        slot: u32,
    ) {
        connection.count(kernel);
        let mut bound = self.bound.borrow_mut();
        let (pipeline, bind_group) = bound.entry(kernel.name).or_insert_with(|| self.bind(connection, kernel));
        pass.set_pipeline(pipeline);
        pass.set_bind_group(0, &*bind_group, &[slot * self.stride]);
        match self.groups(kernel.threads) {
            Some([x, y, z]) => pass.dispatch_workgroups(x, y, z),
            None => pass.dispatch_workgroups_indirect(self.get(Buffer::NextDispatch), 0),
        }
    }

    /// Workgroups of a dispatch; none if the device decides.
    fn groups(&self, threads: Threads) -> Option<Dispatch> {
        let Iteration { faces, clusters, row, entries, .. } = self.common;
        let items = match threads {
            Threads::One | Threads::Group => 1,
            Threads::Faces => faces,
            Threads::FaceRuns => faces.div_ceil(self.tuning.run),
            Threads::Clusters => clusters,
            Threads::Entries => entries,
            Threads::Listed => return None,
        };
        Some(groups(u64::from(items), self.tuning.workgroup, row))
    }

    fn bind(&self, connection: &Connection, kernel: &Kernel) -> (wgpu::ComputePipeline, wgpu::BindGroup) {
        let iteration = wgpu::BindingResource::Buffer(wgpu::BufferBinding {
            buffer: &self.iterations,
            offset: 0,
            size: wgpu::BufferSize::new(size_of::<Iteration>() as u64),
        });
        let bindings = kernel.bindings();
        let storage = bindings.iter().map(|binding| self.get(binding.buffer).as_entire_binding());
        let entries: Vec<_> = (0..)
            .zip(std::iter::once(iteration).chain(storage))
            .map(|(binding, resource)| wgpu::BindGroupEntry { binding, resource })
            .collect();
        let (layout, pipeline) = connection.pipeline(kernel);
        let bind_group = connection.device.create_bind_group(&wgpu::BindGroupDescriptor {
            label: Some(kernel.name),
            layout: &layout,
            entries: &entries,
        });
        (pipeline, bind_group)
    }
}

/// The proxies of clusters without faces.
fn proxies(graph: &DualGraph, component_of_cluster: &[u32]) -> Result<Vec<Proxy>> {
    let (faces, clusters) = (graph.faces(), component_of_cluster.len());
    if clusters == 0 || clusters > faces {
        return Err(Error::new(Kind::Internal, format_args!("{faces} faces cannot make {clusters} clusters")));
    }
    let proxy = |&component: &u32| match graph.components.get(component as usize) {
        Some(component) => Ok(Proxy::unfitted(component.energy_shift)),
        None => Err(Error::new(Kind::Internal, format_args!("a cluster lies in no component: {component}"))),
    };
    component_of_cluster.iter().map(proxy).collect()
}

/// Workgroups of `size` for so many threads, in rows of `row`.
fn groups(threads: u64, size: u32, row: u32) -> Dispatch {
    let groups = threads.div_ceil(u64::from(size)).max(1);
    let rows = groups.div_ceil(u64::from(row));
    [groups.min(u64::from(row)) as u32, rows as u32, 1]
}

/// Refuses more faces than threads of a dispatch can number in u32, the last row half empty, and more neighbours than
/// u32 can index behind the rows.
fn check_counts(connection: &Connection, graph: &DualGraph) -> Result<()> {
    let (faces, neighbours) = (graph.faces() as u64, graph.neighbours.len() as u64);
    let row = u64::from(connection.limits.max_compute_workgroups_per_dimension);
    let threads = (row * row * u64::from(connection.tuning.workgroup)).min(MOST_FACES);
    for (what, found, limit) in
        [("faces", faces, threads), ("faces and neighbours of faces", faces + 1 + neighbours, u64::from(u32::MAX))]
    {
        if found > limit {
            return Err(Error::new(
                Kind::DeviceUnsuitable,
                format_args!("the gpu {} takes at most {limit} {what}, use the cpu device: {found}", connection.name),
            ));
        }
    }
    Ok(())
}

/// A storage buffer; of one item without sizes. Errors: it is larger than the device allows, or there is no memory.
fn create(connection: &Connection, buffer: Buffer, sizes: Option<&Sizes>) -> Result<wgpu::Buffer> {
    let spec = buffer.spec();
    let bytes = sizes.map_or(spec.stride as u64, spec.bytes);
    let limit = connection.limits.max_storage_buffer_binding_size.min(connection.limits.max_buffer_size);
    if bytes > limit {
        return Err(Error::new(
            Kind::DeviceUnsuitable,
            format_args!(
                "the mesh does not fit the gpu {}, use the cpu device: the buffer for its {} may have {limit} bytes \
                 and needs {bytes}",
                connection.name,
                spec.name.replace('_', " ")
            ),
        ));
    }
    let mut usage = wgpu::BufferUsages::STORAGE | wgpu::BufferUsages::COPY_DST | wgpu::BufferUsages::COPY_SRC;
    if buffer == Buffer::NextDispatch {
        usage |= wgpu::BufferUsages::INDIRECT;
    }
    connection.buffer(spec.name, bytes, usage)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn dispatches_cover_all_threads_within_the_limit() {
        for (threads, row, expected) in [
            (0, 65_535, [1, 1, 1]),
            (256, 65_535, [1, 1, 1]),
            (257, 65_535, [2, 1, 1]),
            (256 * 65_535, 65_535, [65_535, 1, 1]),
            (256 * 65_535 + 1, 65_535, [65_535, 2, 1]),
            (256 * 7, 3, [3, 3, 1]),
        ] {
            assert_eq!(groups(threads, 256, row), expected);
        }
    }
}
