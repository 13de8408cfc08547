use std::cmp::Reverse;

use super::*;
use crate::sample::{Sample, generate};
use crate::surface::Surface;

#[test]
fn a_bid_goes_with_the_last_face_that_it_was_for() {
    let surface = Surface::build(&generate(Sample::Strip, 400).expect("a mesh")).expect("a surface");
    let graph = &surface.graph;
    let first = (0..400).find(|&face| graph.neighbours_of(face).len() == 1).expect("a strip has ends");
    let mut strip = vec![first];
    while let Some(&next) = graph.neighbours_of(strip[strip.len() - 1]).iter().find(|near| !strip.contains(near)) {
        strip.push(next);
    }
    // the end of a long cluster lies nearer the middle of the short one beside it; far away are many more
    let cluster_at = |at: usize| if at < 21 { 0 } else { (at as u32 - 21) / 4 + 1 };
    let mut labels = vec![0; strip.len()];
    strip.iter().enumerate().for_each(|(at, &face)| labels[face as usize] = cluster_at(at));
    let component_of_cluster = vec![0; cluster_at(399) as usize + 1];
    let mut steps = CpuSteps::new(graph, &component_of_cluster);
    steps.set_labels(&labels).expect("nothing can fail");
    steps.gather();
    assert!(steps.renew_bids(Vec::new()));
    let (end, beside) = (strip[20], strip[21]);
    assert!(steps.bids.at(&[0]).any(|face| face == end), "the end would go");
    steps.apply(&[Move { face: beside, from: 1, to: 0 }]);
    if let Some(frontier) = &mut steps.frontier {
        frontier.prune(graph, &steps.labels, 0);
        assert!(frontier.boundary_of(0).all(|face| face != end), "it is an end no more");
    }
    steps.renew_bids(Vec::new());
    assert!(steps.bids.at(&[0]).all(|face| face != end), "it has nowhere to go");
}

/// The faces outside the largest piece of each cluster, sorted, found among all.
fn all_but_largest(graph: &DualGraph, labels: &[u32]) -> Vec<u32> {
    let mut pieces: Vec<(u32, Vec<u32>)> = Vec::new();
    let mut is_found = vec![false; labels.len()];
    for start in 0..labels.len() as u32 {
        if std::mem::replace(&mut is_found[start as usize], true) {
            continue;
        }
        let cluster = labels[start as usize];
        let mut piece = vec![start];
        let mut next = 0;
        while let Some(&face) = piece.get(next) {
            next += 1;
            for &near in graph.neighbours_of(face) {
                if labels[near as usize] == cluster && !std::mem::replace(&mut is_found[near as usize], true) {
                    piece.push(near);
                }
            }
        }
        pieces.push((cluster, piece));
    }
    // the largest of each cluster first; they began with their smallest face
    pieces.sort_by_key(|(cluster, piece)| (*cluster, Reverse(piece.len()), piece[0]));
    let others = pieces.chunk_by(|a, b| a.0 == b.0).flat_map(|of_cluster| &of_cluster[1..]);
    let mut faces: Vec<u32> = others.flat_map(|(_, piece)| piece.iter().copied()).collect();
    faces.sort_unstable();
    faces
}

#[test]
fn whatever_faces_move_all_pieces_are_found() {
    let mut state = 1u64;
    let mut random = |below: usize| {
        state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        (state >> 33) as usize % below
    };
    let mut cut_off = 0;
    for (sample, faces) in [(Sample::Sphere, 1500), (Sample::Strip, 300), (Sample::Cube, 600), (Sample::Parts, 900)] {
        let surface = Surface::build(&generate(sample, faces).expect("a mesh")).expect("a surface");
        let graph = &surface.graph;
        let mut steps = CpuSteps::new(graph, &graph.component_of_face());
        steps.set_labels(&(0..graph.faces() as u32).collect::<Vec<_>>()).expect("nothing can fail");
        for _ in 0..14 {
            let mutual = steps.mutual_dual_edges(Ties::Hash).expect("nothing can fail");
            let pairs: Vec<(u32, u32)> = mutual.iter().map(Rank::ends).collect();
            steps.merge(&pairs).expect("nothing can fail");
            steps.gather();
            for _ in 0..3 {
                let labels = steps.labels.all().to_vec();
                let mut left: Vec<u32> =
                    (0..labels.len() as u32).map(|cluster| steps.clusters.sums(cluster).faces).collect();
                let mut moves = Vec::new();
                for face in 0..labels.len() as u32 {
                    let near = graph.neighbours_of(face);
                    let from = labels[face as usize];
                    let to = labels[near[random(near.len())] as usize];
                    if to != from && left[from as usize] > 1 && random(3) == 0 {
                        left[from as usize] -= 1;
                        moves.push(Move { face, from, to });
                    }
                }
                steps.apply(&moves);
            }
            let expected = all_but_largest(graph, steps.labels.all());
            assert_eq!(steps.cut_off_faces(), expected, "{}", sample.name());
            cut_off += expected.len();
            steps.regrow(&expected, &Cancel::default()).expect("nothing can fail");
            assert!(all_but_largest(graph, steps.labels.all()).is_empty(), "{}", sample.name());
        }
    }
    assert!(cut_off > 1000, "{cut_off} faces");
}
