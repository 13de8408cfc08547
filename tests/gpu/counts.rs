//! How many dispatches and waits of the host a clustering takes on a gpu, and the bytes that its kernels read and
//! write. All are the same on every adapter. On small meshes, dispatches and waits cost more than the work of a
//! dispatch.

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
use tesserae_mesh::device::{Cancel, Device, Profile};
use tesserae_mesh::mesh::{self, Format, Limits, NoResources};
use tesserae_mesh::surface::Surface;

/// A device that counts. Batches do not depend on time, and every coarse graph is clustered on the cpu, as beside a
/// software gpu; a card would take those of the bunny, in 526 dispatches and 26 waits, and less time.
fn counting() -> GpuDevice {
    let tuning = Tuning { batch_ms: 1_000_000, start_on_cpu: u32::MAX / 4, ..Tuning::default() };
    device_with(Overrides { timed: true, tuning, ..Overrides::default() })
}

/// What the device did since the last call; none where the adapter has no timestamps.
fn profile(device: &mut GpuDevice) -> Option<Profile> {
    let device: &mut dyn Device = device;
    device.take_profile().expect("a profile")
}

/// Dispatches and waits.
fn counts(profile: &Profile) -> (u64, u64) {
    (profile.total().dispatches, profile.waits)
}

/// Fails if a flat clustering takes more than so many dispatches, waits and megabytes.
fn check(name: &str, surface: &Surface, clusters: u64, most: [u64; 3]) {
    let Some(profile) = of_flat(surface, clusters) else { return };
    let (dispatches, waits) = counts(&profile);
    let found = [dispatches, waits, profile.total().bytes.div_ceil(1_000_000)];
    eprintln!("{name}/{clusters}: {found:?}");
    assert!(found.iter().zip(most).all(|(&found, most)| found <= most), "{name}: {found:?} above {most:?}");
}

/// That of a clustering at default quality, up to relocation, which works on the host.
fn of_flat(surface: &Surface, clusters: u64) -> Option<Profile> {
    let mut device = counting();
    profile(&mut device);
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
    profile(&mut device)
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
    profile(&mut device);
    let (mut rounds, mut optimised) = (0, 0);
    {
        let mut on_round = |row: tesserae_mesh::cluster::hierarchy::RoundRow| {
            rounds += 1;
            optimised += u64::from(row.moves > 0);
        };
        hierarchical(surface, &options, &mut device, &Cancel::default(), &mut |_| {}, &mut on_round).expect("it runs");
    }
    profile(&mut device).map(|profile| (counts(&profile), rounds, optimised))
}

#[test]
fn a_flat_clustering_takes_no_more_dispatches_waits_and_bytes_than_before() {
    for (sample, faces, clusters, most) in
        [(Sample::Knot, 20_000, 200, [270, 12, 42]), (Sample::Sphere, 5000, 2000, [80, 4, 5])]
    {
        check(sample.name(), &surface(sample, faces), clusters, most);
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
fn real_meshes_take_no_more_dispatches_waits_and_bytes_than_before() {
    let Some(folder) = zoo::shared_meshes() else { return };
    for (name, clusters, most) in
        [("stanford-bunny.glb", 1000, [373, 12, 143]), ("armadillo-172k.glb", 2000, [525, 18, 355])]
    {
        let Ok(bytes) = std::fs::read(std::path::Path::new(&folder).join(name)) else {
            eprintln!("notice: {name} is not there");
            continue;
        };
        let mesh = mesh::read(&bytes, Format::Glb, &NoResources, &Limits::default()).expect("a mesh");
        let surface = Surface::build(&mesh).expect("a surface");
        check(name, &surface, clusters, most);
    }
}
