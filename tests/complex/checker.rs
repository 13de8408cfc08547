//! Topology by maps of edges and sets of corners, without half-edges and walks.

use std::collections::{BTreeMap, BTreeSet};

use tesserae_mesh::mesh::PolygonMesh;

/// What triangles are after cutting edges that do not have exactly two triangles in opposite directions.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Found {
    pub euler: i64,
    pub loops: usize,
    pub components: usize,
    /// What keeps them from being an oriented manifold, in words.
    pub faults: BTreeSet<&'static str>,
}

/// Sets of numbers that can be joined.
struct Sets(Vec<usize>);

impl Sets {
    fn new(count: usize) -> Self {
        Self((0..count).collect())
    }

    fn of(&self, mut one: usize) -> usize {
        while self.0[one] != one {
            one = self.0[one];
        }
        one
    }

    fn join(&mut self, one: usize, other: usize) {
        let (one, other) = (self.of(one), self.of(other));
        self.0[one.max(other)] = one.min(other);
    }

    fn count(&self, members: impl Iterator<Item = usize>) -> usize {
        members.map(|member| self.of(member)).collect::<BTreeSet<_>>().len()
    }
}

/// For the two ends of an edge, the triangles that have it, the side, and whether it runs upwards there.
type Sides = BTreeMap<(u32, u32), Vec<(usize, usize, bool)>>;

fn sides(triangles: &[[u32; 3]]) -> Sides {
    let mut sides: BTreeMap<_, Vec<_>> = BTreeMap::new();
    for (number, triangle) in triangles.iter().enumerate() {
        for side in 0..3 {
            let (from, to) = (triangle[side], triangle[(side + 1) % 3]);
            sides.entry((from.min(to), from.max(to))).or_default().push((number, side, from < to));
        }
    }
    sides
}

/// Topology and faults of triangles.
pub fn look(triangles: &[[u32; 3]]) -> Found {
    let mut faults = BTreeSet::new();
    let mut corners = Sets::new(3 * triangles.len());
    let mut components = Sets::new(triangles.len());
    let mut edges = 0;
    let mut boundary = Vec::new();
    for sides in sides(triangles).values() {
        match sides[..] {
            [(one, of_one, up), (other, of_other, down)] if up != down => {
                edges += 1;
                components.join(one, other);
                corners.join(3 * one + of_one, 3 * other + (of_other + 1) % 3);
                corners.join(3 * one + (of_one + 1) % 3, 3 * other + of_other);
            }
            _ => {
                edges += sides.len();
                boundary.extend(sides.iter().map(|&(triangle, side, _)| 3 * triangle + side));
                match sides.len() {
                    1 => {}
                    2 => drop(faults.insert("two triangles run along an edge in one direction")),
                    _ => drop(faults.insert("an edge has more than two triangles")),
                }
            }
        }
    }
    let mut sorted: Vec<[u32; 3]> = triangles.to_vec();
    sorted.iter_mut().for_each(|triangle| triangle.sort_unstable());
    let distinct: BTreeSet<[u32; 3]> = sorted.iter().copied().collect();
    if distinct.len() < sorted.len() {
        faults.insert("a triangle is there twice");
    }
    if sorted.iter().any(|triangle| triangle[0] == triangle[1] || triangle[1] == triangle[2]) {
        faults.insert("a triangle has equal corners");
    }
    let umbrellas = corners.count(0..3 * triangles.len());
    let vertices: BTreeSet<u32> = triangles.iter().flatten().copied().collect();
    if umbrellas > vertices.len() {
        faults.insert("a vertex has several umbrellas");
    }
    let mut loops = Sets::new(3 * triangles.len());
    let mut at_umbrella: BTreeMap<usize, usize> = BTreeMap::new();
    for &half in &boundary {
        for end in [half, half / 3 * 3 + (half + 1) % 3] {
            let first = *at_umbrella.entry(corners.of(end)).or_insert(half);
            loops.join(first, half);
        }
    }
    Found {
        euler: umbrellas as i64 - edges as i64 + triangles.len() as i64,
        loops: loops.count(boundary.iter().copied()),
        components: components.count(0..triangles.len()),
        faults,
    }
}

/// The triangles of a mesh: welded, in fans, without those of two equal corners, and the face of each.
pub fn welded(mesh: &PolygonMesh) -> (Vec<[u32; 3]>, Vec<usize>) {
    let mut numbers = BTreeMap::new();
    let mut number = |vertex: u32| {
        let key = mesh.positions[vertex as usize].map(|x| (x + 0.0).to_bits());
        let next = numbers.len() as u32;
        *numbers.entry(key).or_insert(next)
    };
    let (mut triangles, mut faces) = (Vec::new(), Vec::new());
    for face in 0..mesh.faces.len() {
        let corners: Vec<u32> = mesh.faces.corners(face).iter().map(|&vertex| number(vertex)).collect();
        for second in 1..corners.len().saturating_sub(1) {
            let triangle = [corners[0], corners[second], corners[second + 1]];
            if triangle[0] != triangle[1] && triangle[1] != triangle[2] && triangle[2] != triangle[0] {
                triangles.push(triangle);
                faces.push(face);
            }
        }
    }
    (triangles, faces)
}

/// Triangles turned so that edges of two have them in opposite directions; none if that is impossible.
pub fn oriented(mut triangles: Vec<[u32; 3]>) -> Option<Vec<[u32; 3]>> {
    // triangle t as it is, and turned
    let mut sets = Sets::new(2 * triangles.len());
    for sides in sides(&triangles).values() {
        if let [(one, _, up), (other, _, also)] = sides[..] {
            let differ = usize::from(up == also);
            sets.join(2 * one, 2 * other + differ);
            sets.join(2 * one + 1, 2 * other + 1 - differ);
        }
    }
    for (number, triangle) in triangles.iter_mut().enumerate() {
        let (straight, turned) = (sets.of(2 * number), sets.of(2 * number + 1));
        if straight == turned {
            return None;
        }
        if turned < straight {
            triangle.swap(1, 2);
        }
    }
    Some(triangles)
}

#[test]
fn the_checker_finds_what_is_wrong() {
    let sphere = vec![[0, 1, 2], [0, 2, 3], [0, 3, 1], [1, 3, 2]];
    let good = look(&sphere);
    assert_eq!(good, Found { euler: 2, loops: 0, components: 1, faults: BTreeSet::new() });
    let holed = look(&sphere[1..]);
    assert_eq!((holed.euler, holed.loops, holed.faults.len()), (1, 1, 0));
    let with = |change: &dyn Fn(&mut Vec<[u32; 3]>)| {
        let mut triangles = sphere.clone();
        change(&mut triangles);
        look(&triangles).faults
    };
    assert!(with(&|all| all[0].swap(0, 1)).contains("two triangles run along an edge in one direction"));
    assert!(with(&|all| all.push([0, 1, 4])).contains("an edge has more than two triangles"));
    assert!(with(&|all| all.push([2, 0, 1])).contains("a triangle is there twice"));
    assert!(with(&|all| all.push([0, 4, 5])).contains("a vertex has several umbrellas"));
    assert!(with(&|all| all.push([4, 5, 5])).contains("a triangle has equal corners"));
    assert!(oriented(sphere).is_some());
    let twisted = vec![[0, 2, 1], [1, 2, 3], [2, 4, 3], [3, 4, 5], [4, 1, 5], [5, 1, 0]];
    assert_eq!(oriented(twisted), None);
}
