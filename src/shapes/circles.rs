//! The faces of clusters as circles: clusters unite, and faces change their clusters, in constant time.

/// The faces of each cluster, in a circle. At first each face is a cluster with its number.
#[derive(Debug)]
pub(super) struct Circles {
    /// The face after each one.
    next: Vec<u32>,
    /// The face before each one.
    previous: Vec<u32>,
    /// A face of each cluster.
    first: Vec<u32>,
}

impl Circles {
    pub fn new(faces: usize) -> Self {
        let numbers: Vec<u32> = (0..faces as u32).collect();
        Self { next: numbers.clone(), previous: numbers.clone(), first: numbers }
    }

    /// The faces of a cluster.
    pub fn of(&self, cluster: u32) -> impl Iterator<Item = u32> + Clone {
        let first = self.first[cluster as usize];
        let after = move |&face: &u32| Some(self.next[face as usize]).filter(|&next| next != first);
        std::iter::successors(Some(first), after)
    }

    /// Makes some faces, which belong to no cluster that is still used, a cluster.
    pub fn set(&mut self, cluster: u32, faces: &[u32]) {
        self.first[cluster as usize] = faces[0];
        for (at, &face) in faces.iter().enumerate() {
            self.link(face, faces[(at + 1) % faces.len()]);
        }
    }

    /// Makes one of two clusters; both numbers stand for it.
    pub fn unite(&mut self, a: u32, b: u32) {
        let [a, b] = [a, b].map(|cluster| self.first[cluster as usize]);
        let [after_a, after_b] = [a, b].map(|face| self.next[face as usize]);
        self.link(a, after_b);
        self.link(b, after_a);
    }

    /// Moves a face to another cluster; its own must have another face.
    pub fn give(&mut self, face: u32, from: u32, to: u32) {
        let (before, after) = (self.previous[face as usize], self.next[face as usize]);
        self.link(before, after);
        if self.first[from as usize] == face {
            self.first[from as usize] = after;
        }
        let first = self.first[to as usize];
        let second = self.next[first as usize];
        self.link(first, face);
        self.link(face, second);
    }

    fn link(&mut self, face: u32, next: u32) {
        self.next[face as usize] = next;
        self.previous[next as usize] = face;
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn clusters_unite_and_faces_change_theirs() {
        let mut circles = Circles::new(6);
        let of = |circles: &Circles, cluster| {
            let mut faces: Vec<u32> = circles.of(cluster).collect();
            faces.sort_unstable();
            faces
        };
        circles.unite(0, 1);
        circles.unite(3, 4);
        circles.unite(0, 2);
        assert_eq!((of(&circles, 0), of(&circles, 3)), (vec![0, 1, 2], vec![3, 4]));
        // the first face leaves, too
        circles.give(0, 0, 3);
        circles.give(4, 3, 5);
        assert_eq!((of(&circles, 0), of(&circles, 3), of(&circles, 5)), (vec![1, 2], vec![0, 3], vec![4, 5]));
        circles.set(5, &[5, 1]);
        circles.set(4, &[4]);
        assert_eq!((of(&circles, 5), of(&circles, 4)), (vec![1, 5], vec![4]));
    }
}
