//! The buffers of a surface on the device, and the bind groups over them.

use std::mem::{offset_of, size_of};

use bytemuck::{Pod, Zeroable};

use super::FaultPoint;
use super::connection::{Compiled, Connection};
use super::fixed::Fixed;
use super::kernels::Access;
use super::layout::{
    Cluster, Dispatch, GATHER_RUN, Lists, Market, Offer, Proxy, Slot, TIES_BY_HASH, TIES_BY_LARGEST_ID, Turn, WORKGROUP,
};
use crate::cluster::dual_edge::Ties;
use crate::device::FREE;
use crate::error::{Error, Kind, Result};
use crate::surface::DualGraph;

/// Turns that fit into one batch.
pub(super) const RING: u32 = 64;

/// The turn, and the slot of the ring, of the state between batches.
pub(super) const BETWEEN: u32 = RING;

/// Words in front of the entries of the lists.
const LIST_HEAD: u64 = (offset_of!(Lists, entries) / 4) as u64;

/// Items that are brought to the device at once.
const UPLOAD: usize = 1 << 20;

/// A surface on the device.
#[derive(Debug)]
pub(super) struct Buffers {
    pub(super) faces: u32,
    pub(super) neighbours: wgpu::Buffer,
    pub(super) labels: wgpu::Buffer,
    pub(super) clusters: wgpu::Buffer,
    pub(super) proxies: wgpu::Buffer,
    /// Labels while they grow, and the trees of pieces.
    pub(super) wishes: wgpu::Buffer,
    /// Also the sizes of pieces.
    pub(super) offers: wgpu::Buffer,
    pub(super) markets: wgpu::Buffer,
    pub(super) origins: wgpu::Buffer,
    pub(super) lists: wgpu::Buffer,
    pub(super) turns: Turns,
    pub(super) ring: wgpu::Buffer,
    pub(super) next_dispatch: wgpu::Buffer,
    /// Where the ring is copied to, one for each of two batches in flight.
    pub(super) staging: [wgpu::Buffer; 2],
    pub(super) bindings: Bindings,
    /// Workgroups of a dispatch with a thread a face, a few faces a thread, a thread a cluster.
    pub(super) face_groups: Dispatch,
    pub(super) gather_groups: Dispatch,
    pub(super) cluster_groups: Dispatch,
}

/// What each kernel sees.
#[derive(Debug)]
pub(super) struct Bindings {
    /// From `labels` to `wishes`, and back.
    pub(super) grow: [wgpu::BindGroup; 2],
    pub(super) settle: wgpu::BindGroup,
    pub(super) enlist: wgpu::BindGroup,
    pub(super) weed: wgpu::BindGroup,
    pub(super) line_up: wgpu::BindGroup,
    pub(super) gather: wgpu::BindGroup,
    pub(super) propose: wgpu::BindGroup,
    pub(super) apply: wgpu::BindGroup,
    pub(super) fit: wgpu::BindGroup,
    pub(super) bid: wgpu::BindGroup,
    pub(super) choose: wgpu::BindGroup,
    pub(super) join: wgpu::BindGroup,
    pub(super) judge: wgpu::BindGroup,
    pub(super) deal: wgpu::BindGroup,
    pub(super) link: wgpu::BindGroup,
    pub(super) hook: wgpu::BindGroup,
    pub(super) weigh: wgpu::BindGroup,
    pub(super) elect: wgpu::BindGroup,
    pub(super) cut: wgpu::BindGroup,
}

/// What the turns of a batch know, and those between batches; a uniform that dispatches see at different offsets.
#[derive(Debug)]
pub(super) struct Turns {
    buffer: wgpu::Buffer,
    stride: u32,
    /// What all turns have in common.
    common: Turn,
}

impl Turns {
    /// Where a turn is in the buffer.
    pub(super) fn offset(&self, slot: u32) -> u32 {
        slot * self.stride
    }

