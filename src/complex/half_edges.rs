//! Triangles with a direction on every edge, oriented alike where possible.
//!
//! Half-edge 3t + i runs from corner i of triangle t to its next corner; the triangle lies on its left. Two half-edges
//! are twins if they are all that there is on their edge and run in opposite directions; an edge without twins is cut.
//! Triangles are turned breadth first, from the first of each component, so that edges of two half-edges have twins.
//! On a surface that cannot be oriented, edges remain where that fails. Of a component's two orientations, the one
//! that more of its triangles have stays.
//!
//! Around a vertex, triangles that twins connect are an *umbrella*: closed, or open with one boundary half-edge that
//! leaves the vertex and one that arrives. A vertex of several umbrellas is several vertices of the cut surface.

mod mates;

use self::mates::Mates;
use crate::parallel;

/// No half-edge.
pub const NONE: u32 = u32::MAX;

/// A 2-manifold with boundary, made of triangles by cutting.
#[derive(Debug)]
pub struct HalfEdges {
    /// Corners of each triangle, oriented.
    pub triangles: Vec<[u32; 3]>,
    /// The twin of each half-edge, or [`NONE`].
    pub twins: Vec<u32>,
    /// The umbrella of each half-edge's origin.
    pub umbrella: Vec<u32>,
    /// All umbrellas, by their first half-edges.
    pub umbrellas: Vec<Umbrella>,
    /// The component of each triangle, across twins; numbered by their first triangles.
    pub component: Vec<u32>,
    /// Number of components.
    pub components: u32,
    /// Whether each triangle was turned: its second and third corner swapped.
    pub turned: Vec<bool>,
    /// Edges of several half-edges that are cut.
    pub cut_edges: u64,
    /// Pairs of triangles that share an edge of more than two half-edges; enough to connect all of them.
    pub across_crowded: Vec<[u32; 2]>,
}

/// A vertex of the cut surface.
#[derive(Debug, Clone, Copy)]
pub struct Umbrella {
    /// A half-edge that leaves it: of an open one, that on the boundary.
    pub first: u32,
    /// Whether it is on the boundary.
    pub is_open: bool,
}

/// What cutting, clustering and remeshing must agree on.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Topology {
    /// Vertices − edges + triangles.
    pub euler: i64,
    /// Circles that the boundary consists of.
    pub loops: u64,
    /// Components.
    pub components: u64,
}

/// The next half-edge of the triangle.
#[inline]
pub fn next(half: u32) -> u32 {
    if half % 3 == 2 { half - 2 } else { half + 1 }
}

/// The half-edge before in the triangle.
#[inline]
pub fn previous(half: u32) -> u32 {
    if half.is_multiple_of(3) { half + 2 } else { half - 1 }
}

impl HalfEdges {
    /// Orients triangles and cuts them apart. The corners of each are different and below `vertices`; there are at most
    /// 2³²/3 triangles.
    pub fn new(mut triangles: Vec<[u32; 3]>, vertices: usize) -> Self {
        let Mates { mates, crowded_edges, across_crowded, run_alike } = Mates::new(&triangles, vertices);
        // where no two run alike, nothing is turned, and mates are twins
        let ((component, components, turned), early) =
            rayon::join(|| orient(&triangles, &mates), || (!run_alike).then(|| umbrellas(&mates)));
        let (twins, cut) = match run_alike {
            true => twins(&triangles, &mates, &turned),
            false => (mates, 0),
        };
        let cut_edges = crowded_edges + cut;
        for (triangle, _) in triangles.iter_mut().zip(&turned).filter(|(_, turned)| **turned) {
            triangle.swap(1, 2);
        }
        let (umbrella, umbrellas) = early.unwrap_or_else(|| umbrellas(&twins));
        Self { triangles, twins, umbrella, umbrellas, component, components, turned, cut_edges, across_crowded }
    }

    /// The vertex that a half-edge leaves.
    #[inline]
    pub fn origin(&self, half: u32) -> u32 {
        origin(&self.triangles, half)
    }

    /// The vertex that a half-edge arrives at.
    #[inline]
    pub fn target(&self, half: u32) -> u32 {
        self.origin(next(half))
    }

    /// The boundary half-edge after one.
    pub fn next_on_boundary(&self, half: u32) -> u32 {
        self.umbrellas[self.umbrella[next(half) as usize] as usize].first
    }

    /// The boundary as circles of half-edges, by their first half-edges.
    pub fn loops(&self) -> Vec<Vec<u32>> {
        let mut seen = vec![false; self.twins.len()];
        let mut loops = Vec::new();
        let mut starts: Vec<u32> = self.open().map(|umbrella| umbrella.first).collect();
        starts.sort_unstable();
        for start in starts {
            let mut circle = Vec::new();
            let mut half = start;
            while !std::mem::replace(&mut seen[half as usize], true) {
                circle.push(half);
                half = self.next_on_boundary(half);
            }
            if !circle.is_empty() {
                loops.push(circle);
            }
        }
        loops
    }

