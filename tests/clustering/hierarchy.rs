//! Hierarchies against brute force, and the promises that every hierarchy keeps.

use crate::common::{pml, zoo};
use tesserae_mesh::cluster::hierarchy::{Hierarchy, Options, RoundRow, hierarchical};
use tesserae_mesh::cluster::merging::Pairs;
use tesserae_mesh::cluster::quality::Quality;
use tesserae_mesh::dev::sample::hard::star;
use tesserae_mesh::dev::sample::{Sample, generate};
use tesserae_mesh::device::Cancel;
use tesserae_mesh::device::cpu::CpuDevice;
use tesserae_mesh::device::dual_edge::{Rank, Ties};
use tesserae_mesh::device::pieces::disconnected_clusters;
use tesserae_mesh::device::plain;
use tesserae_mesh::energy::{ClusterSums, End, Energy, Functional, Sums};
use tesserae_mesh::hierarchy::{Round, Tree};
use tesserae_mesh::surface::Surface;

/// Sequential rounds without optimisation: exact greedy Ward clustering.
fn hr() -> Options {
    Options { sequential_at: u64::MAX, optimise: false, ..pml() }
}

struct Outcome {
    tree: Tree,
    labels: Vec<u32>,
    rounds: Vec<RoundRow>,
}

fn run(surface: &Surface, options: &Options) -> Outcome {
    let mut device = CpuDevice::new();
    let mut rounds = Vec::new();
    let run = hierarchical(surface, options, &mut device, &Cancel::default(), &mut |_| {}, &mut |row| rounds.push(row));
    let Hierarchy { tree, labels, .. } = run.expect("no cancellation");
    Outcome { tree, labels, rounds }
}

fn sums_of(surface: &Surface, labels: &[u32]) -> Vec<ClusterSums> {
    let mut sums = vec![ClusterSums::default(); labels.len()];
    for (face, &label) in labels.iter().enumerate() {
        sums[label as usize].add_face(surface.face(face), 1);
    }
    sums
}

fn end(sums: &ClusterSums) -> End<[i32; 3]> {
    End { weight: sums.weight as u64, proxy: sums.fit().expect("it has faces").0 }
}

/// All pairs of clusters that share a dual edge, by internal numbers, the smaller first.
fn adjacent(surface: &Surface, labels: &[u32]) -> Vec<(u32, u32)> {
    let mut pairs: Vec<(u32, u32)> = (0..labels.len() as u32)
        .flat_map(|face| surface.neighbours_of(face).iter().map(move |&near| (face, near)))
        .map(|(face, near)| (labels[face as usize], labels[near as usize]))
        .filter(|(a, b)| a < b)
        .collect();
    pairs.sort_unstable();
    pairs.dedup();
    pairs
}

/// Merges two clusters as the definition says.
fn merge(surface: &Surface, labels: &mut [u32], (low, high): (u32, u32)) {
    let sums = sums_of(surface, labels);
    let keeps_high = sums[high as usize].faces > sums[low as usize].faces;
    let (into, from) = if keeps_high { (high, low) } else { (low, high) };
    labels.iter_mut().filter(|label| **label == from).for_each(|label| *label = into);
}

/// Labels numbered by the first face of the upload that carries them.
fn canonical(surface: &Surface, labels: &[u32]) -> Vec<u32> {
    let by_upload = surface.in_upload_order(labels);
    let mut seen = Vec::new();
    by_upload
        .into_iter()
        .map(|label| {
            seen.iter().position(|&known| known == label).unwrap_or_else(|| {
                seen.push(label);
                seen.len() - 1
            }) as u32
        })
        .collect()
}

/// The rounds of a tree but that of the loose faces.
fn of_surface<'a>(surface: &Surface, tree: &'a Tree) -> &'a [Round] {
    &tree.rounds[usize::from(!surface.loose.is_empty())..]
}

fn small_zoo() -> Vec<(String, Surface)> {
    let small = zoo::all().into_iter().filter(|(_, mesh)| mesh.faces.len() <= 300);
    small.map(|(name, mesh)| (name, Surface::build(&mesh).expect("the zoo can be put on the lattice"))).collect()
}

