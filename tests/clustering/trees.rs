//! Hierarchies of planes and shapes, looked at from outside.

use std::collections::BTreeSet;

use crate::common::zoo;
use tesserae_mesh::dev::sample::{Sample, generate, generate_part};
use tesserae_mesh::device::cpu::CpuDevice;
use tesserae_mesh::device::{Cancel, pieces};
use tesserae_mesh::energy::Kind;
use tesserae_mesh::error;
use tesserae_mesh::hierarchy::Tree;
use tesserae_mesh::job::{self, InMemory, Outcome, RESOLUTION};
use tesserae_mesh::mesh::{Limits, PolygonMesh};
use tesserae_mesh::parameters::{Algorithm, Features, Levels, Optimize, Parameters, Shapes};
use tesserae_mesh::shapes::best::{Allowed, FEWEST_FACES};
use tesserae_mesh::shapes::faces::{Faces, members};
use tesserae_mesh::shapes::kind::Kind as Shape;
use tesserae_mesh::shapes::moments::{Higher, Moments};
use tesserae_mesh::shapes::prices::Prices;
use tesserae_mesh::surface::{Surface, Wanted, WantedFeatures};

const ALGORITHMS: [Algorithm; 3] = [Algorithm::Pml, Algorithm::Ml, Algorithm::Hr];

fn tree_of(energy: Kind, algorithm: Algorithm) -> Parameters {
    Parameters { energy, algorithm, ..Parameters::default() }
}

fn try_to_run(mesh: &PolygonMesh, parameters: &Parameters, cancel: &Cancel) -> Result<Outcome, error::Error> {
    let job = InMemory { mesh: mesh.into(), limits: Limits::default(), parameters, seeds: None, weights: None };
    let prepared = job::prepare_in_memory(&job).map_err(|refusal| refusal.error)?;
    job::run(&prepared, &mut CpuDevice::new(), cancel, &mut |_| {})
}

fn run(mesh: &PolygonMesh, parameters: &Parameters) -> Outcome {
    try_to_run(mesh, parameters, &Cancel::default()).expect("a result")
}

fn tree(outcome: &Outcome) -> &Tree {
    &outcome.hierarchy.as_ref().expect("a hierarchy").tree
}

/// Numbers of clusters to cut at: some that rounds ended with, and others.
fn cuts(tree: &Tree) -> BTreeSet<u64> {
    let (few, all) = (u64::from(tree.roots()), u64::from(tree.faces));
    let ends = tree.rounds.iter().step_by(1 + tree.rounds.len() / 6).map(|round| u64::from(round.clusters));
    ends.chain([few, few + (all - few) / 7, few + (all - few) / 2, all]).collect()
}

#[test]
fn every_cut_has_its_number_of_connected_clusters() {
    let small = zoo::all().into_iter().filter(|(_, mesh)| mesh.faces.len() < 800);
    for (at, (name, mesh)) in small.enumerate() {
        for (nth, features) in [None, Some(Features { angle: Some(40.0), groups: false })].into_iter().enumerate() {
            let wanted = features.map(|features| WantedFeatures { angle: features.angle, groups: None });
            let surface = Surface::build_with(&mesh, false, Wanted::default(), wanted).expect("a surface");
            let few = surface.components.len() as u64;
            let level = few + (surface.faces() as u64 - few) / 9;
            for (turn, algorithm) in ALGORITHMS.into_iter().enumerate() {
                for energy in zoo::in_turn(at / 2 + nth + turn, &[Kind::Planes, Kind::Shapes]) {
                    let levels = Some(Levels(vec![level]));
                    let outcome = run(&mesh, &Parameters { features, levels, ..tree_of(energy, algorithm) });
                    let (tree, of) = (tree(&outcome), format!("{name} {energy:?} {algorithm:?} {features:?}"));
                    assert_eq!(u64::from(tree.roots()), few, "{of}");
                    assert_eq!(tree.is_nested(), algorithm == Algorithm::Hr || tree.moves.is_empty(), "{of}");
                    for clusters in cuts(tree).into_iter().chain([level]) {
                        let cut = tree.labels_at(clusters).expect("a cut");
                        assert_eq!(cut.clusters(), clusters, "{of}");
                        let internal: Vec<u32> =
                            surface.upload_face.iter().map(|&face| cut.labels[face as usize]).collect();
                        let pieces = pieces::disconnected_clusters(&surface.items, clusters as usize, &internal);
                        assert_eq!(pieces, 0, "{of} {clusters}");
                    }
                }
            }
        }
    }
}

