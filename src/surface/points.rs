//! A surface of points: its items are the points of a triangle mesh in place of its faces.
//!
//! An item is a position that triangles use, numbered in the order of first use. Its place is the position, its area a
//! third of that of the triangles at it, and its neighbours are the positions at the other ends of its edges. So the
//! energy of a clustering is Σ area·|position − P|², with P the mean of a cluster's positions weighted by area: what
//! pyacvd minimises, up to the third.
//!
//! Everything after this step sees a [`DualGraph`](super::DualGraph) and cannot tell points from faces.

use super::components::Components;
use super::density::{self, Wanted};
use super::lattice::{self, COORDINATE_BITS, FaceGeometry};
use super::rows::symmetric;
use super::weld::{self, UNUSED, Weld};
use super::{Counts, Gathered, Surface, bridge, order};
use crate::error::{Error, Result};
use crate::mesh::{Frame, MeshView};
use crate::union_find;

/// A surface of points, and where its items come from.
#[derive(Debug)]
pub struct OfPoints {
    /// The surface; `upload_face` has numbers of items.
    pub surface: Surface,
    /// The item of each point of the mesh; `u32::MAX` where no triangle uses it.
    pub item_of_point: Vec<u32>,
}

impl OfPoints {
    /// Puts the points of a triangle mesh on the lattice. Joins components if there are more than `most_components`.
    ///
    /// Weights of `wanted`, one a point, multiply areas.
    ///
    /// # Errors
    /// A face is no triangle, there are more than 2³⁰ corners, weights are not one a point, finite and above 0, or
    /// there is a curvature exponent.
    pub fn build(mesh: MeshView<'_>, most_components: u64, wanted: Wanted<'_>) -> Result<Self> {
        if !mesh.faces.are_triangles() {
            return Err(Error::mesh("points are clustered on triangles only: cut other faces into triangles"));
        }
        let corners = mesh.faces.all_corners().len();
        if corners > 1 << 30 {
            return Err(Error::too_large(format_args!(
                "the points of a mesh with more than {} corners of triangles cannot be numbered: {corners}",
                1u32 << 30
            )));
        }
        if let Some(exponent) = wanted.curvature_exponent {
            return Err(Error::parameter(format_args!("points have no curvature exponent, faces have: {exponent}")));
        }
        let weights = wanted.weights.map(|weights| checked(mesh, weights)).transpose()?;
        // from within the pool, parallel steps need not wake it
        Ok(rayon::scope(|_| Self::build_in_pool(mesh, most_components, weights)))
    }

    fn build_in_pool(mesh: MeshView<'_>, most_components: u64, weights: Option<Weights<'_>>) -> Self {
        let (weld, corners) = weld::weld(mesh);
        let triangles = corners.as_chunks::<3>().0;
        let (frame, mut geometry) = places(mesh, &weld);
        let items = geometry.len();
        let along_curve = || {
            order::along_curve(items, &|items, visit| {
                items.iter().enumerate().for_each(|(at, &item)| visit(at, geometry[item as usize].centroid));
            })
        };
        let connected = || components(items, edges(triangles));
        let areas = || areas(mesh, triangles, &geometry, weights);
        let (sorted, (mut components, areas)) = rayon::join(along_curve, || rayon::join(connected, areas));
        geometry.iter_mut().zip(areas).for_each(|(item, area)| item.area = area);

        let counts = Counts {
            components: components.count as u64,
            welded_vertices: u64::from(weld.vertices),
            ..Counts::default()
        };
        let mut bridges = Vec::new();
        if components.count as u64 > most_components {
            bridges = bridge::bridges(&geometry, &components);
            components = self::components(items, edges(triangles).chain(bridges.iter().copied()));
        }
        let upload_face = order::by_component(sorted, &components);
        let runs = components.runs(&upload_face);
        let internal = order::inverse(&upload_face, items);
        let gather = || {
            let geometry: Vec<FaceGeometry> = upload_face.iter().map(|&item| geometry[item as usize]).collect();
            let points = geometry.iter().map(|item| lattice::round_centroid(item.centroid)).collect();
            Gathered { geometry, points, moment_inside_faces: None, zero_area_faces: 0, tiny_faces: 0 }
        };
        let of_items = || edges(triangles).chain(bridges.iter().copied());
        let internal = || of_items().map(|(a, b)| (internal[a as usize], internal[b as usize]));
        let (rows, gathered) = rayon::join(|| symmetric(items, internal), gather);
        let density_unit = weights.map(|weights| weights.largest);
        let surface = Surface::of(gathered, &runs, rows, upload_face, counts, frame, density_unit);
        Self { surface, item_of_point: weld.position_of_vertex }
    }
}

