//! A surface on the device: its buffers, the bind groups over them, and the sizes of dispatches.

use std::cell::RefCell;
use std::collections::HashMap;
use std::sync::Arc;

use bytemuck::Zeroable;

use super::FaultPoint;
use super::buffers::{BATCH, Buffer, Sizes};
use super::connection::Connection;
use super::kernels::{self, Items, Kernel};
use super::layout::{Iteration, IterationStats};
use super::pages::Pages;
use super::prepare;
use super::upload::{upload, upload_graph};
use crate::device::KernelWork;
use crate::device::dual_edge::Ties;
use crate::energy::Words;
use crate::error::{Error, Result};
use crate::surface::{DualGraph, MOST_FACES};

/// The entry of the statistics of what is done between batches.
pub(super) const BETWEEN: u32 = BATCH;

/// The same of what is done before a batch, or before that.
pub(super) const BEFORE: u32 = BATCH + 1;

/// Entries of the statistics, and uniforms.
const ENTRIES: u32 = BATCH + 2;

/// Of this many listed faces, one has a thread as a mover.
const MOVERS_OF: u32 = 4;

/// Numbers that the kernels of a submission see.
#[derive(Debug, Clone, Copy)]
pub(super) struct Numbers {
    /// The number of its first iteration.
    pub first: u32,
    /// That of the first one of the phase.
    pub phase_from: u32,
    /// Its iterations.
    pub iterations: u32,
    /// Entries of a list.
    pub entries: u32,
    /// The order of equally cheap edges.
    pub ties: Ties,
    /// Whether faces that moved since the last merge stay listed.
    pub keeps_moved: bool,
}

impl Numbers {
    /// Of a submission with neither iterations nor a list.
    pub(super) const NONE: Self =
        Self { first: 1, phase_from: 1, iterations: 0, entries: 0, ties: Ties::Hash, keeps_moved: false };
}

/// A surface on the device.
#[derive(Debug)]
pub(super) struct SurfaceMemory {
    /// By number of the [`Buffer`].
    storage: Vec<Pages>,
    /// Whether these have pages.
    is_paged: bool,
    /// What kernels see before a batch, between batches, and in each iteration: a uniform, at different offsets.
    iterations: wgpu::Buffer,
    /// The same, as kernels bind it.
    iteration_group: wgpu::BindGroup,
    /// Bytes from one of those to the next.
    stride: u32,
    /// What all iterations have in common.
    common: Iteration,
    /// Numbers that the lengths of buffers depend on.
    sizes: Sizes,
    /// Whether clusters may merge, which takes more buffers; others have room for one item.
    pub(super) is_merging: bool,
    /// Faces on the boundary list when the host last read that; all of them before.
    pub(super) listed: u32,
    /// Pipelines and buffers of kernels that were dispatched, by name.
    bound: RefCell<HashMap<&'static str, (wgpu::ComputePipeline, wgpu::BindGroup)>>,
}

impl SurfaceMemory {
    /// Uploads a surface, without clusters and labels. Errors: the surface exceeds a limit of the device
    /// ([`DeviceUnsuitable`](crate::Kind)), or there is no memory for it ([`DeviceLost`](crate::Kind)). With `is_paged`
    /// buffers have pages in any case, and kernels with pages must be compiled.
    pub(super) fn new<E: Words>(
        connection: &Arc<Connection>,
        graph: &DualGraph<E>,
        is_merging: bool,
        is_paged: bool,
    ) -> Result<Self> {
        check_counts(connection, graph)?;
        let sizes = Sizes {
            axes: E::AXES,
            faces: graph.faces() as u64,
            neighbours: graph.neighbours.items.len() as u64,
            clusters: 0,
            face_groups: graph.faces().div_ceil(connection.tuning.workgroup as usize) as u64,
        };
        connection.reach(FaultPoint::Upload);
        let stride =
            (size_of::<Iteration>() as u32).next_multiple_of(connection.limits.min_uniform_buffer_offset_alignment);
        let bytes = u64::from(ENTRIES) * u64::from(stride);
        let iterations =
            connection.buffer("iterations", bytes, wgpu::BufferUsages::UNIFORM | wgpu::BufferUsages::COPY_DST)?;
        let common = Iteration { faces: sizes.faces as u32, ..Iteration::zeroed() };
        let mut memory = Self {
            storage: Vec::new(),
            is_paged,
            iteration_group: iteration_group(connection, &iterations),
            iterations,
            stride,
            common,
            sizes,
            is_merging,
            listed: common.faces,
            bound: RefCell::default(),
        };
        memory.allocate(connection, graph, sizes)?;
        connection.check()?;
        Ok(memory)
    }

