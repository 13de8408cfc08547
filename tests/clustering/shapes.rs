//! Clustering by shapes (`energy=planes`, `energy=shapes`), looked at by means of its own.

use std::collections::BTreeSet;

use crate::common::zoo;
use tesserae_mesh::cluster::merging::Pairs;
use tesserae_mesh::cluster::quality::Quality;
use tesserae_mesh::dev::sample::{Sample, generate, generate_part};
use tesserae_mesh::device::Cancel;
use tesserae_mesh::device::cpu::CpuDevice;
use tesserae_mesh::device::dual_edge::Ties;
use tesserae_mesh::energy::Kind;
use tesserae_mesh::job::{self, InMemory, Outcome, Prepared, Refusal, Request};
use tesserae_mesh::mesh::{Format, Limits, PolygonMesh};
use tesserae_mesh::parameters::{Algorithm, Features, Length, Parameters, Refine, Seeds, Shapes, Snapshots};
use tesserae_mesh::report::Phase;
use tesserae_mesh::shapes::kind::Kind as ShapeKind;
use tesserae_mesh::surface::{Surface, Wanted, WantedFeatures};

fn by(energy: Kind, clusters: u64) -> Parameters {
    Parameters { energy, clusters: Some(clusters), ..Parameters::default() }
}

fn try_to_prepare(mesh: &PolygonMesh, parameters: &Parameters) -> Result<Prepared, Refusal> {
    let job = InMemory { mesh: mesh.into(), limits: Limits::default(), parameters, seeds: None, weights: None };
    job::prepare_in_memory(&job)
}

fn clustered(prepared: &Prepared) -> Outcome {
    job::run(prepared, &mut CpuDevice::new(), &Cancel::default(), &mut |_| {}).expect("a result")
}

fn run(mesh: &PolygonMesh, parameters: &Parameters) -> Outcome {
    clustered(&try_to_prepare(mesh, parameters).expect("a surface"))
}

fn labels(outcome: &Outcome) -> &[u32] {
    outcome.labels.as_deref().expect("labels")
}

/// F rises in no row; that it falls strictly is tested in integers (`src/shapes/run.rs`).
fn assert_falls(outcome: &Outcome, of: &str) {
    for pair in outcome.report.iterations.windows(2) {
        assert!(pair[1].energy <= pair[0].energy && pair[1].iteration == pair[0].iteration + 1, "{of}: {pair:?}");
        assert_eq!(pair[1].moves == 0, pair[1].phase == Phase::Refit, "{of}: {pair:?}");
    }
}

#[test]
fn clusters_are_as_many_as_asked_for_connected_and_the_energy_falls() {
    let all = [(Kind::Planes, None), (Kind::Shapes, None), (Kind::Shapes, Some(Shapes(ShapeKind::ALL.to_vec())))];
    let small = zoo::all().into_iter().filter(|(_, mesh)| mesh.faces.len() < 1000);
    for (at, (name, mesh)) in small.enumerate() {
        let surface = Surface::build(&mesh).expect("a surface");
        let (fewest, most) = (surface.components.len() as u64, surface.faces() as u64);
        for (turn, clusters) in BTreeSet::from([fewest, (most / 9).max(fewest), most]).into_iter().enumerate() {
            for (energy, shapes) in zoo::in_turn(at + turn, &all) {
                let outcome = run(&mesh, &Parameters { shapes, ..by(energy, clusters) });
                let report = &outcome.report;
                let mut seen = 0;
                for &label in labels(&outcome) {
                    assert!(label <= seen, "{name}: numbered by the first face");
                    seen = seen.max(label + 1);
                }
                assert_eq!((u64::from(seen), report.disconnected_clusters), (clusters, 0), "{name} {energy:?}");
                assert_falls(&outcome, &name);
                assert!(report.energy.final_ <= report.energy.initial || energy == Kind::Shapes);
                let rows = report.shapes.as_ref().expect("shapes");
                assert_eq!(rows.len() as u64, clusters);
                let of_label =
                    |number: usize| labels(&outcome).iter().filter(|&&label| label as usize == number).count();
                for (number, row) in rows.iter().enumerate() {
                    assert_eq!((row.label as usize, row.faces as usize), (number, of_label(number)), "{name}");
                    assert!(row.residual.rms <= row.residual.max * (1.0 + 1e-9), "{name}: {row:?}");
                }
            }
        }
    }
}