/// One weight a point, and the largest of those that triangles use.
#[derive(Clone, Copy)]
struct Weights<'a> {
    of_point: &'a [f64],
    largest: f64,
}

fn checked<'a>(mesh: MeshView<'_>, of_point: &'a [f64]) -> Result<Weights<'a>> {
    if of_point.len() != mesh.positions.len() {
        return Err(Error::parameter(format_args!(
            "there must be one weight a point, {}, not {}",
            mesh.positions.len(),
            of_point.len()
        )));
    }
    density::check(of_point)?;
    let used = mesh.faces.all_corners().iter().map(|&point| of_point[point as usize]);
    Ok(Weights { of_point, largest: used.fold(0.0, f64::max) })
}

/// The frame of the positions that triangles use, and the items in it, without their areas.
fn places(mesh: MeshView<'_>, weld: &Weld) -> (Frame, Vec<FaceGeometry>) {
    let mut source = vec![[0.0; 3]; weld.vertices as usize];
    for (point, &item) in weld.position_of_vertex.iter().enumerate() {
        if item != UNUSED {
            source[item as usize] = mesh.positions.at(point);
        }
    }
    let frame = Frame::of(source.iter().copied(), COORDINATE_BITS);
    let items = source.into_iter().map(|at| FaceGeometry::new(frame.position(at), 0.0));
    (frame, items.collect())
}

/// The pairs of items that an edge joins, once for each triangle at the edge.
fn edges(triangles: &[[u32; 3]]) -> impl Iterator<Item = (u32, u32)> + Clone + '_ {
    triangles.iter().flat_map(|&[a, b, c]| [(a, b), (b, c), (c, a)]).filter(|(a, b)| a != b)
}

fn components(items: usize, edges: impl Iterator<Item = (u32, u32)>) -> Components {
    let mut sets = union_find::singletons(items);
    edges.for_each(|(a, b)| {
        union_find::join(&mut sets, a, b);
    });
    let (of_face, count) = union_find::numbered(sets);
    Components { of_face, count }
}