#[test]
fn without_optimisation_sequential_rounds_are_exact_greedy_ward_step_by_step() {
    for (name, surface) in small_zoo() {
        let Outcome { tree, .. } = run(&surface, &hr());
        let mut labels: Vec<u32> = (0..surface.faces() as u32).collect();
        for (step, round) in of_surface(&surface, &tree).iter().enumerate() {
            let sums = sums_of(&surface, &labels);
            let cheapest = adjacent(&surface, &labels)
                .into_iter()
                .map(|(a, b)| {
                    let component = surface.components.iter().find(|run| run.range().contains(&(a as usize)));
                    let shift = component.expect("every face is in one").energy_shift;
                    let cost = Energy::merge_cost(end(&sums[a as usize]), end(&sums[b as usize])) << shift;
                    Rank::new(cost, a, b, Ties::Hash)
                })
                .min()
                .unwrap_or_else(|| panic!("{name}: step {step} merges what is not there"));
            merge(&surface, &mut labels, cheapest.ends());
            let cut = tree.labels_at(u64::from(round.clusters)).expect("a round's own number");
            assert_eq!(cut.labels, canonical(&surface, &labels), "{name}: step {step}");
        }
        assert_eq!(adjacent(&surface, &labels), [], "{name}: something is left to merge");
        assert!(tree.is_nested());
    }
}

#[test]
fn parallel_rounds_merge_the_pairs_that_chose_each_other() {
    for (name, surface) in small_zoo() {
        for (ties, which) in [
            (Ties::Hash, Pairs::CheaperHalf),
            (Ties::Hash, Pairs::All),
            (Ties::LargestId, Pairs::CheaperHalf),
            (Ties::LargestId, Pairs::All),
        ] {
            let Outcome { tree, .. } = run(&surface, &Options { optimise: false, ties, pairs: which, ..pml() });
            let mut labels: Vec<u32> = (0..surface.faces() as u32).collect();
            for (step, round) in of_surface(&surface, &tree).iter().enumerate() {
                let sums = sums_of(&surface, &labels);
                let pairs = adjacent(&surface, &labels);
                let cost = |&(a, b): &(u32, u32)| {
                    let component = surface.components.iter().find(|run| run.range().contains(&(a as usize)));
                    let shift = component.expect("every face is in one").energy_shift;
                    Energy::packed_merge_cost(end(&sums[a as usize]), end(&sums[b as usize]), shift)
                };
                let best = |cluster: u32| {
                    let edges = pairs.iter().filter(|&&(a, b)| a == cluster || b == cluster);
                    let rank = |pair: &(u32, u32)| {
                        Rank::new(cost(pair), cluster, if pair.0 == cluster { pair.1 } else { pair.0 }, ties)
                    };
                    edges.map(rank).min().map(|rank| rank.ends())
                };
                let mut mutual: Vec<(u32, u32)> = pairs
                    .iter()
                    .copied()
                    .filter(|&(a, b)| best(a) == Some((a, b)) && best(b) == Some((a, b)))
                    .collect();
                if which == Pairs::CheaperHalf {
                    let mut costs: Vec<u32> = mutual.iter().map(cost).collect();
                    costs.sort_unstable();
                    mutual.retain(|pair| cost(pair) <= costs[(costs.len() - 1) / 2]);
                }
                for pair in mutual {
                    merge(&surface, &mut labels, pair);
                }
                let cut = tree.labels_at(u64::from(round.clusters)).expect("a round's own number");
                assert_eq!(cut.labels, canonical(&surface, &labels), "{name} {ties:?} {which:?}: round {step}");
            }
            assert_eq!(adjacent(&surface, &labels), [], "{name} {ties:?} {which:?}: something is left to merge");
        }
    }
}