#[test]
fn energies_of_rounds_are_those_of_their_cuts_from_scratch() {
    let (part, _) = generate_part(600, 0.3).expect("a part");
    let kinds = [Shape::Plane, Shape::Sphere];
    for mesh in [part, generate(Sample::Cube, 300).expect("quads"), generate(Sample::Knot, 500).expect("a sample")] {
        let surface = Surface::build(&mesh).expect("a surface").with_normals((&mesh).into());
        let samples = surface.samples(&surface.corners((&mesh).into()));
        let faces = Faces { graph: &surface.graph, samples: &samples };
        for (energy, kinds) in [(Kind::Planes, &kinds[..1]), (Kind::Shapes, &kinds[..])] {
            let of_shapes = (energy == Kind::Shapes).then(|| Shapes(kinds.to_vec()));
            for algorithm in ALGORITHMS {
                let levels = Some(Levels(vec![50]));
                let parameters = Parameters { shapes: of_shapes.clone(), levels, ..tree_of(energy, algorithm) };
                let outcome = run(&mesh, &parameters);
                let prices = Prices::of_tree(faces.graph, None, surface.on_lattice(|_| RESOLUTION));
                let allowed = Allowed { kinds, prices: &prices, tolerance: None };
                let from_scratch = |labels: &[u32], clusters: usize| -> f64 {
                    let internal: Vec<u32> = surface.upload_face.iter().map(|&face| labels[face as usize]).collect();
                    let of = |members: &Vec<u32>| {
                        let has_enough = members.len() as u32 >= FEWEST_FACES;
                        let higher = || has_enough.then(|| Higher::of_all(&faces, members));
                        let best = allowed.fits(0, &Moments::of_all(&faces, members), higher, &[]).best();
                        best.energy - prices[0].of_kind(best.kind)
                    };
                    let energy: f64 = members(&internal, clusters, |_| true).iter().map(of).sum();
                    surface.source_of_lattice(energy * 4096.0, 0) / 3.0
                };
                let tree = tree(&outcome);
                let last = tree.rounds.last().expect("a round").energy;
                for round in tree.rounds.iter().step_by(1 + tree.rounds.len() / 20).chain(tree.rounds.last()) {
                    let cut = tree.labels_at(round.clusters.into()).expect("a cut");
                    let expected = from_scratch(&cut.labels, round.clusters as usize);
                    let off = (round.energy - expected).abs();
                    assert!(
                        off <= 1e-9 * last,
                        "{energy:?} {algorithm:?} {}: {expected} {}",
                        round.clusters,
                        round.energy
                    );
                    assert_eq!(round.energy, cut.energy);
                }
                let parts = |pick: fn(&tesserae_mesh::hierarchy::Merge) -> bool| tree.merges.iter().any(pick);
                assert!(parts(|merge| merge.made.shape == Some(Shape::Plane)));
                assert!(!parts(|merge| merge.made.shape.is_none()));
            }
        }
    }
}

#[test]
fn any_number_of_threads_gives_the_same_hierarchy() {
    let (mesh, _) = generate_part(1200, 0.2).expect("a part");
    for algorithm in ALGORITHMS {
        let parameters = Parameters { levels: Some(Levels(vec![60, 20])), ..tree_of(Kind::Shapes, algorithm) };
        let of = |threads| {
            let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().expect("a pool");
            pool.install(|| tree(&run(&mesh, &parameters)).clone())
        };
        assert_eq!(of(1), of(3), "{algorithm:?}");
    }
}

