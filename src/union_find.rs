//! Union-find: a forest of parents, in which a root is its own parent.

/// The root of a member's tree; halves the path on the way.
pub(crate) fn root(parent: &mut [u32], mut member: u32) -> u32 {
    loop {
        let up = parent[member as usize];
        if up == member {
            return member;
        }
        let above = parent[up as usize];
        parent[member as usize] = above;
        member = above;
    }
}

/// Joins the trees of two members: the smaller root becomes the parent of the larger. Returns whether they were two
/// trees.
pub(crate) fn join(parent: &mut [u32], one: u32, other: u32) -> bool {
    let (one, other) = (root(parent, one), root(parent, other));
    parent[one.max(other) as usize] = one.min(other);
    one != other
}

/// Connected sets of faces, found in one pass over the faces (the two-pass labelling of Rosenfeld & Pfaltz 1966).
///
/// A face takes the set of one neighbour; where its neighbours are in several sets, these are joined.
/// [`numbered`](Self::numbered) is the second pass. There are few sets where the order of faces keeps neighbours close,
/// at most one a face.
#[derive(Debug, Default)]
pub(crate) struct Sets {
    /// For each set an earlier one that it is part of, or itself.
    joined: Vec<u32>,
}

/// No set, or none yet.
pub(crate) const NO_SET: u32 = u32::MAX;

impl Sets {
    /// The set of a face whose neighbours are in these sets, some of which may be [`NO_SET`]; a new set if all are.
    #[inline]
    pub fn of_face(&mut self, beside: impl Iterator<Item = u32>) -> u32 {
        let mut set = NO_SET;
        for other in beside {
            let (low, high) = (set.min(other), set.max(other));
            if (high != NO_SET) & (low != high) {
                self.join(low, high);
            }
            set = low;
        }
        if set == NO_SET {
            set = self.joined.len() as u32;
            self.joined.push(set);
        }
        set
    }

    /// Makes two sets one.
    pub fn join(&mut self, one: u32, other: u32) {
        join(&mut self.joined, one, other);
    }

    /// The number of the connected set that each set is part of, in the order of their first faces; and how many there
    /// are.
    pub fn numbered(self) -> (Vec<u32>, usize) {
        let mut numbers = self.joined;
        let mut count = 0;
        for set in 0..numbers.len() {
            // a set is part of an earlier one, which already has its number
            let of = numbers[set] as usize;
            numbers[set] = if of == set {
                count += 1;
                count - 1
            } else {
                numbers[of]
            };
        }
        (numbers, count as usize)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn sets_are_those_that_a_walk_finds_in_the_order_of_their_first_faces() {
        let mut state = 1u64;
        for (faces, edges) in [(1, 0), (40, 15), (300, 250), (300, 600), (2000, 1900)] {
            let mut random = || {
                state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
                (state >> 33) as usize % faces
            };
            let mut beside = vec![Vec::new(); faces];
            for (a, b) in (0..edges).map(|_| (random(), random())) {
                beside[a].push(b);
                beside[b].push(a);
            }
            let mut sets = Sets::default();
            let mut of_face = vec![NO_SET; faces];
            for face in 0..faces {
                of_face[face] = sets.of_face(beside[face].iter().map(|&other| of_face[other]));
            }
            let (numbers, count) = sets.numbered();
            let mut expected = vec![NO_SET; faces];
            let mut walks = 0;
            for start in 0..faces {
                if expected[start] != NO_SET {
                    continue;
                }
                let mut stack = vec![start];
                while let Some(face) = stack.pop() {
                    if std::mem::replace(&mut expected[face], walks) == NO_SET {
                        stack.extend(&beside[face]);
                    }
                }
                walks += 1;
            }
            let found: Vec<u32> = of_face.iter().map(|&set| numbers[set as usize]).collect();
            assert_eq!((found, count), (expected, walks as usize));
        }
    }
}