#[test]
fn around_a_hub_rounds_are_few() {
    let triangles = 3000;
    let surface = Surface::build(&star(triangles)).expect("a surface");
    for (options, bounded_at) in [(pml(), None), (hr(), Some(1602)), (Options { optimise: true, ..hr() }, Some(2616))] {
        let (device, cancel) = (&mut CpuDevice::new(), Cancel::default());
        let run = hierarchical(&surface, &options, device, &cancel, &mut |_| {}, &mut |_| {}).expect("no cancellation");
        let rounds = &run.tree.rounds;
        assert!(rounds.len() < 1399 + 32, "{options:?}: {} rounds", rounds.len());
        // 1,399 merges of one pair count 3,000 neighbours each, more than 2²²; after 385, 2·3,001·11 faces have moved
        assert_eq!(run.bounded_at, bounded_at, "{options:?}");
        assert_eq!(rounds.last().map(|round| (round.clusters, round.merges_end)), Some((1, triangles)));
    }
}

#[test]
fn a_run_with_optimisation_repeats_and_its_last_cut_is_its_last_state() {
    for (name, surface) in small_zoo() {
        for options in [pml(), Options { sequential_at: u64::MAX, ..pml() }, Options { refine: false, ..pml() }] {
            let one = run(&surface, &options);
            assert_eq!(one.tree, run(&surface, &options).tree, "{name}");
            let cut = one.tree.labels_at(u64::from(one.tree.roots())).expect("the roots");
            assert_eq!(cut.labels, canonical(&surface, &one.labels), "{name} {options:?}");
            assert_eq!(one.tree.roots() as usize, surface.components.len(), "{name}: one root a component");
        }
    }
}

#[test]
fn cuts_have_exactly_the_clusters_asked_for_all_of_them_connected() {
    for sample in [Sample::Knot, Sample::Terrain, Sample::Parts, Sample::Quads] {
        let surface = Surface::build(&generate(sample, 1500).expect("a sample")).expect("a surface");
        let internal = surface.internal_faces();
        for options in [pml(), Options { levels: vec![77, 500], ..pml() }, hr()] {
            let Outcome { tree, rounds, .. } = run(&surface, &options);
            for &level in &options.levels {
                assert!(rounds.iter().any(|row| row.clusters == level && row.is_level), "no round ends at {level}");
            }
            for clusters in (surface.components.len() as u64..=surface.faces() as u64).step_by(23) {
                let cut = tree.labels_at(clusters).expect("within the tree");
                let most = cut.labels.iter().max().map_or(0, |&label| label + 1);
                assert_eq!(u64::from(most), clusters, "{}", sample.name());
                let mut labels = vec![0; internal.len()];
                cut.labels.iter().zip(&internal).for_each(|(&label, &face)| labels[face as usize] = label);
                assert_eq!(disconnected_clusters(&surface, most as usize, &labels), 0, "{} {clusters}", sample.name());
                // the energy of the cut is that of its labels, but for the rounding of weights
                let source = surface.source_energy(&labels, most as usize);
                assert!((cut.energy - source).abs() <= 1e-4 * source + 1e-18, "{clusters}: {} {source}", cut.energy);
            }
            assert!(tree.labels_at(surface.components.len() as u64 - 1).is_err());
            assert!(tree.labels_at(surface.faces() as u64 + 1).is_err());
        }
    }
}

