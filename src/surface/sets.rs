//! Connected sets of faces, found by going through the faces once (the labelling in two passes of Rosenfeld & Pfaltz 1966).
//!
//! A face takes the set of a face beside it, and where those are of several sets, these are noted to be one. Which of the faces
//! beside it have a set already follows no pattern; nothing here branches on it but that two different ones meet, which is rare
//! where faces come in an order that keeps neighbours close.

use crate::union_find::root;

/// Sets, some of which turn out to be the same.
#[derive(Debug, Default)]
pub struct Sets {
    /// For each set an earlier one that it is part of, or itself: few where neighbours come one after the other, a set a face where
    /// none has a neighbour.
    joined: Vec<u32>,
}

/// In place of a set: none, or none yet.
pub const NO_SET: u32 = u32::MAX;

impl Sets {
    /// The set of a face beside faces of these sets: a new one where there is none.
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

    /// Two sets are one.
    pub fn join(&mut self, one: u32, other: u32) {
        let (one, other) = (root(&mut self.joined, one), root(&mut self.joined, other));
        self.joined[one.max(other) as usize] = one.min(other);
    }

    /// For each set the number of the whole that it is part of, in the order of their first faces; and how many wholes there are.
    pub fn numbered(self) -> (Vec<u32>, usize) {
        let mut numbers = self.joined;
        let mut count = 0;
        for set in 0..numbers.len() {
            // the one that it is part of is never a later one, so that it already has its number
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