#[test]
fn a_hierarchy_that_ends_early_is_the_flat_clustering_of_small_planes_and_has_their_shapes() {
    let (mesh, _) = generate_part(1200, 0.2).expect("a part");
    // flat clusterings merge larger planes one by one
    let of = |algorithm| run(&mesh, &Parameters { clusters: Some(200), ..tree_of(Kind::Planes, algorithm) });
    let [flat, tree] = [Algorithm::Bb, Algorithm::Pml].map(of);
    assert!((&flat.labels, &flat.report.shapes) == (&tree.labels, &tree.report.shapes));
    assert_eq!(flat.report.energy.final_, tree.report.energy.final_);
    assert_eq!(tree.report.energy.initial, None);
    // whole trees have neither labels nor shapes of their own
    let whole = run(&mesh, &tree_of(Kind::Planes, Algorithm::Pml));
    assert_eq!((whole.labels, whole.report.shapes.is_none()), (None, true));
}

#[test]
fn the_shapes_of_the_last_clusters_are_near_their_faces() {
    let (mesh, _) = generate_part(3000, 0.0).expect("a part");
    for algorithm in ALGORITHMS {
        for clusters in [13, 20, 30] {
            let outcome = run(&mesh, &Parameters { clusters: Some(clusters), ..tree_of(Kind::Shapes, algorithm) });
            let (report, energy) = (&outcome.report, outcome.report.energy.final_.expect("an energy"));
            let rows = report.shapes.as_ref().expect("shapes");
            let of_corners: f64 = rows.iter().map(|row| row.area * row.residual.rms.powi(2)).sum();
            assert!(of_corners <= 10.0 * energy, "{algorithm:?} {clusters}: {of_corners} of corners, {energy}");
        }
    }
}

#[test]
fn moves_after_each_merge_lower_the_energy() {
    let (mesh, _) = generate_part(1200, 0.2).expect("a part");
    let energy = |algorithm, optimize| {
        let outcome = run(&mesh, &Parameters { optimize, ..tree_of(Kind::Planes, algorithm) });
        tree(&outcome).labels_at(40).expect("a cut").energy
    };
    let [moved, merged] = [Algorithm::Ml, Algorithm::Hr].map(|algorithm| energy(algorithm, Optimize::On));
    assert!(moved < merged, "{moved} {merged}");
    assert_eq!(energy(Algorithm::Ml, Optimize::None), merged);
}

#[test]
fn a_hierarchy_can_be_cancelled() {
    let (mesh, _) = generate_part(1200, 0.2).expect("a part");
    for algorithm in ALGORITHMS {
        let job = InMemory {
            mesh: (&mesh).into(),
            limits: Limits::default(),
            parameters: &tree_of(Kind::Shapes, algorithm),
            seeds: None,
            weights: None,
        };
        let prepared = job::prepare_in_memory(&job).map_err(|refusal| refusal.error).expect("a surface");
        let (cancel, mut rounds) = (Cancel::default(), 0);
        let cancelled = job::run(&prepared, &mut CpuDevice::new(), &cancel, &mut |_| {
            rounds += 1;
            cancel.cancel();
        });
        assert_eq!(cancelled.expect_err("cancelled").kind, error::Kind::Cancelled);
        assert_eq!(rounds, 1, "{algorithm:?}");
    }
}

#[test]
fn a_face_with_very_many_neighbours_takes_bounded_work() {
    let outcome = run(&zoo::wheel(2000), &tree_of(Kind::Planes, Algorithm::Hr));
    assert!(tree(&outcome).rounds.len() < 200, "{}", tree(&outcome).rounds.len());
    assert!(outcome.report.warnings.iter().any(|warning| warning.contains("bound on work")));
}
