//! Clusterings by shapes beside others of the same mesh: faces that are wrong, types, L2 and L2,1.
//!
//! Labels of other programs, such as those of CGAL that `benches/cgal_shapes.cpp` writes, get the best shapes of their
//! clusters.

use std::collections::BTreeMap;

use crate::cluster::numbers;
use crate::dev::markdown::{line, table_head};
use crate::device::Cancel;
use crate::device::cpu::CpuDevice;
use crate::energy;
use crate::error::Result;
use crate::job::{self, InMemory, RESOLUTION};
use crate::mesh::{Limits, PolygonMesh};
use crate::parameters::Parameters;
use crate::shapes::faces::Faces;
use crate::shapes::given::as_given;
use crate::shapes::kind::Kind;
use crate::surface::Surface;

/// Faces of the part.
pub const FACES: u64 = 12_528;

/// Noise of the part, percent of the diagonal.
pub const NOISE: [f64; 5] = [0.0, 0.05, 0.1, 0.2, 0.5];

/// Labels of a mesh.
#[derive(Debug, Clone)]
pub struct Given {
    /// What the table calls them.
    pub name: String,
    /// One a face, upload order, below the number of faces.
    pub labels: Vec<u32>,
}

/// A row of the table.
struct Row {
    name: String,
    labels: Vec<u32>,
    /// Clusters of each type.
    types: [usize; Kind::USUAL.len()],
    /// ∫ squared distance to the shapes, units of the file.
    l2: f64,
    l21: f64,
}

/// Clusters of the truth, or else of the first of the given labels.
pub fn clusters(truth: Option<&[u32]>, given: &[Given]) -> usize {
    truth.or(given.first().map(|given| given.labels.as_slice())).map_or(1, |labels| compact(labels).1)
}

/// The table of a mesh, in Markdown: ours with as many [`clusters`], then the others.
pub fn beside(mesh: &PolygonMesh, truth: Option<Vec<u32>>, given: Vec<Given>, cancel: &Cancel) -> Result<String> {
    let clusters = clusters(truth.as_deref(), &given) as u64;
    let mut rows = Vec::new();
    for energy in [energy::Kind::Shapes, energy::Kind::Planes] {
        rows.push(ours(mesh, energy, clusters, cancel)?);
    }
    let of_truth = truth.iter().map(|labels| Given { name: "truth".to_owned(), labels: labels.clone() });
    for given in given.into_iter().chain(of_truth) {
        rows.push(measured(mesh, given)?);
    }
    let mut out = String::new();
    table_head(&mut out, &["", "clusters", "wrong faces", "planes", "spheres", "cylinders", "L2", "L2,1"]);
    for Row { name, labels, types, l2, l21 } in rows {
        let wrong = truth.as_ref().map_or("–".to_owned(), |truth| wrong(truth, &labels).to_string());
        let mut cells = vec![name, types.iter().sum::<usize>().to_string(), wrong];
        cells.extend(types.map(|count| count.to_string()));
        cells.extend([l2, l21].map(|energy| format!("{energy:.3e}")));
        line(&mut out, &cells);
    }
    Ok(out)
}

fn ours(mesh: &PolygonMesh, energy: energy::Kind, clusters: u64, cancel: &Cancel) -> Result<Row> {
    let parameters = &Parameters { energy, clusters: Some(clusters), ..Parameters::default() };
    let request = InMemory { mesh: mesh.into(), limits: Limits::default(), parameters, seeds: None, weights: None };
    let prepared = job::prepare_in_memory(&request).map_err(|refusal| refusal.error)?;
    let outcome = job::run(&prepared, &mut CpuDevice::new(), cancel, &mut |_| ())?;
    let rows = outcome.report.shapes.unwrap_or_default();
    Ok(Row {
        name: format!("tesserae, {}", energy.name()),
        labels: outcome.labels.unwrap_or_default(),
        types: Kind::USUAL.map(|kind| rows.iter().filter(|row| row.kind == kind).count()),
        l2: outcome.report.energy.final_.unwrap_or(f64::NAN),
        l21: outcome.report.energy.l21.unwrap_or(f64::NAN),
    })
}