#[test]
fn any_number_of_threads_gives_the_same_labels() {
    let (mesh, _) = generate_part(1500, 0.2).expect("a part");
    let of = |threads| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().expect("a pool");
        pool.install(|| {
            let outcome = run(&mesh, &by(Kind::Shapes, 20));
            (outcome.report.labels_sha256, outcome.report.energy.final_, outcome.report.shapes)
        })
    };
    assert_eq!(of(1), of(3));
}

#[test]
fn a_part_is_cut_into_its_patches_which_have_their_shapes() {
    let (mesh, truth) = generate_part(3000, 0.0).expect("a part");
    let outcome = run(&mesh, &by(Kind::Shapes, 13));
    let pairs: BTreeSet<(u32, u32)> = labels(&outcome).iter().copied().zip(truth).collect();
    assert_eq!(pairs.len(), 13, "{pairs:?}");
    let rows = outcome.report.shapes.as_ref().expect("shapes");
    let radius = |row: &tesserae_mesh::shapes::table::ClusterShape| {
        row.sphere.map(|sphere| sphere.radius).or(row.cylinder.map(|cylinder| cylinder.radius))
    };
    let mut radii: Vec<f64> = rows.iter().filter_map(radius).collect();
    radii.sort_by(f64::total_cmp);
    assert_eq!(radii.len(), 6);
    for (found, radius) in radii.into_iter().zip([0.5, 0.5, 0.5, 0.5, 0.6, 1.1]) {
        assert!((found - radius).abs() < 1e-6, "{found} {radius}");
    }
    // with planes alone it takes more of them
    let planes = run(&mesh, &by(Kind::Planes, 13));
    assert!(planes.report.energy.final_.expect("finite") > 10.0 * outcome.report.energy.final_.expect("finite"));
    assert!(planes.report.shapes.as_ref().is_some_and(|rows| rows.iter().all(|row| row.plane.is_some())));
}

/// A part of revolution, turned so that nothing lies along an axis: a tip, a rod, a chamfer, a thicker rod, a rim, a
/// countersink, a hole and its end; and the patch of each face. All corners lie on the shapes.
pub(super) fn turned_part() -> (PolygonMesh, Vec<u32>) {
    const AROUND: u32 = 40;
    let profile = [(0.0, 3.0), (1.0, 1.5), (1.0, 0.5), (1.4, 0.1), (1.4, -0.6), (0.8, -0.6), (0.4, -0.1), (0.4, 0.4)];
    let ends = profile.into_iter().skip(1).chain([(0.0, 0.4)]);
    let (mut rings, mut patches) = (vec![profile[0]], Vec::new());
    for (patch, ((r, z), (to_r, to_z))) in (0..).zip(profile.into_iter().zip(ends)) {
        let rows = (f64::hypot(to_r - r, to_z - z) / 0.17).ceil();
        for row in 1..=rows as u32 {
            let share = f64::from(row) / rows;
            rings.push((r + share * (to_r - r), z + share * (to_z - z)));
            patches.push(patch);
        }
    }
    let at = |(r, z): (f64, f64), turn: u32| {
        let (sine, cosine) = (f64::from(turn) / f64::from(AROUND) * std::f64::consts::TAU).sin_cos();
        let (x, y) = (r * cosine, r * sine);
        [0.8 * x - 0.36 * y + 0.48 * z, 0.6 * x + 0.48 * y - 0.64 * z, 0.8 * y + 0.6 * z]
    };
    let last = rings.len() as u32 - 1;
    let middle = &rings[1..rings.len() - 1];
    let mut positions = vec![at(rings[0], 0)];
    positions.extend(middle.iter().flat_map(|&ring| (0..AROUND).map(move |turn| at(ring, turn))));
    positions.push(at(rings[last as usize], 0));
    let vertex = |ring: u32, turn: u32| match ring {
        0 => 0,
        ring if ring == last => positions.len() as u32 - 1,
        ring => 1 + (ring - 1) * AROUND + turn % AROUND,
    };
    let (mut faces, mut truth) = (Vec::new(), Vec::new());
    for (ring, &patch) in (0..).zip(&patches) {
        for turn in 0..AROUND {
            let [a, b] = [turn, turn + 1].map(|turn| vertex(ring, turn));
            let [c, d] = [turn, turn + 1].map(|turn| vertex(ring + 1, turn));
            for corners in [[a, c, d], [a, d, b]].into_iter().filter(|[a, b, c]| a != b && b != c && c != a) {
                faces.push(corners);
                truth.push(patch);
            }
        }
    }
    let faces: Vec<&[u32]> = faces.iter().map(|corners| corners.as_slice()).collect();
    (zoo::mesh(&positions, &faces), truth)
}

