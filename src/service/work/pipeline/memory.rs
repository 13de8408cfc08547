//! Memory for meshes: jobs wait for it, so that the process does not run out of it.
//!
//! A job reserves memory in two steps: for its files before they are read, and for its faces before the surface is
//! built. One job at a time is between the two, so that no two wait for memory that the other holds. A small mesh
//! reserves both at once and takes no turn. Results, made while the device works on the next job, are covered, too.

use std::sync::{Arc, OnceLock};

use tesserae_mesh::data::{Size, width};
use tesserae_mesh::error::{Error, Result};
use tesserae_mesh::job::Clustering;
use tokio::sync::{Mutex, OwnedMutexGuard, OwnedSemaphorePermit, Semaphore};

use super::small::{SMALL_BYTES, SMALL_FACES};
use crate::ops::proc_bytes;

const UNIT: u64 = 64 << 10;

/// Bytes that a face takes at the peak of a job, with its vertices, its edges and its labels (see `mesh::allowance`).
const BYTES_A_FACE: u64 = 275;

/// The same for what begins with a cluster a face: hierarchies, which record every merge and move, and merged starts.
/// 630 were measured for `pml` with optimisation, 540 without, 610 for `hr`; by normals, `pml` 800.
const BYTES_A_FACE_OF_HIERARCHY: u64 = 900;

/// The same for planes and shapes, which keep moments of clusters: 971 measured for `ml` of shapes, 735 `hr`, 820 flat.
const BYTES_A_FACE_OF_SHAPES: u64 = 1100;

/// What an item of points takes in the same way, for each of its coordinates and each of its neighbours besides. Peaks
/// of 100,000 items, without their file, were 128 bytes an item (5 coordinates, grid), 730 (9, grid), 1,323 (64, grid),
/// 230 (3, knn:8) and 847 (3, knn:32).
const BYTES_AN_ITEM: u64 = 200;
const BYTES_A_COORDINATE: u64 = 32;
const BYTES_A_NEIGHBOUR: u64 = 16;

/// What a byte takes that comes of a compressed file.
const INFLATED: u64 = 4;

/// What a hierarchy of points takes as many times as a flat clustering of them: 762 bytes an item were measured for
/// `pml` of 5 coordinates, 3,416 of 64.
const HIERARCHY_OF_POINTS: u64 = 2;

/// Bytes that the faces of a small mesh take at the most in a flat clustering.
const SMALL: u64 = SMALL_FACES as u64 * BYTES_A_FACE;

#[derive(Debug, Clone)]
pub(crate) struct Memory {
    total: u64,
    left: Arc<Semaphore>,
    reading: Arc<Mutex<()>>,
}

/// What a job takes beyond its files.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Needed {
    bytes: u64,
    items: u64,
    noun: &'static str,
}

/// Memory of a job that is reading its mesh.
#[derive(Debug)]
pub(crate) struct Reading {
    memory: Memory,
    bytes: u64,
    pub(super) held: Held,
    /// None for a mesh that is small as far as is known, which holds [`SMALL`] bytes for its faces already.
    turn: Option<OwnedMutexGuard<()>>,
}

/// Memory of a job; free again when dropped.
pub(crate) type Held = OwnedSemaphorePermit;

/// The place of a mesh among those in memory, shared by all that works on it.
#[derive(Debug, Clone)]
pub(super) struct Slot(Arc<(OwnedSemaphorePermit, OnceLock<Held>)>);

impl Slot {
    pub fn new(slot: OwnedSemaphorePermit) -> Self {
        Self(Arc::new((slot, OnceLock::new())))
    }

    /// Holds the one share of memory of the job, too.
    pub fn holds(&self, memory: Held) {
        let _ = self.0.1.set(memory);
    }
}

impl Memory {
    /// A budget of `bytes`; of three quarters of the machine's memory without a number.
    pub fn new(bytes: Option<u64>) -> Self {
        let total = bytes.or_else(|| Some(machine()? / 4 * 3)).unwrap_or(u64::MAX);
        let units = usize::try_from(total / UNIT).unwrap_or(usize::MAX).min(Semaphore::MAX_PERMITS);
        Self { total, left: Arc::new(Semaphore::new(units)), reading: Arc::default() }
    }

    pub async fn read(&self, bytes: u64) -> Result<Reading> {
        check(self.total, bytes, "its files")?;
        let is_small = bytes <= SMALL_BYTES && bytes + SMALL <= self.total;
        let turn = if is_small { None } else { Some(Arc::clone(&self.reading).lock_owned().await) };
        let held = acquire(&self.left, if is_small { bytes + SMALL } else { bytes }).await?;
        Ok(Reading { memory: self.clone(), bytes, held, turn })
    }
}

impl Reading {
    pub fn may_be_small(&self) -> bool {
        self.turn.is_none()
    }

    pub async fn build(mut self, need: Needed) -> Result<Held> {
        let Needed { bytes: more, items, noun } = need;
        let all = self.bytes.saturating_add(more);
        check(self.memory.total, all, format_args!("its {items} {noun}"))?;
        match self.turn {
            None if need.is_small() => {}
            None => {
                // not small after all: a job that waits for its turn must hold no memory that others wait for
                drop(self.held);
                let _turn = self.memory.reading.lock().await;
                return acquire(&self.memory.left, all).await;
            }
            Some(_turn) => self.held.merge(acquire(&self.memory.left, more).await?),
        }
        Ok(self.held)
    }
}

