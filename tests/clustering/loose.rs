//! Loose faces (without area, connected with no face that has area) take no cluster, change no other label, and have
//! that of their host.

use std::io::Cursor;

use tesserae_mesh::cluster::seeds;
use tesserae_mesh::dev::sample::{Sample, generate};
use tesserae_mesh::device::cpu::CpuDevice;
use tesserae_mesh::device::{Cancel, Device};
use tesserae_mesh::hierarchy::stored::Stored;
use tesserae_mesh::job::{self, InMemory, Outcome};
use tesserae_mesh::mesh::{Faces, Limits, PolygonMesh};
use tesserae_mesh::parameters::{Algorithm, Parameters, Seeds, Snapshots};
use tesserae_mesh::report::{DeviceKind, Input};
use tesserae_mesh::surface::Surface;

use crate::common::gpu;

/// A knot; the same with loose faces behind and maybe before its own; and the host's number in the knot of each loose
/// face, where that is known. Faces before others change their numbers, and with them pseudo-random choices.
struct Case {
    plain: PolygonMesh,
    loose: PolygonMesh,
    before: usize,
    hosts: Vec<Option<usize>>,
}

fn case(before: &[Vec<u32>]) -> Case {
    let plain = generate(Sample::Knot, 1200).expect("a sample");
    let faces: Vec<Vec<u32>> = (0..plain.faces.len()).map(|face| plain.faces.corners(face).to_vec()).collect();
    let first_at = |vertex: u32| faces.iter().position(|face| face.contains(&vertex));
    let mut loose = plain.clone();
    // at no vertex of another face
    let apart = loose.positions.len() as u32;
    let [a, b] = [plain.positions[0], plain.positions[1]];
    let between: [f64; 3] = std::array::from_fn(|axis| 0.7 * a[axis] + 0.3 * b[axis]);
    loose.positions.extend([between; 3]);
    let behind = [vec![7, 7, 7], vec![7, 7, 7], vec![300, 9, 300], vec![apart, apart + 1, apart + 2]];
    let host = |face: &Vec<u32>| face.iter().map(|&vertex| first_at(vertex)).min().flatten();
    let hosts = before.iter().chain(&behind).map(|face| host(face).filter(|_| face[0] != apart)).collect();
    let all: Vec<Vec<u32>> = before.iter().cloned().chain(faces).chain(behind.iter().cloned()).collect();
    loose.faces = faces_of(&all);
    Case { plain, loose, before: before.len(), hosts }
}

impl Case {
    /// Labels of the knot's own faces, numbered by the first face, and those of the loose ones.
    fn divided(&self, labels: &[u32]) -> (Vec<u32>, Vec<u32>) {
        let own = &labels[self.before..self.before + self.plain.faces.len()];
        let loose = labels[..self.before].iter().chain(&labels[self.before + own.len()..]).copied().collect();
        (numbered(own), loose)
    }

    fn check(&self, labels: &[u32], expected: &[u32], context: &str) {
        let (own, loose) = self.divided(labels);
        assert!(self.before > 0 || own == numbered(expected), "{context}");
        let own = &labels[self.before..];
        for (&label, host) in loose.iter().zip(&self.hosts) {
            match host {
                Some(host) => assert_eq!(label, own[*host], "{context}"),
                None => assert!(own[..self.plain.faces.len()].contains(&label), "{context}"),
            }
        }
        assert_eq!(labels[0], 0, "clusters are numbered by the first face, loose or not");
    }
}

fn faces_of(lists: &[Vec<u32>]) -> Faces {
    let mut faces = Faces::with_capacity(lists.len());
    lists.iter().for_each(|corners| faces.push(corners));
    faces
}

fn numbered(labels: &[u32]) -> Vec<u32> {
    let mut number = vec![None; labels.len() + 1];
    let mut seen = 0;
    let mut of = |label: u32| {
        *number[label as usize].get_or_insert_with(|| {
            seen += 1;
            seen - 1
        })
    };
    labels.iter().map(|&label| of(label)).collect()
}

fn run(mesh: &PolygonMesh, parameters: &Parameters, device: &mut dyn Device) -> Outcome {
    let job = InMemory { mesh: mesh.into(), limits: Limits::default(), parameters, seeds: None, weights: None };
    let prepared = job::prepare_in_memory(&job).expect("a mesh");
    job::run(&prepared, device, &Cancel::default(), &mut |_| {}).expect("labels")
}

fn parameters(algorithm: Algorithm) -> Parameters {
    Parameters { algorithm, clusters: Some(60), ..Parameters::default() }
}

#[test]
fn they_change_no_other_label_and_have_that_of_their_host() {
    let cases = [case(&[]), case(&[vec![40, 40, 40]])];
    let mut devices: [Box<dyn Device>; 2] = [Box::new(CpuDevice::new()), Box::new(gpu::opened())];
    let algorithms = [Algorithm::Bb, Algorithm::Pml, Algorithm::Ml, Algorithm::Hr];
    for (case, device) in cases.iter().flat_map(|case| (0..2).map(move |device| (case, device))) {
        let device = &mut devices[device];
        // on software Vulkan the others take a minute
        let is_gpu = device.info().kind == DeviceKind::Gpu;
        for algorithm in algorithms.into_iter().take(if is_gpu { 2 } else { algorithms.len() }) {
            let parameters = parameters(algorithm);
            let expected = run(&case.plain, &parameters, device.as_mut());
            let found = run(&case.loose, &parameters, device.as_mut());
            let context = format!("{algorithm:?} on {:?}", device.info().kind);
            case.check(&found.labels.expect("labels"), &expected.labels.expect("labels"), &context);
            let report = found.report;
            assert_eq!((report.clusters, report.disconnected_clusters), (60, 0), "{context}");
            let Input::Mesh(input) = &report.input else { panic!("a mesh") };
            assert_eq!((input.components, input.loose_faces), (1, 4 + case.before as u64), "{context}");
            assert!(report.warnings.iter().any(|warning| warning.contains("share no edge")), "{:?}", report.warnings);
        }
    }
}

