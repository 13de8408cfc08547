//! Triangles of a polygon whose corners are vertices of a mesh that is being made.

use std::collections::HashSet;

use glam::DVec3;

/// An edge: the lower end first.
pub type Edge = (u32, u32);

/// The edge between two vertices.
pub fn edge(one: u32, other: u32) -> Edge {
    (one.min(other), one.max(other))
}

/// Edges and triangles that there are.
#[derive(Debug, Default)]
pub struct Made {
    /// All triangles.
    pub triangles: Vec<[u32; 3]>,
    /// All edges.
    pub edges: HashSet<Edge>,
    /// The corners of all triangles, sorted.
    corners: HashSet<[u32; 3]>,
}

impl Made {
    /// Adds triangles and their edges.
    pub fn extend(&mut self, triangles: impl IntoIterator<Item = [u32; 3]>) {
        for triangle in triangles {
            self.triangles.push(triangle);
            self.edges.extend(edges(triangle));
            self.corners.insert(sorted(triangle));
        }
    }

    /// Whether a triangle has three different corners and does not exist.
    pub fn admits(&self, [a, b, c]: [u32; 3]) -> bool {
        a != b && b != c && c != a && !self.corners.contains(&sorted([a, b, c]))
    }
}

fn edges([a, b, c]: [u32; 3]) -> [Edge; 3] {
    [edge(a, b), edge(b, c), edge(c, a)]
}

fn sorted(mut triangle: [u32; 3]) -> [u32; 3] {
    triangle.sort_unstable();
    triangle
}

/// Corners up to which polygons are triangulated in the best way; it takes time of the third power.
pub const MOST_CORNERS: usize = 32;

/// The triangulation whose worst triangle is best, among those whose diagonals are no edges and whose triangles do not
/// exist. Corners may repeat; sides are edges already. None if there is none, and above [`MOST_CORNERS`].
pub fn triangulate(polygon: &[u32], made: &Made, position: impl Fn(u32) -> DVec3) -> Option<Vec<[u32; 3]>> {
    let corners = polygon.len();
    if !(3..=MOST_CORNERS).contains(&corners) {
        return None;
    }
    let places: Vec<DVec3> = polygon.iter().map(|&vertex| position(vertex)).collect();
    // of the polygon from corner i to corner j: the worst quality of its best triangulation, and the third corner of
    // the triangle at the diagonal
    let mut best: Vec<Option<(f64, usize)>> = vec![None; corners * corners];
    for corner in 0..corners - 1 {
        best[corner * corners + corner + 1] = Some((f64::INFINITY, 0));
    }
    for span in 2..corners {
        for i in 0..corners - span {
            let j = i + span;
            let (one, other) = (polygon[i], polygon[j]);
            if span < corners - 1 && (one == other || made.edges.contains(&edge(one, other))) {
                continue;
            }
            for middle in i + 1..j {
                let parts = (best[i * corners + middle], best[middle * corners + j]);
                let (Some((left, _)), Some((right, _))) = parts else { continue };
                if !made.admits([one, polygon[middle], other]) {
                    continue;
                }
                let worst = quality(places[i], places[middle], places[j]).min(left).min(right);
                let found = &mut best[i * corners + j];
                if found.is_none_or(|(so_far, _)| worst > so_far) {
                    *found = Some((worst, middle));
                }
            }
        }
    }
    let mut triangles = Vec::with_capacity(corners - 2);
    let mut open = vec![(0, corners - 1)];
    while let Some((i, j)) = open.pop() {
        if j > i + 1 {
            let (_, middle) = best[i * corners + j]?;
            triangles.push([polygon[i], polygon[middle], polygon[j]]);
            open.extend([(middle, j), (i, middle)]);
        }
    }
    is_sound(&triangles).then_some(triangles)
}

