//! Connected moves against their definition: meshes, grids, nearest neighbours, hubs.

use crate::common::zoo;
use tesserae_mesh::cluster::connected::{Clusters, settle};
use tesserae_mesh::cluster::flat::{self, Options};
use tesserae_mesh::cluster::record::Record;
use tesserae_mesh::cluster::run::Phase;
use tesserae_mesh::cluster::seeds;
use tesserae_mesh::data::{Csr, Graph, Members, PointSet, Values, lay};
use tesserae_mesh::dev::random;
use tesserae_mesh::device::cpu::CpuDevice;
use tesserae_mesh::device::plain::{self, ConnectedMoves};
use tesserae_mesh::device::{Cancel, Device, Ending, FREE, pieces};
use tesserae_mesh::energy::{Energy, Functional, OfPoints};
use tesserae_mesh::parameters::Seeds;
use tesserae_mesh::surface::{DualGraph, Items, Moves, Surface, Units};

/// A clustering from which connected moves begin.
struct Start<E: Functional> {
    name: String,
    graph: DualGraph<E>,
    component_of_cluster: Vec<u32>,
    /// Connected clusters, far from a minimum: grown from seeds.
    labels: Vec<u32>,
}

impl<E: Functional> Start<E> {
    fn new(name: &str, items: &Items<E>, clusters: usize, moves: Moves) -> Self {
        let clusters = clusters.clamp(items.components.len(), items.faces()) as u64;
        let seeds = seeds::choose(items, clusters, &Seeds::Random, 9, None).expect("the number is possible");
        let mut free = vec![FREE; items.faces()];
        (0..).zip(&seeds.face_of_cluster).for_each(|(cluster, &face)| free[face as usize] = cluster);
        let graph = DualGraph { moves, ..items.graph.clone() };
        let labels = plain::grow(&graph, &free);
        let name = format!("{name}, {clusters} clusters, {moves:?}");
        Self { name, graph, component_of_cluster: seeds.component_of_cluster, labels }
    }

    /// Several numbers of clusters, and both kinds of moves.
    fn of_items(name: &str, items: &Items<E>) -> impl Iterator<Item = Self> {
        let kinds = [3, items.faces() / 12, items.faces() / 3].map(|k| [(k, Moves::Free), (k, Moves::Connected)]);
        kinds.into_iter().flatten().map(move |(clusters, moves)| Self::new(name, items, clusters, moves))
    }

    /// The labels after each pass, as they are made in use, and how the passes end.
    fn in_use(&self) -> (Vec<Vec<u32>>, Ending) {
        let mut clusters = Clusters::new(&self.graph, self.labels.clone());
        let mut changed: Vec<u32> = clusters.numbers().collect();
        let mut after = Vec::new();
        while !changed.is_empty() {
            changed = settle::pass(&mut clusters, &changed);
            after.extend((clusters.take_moves() > 0).then(|| clusters.labels().to_vec()));
        }
        (after, clusters.ending())
    }

    /// The same by the definition, with a rule that says which faces may leave. Up to `most` passes.
    fn defined(&self, most: usize, rule: impl Fn(&mut ConnectedMoves<E>, u32) -> bool) -> Vec<Vec<u32>> {
        let mut phase = ConnectedMoves::new(&self.graph, &self.component_of_cluster, self.labels.clone());
        std::iter::from_fn(|| phase.pass(&rule)).take(most).map(|pass| pass.labels).collect()
    }

    fn clusters_in_pieces(&self, labels: &[u32]) -> u64 {
        pieces::disconnected_clusters(&self.graph, self.component_of_cluster.len(), labels)
    }

    fn explained(&self, labels: &[u32]) -> i128 {
        plain::explained(&self.graph, &self.component_of_cluster, labels)
    }
}

/// Points at random, their coordinates small numbers: many are equal.
fn points(graph: Graph, shape: &[usize], dimensions: usize, seed: u64) -> PointSet {
    let mut states = random(seed);
    let mut next = || (states() >> 33) as i32 % 12;
    let values = (0..shape.iter().product::<usize>() * dimensions).map(|_| next()).collect();
    PointSet { dimensions, values: Values::I4(values), weights: None, mask: None, shape: shape.to_vec(), graph }
}

fn items<const D: usize>(set: &PointSet) -> Items<OfPoints<D>> {
    let laid = lay::<D>(set, &Members::new(set.items(), None), false).expect("points on the lattice");
    let graph = DualGraph {
        points: laid.points,
        weights: laid.weights,
        neighbours: laid.neighbours,
        components: laid.components,
        moves: Moves::Connected,
    };
    let units = Units { centre: [0.0; D], exponent: laid.exponent, weight_exponent: 0, density: 1.0 };
    Items::new(graph, laid.member, units)
}

