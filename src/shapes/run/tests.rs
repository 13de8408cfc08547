//! Energies that are kept, and those from scratch.

use super::*;
use crate::dev::sample::generate_part;
use crate::surface::Surface;

#[test]
fn the_energy_that_is_kept_is_that_of_the_labels_and_a_shape_must_be_better_by_one_unit() {
    let (mesh, _) = generate_part(1500, 0.3).expect("a part");
    let surface = Surface::build(&mesh).expect("a surface");
    let samples = surface.samples(&surface.corners((&mesh).into()));
    let faces = Faces { graph: &surface.graph, samples: &samples };
    let prices = Prices::of(faces.graph, 13, 1e5);
    let allowed = Allowed { kinds: &Kind::ALL, prices: &prices, tolerance: None };
    let (merged, _) = merged(faces, allowed, 13, &Cancel::default()).expect("clusters");
    let mut run =
        Run::fitted(faces, allowed, merged.labels, merged.component_of_cluster, &merged.axes).expect("shapes");
    let (mut steps, mut last) = (0, run.energy());
    run.converge(&mut u32::MAX.clone(), &Cancel::default(), &mut |step, _| {
        assert!(step.energy < last, "{step:?} {last}");
        (steps, last) = (steps + 1, step.energy);
    })
    .expect("an end");
    assert!(steps > 2 && last == run.energy());
    // nothing is left to move
    let all: Vec<u32> = (0..faces.count() as u32).collect();
    assert_eq!(run.clusters.pass(&all).0, 0);
    let members = members(&run.clusters.labels, 13, |_| true);
    for (number, members) in members.iter().enumerate() {
        let proxy = &run.clusters.proxies[number];
        let cost_of = |&face: &u32| i128::from(faces.weight(face)) * i128::from(proxy.cost(faces.samples(face)));
        assert_eq!(run.clusters.costs[number], members.iter().map(cost_of).sum::<i128>());
    }
    let axis = run.clusters.shapes[0].axis();
    let again = |so_far| fitted(faces, allowed, 0, &members[0], axis, so_far);
    let found = again(None).expect("a shape");
    let with = |cost| Some((found.proxy.kind, cost));
    assert!(again(with(found.cost)).is_none() && again(with(found.cost + 1)).is_some());
}