#[test]
fn a_turned_part_has_its_cones() {
    let (mesh, truth) = turned_part();
    let all = Parameters { shapes: Some(Shapes(ShapeKind::ALL.to_vec())), ..by(Kind::Shapes, 8) };
    let outcome = run(&mesh, &all);
    assert_falls(&outcome, "a turned part");
    let pairs: BTreeSet<(u32, u32)> = labels(&outcome).iter().copied().zip(truth).collect();
    assert_eq!(pairs.len(), 8, "{pairs:?}");
    let rows = outcome.report.shapes.as_ref().expect("shapes");
    let row_of = |patch: u32| {
        let label = pairs.iter().find(|pair| pair.1 == patch).expect("a patch").0;
        &rows[label as usize]
    };
    for (patch, slope, convex, [low, high], apex) in
        [(0, 1.0 / 1.5, true, [0.0, 1.5], 3.0), (2, 1.0, true, [1.0, 1.4], 1.5), (5, 0.8, false, [0.5, 1.0], 0.4)]
    {
        let cone = row_of(patch).cone.unwrap_or_else(|| panic!("a cone: {:?}", row_of(patch)));
        let near = |a: f64, b: f64| assert!((a - b).abs() < 1e-6 * b.abs().max(1.0), "{patch}: {a} {b} {cone:?}");
        near(cone.half_angle, f64::atan(slope).to_degrees());
        near(cone.extent[0], low);
        near(cone.extent[1], high);
        near(cone.angle, 360.0);
        (0..3).for_each(|axis| near(cone.apex[axis], apex * [0.48, -0.64, 0.6][axis]));
        assert_eq!(cone.convex, convex, "{patch}");
    }
    let kinds: Vec<ShapeKind> = (0..8).map(|patch| row_of(patch).kind).collect();
    let [plane, cylinder, cone] = [ShapeKind::Plane, ShapeKind::Cylinder, ShapeKind::Cone];
    assert_eq!(kinds, [cone, cylinder, cone, cylinder, plane, cone, cylinder, plane]);
    // without cones it takes more clusters
    let without = run(&mesh, &by(Kind::Shapes, 8));
    assert!(without.report.energy.final_.expect("finite") > 10.0 * outcome.report.energy.final_.expect("finite"));
}

