//! Clustering within a tolerance, checked from outside: labels, the mesh that was read, and shapes of reports.

use std::collections::BTreeSet;

use super::shapes::turned_part;
use crate::common::zoo;
use tesserae_mesh::dev::sample::{Sample, generate, generate_part};
use tesserae_mesh::device::Cancel;
use tesserae_mesh::device::cpu::CpuDevice;
use tesserae_mesh::energy::Kind;
use tesserae_mesh::job::{self, InMemory, Outcome, Request};
use tesserae_mesh::mesh::{Format, Limits, PolygonMesh};
use tesserae_mesh::parameters::{Algorithm, Features, Length, Parameters, Shapes};
use tesserae_mesh::report::{Input, Phase};
use tesserae_mesh::shapes::kind::Kind as ShapeKind;
use tesserae_mesh::shapes::table::ClusterShape;

fn within(energy: Kind, tolerance: Length) -> Parameters {
    Parameters { energy, tolerance: Some(tolerance), ..Parameters::default() }
}

fn run(mesh: &PolygonMesh, parameters: &Parameters) -> Outcome {
    let job = InMemory { mesh: mesh.into(), limits: Limits::default(), parameters, seeds: None, weights: None };
    let prepared = job::prepare_in_memory(&job).expect("a surface");
    job::run(&prepared, &mut CpuDevice::new(), &Cancel::default(), &mut |_| {}).expect("a result")
}

fn labels(outcome: &Outcome) -> &[u32] {
    outcome.labels.as_deref().expect("labels")
}

fn minus(a: [f64; 3], b: [f64; 3]) -> [f64; 3] {
    std::array::from_fn(|axis| a[axis] - b[axis])
}

fn dot(a: [f64; 3], b: [f64; 3]) -> f64 {
    (0..3).map(|axis| a[axis] * b[axis]).sum()
}

/// The distance of a place from the shape in a row of a report.
fn distance(row: &ClusterShape, at: [f64; 3]) -> f64 {
    if let Some(plane) = row.plane {
        return dot(minus(at, plane.point), plane.normal).abs();
    }
    if let Some(sphere) = row.sphere {
        let from = minus(at, sphere.centre);
        return (dot(from, from).sqrt() - sphere.radius).abs();
    }
    if let Some(cone) = row.cone {
        let from = minus(at, cone.apex);
        let along = dot(from, cone.axis);
        let out = minus(from, cone.axis.map(|axis| axis * along));
        let (sine, cosine) = cone.half_angle.to_radians().sin_cos();
        let out = dot(out, out).sqrt();
        let is_beyond = along * cosine + out * sine < 0.0;
        return if is_beyond { dot(from, from).sqrt() } else { (out * cosine - along * sine).abs() };
    }
    let cylinder = row.cylinder.expect("a shape");
    let from = minus(at, cylinder.point);
    let along = dot(from, cylinder.axis);
    let out = minus(from, cylinder.axis.map(|axis| axis * along));
    (dot(out, out).sqrt() - cylinder.radius).abs()
}

/// The largest distances of a corner of each face and of the middle of an edge from the shape of its cluster.
fn farthest(mesh: &PolygonMesh, outcome: &Outcome) -> Vec<[f64; 2]> {
    let rows = outcome.report.shapes.as_ref().expect("shapes");
    let of_face = |(face, &label): (usize, &u32)| {
        let corners = mesh.faces.corners(face).iter().map(|&corner| mesh.positions[corner as usize]);
        let middle = |(a, b): ([f64; 3], [f64; 3])| std::array::from_fn(|axis| a[axis] / 2.0 + b[axis] / 2.0);
        let middles = corners.clone().zip(corners.clone().cycle().skip(1)).map(middle);
        let most = |far: f64, at: [f64; 3]| far.max(distance(&rows[label as usize], at));
        [corners.fold(0.0, most), middles.fold(0.0, most)]
    };
    labels(outcome).iter().enumerate().map(of_face).collect()
}

