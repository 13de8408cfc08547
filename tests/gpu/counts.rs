//! How many dispatches and waits of the host a clustering takes on a gpu. Both are the same on every adapter, and cost
//! more than the work of a dispatch on small meshes.

use crate::common::gpu::{ALL, device_with, surface};
use crate::common::zoo;
use tesserae_mesh::cluster::coarse::CoarseStart;
use tesserae_mesh::cluster::flat::boundary_based;
use tesserae_mesh::cluster::hierarchy::{Options, hierarchical};
use tesserae_mesh::cluster::merging::Pairs;
use tesserae_mesh::cluster::quality::Quality;
use tesserae_mesh::cluster::record::Record;
use tesserae_mesh::dev::sample::Sample;
use tesserae_mesh::device::dual_edge::Ties;
use tesserae_mesh::device::gpu::{GpuDevice, Overrides, Tuning};
use tesserae_mesh::device::{Cancel, Device};
use tesserae_mesh::mesh::{self, Format, Limits, NoResources};
use tesserae_mesh::surface::Surface;

/// A device that counts. Batches do not depend on time, and every coarse graph is clustered on the cpu, as beside a
/// software gpu; a card would take those of the bunny, in 526 dispatches and 26 waits, and less time.
fn counting() -> GpuDevice {
    let tuning = Tuning { batch_ms: 1_000_000, start_on_cpu: u32::MAX / 4, ..Tuning::default() };
    device_with(Overrides { timed: true, tuning, ..Overrides::default() })
}

/// Dispatches and waits since the last call; none where the adapter has no timestamps.
fn counts(device: &mut GpuDevice) -> Option<(u64, u64)> {
    let device: &mut dyn Device = device;
    let profile = device.take_profile().expect("a profile")?;
    Some((profile.dispatches.values().sum(), profile.waits))
}

/// Those of a clustering at default quality, up to relocation, which works on the host.
fn of_flat(surface: &Surface, clusters: u64) -> Option<(u64, u64)> {
    let mut device = counting();
    counts(&mut device);
    let cancel = Cancel::default();
    let plan =
        CoarseStart::new(surface, clusters, 0, Quality::Default.start(surface.moves)).expect("so many are possible");
    let start = plan.labels(surface, &mut device, &cancel).expect("it runs");
    {
        let mut steps = device.open(surface, &start.component_of_cluster).expect("it fits");
        let mut record = Record::default();
        boundary_based(surface, &start.labels, ALL, steps.as_mut(), &cancel, &mut |_| {}, &mut record)
            .expect("it runs");
    }
    counts(&mut device)
}

/// Those of a hierarchy, and its rounds: all of them, and the optimised ones.
fn of_hierarchy(surface: &Surface, sequential_at: u64, optimise: bool) -> Option<((u64, u64), u64, u64)> {
    let options = Options {
        sequential_at,
        collapse_fraction: None,
        optimise,
        refine: true,
        iterations_a_round: [2, 1],
        optimised_from: 4,
        pairs: Pairs::CheaperHalf,
        ties: Ties::Hash,
        clusters: None,
        levels: Vec::new(),
        allow_disconnected: false,
        relocation: None,
    };
    let mut device = counting();
    counts(&mut device);
    let (mut rounds, mut optimised) = (0, 0);
    {
        let mut on_round = |row: tesserae_mesh::cluster::hierarchy::RoundRow| {
            rounds += 1;
            optimised += u64::from(row.moves > 0);
        };
        hierarchical(surface, &options, &mut device, &Cancel::default(), &mut |_| {}, &mut on_round).expect("it runs");
    }
    counts(&mut device).map(|counted| (counted, rounds, optimised))
}

#[test]
fn a_flat_clustering_takes_no_more_dispatches_and_waits_than_before() {
    for (sample, faces, clusters, most) in
        [(Sample::Knot, 20_000, 200, (270, 12)), (Sample::Sphere, 5000, 2000, (80, 4))]
    {
        let Some(found) = of_flat(&surface(sample, faces), clusters) else { return };
        eprintln!("{} {faces}/{clusters}: {found:?}", sample.name());
        assert!(found.0 <= most.0 && found.1 <= most.1, "{} {faces}: {found:?} above {most:?}", sample.name());
    }
}

#[test]
fn a_round_of_a_hierarchy_takes_no_more_dispatches_and_waits_than_before() {
    let surface = surface(Sample::Knot, 5000);
    for optimise in [false, true] {
        let Some(((dispatches, waits), rounds, optimised)) = of_hierarchy(&surface, 0, optimise) else { return };
        eprintln!("{rounds} rounds, {optimised} optimised: {dispatches} dispatches, {waits} waits");
        // a round that nothing follows has one wait; the first and the last have further ones
        let plain = rounds - optimised;
        assert!(waits <= 2 * optimised + plain + 6, "{waits} waits in {rounds} rounds, {optimised} of them optimised");
        assert!(dispatches <= 20 * optimised + 8 * plain + 20, "{dispatches} dispatches in {rounds} rounds");
    }
}

#[test]
fn a_step_of_a_sequential_hierarchy_takes_no_more_dispatches_and_waits_than_before() {
    let surface = surface(Sample::Knot, 300);
    for (optimise, most) in [(false, (1830, 306)), (true, (4220, 940))] {
        let Some((found, steps, _)) = of_hierarchy(&surface, u64::MAX, optimise) else { return };
        eprintln!("{steps} steps: {found:?}");
        assert!(found.0 <= most.0 && found.1 <= most.1, "{steps} steps: {found:?} above {most:?}");
    }
}

#[test]
fn real_meshes_take_no_more_dispatches_and_waits_than_before() {
    let Some(folder) = zoo::shared_meshes() else { return };
    for (name, clusters, most) in [("stanford-bunny.glb", 1000, (373, 12)), ("armadillo-172k.glb", 2000, (525, 18))] {
        let Ok(bytes) = std::fs::read(std::path::Path::new(&folder).join(name)) else {
            eprintln!("notice: {name} is not there");
            continue;
        };
        let mesh = mesh::read(&bytes, Format::Glb, &NoResources, &Limits::default()).expect("a mesh");
        let surface = Surface::build(&mesh).expect("a surface");
        let Some(found) = of_flat(&surface, clusters) else { return };
        eprintln!("{name}/{clusters}: {found:?}");
        assert!(found.0 <= most.0 && found.1 <= most.1, "{name}: {found:?} above {most:?}");
    }
}