    /// The umbrellas on the boundary.
    fn open(&self) -> impl Iterator<Item = &Umbrella> {
        self.umbrellas.iter().filter(|umbrella| umbrella.is_open)
    }

    /// Euler number, boundary circles, components.
    pub fn topology(&self) -> Topology {
        // of open umbrellas there are as many as of half-edges on the boundary
        let edges = (self.twins.len() + self.open().count()) / 2;
        Topology {
            euler: self.umbrellas.len() as i64 - edges as i64 + self.triangles.len() as i64,
            loops: self.loops().len() as u64,
            components: u64::from(self.components),
        }
    }

    /// The half-edges with another cell, or none, on their right; `cells` has one a triangle. Ascending.
    pub fn crossing(&self, cells: &[u32]) -> Vec<u32> {
        parallel::filter(self.twins.len(), parallel::LEAST, |&half| self.crosses(cells, half))
    }

    /// Whether another cell, or none, lies on the right of a half-edge.
    #[inline]
    pub fn crosses(&self, cells: &[u32], half: u32) -> bool {
        let twin = self.twins[half as usize];
        twin == NONE || cells[twin as usize / 3] != cells[half as usize / 3]
    }

    /// The Euler number of each cell without its border: triangles − inner edges + inner vertices. A connected cell is
    /// a disk if that is 1.
    pub fn euler_of_cells(&self, cells: &[u32], count: usize, crossing: &[u32]) -> Vec<i64> {
        // 2·triangles − (half-edges − crossing ones) + 2·vertices
        let mut doubled = vec![0; count];
        cells.iter().for_each(|&cell| doubled[cell as usize] -= 1);
        let mut is_inner: Vec<bool> = self.umbrellas.iter().map(|umbrella| !umbrella.is_open).collect();
        for &half in crossing {
            doubled[cells[half as usize / 3] as usize] += 1;
            is_inner[self.umbrella[half as usize] as usize] = false;
        }
        for (umbrella, _) in self.umbrellas.iter().zip(is_inner).filter(|(_, is_inner)| *is_inner) {
            doubled[cells[umbrella.first as usize / 3] as usize] += 2;
        }
        doubled.into_iter().map(|doubled| doubled / 2).collect()
    }
}

#[inline]
fn origin(triangles: &[[u32; 3]], half: u32) -> u32 {
    triangles[half as usize / 3][half as usize % 3]
}

/// The component of each triangle, their number, and which triangles to turn.
fn orient(triangles: &[[u32; 3]], mates: &[u32]) -> (Vec<u32>, u32, Vec<bool>) {
    let mut component = vec![NONE; triangles.len()];
    let mut turned = vec![false; triangles.len()];
    let mut components = 0;
    let mut queue: Vec<u32> = Vec::new();
    for start in 0..triangles.len() as u32 {
        if component[start as usize] != NONE {
            continue;
        }
        queue.clear();
        queue.push(start);
        component[start as usize] = components;
        let (mut at, mut turns) = (0, 0);
        while at < queue.len() {
            let triangle = queue[at];
            at += 1;
            for half in 3 * triangle..3 * triangle + 3 {
                let mate = mates[half as usize];
                let other = mate as usize / 3;
                if mate == NONE || component[other] != NONE {
                    continue;
                }
                component[other] = components;
                let run_alike = origin(triangles, half) == origin(triangles, mate);
                turned[other] = turned[triangle as usize] != run_alike;
                turns += usize::from(turned[other]);
                queue.push(other as u32);
            }
        }
        if 2 * turns > queue.len() {
            queue.iter().for_each(|&triangle| turned[triangle as usize] ^= true);
        }
        components += 1;
    }
    (component, components, turned)
}

/// The twins of half-edges after triangles are turned, and the number of edges of two that are cut.
fn twins(triangles: &[[u32; 3]], mates: &[u32], turned: &[bool]) -> (Vec<u32>, u64) {
    let placed = |half: u32| match turned[half as usize / 3] {
        true => half / 3 * 3 + 2 - half % 3,
        false => half,
    };
    let (mut twins, mut cut) = (vec![NONE; mates.len()], 0);
    for (half, &mate) in (0..).zip(mates) {
        if mate == NONE {
            continue;
        }
        let run_alike = origin(triangles, half) == origin(triangles, mate);
        if run_alike == (turned[half as usize / 3] != turned[mate as usize / 3]) {
            twins[placed(half) as usize] = placed(mate);
        } else {
            cut += u64::from(half < mate);
        }
    }
    (twins, cut)
}