/// No corner is further than the tolerance, no middle of an edge than twice that, and what the report says is so.
/// Loose faces do not count.
fn assert_holds(mesh: &PolygonMesh, outcome: &Outcome, of: &str) {
    let report = &outcome.report;
    let tolerance = report.tolerance.expect("a tolerance");
    let rows = report.shapes.as_ref().expect("shapes");
    assert_eq!((rows.len() as u64, report.disconnected_clusters), (report.clusters, 0), "{of}");
    let diagonal = diagonal(mesh);
    let slack = tolerance.length * 1e-9 + diagonal * 1e-13;
    assert!((tolerance.asked.share_of(diagonal).min(1.0) * diagonal - tolerance.length).abs() <= slack, "{of}");
    let has_loose = matches!(&report.input, Input::Mesh(input) if input.loose_faces > 0);
    let mut farthest = farthest(mesh, outcome);
    let loose = (0..farthest.len()).filter(|&face| has_loose && has_no_area(mesh, face));
    loose.for_each(|face| farthest[face] = [0.0; 2]);
    let mut beyond = 0;
    for (&label, [corner, middle]) in labels(outcome).iter().zip(&farthest) {
        if *corner > tolerance.length + slack {
            assert_eq!(rows[label as usize].faces, 1, "{of}: {corner} {tolerance:?}");
            beyond += 1;
        } else {
            assert!(*middle <= 2.0 * (tolerance.length + slack), "{of}: {middle} {tolerance:?}");
        }
    }
    let warning = report.warnings.iter().find(|warning| warning.contains("tolerance"));
    assert_eq!(warning.is_some(), beyond > 0, "{of}: {warning:?}");
    assert!(warning.is_none_or(|warning| warning.ends_with(&format!(": {beyond}"))), "{of}: {warning:?} {beyond}");
    let largest = farthest.into_iter().fold(0.0, |most: f64, [corner, _]| most.max(corner));
    assert!((largest - tolerance.largest).abs() <= slack, "{of}: {largest} {tolerance:?}");
}

fn has_no_area(mesh: &PolygonMesh, face: usize) -> bool {
    let corners: BTreeSet<[u64; 3]> =
        mesh.faces.corners(face).iter().map(|&corner| mesh.positions[corner as usize].map(f64::to_bits)).collect();
    corners.len() < 3
}

fn diagonal(mesh: &PolygonMesh) -> f64 {
    let end = |of: fn(f64, f64) -> f64, from: f64| -> [f64; 3] {
        let used = (0..mesh.faces.len()).flat_map(|face| mesh.faces.corners(face));
        let places = used.map(|&corner| mesh.positions[corner as usize]);
        places.fold([from; 3], |ends, at| std::array::from_fn(|axis| of(ends[axis], at[axis])))
    };
    let sides = minus(end(f64::max, f64::NEG_INFINITY), end(f64::min, f64::INFINITY));
    dot(sides, sides).sqrt()
}

#[test]
fn no_corner_is_further_from_its_shape() {
    let few = |(name, mesh): &(String, PolygonMesh)| mesh.faces.len() < 800 && !["huge", "tiny"].contains(&&name[..]);
    let all = [(Kind::Planes, None), (Kind::Shapes, None), (Kind::Shapes, Some(Shapes(ShapeKind::ALL.to_vec())))];
    for (at, (name, mesh)) in zoo::all().into_iter().filter(few).enumerate() {
        for (turn, share) in [1e-9, 1e-4, 3e-3, 0.03, 1.0].into_iter().enumerate() {
            for (energy, shapes) in zoo::in_turn(at + turn, &all) {
                let of = format!("{name} {share} {energy:?} {shapes:?}");
                let outcome = run(&mesh, &Parameters { shapes, ..within(energy, Length::Share(share)) });
                assert_holds(&mesh, &outcome, &of);
                if share == 1.0 {
                    let components = outcome.report.input.components();
                    assert_eq!(outcome.report.clusters, components, "{of}");
                }
            }
        }
    }
}

#[test]
fn energies_fall_but_where_clusters_merge() {
    let (mesh, _) = generate_part(1500, 0.1).expect("a part");
    let outcome = run(&mesh, &within(Kind::Shapes, Length::Share(2e-3)));
    assert_holds(&mesh, &outcome, "a part");
    let rows = &outcome.report.iterations;
    for pair in rows.windows(2) {
        assert!(pair[1].energy <= pair[0].energy || pair[1].phase == Phase::Merge, "{pair:?}");
    }
    assert!(rows.iter().any(|row| row.phase == Phase::Merge && row.moves > 0), "{rows:?}");
}

#[test]
fn a_part_is_cut_into_its_patches() {
    for (noise, share, wrong) in [(0.0, 1e-3, 0), (0.0, 1e-2, 0), (0.05, 4e-3, 30)] {
        let (mesh, truth) = generate_part(3000, noise).expect("a part");
        let outcome = run(&mesh, &within(Kind::Shapes, Length::Share(share)));
        assert_holds(&mesh, &outcome, "a part");
        assert_eq!(outcome.report.clusters, 13, "{noise} {share}");
        let tolerance = outcome.report.tolerance.expect("a tolerance");
        assert!(noise == 0.0 || tolerance.largest > 0.1 * tolerance.length, "{tolerance:?}");
        let mut counts = std::collections::BTreeMap::<(u32, u32), usize>::new();
        labels(&outcome)
            .iter()
            .zip(&truth)
            .for_each(|(&label, &patch)| *counts.entry((label, patch)).or_default() += 1);
        let most = |label: u32| counts.range((label, 0)..=(label, u32::MAX)).map(|(_, &count)| count).max();
        let right: usize = (0..13).filter_map(most).sum();
        assert!(truth.len() - right <= wrong, "{noise} {share}: {right} of {}", truth.len());
    }
}