/// Whether no triangle is there twice and no edge three times: diagonals between different corners of a polygon may
/// join the same vertices.
fn is_sound(triangles: &[[u32; 3]]) -> bool {
    let mut corners: Vec<[u32; 3]> = triangles.iter().map(|&triangle| sorted(triangle)).collect();
    corners.sort_unstable();
    let mut all: Vec<Edge> = triangles.iter().flat_map(|&triangle| edges(triangle)).collect();
    all.sort_unstable();
    corners.windows(2).all(|pair| pair[0] != pair[1]) && all.windows(3).all(|three| three[0] != three[2])
}

/// Triangles of a polygon of any number of different corners, of which no two have an edge but the sides.
pub fn zigzag(polygon: &[u32]) -> Vec<[u32; 3]> {
    let (mut low, mut high) = (0, polygon.len().saturating_sub(1));
    let mut triangles = Vec::with_capacity(polygon.len().saturating_sub(2));
    while high > low + 1 {
        triangles.push([polygon[low], polygon[low + 1], polygon[high]]);
        low += 1;
        if high > low + 1 {
            triangles.push([polygon[low], polygon[high - 1], polygon[high]]);
            high -= 1;
        }
    }
    triangles
}

/// 1 for equal sides, 0 without an area.
fn quality(a: DVec3, b: DVec3, c: DVec3) -> f64 {
    let squares = a.distance_squared(b) + b.distance_squared(c) + c.distance_squared(a);
    let area = (b - a).cross(c - a).length();
    if squares > 0.0 { 12f64.sqrt() * area / squares } else { 0.0 }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn place(vertex: u32) -> DVec3 {
        let [x, y] = [[0.0, 0.0], [3.0, 0.0], [4.0, 2.0], [2.0, 3.0], [0.0, 2.0], [9.0, 9.0]][vertex as usize % 6];
        DVec3::new(x, y, 0.0)
    }

    #[test]
    fn diagonals_are_new_edges_and_triangles_are_new() {
        let free = triangulate(&[0, 1, 2, 3], &Made::default(), place).expect("a quad");
        assert_eq!(free.len(), 2);
        let has = |triangles: &[[u32; 3]], one, other| {
            triangles.iter().filter(|triangle| edges(**triangle).contains(&edge(one, other))).count()
        };
        let (taken, left) = if has(&free, 0, 2) == 2 { ((0, 2), (1, 3)) } else { ((1, 3), (0, 2)) };
        let mut made = Made::default();
        made.edges.insert(taken);
        let other = triangulate(&[0, 1, 2, 3], &made, place).expect("the other diagonal");
        assert_eq!(has(&other, left.0, left.1), 2);
        made.edges.insert(left);
        assert_eq!(triangulate(&[0, 1, 2, 3], &made, place), None);
        made.extend([[2, 1, 0]]);
        assert_eq!(triangulate(&[0, 1, 2], &made, place), None);
        assert_eq!(triangulate(&[0, 1, 0], &Made::default(), place), None);
    }

    #[test]
    fn repeated_corners_give_no_double_edges() {
        // both diagonals from the two corners at vertex 0 to vertex 2 would be one edge
        for polygon in [&[0, 1, 0, 2][..], &[0, 1, 2, 0, 3, 2], &[0, 1, 2, 3, 0, 4, 5, 3]] {
            if let Some(triangles) = triangulate(polygon, &Made::default(), place) {
                assert!(is_sound(&triangles), "{polygon:?} {triangles:?}");
                assert_eq!(triangles.len(), polygon.len() - 2);
            }
        }
        assert_eq!(triangulate(&[0, 1, 0, 2], &Made::default(), place), None);
    }

    #[test]
    fn any_number_of_corners_is_zigzagged() {
        for corners in 0..40 {
            let polygon: Vec<u32> = (0..corners).collect();
            let triangles = zigzag(&polygon);
            assert_eq!(triangles.len(), (corners as usize).saturating_sub(2));
            assert!(is_sound(&triangles));
            for side in 0..corners.saturating_sub(1) {
                let directed = |t: &&[u32; 3]| (0..3).any(|i| t[i] == side && t[(i + 1) % 3] == side + 1);
                assert!(corners < 3 || triangles.iter().filter(directed).count() == 1, "{corners} {side}");
            }
        }
    }
}