/// The umbrella of each half-edge's origin, and all umbrellas.
fn umbrellas(twins: &[u32]) -> (Vec<u32>, Vec<Umbrella>) {
    let mut umbrella = vec![NONE; twins.len()];
    let mut umbrellas = Vec::new();
    for start in 0..twins.len() as u32 {
        if umbrella[start as usize] != NONE {
            continue;
        }
        let number = umbrellas.len() as u32;
        let mut half = start;
        // clockwise, around or to the boundary
        let is_open = loop {
            umbrella[half as usize] = number;
            let twin = twins[half as usize];
            if twin == NONE {
                break true;
            }
            half = next(twin);
            if half == start {
                break false;
            }
        };
        umbrellas.push(Umbrella { first: half, is_open });
        if is_open {
            // counter-clockwise, what lies on the other side of the start
            let mut half = twins[previous(start) as usize];
            while half != NONE {
                umbrella[half as usize] = number;
                half = twins[previous(half) as usize];
            }
        }
    }
    (umbrella, umbrellas)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn topology(triangles: &[[u32; 3]], vertices: usize) -> (i64, u64, u64, u64) {
        let halves = HalfEdges::new(triangles.to_vec(), vertices);
        let Topology { euler, loops, components } = halves.topology();
        (euler, loops, components, halves.cut_edges)
    }

    /// A strip of `squares` squares whose ends are joined, with a half twist or without.
    fn band(squares: u32, is_twisted: bool) -> Vec<[u32; 3]> {
        let twist = u32::from(is_twisted);
        let corner = |column: u32, row: u32| if column < squares { 2 * column + row } else { row ^ twist };
        let square =
            |x| [[corner(x, 0), corner(x + 1, 0), corner(x, 1)], [corner(x, 1), corner(x + 1, 0), corner(x + 1, 1)]];
        (0..squares).flat_map(square).collect()
    }

    #[test]
    fn surfaces_have_the_topology_of_the_textbook() {
        let tetrahedron = [[0, 1, 2], [0, 2, 3], [0, 3, 1], [1, 3, 2]];
        assert_eq!(topology(&tetrahedron, 4), (2, 0, 1, 0));
        assert_eq!(topology(&[[0, 1, 2]], 3), (1, 1, 1, 0));
        // both copies of a triangle are the two sides of a cushion; of three, nothing is joined
        assert_eq!(topology(&[[0, 1, 2]; 2], 3), (2, 0, 1, 0));
        assert_eq!(topology(&[[0, 1, 2]; 3], 3), (3, 3, 3, 3));
        assert_eq!(topology(&band(5, false), 10), (0, 2, 1, 0));
        // the strip that a Möbius strip is made of, cut where it was joined
        assert_eq!(topology(&band(5, true), 10), (1, 1, 1, 1));
        // two triangles that share a vertex
        assert_eq!(topology(&[[0, 1, 2], [0, 3, 4]], 5), (2, 2, 2, 0));
        // tetrahedra that share an edge are two spheres, each with a slit
        let other = tetrahedron.map(|triangle| triangle.map(|corner| if corner < 2 { corner } else { corner + 2 }));
        assert_eq!(topology(&[tetrahedron, other].concat(), 6), (2, 2, 2, 1));
    }

    #[test]
    fn triangles_are_turned_as_most_of_their_component_lie() {
        let mut triangles = vec![[0, 2, 1], [0, 2, 3], [0, 3, 1], [1, 3, 2]];
        let halves = HalfEdges::new(triangles.clone(), 4);
        assert_eq!(halves.turned, [true, false, false, false]);
        triangles[0].swap(1, 2);
        assert_eq!(halves.triangles, triangles);
        for (half, &twin) in (0..).zip(&halves.twins) {
            assert_eq!(halves.twins[twin as usize], half);
            assert_eq!((halves.origin(half), halves.target(half)), (halves.target(twin), halves.origin(twin)));
        }
    }

    #[test]
    fn cells_that_are_disks_have_the_euler_number_1() {
        let ring = HalfEdges::new(band(6, false), 12);
        let euler = |cells: &[u32], count| ring.euler_of_cells(cells, count, &ring.crossing(cells));
        assert_eq!(euler(&[0; 12], 1), [0]);
        assert_eq!(euler(&[0, 0, 0, 1, 1, 1, 1, 1, 1, 1, 1, 1], 2), [1, 1]);
        let sphere = HalfEdges::new(vec![[0, 1, 2], [0, 2, 3], [0, 3, 1], [1, 3, 2]], 4);
        assert_eq!(sphere.euler_of_cells(&[0; 4], 1, &sphere.crossing(&[0; 4])), [2]);
        assert_eq!(sphere.euler_of_cells(&[0, 0, 0, 1], 2, &sphere.crossing(&[0, 0, 0, 1])), [1, 1]);
    }
}