#[test]
fn a_turned_part_is_cut_into_its_cones() {
    let (mesh, truth) = turned_part();
    for share in [1e-3, 4e-3] {
        let shapes = Some(Shapes(ShapeKind::ALL.to_vec()));
        let outcome = run(&mesh, &Parameters { shapes, ..within(Kind::Shapes, Length::Share(share)) });
        assert_holds(&mesh, &outcome, "a turned part");
        let patches: BTreeSet<(u32, u32)> = labels(&outcome).iter().copied().zip(truth.iter().copied()).collect();
        assert_eq!((outcome.report.clusters, patches.len()), (8, 8), "{share}: {patches:?}");
        assert!(outcome.report.shapes.as_ref().is_some_and(|rows| rows.iter().filter_map(|row| row.cone).count() == 3));
    }
}

#[test]
fn polygons_that_bend_by_more_are_clusters_of_their_own() {
    // quads of a saddle, some of which bend by more than the rest
    let mut mesh = generate(Sample::Quads, 400).expect("a sample");
    let middle = mesh.positions.len() / 2;
    mesh.positions[middle].iter_mut().for_each(|x| *x *= 1.3);
    let outcome = run(&mesh, &within(Kind::Shapes, Length::Share(1e-4)));
    assert_holds(&mesh, &outcome, "quads");
    let report = &outcome.report;
    let tolerance = report.tolerance.expect("a tolerance");
    assert!(tolerance.largest > tolerance.length, "{tolerance:?}");
}

#[test]
fn a_length_of_the_file_is_one_and_threads_features_and_limits_do_not_matter() {
    let (mesh, _) = generate_part(1500, 0.1).expect("a part");
    let length = "0.02u".parse().expect("a length");
    let of = |threads| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().expect("a pool");
        pool.install(|| run(&mesh, &within(Kind::Shapes, length)))
    };
    let (one, three) = (of(1), of(3));
    assert_holds(&mesh, &one, "0.02u");
    let tolerance = one.report.tolerance.expect("a tolerance");
    assert!((tolerance.length - 0.02).abs() < 1e-15 && tolerance.asked == length, "{tolerance:?}");
    assert_eq!(one.report.parameters.resolution, Some("0.002u".parse().expect("a length")));
    assert_eq!((one.report.labels_sha256, one.report.shapes), (three.report.labels_sha256, three.report.shapes));
    let features = Some(Features { angle: Some(60.0), groups: false });
    let outcome = run(&mesh, &Parameters { features, ..within(Kind::Planes, length) });
    assert_holds(&mesh, &outcome, "features");
    let outcome = run(&mesh, &Parameters { max_iterations: Some(1), ..within(Kind::Shapes, length) });
    assert_holds(&mesh, &outcome, "a limit");
    assert!(outcome.report.warnings.iter().any(|warning| warning.contains("max_iterations")));
}

#[test]
fn contradictions_are_refused() {
    let planes = || within(Kind::Planes, Length::Share(0.01));
    for (parameters, words) in [
        (Parameters { clusters: Some(3), ..planes() }, ["clusters", "tolerance"]),
        (Parameters { energy: Kind::Cvd, ..planes() }, ["tolerance", "energy=planes"]),
        (Parameters { energy: Kind::L21, ..planes() }, ["tolerance", "l21"]),
        (Parameters { algorithm: Algorithm::Pml, ..planes() }, ["tolerance", "pml"]),
        (Parameters { snapshots: Some("3".parse().expect("a number")), ..planes() }, ["snapshots", "tolerance"]),
        (Parameters { subdivide: Some("auto".parse().expect("a number")), ..planes() }, ["subdivide", "tolerance"]),
    ] {
        let error = parameters.check(false).expect_err("a refusal");
        assert!(words.iter().all(|word| error.message.contains(word)), "{parameters:?}: {error}");
    }
    let error = Parameters { energy: Kind::Cvd, ..planes() }.check_points().expect_err("points have no shapes");
    assert!(error.message.contains("tolerance"), "{error}");
}

#[test]
fn real_meshes_need_few_clusters() {
    let Some(folder) = zoo::shared_meshes() else { return };
    // the prototype needed 37 and 26
    let bytes = std::fs::read(folder.join("fandisk.obj")).expect("a mesh");
    for (share, most) in [(1e-3, 37), (3e-3, 25)] {
        let parameters = within(Kind::Shapes, Length::Share(share));
        let prepared = job::prepare(&Request::new(&bytes, Format::Obj, &parameters)).expect("a mesh");
        let outcome = job::run(&prepared, &mut CpuDevice::new(), &Cancel::default(), &mut |_| {}).expect("a result");
        assert!(outcome.report.clusters <= most, "{share}: {}", outcome.report.clusters);
        let used: BTreeSet<u32> = labels(&outcome).iter().copied().collect();
        assert_eq!(used.len() as u64, outcome.report.clusters);
    }
}