    /// Makes room for clusters with these numbers, none of which has a face yet; the component of each comes with them.
    /// Errors as of [`new`](Self::new).
    pub(super) fn set_clusters<E: Words>(
        &mut self,
        connection: &Arc<Connection>,
        graph: &DualGraph<E>,
        numbers: &[u32],
        component_of_cluster: &[u32],
    ) -> Result<()> {
        let proxies = proxies(graph, component_of_cluster)?;
        let clusters = numbers.len() as u64;
        if clusters > self.sizes.clusters {
            self.allocate(connection, graph, Sizes { clusters, ..self.sizes })?;
        }
        upload(connection, self.get(Buffer::Proxies), &proxies);
        if self.is_merging {
            upload(connection, self.get(Buffer::ClusterNumbers), numbers);
        }
        connection.check()
    }

    /// Creates the buffers whose sizes have changed: all of them, and uploads the graph, for a new surface and where
    /// the first of them exceeds a binding.
    fn allocate<E: Words>(&mut self, connection: &Arc<Connection>, graph: &DualGraph<E>, sizes: Sizes) -> Result<()> {
        let needed = kernels::needed(self.is_merging);
        let bindings = connection.bindings;
        if !bindings.hold_whole(&needed, &sizes) && !self.is_paged && bindings.pages > 1 {
            prepare::<E>(connection, true)?;
            self.is_paged = true;
            self.storage.clear();
        }
        self.bound.get_mut().clear();
        self.sizes = sizes;
        let is_new = self.storage.is_empty();
        for &buffer in Buffer::ALL {
            let items = items_of(buffer, &needed, &sizes);
            let bytes = self.bytes_of_pages(connection, buffer, items)?;
            let create = |bytes: &u64| storage(connection, buffer.spec().name, *bytes);
            if is_new {
                self.storage.push(Pages::new(bytes.iter().map(create).collect::<Result<_>>()?));
            } else if bytes.iter().sum::<u64>() != self.storage[buffer as usize].bytes() {
                self.storage[buffer as usize] = Pages::new(bytes.iter().map(create).collect::<Result<_>>()?);
            }
        }
        if is_new {
            upload_graph(connection, graph, self.get(Buffer::Faces), self.get(Buffer::Neighbours))?;
        }
        Ok(())
    }

    /// Bytes of each page of a buffer of so many items. Refuses more pages than a kernel binds.
    fn bytes_of_pages(&self, connection: &Connection, buffer: Buffer, items: u64) -> Result<Vec<u64>> {
        let (spec, axes) = (buffer.spec(), self.sizes.axes);
        let page = if self.is_paged { connection.bindings.page(&spec, axes) } else { items };
        let pages = items.div_ceil(page);
        if self.is_paged && pages > connection.bindings.pages {
            let most = connection.bindings.pages * page * (spec.stride)(axes) as u64;
            return Err(too_large(connection, spec.name, most, spec.bytes_of(items, axes)));
        }
        Ok((0..pages).map(|at| spec.bytes_of(page.min(items - at * page), axes)).collect())
    }

    /// A storage buffer.
    pub(super) fn get(&self, buffer: Buffer) -> &Pages {
        &self.storage[buffer.memory() as usize]
    }

    /// Items that a buffer has room for.
    pub(super) fn capacity(&self, buffer: Buffer) -> usize {
        self.get(buffer).bytes() as usize / (buffer.spec().stride)(self.sizes.axes)
    }

