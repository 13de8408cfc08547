//! Damaged meshes: work stays in proportion to faces, clusters stay whole, and the default does not end above `fast`.

use rayon::prelude::*;

use tesserae_mesh::cluster::coarse::CoarseStart;
use tesserae_mesh::cluster::connected::Clusters;
use tesserae_mesh::cluster::connected::settle::settle;
use tesserae_mesh::cluster::flat::{Options, boundary_based};
use tesserae_mesh::cluster::merging::Pairs;
use tesserae_mesh::cluster::quality::Quality;
use tesserae_mesh::cluster::record::Record;
use tesserae_mesh::cluster::relocation::Relocation;
use tesserae_mesh::cluster::{fast, numbers, seeds};
use tesserae_mesh::dev::random;
use tesserae_mesh::dev::sample::{Sample, generate};
use tesserae_mesh::device::cpu::CpuDevice;
use tesserae_mesh::device::{Cancel, Device, pieces};
use tesserae_mesh::mesh::PolygonMesh;
use tesserae_mesh::parameters::Seeds;
use tesserae_mesh::surface::Surface;

use crate::common::zoo;

/// A sample, damaged in one of four ways.
fn damaged(number: usize) -> (String, PolygonMesh) {
    let sample = Sample::ALL[number % Sample::ALL.len()];
    let mut mesh = generate(sample, 500).expect("the sample allows this number");
    let mut states = random(number as u64);
    let mut below = |bound: usize| (states() >> 33) as usize % bound;
    let vertices = mesh.positions.len();
    let damage = match number % 4 {
        0 => {
            let mut flat = mesh.positions.as_flattened().to_vec();
            let at = below(flat.len() / 4);
            flat.remove(at);
            flat.push(0.0);
            mesh.positions = flat.as_chunks().0.to_vec();
            "positions read late"
        }
        1 => {
            for _ in 0..20 {
                mesh.positions[below(vertices)][below(3)] *= 1e6;
            }
            "huge coordinates"
        }
        2 => {
            for _ in 0..vertices / 4 {
                mesh.positions[below(vertices)] = mesh.positions[below(vertices)];
            }
            "welded at random"
        }
        _ => {
            let all: Vec<Vec<u32>> = (0..mesh.faces.len()).map(|face| mesh.faces.corners(face).to_vec()).collect();
            for mut corners in all.into_iter().take(200) {
                let at = below(corners.len());
                let copy = mesh.positions[corners[at] as usize];
                corners[at] = mesh.positions.len() as u32;
                mesh.positions.push(copy);
                mesh.faces.push(&corners);
            }
            "duplicated vertices and faces"
        }
    };
    (format!("{} {number}, {damage}", sample.name()), mesh)
}

/// Labels after all steps of a quality, and the number of iterations, rounds and breaths.
fn clustered(surface: &Surface, clusters: u64, quality: Quality) -> (Vec<u32>, usize) {
    let (cancel, device, record) = (Cancel::default(), &mut CpuDevice::new(), &mut Record::new(None));
    let start = CoarseStart::new(surface, clusters, 0, quality.start(surface.moves)).expect("a possible number");
    let start = start.labels(surface, device, &cancel).expect("a start");
    let mut steps = device.open(surface, &start.component_of_cluster).expect("it opens");
    let (max_iterations, refine) = (quality.max_iterations(surface.moves), quality.refines());
    let options = Options { max_iterations, refine, allow_disconnected: false };
    let mut rows = 0;
    let run = boundary_based(surface, &start.labels, options, steps.as_mut(), &cancel, &mut |_| rows += 1, record);
    drop(steps);
    let relocation = Relocation { graph: surface, quality, pairs: Pairs::CheaperHalf, cancel: &cancel };
    let flat = || fast::labels(surface, clusters, 0, &cancel);
    let cheaper = std::iter::empty();
    let labels = relocation.labels(run.expect("a run").labels, device, flat, cheaper, &mut |_, _, _, _| rows += 1);
    (labels.expect("labels").0, rows)
}

/// Work a face of settling labels that are far from a minimum: steps of searches, and faces that passes looked at.
fn settling(surface: &Surface, clusters: u64) -> [u64; 2] {
    let seeds = seeds::choose(surface, clusters, &Seeds::Random, 1, None).expect("seeds");
    let mut device = CpuDevice::new();
    let mut steps = device.open(surface, &seeds.component_of_cluster).expect("it opens");
    steps.set_labels(&seeds.labels(surface.faces())).expect("labels");
    steps.grow(&Cancel::default()).expect("no cancellation");
    let mut clusters = Clusters::new(surface, steps.labels().expect("labels"));
    let all = clusters.numbers().collect();
    settle(&mut clusters, all, u32::MAX, &Cancel::default()).expect("no cancellation");
    clusters.work().map(|work| work / surface.faces() as u64)
}

#[test]
fn damaged_meshes_take_work_in_proportion_to_their_faces() {
    let meshes = if zoo::is_long() { 5_000 } else { 200 };
    let most = (0..meshes).into_par_iter().map(|number| {
        let (name, mesh) = damaged(number);
        let surface = Surface::build(&mesh).expect("a surface");
        let clusters = (surface.components.len() + 10).min(surface.faces()) as u64;
        let [(default, rows), (fast, fast_rows)] =
            [Quality::Default, Quality::Fast].map(|quality| clustered(&surface, clusters, quality));
        for labels in [&default, &fast] {
            assert_eq!(numbers::compact(labels).iter().max(), Some(&(clusters as u32 - 1)), "{name}");
            assert_eq!(pieces::disconnected_clusters(&surface, clusters as usize, labels), 0, "{name}");
        }
        let [energy, of_fast] = [default, fast].map(|labels| Clusters::new(&surface, labels).total());
        assert!(energy <= of_fast, "{name}: {energy} above {of_fast} of fast");
        let [steps, faces] = settling(&surface, clusters);
        [rows as u64, fast_rows as u64, steps, faces]
    });
    let most = most.reduce(Default::default, |a, b| std::array::from_fn(|of| a[of].max(b[of])));
    println!("most rows by default, at fast, steps a face, passes: {most:?}");
    for (most, bound) in most.into_iter().zip([300, 40, 320, 160]) {
        assert!(most <= bound, "{most} above {bound}");
    }
}
