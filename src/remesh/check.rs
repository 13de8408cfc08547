//! What is checked of every remesh before it is given out.

use crate::complex::half_edges::{HalfEdges, Topology};
use crate::error::{Error, Result};

/// Checks that triangles are a manifold with the topology `expected`, oriented alike and none there twice: every edge
/// has one triangle or two that run along it in opposite directions, and the triangles around a vertex are one
/// umbrella.
pub fn check(triangles: &[[u32; 3]], vertices: usize, expected: Topology) -> Result<()> {
    let wrong = |what: &str| Err(Error::internal(format_args!("a remesh that is not sound: {what}")));
    let mut corners: Vec<[u32; 3]> = triangles.to_vec();
    corners.iter_mut().for_each(|triangle| triangle.sort_unstable());
    if corners.iter().any(|[a, b, c]| a == b || b == c) {
        return wrong("a triangle with two equal corners");
    }
    corners.sort_unstable();
    if corners.windows(2).any(|pair| pair[0] == pair[1]) {
        return wrong("a triangle that is there twice");
    }
    let mut is_used = vec![false; vertices];
    triangles.as_flattened().iter().for_each(|&corner| is_used[corner as usize] = true);
    let used = is_used.into_iter().filter(|is_used| *is_used).count();
    let made = HalfEdges::new(triangles.to_vec(), vertices);
    if made.cut_edges > 0 {
        return wrong("an edge of more than two triangles");
    }
    if made.turned.contains(&true) {
        return wrong("triangles that are not oriented alike");
    }
    if made.umbrellas.len() != used {
        return wrong("a vertex of several umbrellas");
    }
    if made.topology() != expected {
        return wrong("another number of components or boundary circles, or another Euler number");
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_violation_is_found() {
        let sphere = Topology { euler: 2, loops: 0, components: 1 };
        let disk = Topology { euler: 1, loops: 1, components: 1 };
        let two = Topology { euler: 2, loops: 2, components: 2 };
        let tetrahedron: &[[u32; 3]] = &[[0, 1, 2], [0, 2, 3], [0, 3, 1], [1, 3, 2]];
        assert_eq!(check(tetrahedron, 4, sphere), Ok(()));
        for (triangles, expected, word) in [
            (tetrahedron, disk, "another number"),
            (&[[0, 1, 1]], disk, "equal corners"),
            (&[[0, 1, 2], [2, 1, 0]], sphere, "twice"),
            (&[[0, 1, 2], [1, 0, 3], [0, 1, 4]], disk, "more than two"),
            (&[[0, 1, 2], [0, 1, 3], [0, 3, 4]], disk, "oriented"),
            (&[[0, 1, 2], [0, 3, 4]], two, "umbrellas"),
        ] {
            let error = check(triangles, 5, expected).expect_err(word);
            assert!(error.message.contains(word), "{error}");
        }
    }
}
