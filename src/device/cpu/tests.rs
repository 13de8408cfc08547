use super::*;
use crate::dev::random;
use crate::dev::sample::{Sample, generate};
use crate::device::dual_edge::{Rank, Ties};
use crate::device::pieces::cut_off_faces;
use crate::device::{Cancel, Steps};
use crate::energy::Energy;
use crate::surface::Surface;

#[test]
fn a_bid_is_renewed_when_its_face_is_no_longer_on_the_boundary() {
    let surface = Surface::build(&generate(Sample::Strip, 400).expect("a mesh")).expect("a surface");
    let graph = &surface.graph;
    let first = (0..400).find(|&face| graph.neighbours_of(face).len() == 1).expect("a strip has ends");
    let mut strip = vec![first];
    while let Some(&next) = graph.neighbours_of(strip[strip.len() - 1]).iter().find(|near| !strip.contains(near)) {
        strip.push(next);
    }
    // the end of a long cluster lies nearer the middle of the short one beside it; many more clusters are far away
    let cluster_at = |at: usize| if at < 21 { 0 } else { (at as u32 - 21) / 4 + 1 };
    let mut labels = vec![0; strip.len()];
    strip.iter().enumerate().for_each(|(at, &face)| labels[face as usize] = cluster_at(at));
    let component_of_cluster = vec![0; cluster_at(399) as usize + 1];
    let mut steps = CpuSteps::new(graph, &component_of_cluster);
    steps.set_labels(&labels).expect("labels");
    let (end, beside) = (strip[20], strip[21]);
    steps.with_listed(|listed| {
        assert!(listed.renew_bids().at(&[0]).any(|face| face == end), "the end has a bid");
        listed.apply(&[Move { face: beside, from: 1, to: 0 }]);
        let Partition { labels, boundary, .. } = &mut listed.partition;
        boundary.prune(graph, labels, 0);
        assert!(boundary.of_cluster(0).all(|face| face != end), "the end is interior");
        assert!(listed.renew_bids().at(&[0]).all(|face| face != end), "the end has no bid");
    });
}

/// Moves of a third of the boundary faces that leave a face in each cluster.
fn random_moves(partition: &mut Partition<'_, Energy>, next: &mut impl FnMut(usize) -> usize) -> Vec<Move> {
    let Partition { graph, labels, clusters, .. } = partition;
    let labels = labels.all();
    let mut left: Vec<u32> = (0..labels.len() as u32).map(|cluster| clusters.sums(cluster).faces).collect();
    let mut moves = Vec::new();
    for face in 0..labels.len() as u32 {
        let near = graph.neighbours_of(face);
        let from = labels[face as usize];
        let to = labels[near[next(near.len())] as usize];
        if to != from && left[from as usize] > 1 && next(3) == 0 {
            left[from as usize] -= 1;
            moves.push(Move { face, from, to });
        }
    }
    moves
}

#[test]
fn whatever_faces_move_all_pieces_are_found() {
    let mut states = random(1);
    let mut next = |below: usize| (states() >> 33) as usize % below;
    let mut cut_off = 0;
    for (sample, faces) in [(Sample::Sphere, 1500), (Sample::Strip, 300), (Sample::Cube, 600), (Sample::Parts, 900)] {
        let surface = Surface::build(&generate(sample, faces).expect("a mesh")).expect("a surface");
        let graph = &surface.graph;
        let component_of_cluster = graph.component_of_face();
        let mut steps = CpuSteps::new(graph, &component_of_cluster);
        steps.set_labels(&(0..graph.faces() as u32).collect::<Vec<_>>()).expect("the cpu does not fail");
        for _ in 0..14 {
            let mutual = steps.mutual_dual_edges(Ties::Hash).expect("the cpu does not fail");
            let pairs: Vec<(u32, u32)> = mutual.iter().map(Rank::ends).collect();
            steps.merge(&pairs).expect("merges");
            steps.with_listed(|listed| {
                for _ in 0..3 {
                    let moves = random_moves(&mut listed.partition, &mut next);
                    listed.apply(&moves);
                }
                let cut_off_faces = |labels: &[u32]| cut_off_faces(graph, component_of_cluster.len(), labels);
                let expected = cut_off_faces(listed.partition.labels.all());
                assert_eq!(listed.cut_off_faces(), expected, "{}", sample.name());
                cut_off += expected.len();
                listed.regrow(&expected, &Cancel::default()).expect("no cancellation");
                assert!(cut_off_faces(listed.partition.labels.all()).is_empty(), "{}", sample.name());
            });
        }
    }
    assert!(cut_off > 1000, "{cut_off} faces");
}