/// A ring, and hubs that are neighbours of every second and every third item.
fn around_hubs(items: i64) -> Graph {
    let hub = |item: i64| if item % 3 == 0 { 0 } else { 1 };
    let rows = (0..items).map(|item| [(item + 1) % items, hub(item)].into_iter().filter(move |&near| near != item));
    let rows: Vec<Vec<i64>> = rows.map(Iterator::collect).collect();
    let ends = rows.iter().scan(0, |end, row| Some(std::mem::replace(end, *end + row.len() as i64) + row.len() as i64));
    let indptr: Vec<i64> = std::iter::once(0).chain(ends).collect();
    Graph::Rows(Csr::new(indptr.into_iter(), rows.concat().into_iter()).expect("rows"))
}

fn of_points() -> Vec<Start<OfPoints<8>>> {
    let grid = |full: bool| Graph::Grid { full };
    let seeds = if zoo::is_long() { 1..=3 } else { 1..=2 };
    let sets = seeds.flat_map(|seed| {
        [
            ("grid", points(grid(false), &[13, 17], 5, seed)),
            ("full grid", points(grid(true), &[12, 12], 1, seed)),
            ("volume", points(grid(false), &[5, 6, 7], 2, seed)),
            ("nearest", points(Graph::Knn(3), &[180], 2, seed)),
            ("hubs", points(around_hubs(200), &[200], 3, seed)),
        ]
    });
    sets.flat_map(|(name, set)| Start::of_items(name, &items::<8>(&set)).collect::<Vec<_>>()).collect()
}

fn of_meshes() -> Vec<Start<Energy>> {
    let small = zoo::all().into_iter().filter(|(_, mesh)| mesh.faces.len() < 320);
    let wheel = std::iter::once(("wheel".to_owned(), zoo::wheel(150)));
    let surfaces = small.chain(wheel).map(|(name, mesh)| (name, Surface::build(&mesh).expect("a surface")));
    surfaces.flat_map(|(name, surface)| Start::of_items(&name, &surface).collect::<Vec<_>>()).collect()
}

/// Compares every pass, and what clusters and energy do. Returns the number of passes, 0 where a bound on work
/// ends them.
fn compare<E: Functional>(start: &Start<E>) -> usize {
    let (made, ending) = start.in_use();
    if ending == Ending::WorkLimit {
        // free moves hold faces once searches were long, which the definition does not know
        assert_eq!(start.graph.moves, Moves::Free, "{}", start.name);
        return 0;
    }
    let passes = start.defined(usize::MAX, |phase, face| phase.may_leave(face));
    assert_eq!(made, passes, "{}", start.name);
    let mut before = start.explained(&start.labels);
    for labels in &passes {
        assert_eq!(start.clusters_in_pieces(labels), 0, "{}", start.name);
        let explained = start.explained(labels);
        assert!(explained > before, "{}: F falls", start.name);
        before = explained;
    }
    passes.len()
}

#[test]
fn every_pass_is_the_one_that_the_definition_says() {
    let on_meshes: usize = of_meshes().iter().map(compare).sum();
    let on_points: usize = of_points().iter().map(compare).sum();
    assert!(on_meshes > 200 && on_points > 200, "hardly anything was compared: {on_meshes} and {on_points} passes");
}

#[test]
fn a_run_with_connected_moves_makes_the_passes_of_the_definition_and_no_others() {
    for start in of_points().iter().filter(|start| start.graph.moves == Moves::Connected) {
        let mut device = CpuDevice::new();
        let mut steps = device.open(&start.graph, &start.component_of_cluster).expect("the cpu takes everything");
        let options = Options { max_iterations: None, refine: true, allow_disconnected: false };
        let mut rows = Vec::new();
        let run = flat::boundary_based(
            &start.graph,
            &start.labels,
            options,
            steps.as_mut(),
            &Cancel::default(),
            &mut |row| rows.push((row.phase, row.energy.explained)),
            &mut Record::default(),
        );
        let passes = start.defined(usize::MAX, |phase, face| phase.may_leave(face));
        let expected: Vec<_> = passes.iter().map(|labels| (Phase::Refine, start.explained(labels))).collect();
        assert_eq!(rows[1..], expected, "{}", start.name);
        assert_eq!(&run.expect("no cancellation").labels, passes.last().unwrap_or(&start.labels), "{}", start.name);
    }
}

#[test]
fn without_one_of_its_rules_the_definition_differs_from_what_is_made() {
    let [mut broken, mut without_holding, mut with_detours_only] = [0; 3];
    for start in of_points().iter().filter(|start| start.graph.moves == Moves::Connected) {
        let (made, _) = start.in_use();
        let most = made.len() + 1;
        // faces that cut their cluster leave, too
        let torn = start.defined(most, |_, _| true);
        broken += usize::from(torn.iter().any(|labels| start.clusters_in_pieces(labels) > 0));
        // no face is held
        without_holding += usize::from(start.defined(most, |phase, face| phase.is_whole_without(face)) != made);
        // faces without a detour are refused, without a search
        with_detours_only += usize::from(start.defined(most, |phase, face| phase.has_detour(face)) != made);
    }
    assert!(
        broken > 20 && without_holding > 0 && with_detours_only > 0,
        "{broken} {without_holding} {with_detours_only}"
    );
}