    /// Numbers the turns of the next batch.
    pub(super) fn number(&self, queue: &wgpu::Queue, first: u32) {
        let stride = self.stride as usize;
        let mut bytes = vec![0u8; stride * (RING as usize + 1)];
        for (slot, entry) in (0..=RING).zip(bytes.chunks_mut(stride)) {
            let number = first.wrapping_add(slot);
            let turn = Turn { slot, number, forced: u32::from(slot == BETWEEN), ..self.common };
            entry[..size_of::<Turn>()].copy_from_slice(bytemuck::bytes_of(&turn));
        }
        queue.write_buffer(&self.buffer, 0, &bytes);
    }

    /// Tells the next submission, between batches, how many entries the host's list has and what decides ties.
    pub(super) fn announce(&self, queue: &wgpu::Queue, entries: u32, ties: Ties) {
        let ties = match ties {
            Ties::Hash => TIES_BY_HASH,
            Ties::LargestId => TIES_BY_LARGEST_ID,
        };
        let turn = Turn { slot: BETWEEN, forced: 1, entries, ties, ..self.common };
        queue.write_buffer(&self.buffer, u64::from(self.offset(BETWEEN)), bytemuck::bytes_of(&turn));
    }

    /// The buffer, for bindings.
    pub(super) fn buffer(&self) -> &wgpu::Buffer {
        &self.buffer
    }
}

impl Buffers {
    /// Brings a surface to the device, all faces free.
    pub(super) fn new(connection: &Connection, graph: &DualGraph, energy_shifts: &[u32]) -> Result<Self> {
        let faces = graph.centroids.len() as u64;
        let clusters = energy_shifts.len() as u64;
        let storage = wgpu::BufferUsages::STORAGE;
        let (into, out) = (wgpu::BufferUsages::COPY_DST, wgpu::BufferUsages::COPY_SRC);
        let create = |what: &'static str, items: u64, size: usize, usage| {
            create(connection, what, items.max(1) * size as u64, usage)
        };
        check_groups(connection, graph)?;

        connection.reach(FaultPoint::Upload);
        let Fixed { faces: packed, neighbours } = Fixed::bring(connection, graph)?;
        let labels = create("labels", faces, 4, storage | into | out)?;
        let wishes = create("wishes", faces, 4, storage | into)?;
        let sums = create("clusters", clusters, size_of::<Cluster>(), storage | into)?;
        let proxies = create("proxies", clusters, size_of::<Proxy>(), storage | into)?;
        let offers = create("offers", faces, size_of::<Offer>(), storage)?;
        let origins = create("origins", faces, 4, storage | into | out)?;
        let lists = create("lists", LIST_HEAD + 2 * faces + clusters, 4, storage | into | out)?;
        let markets = create("markets", clusters, size_of::<Market>(), storage)?;
        let joining = create("joining", clusters, size_of::<Cluster>(), storage)?;
        let slots = u64::from(RING) + 1;
        let ring = create("ring", slots, size_of::<Slot>(), storage | into | out)?;
        let next_dispatch =
            create("next dispatch", 1, size_of::<Dispatch>(), storage | into | wgpu::BufferUsages::INDIRECT)?;
        let stride = connection.limits.min_uniform_buffer_offset_alignment.max(size_of::<Turn>() as u32);
        let row = connection.limits.max_compute_workgroups_per_dimension;
        let turns = Turns {
            buffer: create("turns", slots, stride as usize, wgpu::BufferUsages::UNIFORM | into)?,
            stride,
            common: Turn { faces: faces as u32, clusters: clusters as u32, row, ..Turn::zeroed() },
        };
        let mapped = wgpu::BufferUsages::MAP_READ | into;
        let staging = [
            create("staging", slots, size_of::<Slot>(), mapped)?,
            create("staging", slots, size_of::<Slot>(), mapped)?,
        ];
        connection.check()?;

        let queue = &connection.queue;
        let positions: Vec<Proxy> = energy_shifts.iter().map(|shift| [0, 0, 0, shift.cast_signed()]).collect();
        upload(queue, &proxies, 0, &positions);
        set_free(connection, &labels, &origins, graph.centroids.len());