#[test]
fn a_noisy_part_without_cones_has_none() {
    let (mesh, _) = generate_part(3000, 0.05).expect("a part");
    let outcome = run(&mesh, &Parameters { shapes: Some(Shapes(ShapeKind::ALL.to_vec())), ..by(Kind::Shapes, 13) });
    let rows = outcome.report.shapes.as_ref().expect("shapes");
    let of = |kind: ShapeKind| rows.iter().filter(|row| row.kind == kind).count();
    assert_eq!(ShapeKind::ALL.map(of), [7, 1, 5, 0]);
}

/// ∫ squared distance to the best plane of each cluster, by sums over triangles: the smallest eigenvalue of the second
/// moment, by Newton's method on its characteristic polynomial.
fn textbook(mesh: &PolygonMesh, labels: &[u32], clusters: usize) -> f64 {
    let middles = |face: usize| {
        let [a, b, c] = [0, 1, 2].map(|at| mesh.positions[mesh.faces.corners(face)[at] as usize]);
        let [u, v]: [[f64; 3]; 2] = [b, c].map(|end| std::array::from_fn(|axis| end[axis] - a[axis]));
        let normal = [u[1] * v[2] - u[2] * v[1], u[2] * v[0] - u[0] * v[2], u[0] * v[1] - u[1] * v[0]];
        let area = normal.iter().map(|x| x * x).sum::<f64>().sqrt() / 2.0;
        let half = |p: [f64; 3], q: [f64; 3]| -> [f64; 3] { std::array::from_fn(|axis| (p[axis] + q[axis]) / 2.0) };
        (area, [half(a, b), half(b, c), half(c, a)])
    };
    let of = |cluster: usize| {
        let faces: Vec<_> = (0..labels.len()).filter(|&face| labels[face] as usize == cluster).map(middles).collect();
        let area: f64 = faces.iter().map(|face| face.0).sum();
        let points = || faces.iter().flat_map(|(area, points)| points.map(|point| (area / 3.0, point)));
        let mean: [f64; 3] = std::array::from_fn(|axis| points().map(|(w, p)| w * p[axis]).sum::<f64>() / area);
        let s: [[f64; 3]; 3] = std::array::from_fn(|i| {
            std::array::from_fn(|j| points().map(|(w, p)| w * (p[i] - mean[i]) * (p[j] - mean[j])).sum())
        });
        let trace = s[0][0] + s[1][1] + s[2][2];
        let minors = s[0][0] * s[1][1] + s[1][1] * s[2][2] + s[2][2] * s[0][0]
            - s[0][1] * s[0][1]
            - s[1][2] * s[1][2]
            - s[0][2] * s[0][2];
        let determinant = s[0][0] * (s[1][1] * s[2][2] - s[1][2] * s[1][2])
            - s[0][1] * (s[0][1] * s[2][2] - s[1][2] * s[0][2])
            + s[0][2] * (s[0][1] * s[1][2] - s[1][1] * s[0][2]);
        (0..60).fold(0.0, |x: f64, _| {
            let value = ((x - trace) * x + minors) * x - determinant;
            let slope = (3.0 * x - 2.0 * trace) * x + minors;
            if slope > 0.0 { x - value / slope } else { x }
        })
    };
    (0..clusters).map(of).sum()
}

#[test]
fn reported_energies_are_those_of_the_textbook() {
    let mesh = generate(Sample::Knot, 900).expect("a sample");
    let outcome = run(&mesh, &by(Kind::Planes, 30));
    let energy = &outcome.report.energy;
    let (found, textbook) = (energy.final_.expect("finite"), textbook(&mesh, labels(&outcome), 30));
    assert!((found / textbook - 1.0).abs() < 1e-5, "{found} {textbook}");
    assert_eq!((energy.functional.as_str(), energy.hexagon_ratio), ("planes", None));
    assert_eq!(outcome.report.iterations.last().and_then(|row| row.energy), energy.final_);
    assert_eq!(outcome.report.iterations[0].energy, energy.initial);
    assert!(energy.final_ < energy.initial && energy.l21.is_some());
    assert_eq!(
        (outcome.report.parameters.seeds.clone(), outcome.report.parameters.refine),
        (Seeds::Merged, Refine::None)
    );
}