impl Needed {
    /// That of faces, clustered in this way; of a flat clustering where none is given.
    pub fn of_faces(faces: u64, clustering: Option<&Clustering>) -> Self {
        let bytes_a_face = match clustering {
            Some(Clustering::Shapes(_)) => BYTES_A_FACE_OF_SHAPES,
            Some(clustering) if clustering.merges_faces() => BYTES_A_FACE_OF_HIERARCHY,
            _ => BYTES_A_FACE,
        };
        Self { bytes: faces.saturating_mul(bytes_a_face), items: faces, noun: "faces" }
    }

    pub fn of_points(size: Size, is_hierarchical: bool) -> Self {
        let Size { items, dimensions, neighbours, inflated } = size;
        // as uploaded and on the lattice
        let coordinates = width(dimensions as usize).max(4) as u64;
        let bytes_an_item = BYTES_AN_ITEM + BYTES_A_COORDINATE * coordinates + BYTES_A_NEIGHBOUR * neighbours;
        let factor = if is_hierarchical { HIERARCHY_OF_POINTS } else { 1 };
        let bytes = items.saturating_mul(factor * bytes_an_item).saturating_add(inflated.saturating_mul(INFLATED));
        Self { bytes, items, noun: "items" }
    }

    pub fn is_small(&self) -> bool {
        self.bytes <= SMALL
    }
}

async fn acquire(left: &Arc<Semaphore>, bytes: u64) -> Result<OwnedSemaphorePermit> {
    let units = u32::try_from(bytes / UNIT).unwrap_or(u32::MAX);
    let held = Arc::clone(left).acquire_many_owned(units).await;
    held.map_err(|error| Error::internal(format_args!("there is no memory to wait for: {error}")))
}

/// Refuses a mesh that never fits.
fn check(total: u64, needed: u64, what: impl std::fmt::Display) -> Result<()> {
    if needed / UNIT > total / UNIT {
        return Err(Error::too_large(format_args!(
            "the mesh needs more memory, for {what}, than the service has for meshes: {needed} bytes of {total}"
        )));
    }
    Ok(())
}

/// Bytes of memory of the container or the machine.
fn machine() -> Option<u64> {
    let container = std::fs::read_to_string("/sys/fs/cgroup/memory.max").ok();
    let container = container.and_then(|text| text.trim().parse::<u64>().ok());
    container.into_iter().chain(proc_bytes("/proc/meminfo", "MemTotal:")).min()
}

#[cfg(test)]
mod tests {
    use futures_util::FutureExt as _;
    use tesserae_mesh::dev::sample::{Sample, generate};
    use tesserae_mesh::energy;
    use tesserae_mesh::job::{InMemory, prepare_in_memory};
    use tesserae_mesh::mesh::Limits;
    use tesserae_mesh::parameters::{Algorithm, Parameters};

    use super::*;

    /// Bytes of files that are not small.
    const LARGE: u64 = 2 * SMALL_BYTES;

    async fn build(memory: &Memory, files: u64, faces: u64, clustering: Option<&Clustering>) -> Result<Held> {
        memory.read(files).await.expect("it fits").build(Needed::of_faces(faces, clustering)).await
    }

    #[tokio::test]
    async fn jobs_wait_for_memory_in_turn() {
        let memory = Memory::new(Some(10 * LARGE));
        let faces = 6 * LARGE / BYTES_A_FACE;
        let first = build(&memory, LARGE, faces, None).await.expect("it fits");
        let reading = memory.read(LARGE).await.expect("it fits");
        assert!(memory.read(LARGE).now_or_never().is_none(), "one at a time reads");
        let small = build(&memory, 1, SMALL_FACES as u64, None).now_or_never();
        drop(small.expect("but for small ones").expect("it fits"));
        let mut second = Box::pin(reading.build(Needed::of_faces(faces, None)));
        assert!(second.as_mut().now_or_never().is_none(), "the first has it");
        drop(first);
        let second = second.await.expect("it fits now");
        memory.read(LARGE).await.expect("the turn is free");
        drop(second);
        assert_eq!(memory.left.available_permits() as u64, 10 * LARGE / UNIT);
    }

    #[test]
    fn the_memory_of_this_machine_is_known() {
        if cfg!(target_os = "linux") {
            assert!(machine().expect("known") > 1 << 20);
        }
    }

    #[tokio::test]
    async fn a_hierarchy_takes_more() {
        let memory = Memory::new(Some(10 * LARGE));
        let faces = 9 * LARGE / BYTES_A_FACE;
        drop(build(&memory, LARGE, faces, None).await.expect("it fits"));
        let mesh = generate(Sample::Part, 400).expect("a sample");
        for energy in [energy::Kind::Cvd, energy::Kind::Shapes] {
            let parameters = &Parameters { algorithm: Algorithm::Pml, energy, ..Parameters::default() };
            let (mesh, limits) = ((&mesh).into(), Limits::default());
            let job = InMemory { mesh, limits, parameters, seeds: None, weights: None };
            let prepared = prepare_in_memory(&job).expect("a job");
            let built = build(&memory, LARGE, faces, Some(&prepared.spec.clustering)).await;
            assert_eq!(built.expect_err("too much").kind, tesserae_mesh::Kind::TooLarge, "{energy:?}");
        }
    }
}