fn measured(mesh: &PolygonMesh, given: Given) -> Result<Row> {
    let surface = Surface::build(mesh)?.with_normals(mesh.into());
    let samples = surface.samples(&surface.corners(mesh.into()));
    let faces = Faces { graph: &surface.graph, samples: &samples };
    let internal: Vec<u32> = surface.upload_face.iter().map(|&face| given.labels[face as usize]).collect();
    let (internal, clusters) = compact(&internal);
    let resolution = surface.on_lattice(|_| RESOLUTION);
    let clustering = as_given(faces, &Kind::USUAL, resolution, internal, clusters)?;
    Ok(Row {
        name: given.name,
        labels: given.labels,
        types: Kind::USUAL.map(|kind| clustering.shapes.iter().filter(|shape| shape.kind() == kind).count()),
        l2: surface.source_of_lattice(clustering.energies[1] as f64, 0) / 3.0,
        l21: surface.l21(&clustering.labels, clusters).unwrap_or(f64::NAN),
    })
}

/// Labels without gaps, and how many there are.
fn compact(labels: &[u32]) -> (Vec<u32>, usize) {
    let labels = numbers::compact(labels);
    let count = labels.iter().max().map_or(0, |&most| most as usize + 1);
    (labels, count)
}

/// Faces outside the patch that stands for their cluster. Each patch stands for one cluster at most: pairs with the
/// most faces in common first.
fn wrong(truth: &[u32], labels: &[u32]) -> usize {
    let mut common = BTreeMap::<(u32, u32), usize>::new();
    truth.iter().zip(labels).for_each(|(&patch, &label)| *common.entry((patch, label)).or_default() += 1);
    let mut pairs: Vec<(usize, (u32, u32))> = common.into_iter().map(|(pair, faces)| (faces, pair)).collect();
    pairs.sort_by_key(|&(faces, pair)| (std::cmp::Reverse(faces), pair));
    let (mut patches, mut clusters) = (std::collections::BTreeSet::new(), std::collections::BTreeSet::new());
    let mut right = 0;
    for (faces, (patch, label)) in pairs {
        if !patches.contains(&patch) && !clusters.contains(&label) {
            patches.insert(patch);
            clusters.insert(label);
            right += faces;
        }
    }
    truth.len() - right
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::dev::sample::generate_part;

    #[test]
    fn faces_are_wrong_outside_the_patch_of_their_cluster() {
        assert_eq!(wrong(&[0, 0, 0, 1, 1], &[7, 7, 7, 4, 4]), 0);
        assert_eq!(wrong(&[0, 0, 0, 1, 1], &[7, 7, 4, 4, 4]), 1);
        // a patch in two clusters, and two in one
        assert_eq!(wrong(&[0, 0, 0, 1, 1], &[1, 1, 2, 3, 3]), 1);
        assert_eq!(wrong(&[0, 0, 0, 1, 1], &[1, 1, 1, 1, 1]), 2);
    }

    #[test]
    fn the_truth_of_a_part_without_noise_is_found_and_given_labels_have_their_energies() {
        let (mesh, truth) = generate_part(1500, 0.0).expect("a part");
        let halves = Given { name: "halves".to_owned(), labels: truth.iter().map(|&patch| patch / 7).collect() };
        let text = beside(&mesh, Some(truth), vec![halves], &Cancel::default()).expect("a table");
        let cells = |name: &str| {
            let row = text.lines().find(|row| row.contains(name)).expect("a row");
            row.split('|').map(|cell| cell.trim().to_owned()).collect::<Vec<_>>()
        };
        assert_eq!(cells("tesserae, shapes")[2..7], ["13", "0", "7", "1", "5"].map(str::to_owned));
        assert_eq!(cells("truth")[2..8], cells("tesserae, shapes")[2..8]);
        assert_eq!(cells("halves")[2], "2");
        let energy = |name: &str| cells(name)[7].parse::<f64>().expect("a number");
        assert!(energy("halves") > energy("tesserae, planes") && energy("tesserae, planes") > energy("truth"));
    }
}