#[test]
fn clusters_do_not_cross_features_and_a_limit_ends_the_run() {
    let (mesh, truth) = generate_part(1500, 0.0).expect("a part");
    let features = Some(Features { angle: Some(60.0), groups: false });
    let outcome = run(&mesh, &Parameters { features, ..by(Kind::Planes, 40) });
    assert_eq!((outcome.report.feature_edges_inside, outcome.report.disconnected_clusters), (0, 0));
    let wanted = WantedFeatures { angle: Some(60.0), groups: None };
    let surface = Surface::build_with(&mesh, false, Wanted::default(), Some(wanted)).expect("a surface");
    assert!(!surface.features.is_empty() && surface.components.len() > 3);
    let patches: BTreeSet<(u32, u32)> = labels(&outcome).iter().copied().zip(truth).collect();
    assert!(patches.len() < 60, "{patches:?}");
    let limited =
        Parameters { max_iterations: Some(2), snapshots: Some(Snapshots::At(vec![0, 1])), ..by(Kind::Planes, 13) };
    let outcome = run(&mesh, &limited);
    assert_eq!(outcome.report.iterations.len(), 3);
    assert_eq!(outcome.report.snapshots, [0, 1]);
    assert!(outcome.report.warnings.iter().any(|warning| warning.contains("max_iterations")));
}

#[test]
fn merging_planes_one_by_one_stops_at_its_bound_on_work() {
    // with one cluster more, clusters merge in rounds to the end
    for (sides, clusters, is_bounded) in [(800, 100, false), (2400, 300, true), (2400, 301, false)] {
        let outcome = run(&zoo::wheel(sides), &by(Kind::Planes, clusters));
        let warnings = &outcome.report.warnings;
        assert_eq!(warnings.iter().any(|warning| warning.contains("bound on work")), is_bounded, "{warnings:?}");
        let all: BTreeSet<u32> = labels(&outcome).iter().copied().collect();
        assert_eq!((all.len() as u64, outcome.report.disconnected_clusters), (clusters, 0));
    }
}

#[test]
fn another_number_of_clusters_and_polygons_are_as_if_prepared_anew() {
    let mesh = generate(Sample::Quads, 500).expect("a sample");
    let mut prepared = try_to_prepare(&mesh, &by(Kind::Shapes, 9)).expect("a surface");
    clustered(&prepared);
    prepared.with_clusters(14).expect("a number that is possible");
    let again = run(&mesh, &by(Kind::Shapes, 14));
    assert_eq!(labels(&clustered(&prepared)), labels(&again));
    assert!(prepared.with_clusters(501 * 4).is_err());
}

#[test]
fn what_makes_no_sense_is_refused() {
    let refused = |parameters: Parameters| parameters.check(false).expect_err("a refusal").message;
    let planes = || by(Kind::Planes, 3);
    for (parameters, words) in [
        (Parameters { shapes: Some("plane".parse().expect("a list")), ..planes() }, "energy=shapes"),
        (Parameters { resolution: Some("0.1u".parse().expect("a length")), ..Parameters::default() }, "energy=shapes"),
        (Parameters { algorithm: Algorithm::Acvd, ..planes() }, "bb, pml, ml and hr"),
        (Parameters { algorithm: Algorithm::Ml, collapse_fraction: Some(5.0), ..planes() }, "collapse_fraction"),
        (Parameters { algorithm: Algorithm::Ml, optimize_iterations: Some(5), ..planes() }, "optimize_iterations"),
        (Parameters { algorithm: Algorithm::Pml, pairs: Pairs::All, ..planes() }, "pairs"),
        (Parameters { algorithm: Algorithm::Hr, ties: Ties::LargestId, ..planes() }, "ties"),
        (Parameters { quality: Quality::Best, ..planes() }, "quality"),
        (Parameters { seeds: Seeds::Random, ..planes() }, "seeds"),
        (Parameters { allow_disconnected: true, ..planes() }, "allow_disconnected"),
        (Parameters { curvature_exponent: Some(1.0), ..planes() }, "curvature_exponent"),
        (Parameters { clusters: None, ..planes() }, "clusters"),
    ] {
        let message = refused(parameters.clone());
        assert!(message.contains(words), "{parameters:?}: {message}");
    }
    let error = planes().check_points().expect_err("points have no planes");
    assert!(error.message.contains("energy"), "{error}");
    let mesh = generate(Sample::Cube, 12).expect("a sample");
    let parameters = planes();
    let weights = b"1 2 3".as_slice();
    let job = InMemory {
        mesh: (&mesh).into(),
        limits: Limits::default(),
        parameters: &parameters,
        seeds: None,
        weights: Some(weights),
    };
    assert!(job::prepare_in_memory(&job).expect_err("weights").error.message.contains("weights"));
    assert!(try_to_prepare(&mesh, &by(Kind::Planes, 13)).is_err());
}

