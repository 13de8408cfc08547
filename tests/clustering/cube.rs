//! P§7: "for some models and specific number, e.g. a cube model with 8 clusters, the results are identical" to those of
//! approximated centroidal Voronoi diagrams (ACVD, Valette & Chassery 2004).

use tesserae_mesh::cluster::{self, flat::Options};
use tesserae_mesh::dev::sample::{Sample, generate};
use tesserae_mesh::device::cpu::CpuDevice;
use tesserae_mesh::device::{Cancel, Device};
use tesserae_mesh::parameters::Seeds;
use tesserae_mesh::surface::Surface;

/// ACVD in its plainest form: sequentially, each face that lies on a boundary moves to the neighbouring cluster for
/// which the energy with respect to exact means falls most, until no move lowers it.
fn acvd(surface: &Surface, clusters: usize, labels: &mut [u32]) {
    let mut sums = vec![[0.0f64; 4]; clusters];
    let face_sums = |face: usize| {
        let weight = f64::from(surface.weights[face]);
        let g = surface.points[face].map(f64::from);
        [weight * g[0], weight * g[1], weight * g[2], weight]
    };
    let add = |a: [f64; 4], b: [f64; 4], sign: f64| std::array::from_fn::<f64, 4, _>(|i| a[i] + sign * b[i]);
    // −|S|²/M: the energy less Σ w·|g|²
    let energy = |s: [f64; 4]| {
        if s[3] > 0.0 { -(s[0] * s[0] + s[1] * s[1] + s[2] * s[2]) / s[3] } else { 0.0 }
    };
    for face in 0..labels.len() {
        let sum = &mut sums[labels[face] as usize];
        *sum = add(*sum, face_sums(face), 1.0);
    }
    loop {
        let mut moved = false;
        for face in 0..labels.len() {
            let from = labels[face] as usize;
            let own = face_sums(face);
            let without = add(sums[from], own, -1.0);
            if without[3] <= 0.0 {
                continue;
            }
            for &near in surface.neighbours_of(face as u32) {
                let to = labels[near as usize] as usize;
                let with = add(sums[to], own, 1.0);
                let change = energy(without) + energy(with) - energy(sums[from]) - energy(sums[to]);
                if to != from && change < -1e-9 * energy(sums[from]).abs() {
                    sums[from] = without;
                    sums[to] = with;
                    labels[face] = to as u32;
                    moved = true;
                    break;
                }
            }
        }
        if !moved {
            return;
        }
    }
}

#[test]
fn a_cube_in_8_clusters_has_the_energy_of_acvd() {
    let mesh = generate(Sample::Cube, 12 * 24 * 24).expect("a sample");
    let surface = Surface::build(&mesh).expect("a surface");
    // a seed in each corner's neighbourhood, none in the corner itself
    let target = |corner: usize| -> [i32; 3] {
        std::array::from_fn(|axis| {
            let reach = 90_000_000 - 7_000_000 * ((corner + axis) % 3) as i32;
            if corner >> axis & 1 == 1 { reach } else { -reach }
        })
    };
    let nearest = |corner: usize| {
        let distance = |face: &usize| -> i64 {
            (0..3).map(|axis| i64::from(surface.points[*face][axis] - target(corner)[axis]).pow(2)).sum()
        };
        surface.upload_face[(0..surface.faces()).min_by_key(distance).expect("there are faces")]
    };
    let listed: Vec<u32> = (0..8).map(nearest).collect();
    let seeds = cluster::seeds::choose(&surface, 8, &Seeds::Listed, 0, Some(&listed)).expect("eight faces");
    let mut device = CpuDevice::new();
    let mut steps = device.open(&surface, &seeds.component_of_cluster).expect("the cpu takes everything");
    let options = Options { max_iterations: None, refine: false, allow_disconnected: false };
    let ours = cluster::flat::boundary_based(
        &surface,
        &seeds.labels(surface.faces()),
        options,
        steps.as_mut(),
        &Cancel::default(),
        &mut |_| {},
        &mut cluster::record::Record::default(),
    )
    .expect("no cancellation");

    let mut reference = ours.initial.clone();
    acvd(&surface, 8, &mut reference);
    let (initial, ours, reference) = (
        surface.source_energy(&ours.initial, 8),
        surface.source_energy(&ours.labels, 8),
        surface.source_energy(&reference, 8),
    );
    assert!(initial > 1.01 * ours, "there was something to do: {initial} {ours}");
    println!("initial {initial:e}, boundary-based {ours:e}, ACVD {reference:e}");
    assert!((ours / reference - 1.0).abs() < 1e-12, "boundary-based {ours:e}, ACVD {reference:e}");
}