#[test]
fn at_levels_clusters_move_to_other_components_and_cuts_follow() {
    let mut surface = Surface::build(&generate(Sample::Parts, 1500).expect("a sample")).expect("a surface");
    // some heavy faces among light ones, in units that differ by component
    let graph = &mut surface.items.graph;
    for (number, component) in graph.components.iter_mut().enumerate() {
        component.energy_shift = number as u32 % 3;
        component.range().for_each(|face| graph.weights[face] = if face * 7 % 5 == 0 { 1 << 20 } else { 1 });
        component.weight = graph.weights[component.range()].iter().map(|&weight| u64::from(weight)).sum();
    }
    let internal = surface.internal_faces();
    let component_of_face = surface.component_of_face();
    let levels = vec![400, 90];
    let with = |relocation| run(&surface, &Options { levels: levels.clone(), relocation, ..pml() });
    let (still, moved) = (with(None), with(Some(Quality::Default)));
    let mut have_crossed = false;
    for &level in &levels {
        let energy = |outcome: &Outcome| {
            let round = outcome.rounds.iter().find(|round| round.clusters == level).expect("a level");
            assert!(round.is_level);
            round.energy
        };
        // what labels explain is the larger, the lower the energy
        assert!(energy(&moved) > energy(&still), "{level}");
        let cut = moved.tree.labels_at(level).expect("a level");
        let mut labels = vec![0; internal.len()];
        cut.labels.iter().zip(&internal).for_each(|(&label, &face)| labels[face as usize] = label);
        assert_eq!(disconnected_clusters(&surface, level as usize, &labels), 0);
        let component_of_cluster = surface.component_of_cluster(&labels, level as usize);
        assert_eq!(energy(&moved).explained, plain::explained(&surface, &component_of_cluster, &labels), "{level}");
        let shares = |outcome: &Outcome| {
            let mut shares: Vec<(u32, u32)> = outcome
                .tree
                .labels_at(level)
                .expect("a level")
                .labels
                .into_iter()
                .zip(surface_components(&surface))
                .collect();
            shares.sort_unstable();
            shares.dedup();
            let mut of_component: Vec<u32> = shares.into_iter().map(|(_, component)| component).collect();
            of_component.sort_unstable();
            of_component
        };
        have_crossed |= shares(&moved) != shares(&still);
    }
    assert!(have_crossed, "every component has the clusters that it had");
    assert_eq!(moved.tree.roots() as usize, surface.components.len());
    let last = moved.tree.labels_at(u64::from(moved.tree.roots())).expect("the roots");
    assert_eq!(last.labels, canonical(&surface, &component_of_face), "one root a component");
}

/// The component of each face of the upload.
fn surface_components(surface: &Surface) -> Vec<u32> {
    let component_of_face = surface.component_of_face();
    surface.internal_faces().iter().map(|&face| component_of_face[face as usize]).collect()
}

#[test]
fn energies_of_rounds_are_those_of_their_labels_and_a_level_has_converged() {
    let surface = Surface::build(&generate(Sample::Knot, 3000).expect("a sample")).expect("a surface");
    let component_of_cluster = surface.component_of_face();
    // rounds that are cut short leave bids that the next ones must not act upon unseen
    for (iterations, sequential_at) in [1, 2, 4, 7, 30, u32::MAX].into_iter().flat_map(|n| [(n, 0), (n, u64::MAX)]) {
        // rounds of several merges one after the other, too
        let collapse_fraction = (sequential_at > 0).then_some(50.0);
        let options = Options {
            clusters: Some(60),
            iterations_a_round: [iterations; 2],
            sequential_at,
            collapse_fraction,
            // settling ends where every move that is left would cut a cluster
            relocation: None,
            ..pml()
        };
        let Outcome { labels, rounds, .. } = run(&surface, &options);
        let last = rounds.last().expect("there are rounds");
        assert_eq!(last.clusters, 60);
        assert_eq!(last.energy.explained, plain::explained(&surface, &component_of_cluster, &labels));
        let mut plain = plain::Refinement::new(&surface, &component_of_cluster, labels);
        assert_eq!(plain.iterate(), None, "there is a move left");
    }
}

#[test]
fn parallel_rounds_are_optimised_once_clusters_are_large_enough_and_stops_always() {
    let surface = Surface::build(&generate(Sample::Knot, 3000).expect("a sample")).expect("a surface");
    let faces = surface.faces() as u64;
    let options = Options { optimised_from: 4, levels: vec![faces / 3], ..pml() };
    let Outcome { tree, rounds, .. } = run(&surface, &options);
    let (early, late): (Vec<&RoundRow>, Vec<&RoundRow>) = rounds.iter().partition(|round| round.clusters * 4 > faces);
    for round in &early {
        assert_eq!(round.moves > 0, round.is_level, "{round:?}");
    }
    assert!(late.iter().filter(|round| round.moves > 0).count() > late.len() / 2, "{late:?}");
    // until the first stop it is as if nothing were ever optimised
    let first_stop = early.iter().take_while(|round| !round.is_level).count();
    let plain = run(&surface, &Options { optimise: false, ..options });
    let merges = tree.rounds[first_stop].merges_end as usize;
    assert_eq!(tree.merges[..merges], plain.tree.merges[..merges]);
    // sequential rounds are the paper's: all of them are optimised
    let ml = Options { optimised_from: 4, sequential_at: u64::MAX, collapse_fraction: Some(10.0), ..pml() };
    let Outcome { rounds, .. } = run(&surface, &ml);
    assert!(rounds.iter().any(|round| round.moves > 0 && round.clusters * 4 > faces), "{rounds:?}");
}