#[test]
fn real_meshes_end_far_below_variational_shape_approximation() {
    let Some(folder) = zoo::shared_meshes() else { return };
    // CGAL 5.5: .154, .0192; 6.8e-6; the prototype .0305, 8.4e-4; 3.9e-6
    for (name, clusters, most) in
        [("fandisk.obj", 22, 0.0309), ("fandisk.obj", 60, 8.5e-4), ("rocker-arm.obj", 100, 3.9e-6)]
    {
        let bytes = std::fs::read(folder.join(name)).expect("a mesh");
        let parameters = by(Kind::Planes, clusters);
        let prepared = job::prepare(&Request::new(&bytes, Format::Obj, &parameters)).expect("a mesh");
        let energy = clustered(&prepared).report.energy.final_.expect("finite");
        assert!(energy < most, "{name} k={clusters}: {energy}");
    }
}

/// A cylinder of radius 1 with so many sides, each a quad, between two polygons.
fn capped_cylinder(sides: usize, height: f64) -> PolygonMesh {
    let circle = (0..sides).map(|side| std::f64::consts::TAU * side as f64 / sides as f64);
    let ring = |z: f64| circle.clone().map(move |angle| [angle.cos(), angle.sin(), z]);
    let positions: Vec<[f64; 3]> = ring(0.0).chain(ring(height)).collect();
    let number = |side: usize, top: usize| (side % sides + top * sides) as u32;
    let quad = |side: usize| vec![number(side, 0), number(side + 1, 0), number(side + 1, 1), number(side, 1)];
    let bottom = (0..sides).rev().map(|side| number(side, 0)).collect();
    let top = (0..sides).map(|side| number(side, 1)).collect();
    let faces: Vec<Vec<u32>> = (0..sides).map(quad).chain([bottom, top]).collect();
    zoo::mesh(&positions, &faces.iter().map(Vec::as_slice).collect::<Vec<_>>())
}

#[test]
fn caps_of_one_polygon_are_no_part_of_their_cylinder() {
    for sides in [6, 12, 24, 32, 48, 64] {
        let mesh = capped_cylinder(sides, 2.0);
        let side: Vec<u32> = vec![0; sides].into_iter().chain([1, 2]).collect();
        assert_eq!(labels(&run(&mesh, &by(Kind::Shapes, 3))), side, "{sides}");
        // of fewer sides, no two are within the tolerance of a plane
        if sides >= 24 {
            let (clusters, tolerance) = (None, Some(Length::Share(0.01)));
            let within = Parameters { clusters, tolerance, ..by(Kind::Shapes, 3) };
            for mesh in [mesh, capped_cylinder(sides, 40.0)] {
                assert_eq!(labels(&run(&mesh, &within)), side, "{sides}");
            }
        }
    }
}
