use super::*;
use crate::cluster::quality::Quality;
use crate::data::Values;
use crate::dev::random;
use crate::device::Cancel;
use crate::device::cpu::CpuDevice;
use crate::job::{Outcome, run};
use crate::parameters::Algorithm;
use crate::union_find;

/// A grid of points with steps and noise in their coordinates.
fn set(shape: [usize; 2], dimensions: usize, mask: Option<Vec<bool>>) -> PointSet {
    let mut states = random(1);
    let mut noise = || f64::from((states() >> 40) as u32) / f64::from(1 << 24);
    let value = |item: usize, axis: usize| {
        let (row, column) = (item / shape[1], item % shape[1]);
        f64::from(((row / 5 + axis) * 3 + column / 7) as u32 % 11)
    };
    let items = shape[0] * shape[1];
    let values = (0..items * dimensions).map(|at| value(at / dimensions, at % dimensions) + 4.0 * noise()).collect();
    let weights = Some((0..items).map(|item| 0.25 + (item % 3) as f64).collect());
    PointSet {
        dimensions,
        values: Values::F8(values),
        weights,
        mask,
        shape: shape.to_vec(),
        graph: Graph::Grid { full: false },
    }
}

fn clustered(set: &PointSet, parameters: &Parameters, seeds: Option<&[u8]>) -> Result<Outcome, Refusal> {
    let set = set.clone();
    let started = Instant::now();
    let job = PointsInMemory { set, format: None, max_items: 1 << 20, parameters, seeds, started };
    Ok(run(&prepare_points_in_memory(job)?, &mut CpuDevice::new(), &Cancel::default(), &mut |_| ())?)
}

/// Number of pieces that clusters of a grid are in.
fn pieces(set: &PointSet, labels: &[u32]) -> usize {
    let mut sets = union_find::singletons(labels.len());
    for item in 0..labels.len() {
        let columns = set.shape[1];
        let left = (item % columns > 0).then(|| item - 1);
        for other in left.into_iter().chain(item.checked_sub(columns)) {
            if labels[item] == labels[other] {
                union_find::join(&mut sets, item as u32, other as u32);
            }
        }
    }
    let root = |item: u32| union_find::root(&mut sets.clone(), item) == item;
    (0..labels.len() as u32).filter(|&item| labels[item as usize] != FREE && root(item)).count()
}

/// The energy by its definition.
fn energy(set: &PointSet, labels: &[u32], clusters: usize) -> f64 {
    (0..clusters as u32)
        .map(|cluster| {
            let items: Vec<usize> = (0..labels.len()).filter(|&item| labels[item] == cluster).collect();
            let weight: f64 = items.iter().map(|&item| set.weight(item)).sum();
            let of_axis = |axis: usize| {
                let mean = items.iter().map(|&item| set.weight(item) * set.at(item, axis)).sum::<f64>() / weight;
                items.iter().map(|&item| set.weight(item) * (set.at(item, axis) - mean).powi(2)).sum::<f64>()
            };
            (0..set.dimensions).map(of_axis).sum::<f64>()
        })
        .sum()
}

#[test]
fn clusters_of_points_of_any_width_are_whole_and_their_energies_those_of_the_definition() {
    for dimensions in [1, 2, 3, 5, 16, 17, 64] {
        for (algorithm, quality) in [
            (Algorithm::Bb, Quality::Fast),
            (Algorithm::Bb, Quality::Default),
            (Algorithm::Bb, Quality::Best),
            (Algorithm::Pml, Quality::Default),
            (Algorithm::Hr, Quality::Default),
            (Algorithm::Acvd, Quality::Default),
        ] {
            let mask = (dimensions == 3).then(|| (0..40 * 35).map(|item| item % 13 != 5).collect::<Vec<_>>());
            let set = set([40, 35], dimensions, mask);
            let parameters = Parameters { algorithm, quality, clusters: Some(12), ..Parameters::default() };
            let Outcome { labels, report, shape, .. } = clustered(&set, &parameters, None).expect("clusters");
            let context = format!("{dimensions} {algorithm:?} {quality:?}");
            let labels = labels.expect("labels");
            assert_eq!(shape.as_deref(), Some(&[40, 35][..]), "{context}");
            assert!((0..1400).all(|item| (labels[item] == FREE) != set.takes_part(item)), "{context}");
            assert_eq!((pieces(&set, &labels), report.disconnected_clusters), (12, 0), "{context}");
            let (expected, total) = (
                energy(&set, &labels, 12),
                energy(&set, &labels.iter().map(|&label| if label == FREE { 1 } else { 0 }).collect::<Vec<_>>(), 1),
            );
            let is_near =
                |found: Option<f64>, expected: f64| found.is_some_and(|found| (found / expected - 1.0).abs() < 1e-9);
            assert!(is_near(report.energy.final_, expected), "{context}: {:?} {expected}", report.energy);
            assert!(
                is_near(report.energy.total, total) && is_near(report.energy.explained, 1.0 - expected / total),
                "{context}"
            );
            // that of the lattice, too
            let last =
                report.iterations.last().and_then(|row| row.energy).or(report.levels.last().and_then(|row| row.energy));
            assert!(last.is_some_and(|last| (last / expected - 1.0).abs() < 1e-5), "{context}: {last:?} {expected}");
        }
    }
}

