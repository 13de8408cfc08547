//! Buffers beyond the largest binding: labels, rows and hierarchies are the same where buffers have pages.

use crate::common::gpu::{ALL, adapter, device_with, surface};
use crate::common::pml;
use crate::equals_cpu::compare as compare_flat;
use crate::hierarchy::compare as compare_hierarchies;
use tesserae_mesh::cluster::hierarchy::Options;
use tesserae_mesh::dev::sample::Sample;
use tesserae_mesh::device::gpu::{GpuDevice, Overrides, Tuning};
use tesserae_mesh::parameters::Seeds;

/// Bytes that the devices of these tests bind: a page has 16,384 faces, or 8,192 clusters.
const BINDING: u64 = 500_000;

/// A device that binds so few, with several dispatches an iteration or with one; none where the adapter has no pages.
fn narrow(chain_items: u32) -> Option<GpuDevice> {
    let adapter = adapter();
    if !adapter.has_pages() {
        eprintln!("skipped: {} has no arrays of bindings", adapter.report.driver);
        return None;
    }
    let tuning = Tuning { chain_items, ..Tuning::default() };
    Some(device_with(Overrides { binding_size: Some(BINDING), tuning, ..Overrides::default() }))
}

// one test: drivers keep compiled kernels for the next device
#[test]
fn labels_and_hierarchies_are_the_same_across_pages() {
    let Some(mut gpu) = narrow(0) else { return };
    // 7 pages of faces, and as many of neighbours
    let large = surface(Sample::Knot, 100_000);
    for (clusters, seeds) in [(20_000, Seeds::Random), (30, Seeds::Morton)] {
        compare_flat(&mut gpu, "large knot", &large, (clusters, &seeds, 1), ALL);
    }
    // a surface without pages, on the same device
    let small = surface(Sample::Knot, 5000);
    compare_flat(&mut gpu, "small knot", &small, (50, &Seeds::Random, 1), ALL);
    // 13 pages of clusters
    compare_hierarchies(&mut gpu, "large knot", &large, &pml());
    // faces fit a binding, and a cluster a face does not, which is known when labels are set
    let middle = surface(Sample::Knot, 9000);
    assert!(16 * middle.faces() as u64 <= BINDING && 60 * middle.faces() as u64 > BINDING);
    let sequential = Options { sequential_at: 100, ..pml() };
    compare_hierarchies(&mut gpu, "knot", &middle, &sequential);
    let Some(mut gpu) = narrow(Tuning::default().chain_items) else { return };
    compare_hierarchies(&mut gpu, "knot", &middle, &sequential);
    compare_hierarchies(&mut gpu, "knot", &middle, &Options { optimise: false, ..pml() });
}
