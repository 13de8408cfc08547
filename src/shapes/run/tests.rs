//! Energies that are kept, and those from scratch.

use super::*;
use crate::dev::sample::{Sample, generate, generate_part};
use crate::shapes::moments::{Higher, Moments};
use crate::surface::Surface;

#[test]
fn the_energy_that_is_kept_is_that_of_the_labels_and_a_shape_must_be_better_by_one_unit() {
    let (mesh, _) = generate_part(1500, 0.3).expect("a part");
    let surface = Surface::build(&mesh).expect("a surface").with_normals((&mesh).into());
    let samples = surface.samples(&surface.corners((&mesh).into()));
    let faces = Faces { graph: &surface.graph, samples: &samples };
    let prices = Prices::of(faces.graph, 13, 1e5);
    let allowed = Allowed { kinds: &Kind::ALL, prices: &prices, tolerance: None };
    let (merged, ..) = merged(faces, allowed, 13, &Cancel::default()).expect("clusters");
    let mut run = Run::of(faces, allowed, merged.labels, merged.component_of_cluster, &merged.axes).expect("shapes");
    let (mut steps, mut last) = (0, run.energy());
    run.converge(&mut u32::MAX.clone(), &mut Gpu::default(), &Cancel::default(), &mut |step, _| {
        assert!(step.energy < last, "{step:?} {last}");
        (steps, last) = (steps + 1, step.energy);
    })
    .expect("an end");
    assert!(steps > 2 && last == run.energy());
    // nothing is left to move
    let all: Vec<u32> = (0..faces.count() as u32).collect();
    assert_eq!(run.clusters.pass(&all, &[]).expect("a pass").0, 0);
    let members = members(&run.clusters.labels, 13, |_| true);
    for (number, members) in members.iter().enumerate() {
        let proxy = &run.clusters.proxies[number];
        let cost_of = |&face: &u32| i128::from(faces.weight(face)) * i128::from(proxy.cost(faces.samples(face)));
        assert_eq!(run.clusters.costs[number], members.iter().map(cost_of).sum::<i128>());
        // of the first fits, and of the moves since then
        assert_eq!(run.sums[number].moments, Moments::of_all(&faces, members));
        assert_eq!(run.sums[number].higher(&faces, members), Higher::of_all(&faces, members));
    }
    let axis = run.clusters.shapes[0].axis();
    let sums = Sums::of(&faces, &members[0]);
    let cluster = Cluster { component: 0, members: &members[0], moments: &sums.moments, axis };
    let again = |so_far| fitted(faces, allowed, &cluster, || sums.higher(&faces, &members[0]), so_far);
    let found = again(None).expect("a shape");
    let with = |cost| Some((found.proxy.kind, cost));
    assert!(again(with(found.cost)).is_none() && again(with(found.cost + 1)).is_some());
}

#[test]
fn a_pass_with_proposals_is_one_without_and_wrong_ones_are_noticed() {
    let mesh = generate(Sample::Knot, 2000).expect("a sample");
    let surface = Surface::build(&mesh).expect("a surface").with_normals((&mesh).into());
    let samples = surface.samples(&surface.corners((&mesh).into()));
    let faces = Faces { graph: &surface.graph, samples: &samples };
    let prices = Prices::of(faces.graph, 100, 0.0);
    let allowed = Allowed { kinds: &Kind::ALL, prices: &prices, tolerance: None };
    let (merged, ..) = merged(faces, allowed, 100, &Cancel::default()).expect("clusters");
    let start = || Run::of(faces, allowed, merged.labels.clone(), vec![0; 100], &merged.axes).expect("shapes");
    let (mut plain, mut ahead) = (start().clusters, start().clusters);
    let mut listed = plain.at_boundaries(&[true; 100]);
    let mut overtaken = 0;
    while !listed.is_empty() {
        let proposals: Vec<u32> = listed.iter().map(|&face| ahead.proposal(face)).collect();
        let before = ahead.labels.clone();
        let (moves, next) = ahead.pass(&listed, &proposals).expect("a pass");
        assert_eq!(plain.pass(&listed, &[]).expect("a pass"), (moves, next.clone()));
        assert!(plain.labels == ahead.labels && plain.costs == ahead.costs);
        let after = listed.iter().map(|&face| (before[face as usize], ahead.labels[face as usize]));
        overtaken += after.zip(&proposals).filter(|&((from, to), &proposal)| from != to && to != proposal).count();
        listed = next;
    }
    assert!(overtaken > 0);
    let all: Vec<u32> = (0..faces.count() as u32).collect();
    for to in [0, 99, 100] {
        let error = ahead.pass(&all, &vec![to; all.len()]).expect_err("no face lies beside most clusters");
        assert_eq!(error.kind, crate::Kind::DeviceWrong);
    }
}