#[test]
fn seeds_are_items_and_a_masked_one_is_refused() {
    let mask: Vec<bool> = (0..60).map(|item| item % 10 != 9).collect();
    let set = set([6, 10], 2, Some(mask));
    let labels = clustered(&set, &Parameters::default(), Some(b"[0, 58]")).expect("clusters").labels.expect("labels");
    assert_eq!((labels[0], labels[58], labels[59]), (0, 1, FREE));
    for (seeds, words) in [(&b"[0, 59]"[..], "masked"), (b"[0, 60]", "of which there are 60")] {
        let refusal = clustered(&set, &Parameters::default(), Some(seeds)).expect_err(words);
        assert!(refusal.error.message.contains(words), "{refusal:?}");
        assert_eq!(refusal.file, Some(InputFile::Seeds));
    }
}

#[test]
fn what_goes_with_meshes_is_refused_and_a_graph_with_a_mesh() {
    let set = set([6, 10], 2, None);
    let parameters = Parameters { clusters: Some(3), curvature_exponent: Some(1.0), ..Parameters::default() };
    let refusal = clustered(&set, &parameters, None).expect_err("a refusal");
    assert!(refusal.error.message.contains("curvature"), "{refusal:?}");
    let parameters = Parameters { clusters: Some(3), graph: Some(Neighbours::Nearest(8)), ..Parameters::default() };
    let request = crate::job::Request::new(b"v 0 0 0\n", crate::mesh::Format::Obj, &parameters);
    let error = crate::job::prepare(&request).expect_err("a refusal");
    assert!(error.message.contains("graph goes with points"), "{error}");
}

#[test]
fn one_item_far_away_leaves_the_energies_and_means_of_the_others_as_they_are() {
    for far in [1e12, 1e20, 1e150] {
        let mut set = set([20, 10], 2, None);
        let Values::F8(values) = &mut set.values else { panic!("floats") };
        values[35] = far;
        let parameters = Parameters { clusters: Some(4), ..Parameters::default() };
        let started = Instant::now();
        let job = PointsInMemory {
            set: set.clone(),
            format: None,
            max_items: 1 << 20,
            parameters: &parameters,
            seeds: None,
            started,
        };
        let prepared = prepare_points_in_memory(job).expect("points");
        let outcome = run(&prepared, &mut CpuDevice::new(), &Cancel::default(), &mut |_| ()).expect("clusters");
        let labels = outcome.labels.expect("labels");
        let table = prepared.subject.points().expect("points").table(&labels, 4);
        let own: Vec<_> = table.rows.iter().filter(|row| row.cluster != labels[17]).collect();
        assert!(own.iter().all(|row| row.mean[1] < 20.0 && row.mean[1] > 1.0), "{far}: {own:?}");
        let expected = energy(&set, &labels, 4);
        assert!(outcome.report.energy.final_.is_some_and(|found| (found / expected - 1.0).abs() < 1e-9), "{far}");
    }
}

#[test]
fn sequential_rounds_are_optimised_when_a_hundredth_of_the_clusters_has_merged() {
    let parameters = Parameters { algorithm: Algorithm::Ml, clusters: Some(10), ..Parameters::default() };
    let report = clustered(&set([40, 40], 3, None), &parameters, None).expect("clusters").report;
    let (mut merged, mut optimised) = (0, 0);
    for round in report.levels {
        merged += round.merges;
        if round.moves > 0 {
            assert!(merged * 100 >= round.clusters, "{round:?} after {merged} merges");
            (merged, optimised) = (0, optimised + 1);
        }
    }
    assert!(optimised > 100, "{optimised}");
}
