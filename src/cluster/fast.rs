//! The phases of quality [`Fast`](Quality::Fast): a start of other qualities and of hierarchies.

use super::coarse::CoarseStart;
use super::flat::{self, Options};
use super::quality::Quality;
use super::record::Record;
use crate::device::cpu::CpuDevice;
use crate::device::{Cancel, Device};
use crate::energy::Functional;
use crate::error::Result;
use crate::surface::Items;

/// The labels that they end with. They run on the cpu, whatever the device: labels are the same.
pub fn labels<E: Functional>(items: &Items<E>, clusters: u64, seed: u64, cancel: &Cancel) -> Result<Vec<u32>> {
    let (fast, device, record) = (Quality::Fast, &mut CpuDevice::new(), &mut Record::new(None));
    let start = CoarseStart::new(items, clusters, seed, fast.start(items.moves))?.labels(items, device, cancel)?;
    let mut steps = device.open(items, &start.component_of_cluster)?;
    let max_iterations = fast.max_iterations(items.moves);
    let options = Options { max_iterations, refine: fast.refines(), allow_disconnected: false };
    Ok(flat::boundary_based(items, &start.labels, options, steps.as_mut(), cancel, &mut |_| {}, record)?.labels)
}