    /// Number of faces.
    pub(super) fn faces(&self) -> u32 {
        self.common.faces
    }

    /// Lets kernels with a thread a cluster go over these only.
    pub(super) fn list_clusters(&mut self, connection: &Connection, living: &[u32]) {
        upload(connection, self.get(Buffer::LivingClusters), living);
        self.common.clusters = living.len() as u32;
    }

    /// Sets the numbers of the next submission. With `is_listed_anew`, what it does [before](BEFORE) a batch makes the
    /// boundary list, in the half that is not in use.
    pub(super) fn number(&mut self, queue: &wgpu::Queue, numbers: Numbers, is_listed_anew: bool) {
        self.common.batch = self.common.batch.wrapping_add(1).max(1);
        self.common.entries = numbers.entries;
        self.common.prefers_largest_id = u32::from(numbers.ties == Ties::LargestId);
        self.common.keeps_moved = u32::from(numbers.keeps_moved);
        let before = Iteration { slot: BEFORE, between: 1, ..self.common };
        self.common.half ^= u32::from(is_listed_anew);
        let between = Iteration { slot: BETWEEN, between: 1, ..self.common };
        let iteration = |slot| {
            let number = numbers.first + slot;
            Iteration { slot, number, in_phase: number - numbers.phase_from + 1, ..self.common }
        };
        let all = [before, between].into_iter().chain((0..numbers.iterations).map(iteration));
        let stride = self.stride as usize;
        let mut bytes = vec![0u8; stride * (2 + numbers.iterations as usize)];
        for (entry, iteration) in bytes.chunks_mut(stride).zip(all) {
            entry[..size_of::<Iteration>()].copy_from_slice(bytemuck::bytes_of(&iteration));
        }
        queue.write_buffer(&self.iterations, 0, &bytes);
    }

    /// Which half of the boundary list is in use.
    pub(super) fn half(&self) -> usize {
        self.common.half as usize
    }

    /// Encodes one dispatch of a kernel: in an iteration of a batch, [`BETWEEN`] batches, or [`BEFORE`] one.
    pub(super) fn dispatch(
        &self,
        connection: &Connection,
        pass: &mut wgpu::ComputePass<'_>,
        kernel: &Kernel,
        slot: u32,
    ) {
        // the statistics of a batch have the lengths of its lists
        let is_in_batch = slot < BATCH;
        let work = if is_in_batch { KernelWork::default() } else { self.work(kernel, &IterationStats::zeroed()) };
        connection.count(kernel.name, KernelWork { dispatches: 1, ..work });
        let mut bound = self.bound.borrow_mut();
        let (pipeline, bind_group) = bound.entry(kernel.name).or_insert_with(|| self.bind(connection, kernel));
        let place = match slot {
            BEFORE => 0,
            BETWEEN => 1,
            slot => slot + 2,
        };
        pass.set_pipeline(pipeline);
        pass.set_bind_group(0, &self.iteration_group, &[place * self.stride]);
        pass.set_bind_group(1, &*bind_group, &[]);
        pass.dispatch_workgroups(self.groups(connection, kernel), 1, 1);
    }

    /// What a kernel does in an iteration; without statistics, between batches.
    pub(super) fn work(&self, kernel: &Kernel, stats: &IterationStats) -> KernelWork {
        let listed = if stats.listed > 0 { stats.listed } else { self.listed };
        kernel.work(&self.common, &IterationStats { listed, ..*stats })
    }

    /// Workgroups of a dispatch. Threads go over all items, however many workgroups there are.
    pub(super) fn groups(&self, connection: &Connection, kernel: &Kernel) -> u32 {
        let movers = self.listed / MOVERS_OF;
        let expected = IterationStats { listed: self.listed, movers, ..IterationStats::zeroed() };
        let threads = match kernel.parts[0].items {
            _ if kernel.is_chain() => 1,
            Items::EntriesAtOnce => 1,
            Items::FaceRuns => self.common.faces.div_ceil(connection.tuning.run),
            items => items.count(&self.common, &expected),
        };
        threads.div_ceil(connection.tuning.workgroup).clamp(1, connection.limits.max_compute_workgroups_per_dimension)
    }