#[test]
fn cuts_trees_and_snapshots_have_them() {
    let case = case(&[]);
    let mut cpu = CpuDevice::new();
    let whole = Parameters { clusters: None, ..parameters(Algorithm::Pml) };
    let [expected, found] =
        [&case.plain, &case.loose].map(|mesh| run(mesh, &whole, &mut cpu).hierarchy.expect("a hierarchy"));
    assert!(!found.tree.is_nested(), "faces move, and loose ones with them");
    for clusters in [1, 2, 17, 300, 900, case.plain.faces.len() as u64] {
        let labels = found.tree.labels_at(clusters).expect("a cut").labels;
        case.check(&labels, &expected.tree.labels_at(clusters).expect("a cut").labels, &format!("{clusters} clusters"));
    }
    let last = found.tree.merges.last().expect("merges").made;
    assert_eq!(last.faces as usize, case.loose.faces.len());
    let mut file = Vec::new();
    found.write(&mut file).expect("a vector takes everything");
    let read = Stored::read(Cursor::new(&file), file.len() as u64, u64::MAX).expect("the file is whole");
    assert!(read.tree == found.tree);
    let nested = run(&case.loose, &Parameters { algorithm: Algorithm::Hr, ..whole.clone() }, &mut cpu);
    let stored = nested.hierarchy.expect("a hierarchy");
    let tree = &stored.tree;
    let mut faces = vec![1; tree.faces as usize];
    for merge in &tree.merges {
        faces[merge.into as usize] += faces[merge.from as usize];
        assert_eq!(merge.made.faces, faces[merge.into as usize], "faces of a node are those of its children");
    }
    assert_eq!(stored.linkage().expect("one root").rows().len(), case.loose.faces.len() - 1);

    let snapshots = Parameters { snapshots: Some(Snapshots::Every(3)), ..parameters(Algorithm::Bb) };
    let labels_of = |mesh| {
        let mut all = Vec::new();
        let outcome = run(mesh, &snapshots, &mut CpuDevice::new());
        let done: Result<(), ()> = outcome.snapshots.replay(|_, labels| {
            all.push(labels.to_vec());
            Ok(())
        });
        done.map(|()| all).expect("nothing fails")
    };
    let (expected, found) = (labels_of(&case.plain), labels_of(&case.loose));
    assert!(expected.len() > 5 && found.len() == expected.len());
    for (found, expected) in found.iter().zip(&expected) {
        let (own, loose) = case.divided(found);
        assert!(own == numbered(expected));
        for (label, host) in loose.iter().zip(&case.hosts) {
            assert!(host.is_none_or(|host| *label == found[case.before + host]));
        }
    }
}

#[test]
fn a_face_with_area_or_a_neighbour_takes_a_cluster_and_a_loose_one_is_no_seed() {
    let Case { plain, loose, .. } = case(&[vec![40, 40, 40]]);
    let surface = Surface::build(&loose).expect("a surface");
    assert_eq!((surface.faces(), surface.loose.len(), surface.components.len()), (plain.faces.len(), 5, 1));
    let refused = seeds::choose(&surface, 1, &Seeds::Listed, 0, Some(&[0])).expect_err("face 0 is loose");
    assert!(refused.message.contains("without area"), "{refused}");
    let many = seeds::choose(&surface, plain.faces.len() as u64 + 1, &Seeds::Random, 0, None).expect_err("too many");
    assert!(many.message.contains("without 5 faces"), "{many}");

    let with = |more: &[Vec<u32>]| {
        let mut mesh = plain.clone();
        let corners = (0..plain.faces.len()).map(|face| plain.faces.corners(face).to_vec());
        mesh.faces = faces_of(&corners.chain(more.iter().cloned()).collect::<Vec<_>>());
        let surface = Surface::build(&mesh).expect("a surface");
        (surface.loose.len(), surface.components.len())
    };
    assert_eq!(with(&[vec![3, 3, 3]]), (1, 1));
    assert_eq!(with(&[vec![3, 400, 3], vec![400, 3, 3]]), (2, 1), "they share an edge");
    assert_eq!(with(&[vec![3, 200, 400]]), (0, 2), "a face with area");
    let edge = plain.faces.corners(8);
    assert_eq!(with(&[vec![edge[0], edge[1], edge[1]]]), (0, 1), "a face at an edge of others");
    let all = PolygonMesh { faces: faces_of(&[vec![0, 0, 0], vec![1, 1, 1]]), ..plain.clone() };
    let surface = Surface::build(&all).expect("a surface");
    assert_eq!((surface.loose.len(), surface.components.len()), (0, 2), "there is no other face");
}
