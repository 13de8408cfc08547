//! The dual of a complex of disks: a vertex a cell, an edge an arc, a polygon a junction, in triangles.
//!
//! # Vertices, edges, polygons
//!
//! Each cell has a vertex, and so has each junction on the boundary. An arc has points of its own, as many as it needs:
//!
//! | points | edges that the arc implies |
//! |---|---|
//! | 0, between cells a and b | ab |
//! | 0, on the boundary of a, between junctions u and v | au, av, uv, and the triangle a, u, v |
//! | more | from each point to a and b (or a alone) and to the next; on the boundary to u and v; triangles between |
//!
//! The polygon of a junction has as corners the cells of its sectors, counter-clockwise; between two of them the
//! nearest point of their arc, if it has points; on a boundary also the junction's vertex.
//!
//! # Why the result is a manifold with the topology of S
//!
//! Cells are disks. S is then the union of their cones over the sides of their arcs; regrouped, one quadrangle for each
//! arc, contracted to the arc's edge (or to its triangles), and one polygon for each junction. So the polygons and
//! triangles above, glued along the sides that they share by construction, are S up to homeomorphism, with one vertex
//! for each of its vertices. A triangulation of the polygons keeps that. What remains is that no two of its edges join
//! the same two vertices, since an edge of the result is the pair of its ends:
//!
//! 1. *Every edge that arcs imply comes from one arc.* Where two arcs imply an edge, the later gets a point. An edge
//!    at a point belongs to the point's arc, so one point (two where a boundary arc returns to its junction, three on
//!    a closed arc) is enough: the cells beside an arc differ.
//! 2. *Every diagonal is new*, and no triangle is there twice: [`triangulate`] takes no others. If it finds nothing,
//!    all arcs at the junction get a point more, and all polygons are triangulated again.
//! 3. *That ends.* An arc has at most two points, or three if it returns. A junction whose arcs all have as many has a
//!    triangulation: cut off the corner of every cell; the diagonals join the two neighbours of the cell, which are
//!    points. What remains is a polygon whose vertices are the junction's alone. An arc with two points shares its
//!    first with one end and its second with the other; of one that returns, the first and the third are at the
//!    junction, which no edge joins. So all of its diagonals are new.
//!
//! After [`PATIENCE`] rounds, all arcs get as many points as they may have, so that the rounds are bounded.

use std::collections::hash_map::{Entry, HashMap};

use glam::DVec3;

use super::points::{Layout, Spot};
use super::polygon::{Edge, MOST_CORNERS, Made, edge, triangulate, zigzag};
use crate::complex::arcs::Junction;
use crate::complex::{Arc, Complex, CutSurface};

/// Rounds after which all arcs get all their points.
const PATIENCE: usize = 30;

/// A mesh of triangles with a vertex a cell.
#[derive(Debug)]
pub struct Dual {
    /// Corners: cells, then `spots`.
    pub triangles: Vec<[u32; 3]>,
    /// The vertices after the cells.
    pub spots: Vec<Spot>,
    /// How many of them are on the boundary.
    pub on_boundary: usize,
}

/// The dual of a complex whose cells are disks. `positions` of the cells decide which diagonals are best.
pub fn dual(surface: &CutSurface, complex: &Complex<'_>, positions: &[DVec3]) -> Dual {
    let mut counts = fewest_points(surface, complex);
    let mut round = 0;
    loop {
        let layout = Layout::new(surface, complex, positions.len(), &counts);
        let mut all = positions.to_vec();
        all.extend(layout.spots.iter().map(|spot| spot.position(surface)));
        let attempt =
            Attempt { complex, counts: &counts, layout: &layout, positions: &all, cells: positions.len() as u32 };
        match attempt.triangles() {
            Ok(triangles) => {
                return Dual { triangles, spots: layout.spots, on_boundary: layout.on_boundary };
            }
            Err(wanting) if round < PATIENCE => {
                for arc in wanting {
                    counts[arc] = most_points(&complex.arcs[arc]).min(counts[arc] + 1);
                }
            }
            Err(_) => counts = complex.arcs.iter().map(most_points).collect(),
        }
        round += 1;
    }
}

/// Points that are always enough.
fn most_points(arc: &Arc) -> u8 {
    if arc.ends.is_none() || arc.returns() { 3 } else { 2 }
}

/// Points without which there would be double edges: of several arcs between two cells, all but the longest need one.
fn fewest_points(surface: &CutSurface, complex: &Complex<'_>) -> Vec<u8> {
    let length = |arc: &Arc| complex.chain(arc).iter().map(|&half| surface.length(half)).sum::<f64>();
    let mut counts = Vec::with_capacity(complex.arcs.len());
    for between in complex.arcs.chunk_by(|one, other| (one.left, one.right) == (other.left, other.right)) {
        let is_alone = between.len() == 1 || between[0].right.is_none();
        let lengths: Vec<f64> = if is_alone { Vec::new() } else { between.iter().map(length).collect() };
        let longest = (1..lengths.len()).fold(0, |best, at| if lengths[at] > lengths[best] { at } else { best });
        counts.extend(between.iter().enumerate().map(|(at, arc)| match (arc.ends, arc.right) {
            (None, _) => 3,
            (Some([start, end]), None) => 2 * u8::from(start == end),
            (Some(_), Some(_)) => u8::from(!is_alone && at != longest),
        }));
    }
    counts
}

/// One try, with fixed numbers of points.
struct Attempt<'a> {
    complex: &'a Complex<'a>,
    counts: &'a [u8],
    layout: &'a Layout,
    positions: &'a [DVec3],
    cells: u32,
}