        let bind = |compiled: &Compiled, storage: &[&wgpu::Buffer]| bind(connection, compiled, &turns.buffer, storage);
        let kernels = &connection.kernels;
        // between phases nobody wishes or offers: the search for pieces has its trees there, and their sizes
        let (parents, sizes) = (&wishes, &offers);
        let bindings = Bindings {
            grow: [
                bind(&kernels.grow, &[&neighbours, &labels, &wishes, &ring, &lists, &packed, &sums]),
                bind(&kernels.grow, &[&neighbours, &wishes, &labels, &ring, &lists, &packed, &sums]),
            ],
            settle: bind(&kernels.settle, &[&ring, &lists, &next_dispatch]),
            enlist: bind(&kernels.enlist, &[&neighbours, &labels, &origins, &lists]),
            weed: bind(&kernels.weed, &[&neighbours, &labels, &origins, &lists]),
            line_up: bind(&kernels.line_up, &[&lists, &next_dispatch]),
            gather: bind(&kernels.gather, &[&packed, &labels, &sums]),
            propose: bind(&kernels.propose, &[&packed, &neighbours, &labels, &proxies, &wishes, &sums, &lists]),
            apply: bind(&kernels.apply, &[&packed, &wishes, &labels, &sums, &ring, &neighbours, &origins, &lists]),
            fit: bind(&kernels.fit, &[&sums, &proxies, &markets, &ring, &next_dispatch, &lists]),
            bid: bind(&kernels.bid, &[&packed, &neighbours, &labels, &proxies, &sums, &markets, &offers, &lists]),
            choose: bind(&kernels.choose, &[&labels, &offers, &markets, &ring, &lists]),
            join: bind(&kernels.join, &[&packed, &labels, &offers, &markets, &joining, &neighbours, &origins, &lists]),
            judge: bind(&kernels.judge, &[&packed, &sums, &joining, &proxies, &markets, &ring, &next_dispatch, &lists]),
            deal: bind(&kernels.deal, &[&labels, &offers, &markets, &lists]),
            link: bind(&kernels.link, &[&neighbours, &labels, &sums, parents, sizes]),
            hook: bind(&kernels.hook, &[&neighbours, &labels, parents]),
            weigh: bind(&kernels.weigh, &[&labels, parents, sizes, &markets]),
            elect: bind(&kernels.elect, &[&labels, parents, sizes, &markets, &sums]),
            cut: bind(&kernels.cut, &[parents, &markets, &labels, &ring, &packed, &sums, &origins, &lists]),
        };
        connection.check()?;

        let mut buffers = Self {
            faces: faces as u32,
            neighbours,
            labels,
            clusters: sums,
            proxies,
            wishes,
            offers,
            markets,
            origins,
            lists,
            turns,
            ring,
            next_dispatch,
            staging,
            bindings,
            face_groups: groups(faces, row),
            gather_groups: groups(faces.div_ceil(u64::from(GATHER_RUN)), row),
            cluster_groups: groups(clusters, row),
        };
        let all: Vec<u32> = (0..clusters as u32).collect();
        buffers.list_clusters(queue, &all);
        Ok(buffers)
    }

    /// Lets dispatches with a thread a cluster go over these only.
    pub(super) fn list_clusters(&mut self, queue: &wgpu::Queue, living: &[u32]) {
        upload(queue, &self.lists, LIST_HEAD as usize + 2 * self.faces as usize, living);
        self.turns.common.clusters = living.len() as u32;
        self.cluster_groups = groups(living.len() as u64, self.turns.common.row);
        self.turns.number(queue, 1);
    }
}

/// Writes items to a buffer, so many at a time that wgpu's copies of them stay small.
pub(super) fn upload<T: Pod>(queue: &wgpu::Queue, buffer: &wgpu::Buffer, first: usize, items: &[T]) {
    let mut at = first * size_of::<T>();
    for chunk in items.chunks(UPLOAD) {
        let bytes: &[u8] = bytemuck::cast_slice(chunk);
        queue.write_buffer(buffer, at as u64, bytes);
        // wgpu keeps its copy until a submission takes it along
        queue.submit([]);
        at += bytes.len();
    }
}