/// The area of each item, in lattice units, times its points' relative weights.
fn areas(
    mesh: MeshView<'_>,
    triangles: &[[u32; 3]],
    geometry: &[FaceGeometry],
    weights: Option<Weights<'_>>,
) -> Vec<f64> {
    let mut areas = vec![0.0; geometry.len()];
    let points = mesh.faces.all_corners().as_chunks::<3>().0;
    for (items, points) in triangles.iter().zip(points) {
        let [a, b, c] = items.map(|item| geometry[item as usize].centroid);
        let third = (b - a).cross(c - a).length() / 6.0;
        for (&item, &point) in items.iter().zip(points) {
            let relative = weights.map_or(1.0, |weights| weights.of_point[point as usize] / weights.largest);
            areas[item as usize] += third * relative;
        }
    }
    areas
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::dev::sample::{Sample, generate};
    use crate::mesh::{Faces, PolygonMesh, Positions};

    const ALL: u64 = u64::MAX;

    fn of(mesh: &PolygonMesh) -> OfPoints {
        OfPoints::build(mesh.into(), ALL, Wanted::default()).expect("a surface")
    }

    /// The items beside each item, sorted.
    fn beside(OfPoints { surface, .. }: &OfPoints) -> Vec<Vec<u32>> {
        let upload = |&item: &u32| surface.upload_face[item as usize];
        let mut all = vec![Vec::new(); surface.faces()];
        for item in 0..surface.faces() as u32 {
            let row = &mut all[upload(&item) as usize];
            row.extend(surface.neighbours_of(item).iter().map(upload));
            row.sort_unstable();
        }
        all
    }

    #[test]
    fn items_are_the_positions_that_triangles_use_and_edges_join_them() {
        for sample in [Sample::Knot, Sample::Parts, Sample::Terrain] {
            let mesh = generate(sample, 600).expect("a sample");
            let points = of(&mesh);
            let mut expected = vec![std::collections::BTreeSet::new(); points.surface.faces()];
            for corners in mesh.faces.all_corners().as_chunks::<3>().0 {
                let items = corners.map(|corner| points.item_of_point[corner as usize]);
                for (a, b) in [(0, 1), (1, 2), (2, 0)] {
                    expected[items[a] as usize].insert(items[b]);
                    expected[items[b] as usize].insert(items[a]);
                }
            }
            let expected: Vec<Vec<u32>> = expected.into_iter().map(|row| row.into_iter().collect()).collect();
            assert_eq!(beside(&points), expected);
            let components = Surface::build(&mesh).expect("a surface").components.len();
            assert_eq!(points.surface.components.len(), components);
        }
    }

    #[test]
    fn a_seam_is_no_boundary_and_points_without_a_triangle_are_no_items() {
        let square = [[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [1.0, 1.0, 0.0], [0.0, 1.0, 0.0]];
        let points = [square[0], square[1], square[2], [9.0; 3], square[0].map(|x: f64| -x), square[2], square[3]];
        let faces = Faces::from_triangles(vec![0, 1, 2, 4, 5, 6, 1, 1, 0]);
        let mesh = MeshView::new(Positions::Double(&points), &faces).expect("a mesh");
        let made = OfPoints::build(mesh, ALL, Wanted::default()).expect("a surface");
        assert_eq!(made.item_of_point, [0, 1, 2, UNUSED, 0, 2, 3]);
        assert_eq!(beside(&made), [vec![1, 2, 3], vec![0, 2], vec![0, 1, 3], vec![0, 2]]);
        // areas of thirds of triangles of 1/2
        let labels: Vec<u32> = made.surface.upload_face.clone();
        assert_eq!(made.surface.source_energy(&labels, 4), 0.0);
        let energy = made.surface.source_energy(&[0; 4], 1);
        assert!((energy - 0.5).abs() < 1e-6, "area 1 × squared distance 1/2 to the middle, not {energy}");
    }

    #[test]
    fn parts_are_joined_where_there_are_more_of_them_than_clusters() {
        let mesh = generate(Sample::Parts, 600).expect("a sample");
        let parts = of(&mesh).surface.components.len();
        assert!(parts > 1);
        for (most, components) in [(parts as u64, parts), (parts as u64 - 1, 1)] {
            let made = OfPoints::build((&mesh).into(), most, Wanted::default()).expect("a surface");
            assert_eq!((made.surface.components.len(), made.surface.counts.components), (components, parts as u64));
        }
    }

    #[test]
    fn only_weights_relative_to_each_other_matter() {
        let mesh = generate(Sample::Knot, 600).expect("a sample");
        let with = |weights: &[f64]| {
            OfPoints::build((&mesh).into(), ALL, Wanted { weights: Some(weights), ..Wanted::default() })
        };
        let points = mesh.positions.len();
        let plain = of(&mesh).surface;
        let equal = with(&vec![3.5; points]).expect("a surface").surface;
        assert_eq!(plain.weights, equal.weights);
        let labels = vec![0; plain.faces()];
        let [one, other] = [&plain, &equal].map(|surface| surface.source_energy(&labels, 1));
        assert!((3.5 * one - other).abs() < 1e-9 * other);
        let mut heavier = vec![1.0; points];
        heavier[7] = 2.0;
        assert_ne!(plain.weights, with(&heavier).expect("a surface").surface.weights);
        for wrong in [vec![1.0; points - 1], vec![0.0; points], vec![f64::NAN; points]] {
            assert!(with(&wrong).is_err());
        }
    }

    #[test]
    fn what_has_no_points_to_cluster_is_refused() {
        let square = [[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [1.0, 1.0, 0.0], [0.0, 1.0, 0.0]];
        let mut faces = Faces::default();
        faces.push(&[0, 1, 2, 3]);
        let mesh = MeshView::new(Positions::Double(&square), &faces).expect("a mesh");
        assert!(OfPoints::build(mesh, ALL, Wanted::default()).expect_err("a quad").message.contains("triangles only"));
        let curved = Wanted { curvature_exponent: Some(1.0), ..Wanted::default() };
        let knot = generate(Sample::Knot, 600).expect("a sample");
        assert!(OfPoints::build((&knot).into(), ALL, curved).is_err());
    }
}