#[test]
fn components_of_a_face_or_two_do_not_keep_a_large_one_from_being_optimised() {
    let mut mesh = generate(Sample::Knot, 2000).expect("a sample");
    let faces_of_knot = mesh.faces.len();
    for leaf in 0..faces_of_knot as u32 {
        let first = mesh.positions.len() as u32;
        let beyond = f64::from(leaf) + 100.0;
        mesh.positions.extend([[beyond, 0.0, 0.0], [beyond + 0.5, 0.0, 0.0], [beyond, 0.5, 0.0]]);
        mesh.faces.push(&[first, first + 1, first + 2]);
    }
    let surface = Surface::build(&mesh).expect("a surface");
    let leaves = surface.components.len() as u64 - 1;
    let Outcome { rounds, .. } = run(&surface, &Options { optimised_from: 4, ..pml() });
    let late = rounds.iter().filter(|round| (round.clusters - leaves) * 4 <= faces_of_knot as u64);
    let (moved, rested): (Vec<&RoundRow>, Vec<&RoundRow>) = late.partition(|round| round.moves > 0);
    assert!(moved.len() > rested.len(), "{} of {} rounds", moved.len(), moved.len() + rested.len());
}

#[test]
fn any_number_of_threads_makes_the_same_merges() {
    let surface = Surface::build(&generate(Sample::Knot, 60_000).expect("a sample")).expect("a surface");
    for pairs in [Pairs::CheaperHalf, Pairs::All] {
        let options = Options { optimise: false, pairs, ..pml() };
        let mut merges = (1..=6).map(|threads| {
            let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().expect("threads");
            pool.install(|| run(&surface, &options)).tree.merges
        });
        let of_one = merges.next().expect("one thread");
        assert!(merges.all(|of_several| of_several == of_one), "{pairs:?}");
    }
}

#[test]
fn plateaus_of_equal_faces_take_rounds_in_proportion_to_the_logarithm() {
    for (sample, faces) in [(Sample::Strip, 4096), (Sample::Plane, 8192), (Sample::Cube, 12 * 24 * 24)] {
        let surface = Surface::build(&generate(sample, faces).expect("a sample")).expect("a surface");
        // optimisation makes the clusters of a plateau alike again, which leaves longer slopes of costs between them
        for (pairs, optimise, factor) in [
            (Pairs::All, false, 3),
            (Pairs::All, true, 5),
            (Pairs::CheaperHalf, false, 5),
            (Pairs::CheaperHalf, true, 5),
        ] {
            let bound = factor * surface.faces().ilog2();
            let rounds = run(&surface, &Options { pairs, optimise, ..pml() }).rounds.len() as u32;
            assert!(rounds <= bound, "{} {pairs:?} optimise={optimise}: {rounds} rounds", sample.name());
        }
    }
    // the paper's rule crawls, but arrives
    let strip = Surface::build(&generate(Sample::Strip, 512).expect("a sample")).expect("a surface");
    let rounds =
        run(&strip, &Options { optimise: false, ties: Ties::LargestId, pairs: Pairs::All, ..pml() }).rounds.len();
    assert!(rounds > 100, "{rounds} rounds");
}

#[test]
fn mixtures_switch_and_collapse_as_they_are_told() {
    let surface = Surface::build(&generate(Sample::Knot, 1500).expect("a sample")).expect("a surface");
    let Outcome { rounds, .. } = run(&surface, &Options { sequential_at: 100, ..pml() });
    for pair in rounds.windows(2).filter(|pair| pair[0].clusters <= 100) {
        assert_eq!(pair[1].merges, 1);
    }
    assert!(rounds.iter().filter(|row| row.clusters > 100).all(|row| row.merges > 1));
    let Outcome { rounds, .. } =
        run(&surface, &Options { sequential_at: u64::MAX, collapse_fraction: Some(10.0), ..pml() });
    for pair in rounds.windows(2) {
        assert_eq!(pair[1].merges, (pair[0].clusters / 10).max(1));
    }
}