/// Makes all faces free: writes that for some, and doubles it on the device, to and fro between both buffers.
fn set_free(connection: &Connection, labels: &wgpu::Buffer, origins: &wgpu::Buffer, faces: usize) {
    /// Faces that it is written for.
    const WRITTEN: usize = 1 << 12;
    let mut free = faces.min(WRITTEN);
    upload(&connection.queue, labels, 0, &vec![FREE; free]);
    let mut encoder = connection.device.create_command_encoder(&wgpu::CommandEncoderDescriptor::default());
    loop {
        encoder.copy_buffer_to_buffer(labels, 0, origins, 0, 4 * free as u64);
        let more = free.min(faces - free);
        if more == 0 {
            break;
        }
        encoder.copy_buffer_to_buffer(origins, 0, labels, 4 * free as u64, 4 * more as u64);
        free += more;
    }
    connection.queue.submit([encoder.finish()]);
}

/// Workgroups for so many threads, in rows of `row`.
pub(super) fn groups(threads: u64, row: u32) -> Dispatch {
    let groups = threads.div_ceil(u64::from(WORKGROUP)).max(1);
    let rows = groups.div_ceil(u64::from(row));
    [groups.min(u64::from(row)) as u32, rows as u32, 1]
}

/// Refuses more faces than can be counted in u32 by the threads of a dispatch, whose last row may be half empty, and more
/// neighbours than can be with them.
pub(super) fn check_groups(connection: &Connection, graph: &DualGraph) -> Result<()> {
    let (faces, neighbours) = (graph.centroids.len() as u64, graph.neighbours.len() as u64);
    let row = u64::from(connection.limits.max_compute_workgroups_per_dimension);
    let limit = (row * row * u64::from(WORKGROUP)).min(1 << 31);
    if faces > limit {
        return Err(Error::new(
            Kind::DeviceUnsuitable,
            format_args!("the gpu {} takes at most {limit} faces, use the cpu device: {faces}", connection.name()),
        ));
    }
    let limit = u64::from(u32::MAX);
    if faces + 1 + neighbours > limit {
        return Err(Error::new(
            Kind::DeviceUnsuitable,
            format_args!(
                "the gpu {} takes at most {limit} faces and neighbours of faces, use the cpu device: {faces} and {neighbours}",
                connection.name()
            ),
        ));
    }
    Ok(())
}

/// A buffer. Fails when it is larger than the device allows, and when there is no memory for it.
pub(super) fn create(
    connection: &Connection,
    what: &'static str,
    bytes: u64,
    usage: wgpu::BufferUsages,
) -> Result<wgpu::Buffer> {
    let limits = &connection.limits;
    let limit = if usage.contains(wgpu::BufferUsages::STORAGE) {
        limits.max_storage_buffer_binding_size.min(limits.max_buffer_size)
    } else {
        limits.max_buffer_size
    };
    if bytes > limit {
        return Err(Error::new(
            Kind::DeviceUnsuitable,
            format_args!(
                "the mesh does not fit the gpu {}, use the cpu device: the buffer for its {what} may have {limit} bytes \
                 and needs {bytes}",
                connection.name()
            ),
        ));
    }
    connection.buffer(&wgpu::BufferDescriptor { label: Some(what), size: bytes, usage, mapped_at_creation: false })
}

/// Binds `turns` and, in the order of the kernel's table, its storage buffers.
pub(super) fn bind(
    connection: &Connection,
    compiled: &Compiled,
    turns: &wgpu::Buffer,
    storage: &[&wgpu::Buffer],
) -> wgpu::BindGroup {
    let mut storage = storage.iter();
    let entries: Vec<_> = (0..)
        .zip(compiled.kernel.bindings)
        .filter_map(|(at, binding)| {
            let resource = match binding.access {
                Access::Turn => wgpu::BindingResource::Buffer(wgpu::BufferBinding {
                    buffer: turns,
                    offset: 0,
                    size: wgpu::BufferSize::new(size_of::<Turn>() as u64),
                }),
                Access::Read | Access::Write => storage.next()?.as_entire_binding(),
            };
            Some(wgpu::BindGroupEntry { binding: at, resource })
        })
        .collect();
    connection.device.create_bind_group(&wgpu::BindGroupDescriptor {
        label: Some(compiled.kernel.name),
        layout: &compiled.layout,
        entries: &entries,
    })
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
            assert_eq!(groups(threads, row), expected);
        }
    }
}