    fn bind(&self, connection: &Connection, kernel: &Kernel) -> (wgpu::ComputePipeline, wgpu::BindGroup) {
        let bindings = kernel.bindings();
        let bound = bindings.iter().map(|binding| self.get(binding.buffer).bound(self.is_paged));
        let bound: Vec<Vec<_>> = bound.collect();
        let resources = bound.iter().map(|pages| match &pages[..] {
            [whole] => wgpu::BindingResource::Buffer(whole.clone()),
            pages => wgpu::BindingResource::BufferArray(pages),
        });
        let (layout, pipeline) = connection.pipeline(kernel, self.sizes.axes, self.is_paged);
        (pipeline, connection.bind_group(kernel.name, &layout, resources))
    }
}

/// Binds the uniform, of which each dispatch chooses a place.
fn iteration_group(connection: &Connection, iterations: &wgpu::Buffer) -> wgpu::BindGroup {
    let iteration = wgpu::BindingResource::Buffer(wgpu::BufferBinding {
        buffer: iterations,
        offset: 0,
        size: wgpu::BufferSize::new(size_of::<Iteration>() as u64),
    });
    connection.bind_group("iteration", &connection.iteration_layout, [iteration])
}

/// Items of a buffer; one if it is not needed, or has the memory of another.
pub(super) fn items_of(buffer: Buffer, needed: &[Buffer], sizes: &Sizes) -> u64 {
    let has_memory = needed.contains(&buffer) && buffer.memory() == buffer;
    if has_memory { buffer.spec().items(sizes) } else { 1 }
}

/// The words of the proxies of clusters without faces.
fn proxies<E: Words>(graph: &DualGraph<E>, component_of_cluster: &[u32]) -> Result<Vec<u32>> {
    let (faces, clusters) = (graph.faces(), component_of_cluster.len());
    if clusters > faces {
        return Err(Error::internal(format_args!("{faces} faces cannot make {clusters} clusters")));
    }
    let mut proxies = Vec::with_capacity(clusters * (E::AXES + 1));
    for &component in component_of_cluster {
        let Some(component) = graph.components.get(component as usize) else {
            return Err(Error::internal(format_args!("a cluster lies in no component: {component}")));
        };
        proxies.extend(E::of_unfitted(component.energy_shift));
    }
    Ok(proxies)
}

/// Refuses more faces than threads can number in u32, and more neighbours than u32 can index behind the rows.
fn check_counts<E: Words>(connection: &Connection, graph: &DualGraph<E>) -> Result<()> {
    let (faces, both) = (graph.faces(), graph.faces() + 1 + graph.neighbours.items.len());
    for (what, found, limit) in
        [("faces", faces, MOST_FACES), ("faces and neighbours of faces", both, u32::MAX as usize)]
    {
        if found > limit {
            return Err(Error::unsuitable(format_args!(
                "the gpu {} takes at most {limit} {what}, use the cpu device: {found}",
                connection.name
            )));
        }
    }
    Ok(())
}

/// The error of a buffer for which so many bytes are too few.
fn too_large(connection: &Connection, name: &str, most: u64, bytes: u64) -> Error {
    Error::unsuitable(format_args!(
        "the mesh does not fit the gpu {}, use the cpu device: the buffer for its {} may have {most} bytes and needs \
         {bytes}",
        connection.name,
        name.replace('_', " ")
    ))
}

/// A storage buffer. Errors: it is larger than the device allows, or there is no memory.
pub(super) fn storage(connection: &Connection, name: &str, bytes: u64) -> Result<wgpu::Buffer> {
    let limit = connection.bindings.bytes;
    if bytes > limit {
        return Err(too_large(connection, name, limit, bytes));
    }
    let usage = wgpu::BufferUsages::STORAGE | wgpu::BufferUsages::COPY_DST | wgpu::BufferUsages::COPY_SRC;
    connection.buffer(name, bytes, usage)
}