impl Attempt<'_> {
    /// All triangles, or the arcs that need a point more.
    fn triangles(&self) -> Result<Vec<[u32; 3]>, Vec<usize>> {
        let mut made = self.around_arcs()?;
        let mut polygons: Vec<(Vec<u32>, &Junction)> =
            self.complex.junctions.iter().map(|junction| (self.polygon(junction), junction)).collect();
        // the fewer corners, the less choice
        polygons.sort_by_key(|(polygon, _)| polygon.len());
        let mut wanting = Vec::new();
        for (polygon, junction) in polygons {
            let best = triangulate(&polygon, &made, |vertex| self.positions[vertex as usize]);
            match best.or_else(|| self.without_cells(&polygon, junction)) {
                Some(triangles) => made.extend(triangles),
                None => wanting.extend(self.arcs_at(junction)),
            }
        }
        wanting.sort_unstable();
        wanting.dedup();
        if wanting.is_empty() { Ok(made.triangles) } else { Err(wanting) }
    }

    /// The edges and triangles that arcs imply, or the arcs that imply an edge of another.
    fn around_arcs(&self) -> Result<Made, Vec<usize>> {
        let mut made = Made::default();
        let mut makers: HashMap<Edge, usize> = HashMap::with_capacity(4 * self.counts.len());
        let mut late = Vec::new();
        let mut edges = Vec::new();
        for (number, arc) in self.complex.arcs.iter().enumerate() {
            edges.clear();
            let ends = arc.ends.map(|ends| ends.map(|junction| self.layout.of_junction[junction as usize]));
            let points = self.points(number);
            match (arc.right, ends) {
                (Some(right), _) if points.is_empty() => edges.push(edge(arc.left, right)),
                (None, Some([start, end])) if points.is_empty() => {
                    made.extend([[arc.left, start, end]]);
                    edges.extend([edge(arc.left, start), edge(arc.left, end), edge(start, end)]);
                }
                (None, Some([start, end])) => {
                    edges.extend([edge(start, points.start), edge(end, points.end - 1)]);
                }
                _ => {}
            }
            for point in points.clone() {
                edges.push(edge(arc.left, point));
                edges.extend(arc.right.map(|right| edge(right, point)));
                let following = match point + 1 < points.end {
                    true => point + 1,
                    false if arc.ends.is_none() => points.start,
                    false => continue,
                };
                edges.push(edge(point, following));
                made.extend([[arc.left, point, following]]);
                made.extend(arc.right.map(|right| [right, following, point]));
            }
            for &edge in &edges {
                match makers.entry(edge) {
                    Entry::Vacant(entry) => {
                        entry.insert(number);
                    }
                    Entry::Occupied(entry) if *entry.get() != number => late.push(number),
                    Entry::Occupied(_) => {}
                }
            }
        }
        late.dedup();
        if !late.is_empty() {
            return Err(late);
        }
        made.edges.extend(makers.into_keys());
        Ok(made)
    }

    /// The points of an arc.
    fn points(&self, arc: usize) -> std::ops::Range<u32> {
        match self.counts[arc] {
            0 => 0..0,
            count => self.layout.first_point[arc]..self.layout.first_point[arc] + u32::from(count),
        }
    }

    /// The point of an arc that is nearest to where a half-edge of it begins (or, `arriving`, ends).
    fn near_point(&self, half: u32, arriving: bool) -> Option<u32> {
        let (arc, runs_along) = self.complex.arc_at(half);
        let points = self.points(arc);
        if points.is_empty() {
            return None;
        }
        Some(if runs_along != arriving { points.start } else { points.end - 1 })
    }

    /// The corners of a junction's polygon, counter-clockwise.
    fn polygon(&self, junction: &Junction) -> Vec<u32> {
        let sectors = self.complex.sectors(junction);
        let mut corners = Vec::with_capacity(2 * sectors.len() + 2);
        if junction.arriving.is_some() {
            let (arc, _) = self.complex.arc_at(sectors[0]);
            // the boundary arc that leaves a junction starts there
            let start = self.complex.arcs[arc].ends.map(|[start, _]| self.layout.of_junction[start as usize]);
            corners.extend(start);
        }
        for &half in sectors {
            corners.extend(self.near_point(half, false));
            corners.push(self.complex.left(half));
        }
        corners.extend(junction.arriving.and_then(|half| self.near_point(half, true)));
        corners
    }

    /// The arcs at a junction.
    fn arcs_at(&self, junction: &Junction) -> impl Iterator<Item = usize> {
        let halves = self.complex.sectors(junction).iter().copied().chain(junction.arriving);
        halves.map(|half| self.complex.arc_at(half).0)
    }

    /// The triangulation that there is if all arcs at a junction have as many points as they may have.
    fn without_cells(&self, polygon: &[u32], junction: &Junction) -> Option<Vec<[u32; 3]>> {
        let is_full = |arc: usize| self.counts[arc] >= most_points(&self.complex.arcs[arc]);
        if !self.arcs_at(junction).all(is_full) {
            return None;
        }
        let corners = polygon.len();
        let at_cells = (0..corners).filter(|&at| polygon[at] < self.cells);
        let corner = |at: usize| [polygon[(at + corners - 1) % corners], polygon[at], polygon[(at + 1) % corners]];
        let mut triangles: Vec<[u32; 3]> = at_cells.map(corner).collect();
        let inner: Vec<u32> = polygon.iter().copied().filter(|&vertex| vertex >= self.cells).collect();
        let best = match inner.len() <= MOST_CORNERS {
            true => triangulate(&inner, &Made::default(), |vertex| self.positions[vertex as usize]),
            false => None,
        };
        triangles.extend(best.unwrap_or_else(|| zigzag(&inner)));
        Some(triangles)
    }
}
