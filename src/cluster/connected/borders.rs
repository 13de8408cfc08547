//! Faces at the borders of clusters.

use super::clusters::Clusters;
use crate::energy::Functional;

/// The faces at borders, kept from pass to pass: most clusters of a pass change in the next one, too, and few of their
/// faces lie at a border.
#[derive(Debug, Default)]
pub struct Borders {
    /// Whether all faces on both sides of a cluster's border are listed.
    is_listed: Vec<bool>,
    /// Ascending; some may have come to lie at no border.
    faces: Vec<u32>,
    /// Those that moved since, and the faces beside them.
    moved: Vec<u32>,
}

impl Borders {
    /// The faces on both sides of the borders of some clusters, ascending.
    pub fn of<E: Functional>(&mut self, clusters: &Clusters<'_, E>, of: &[u32]) -> Vec<u32> {
        if clusters.faces_of(of) + self.moved.len() <= self.faces.len() {
            return along_lists(clusters, of);
        }
        self.is_listed.resize(clusters.numbers().len(), false);
        let new: Vec<u32> = of.iter().copied().filter(|&cluster| !self.is_listed[cluster as usize]).collect();
        new.iter().for_each(|&cluster| self.is_listed[cluster as usize] = true);
        self.faces.append(&mut self.moved);
        self.faces.extend(along_lists(clusters, &new));
        // sorted runs are merged
        self.faces.sort();
        self.faces.dedup();
        let mut is_of = vec![false; clusters.numbers().len()];
        of.iter().for_each(|&cluster| is_of[cluster as usize] = true);
        let mut due = Vec::with_capacity(self.faces.len());
        self.faces.retain(|&face| {
            let own = clusters.label(face);
            let labels = clusters.graph.neighbours_of(face).iter().map(|&near| clusters.label(near));
            let mut others = labels.filter(|&label| label != own).peekable();
            let is_at_border = others.peek().is_some();
            if is_at_border && (is_of[own as usize] || others.any(|label| is_of[label as usize])) {
                due.push(face);
            }
            is_at_border
        });
        due
    }

    /// Follows the move of a face.
    pub fn follow<E: Functional>(&mut self, clusters: &Clusters<'_, E>, face: u32) {
        self.moved.push(face);
        self.moved.extend(clusters.graph.neighbours_of(face));
    }
}

/// The same, by the faces of the clusters.
fn along_lists<E: Functional>(clusters: &Clusters<'_, E>, of: &[u32]) -> Vec<u32> {
    let mut faces = Vec::new();
    for &cluster in of {
        for &face in clusters.faces(cluster) {
            let before = faces.len();
            let beside = clusters.graph.neighbours_of(face).iter();
            faces.extend(beside.filter(|&&near| clusters.label(near) != cluster));
            if faces.len() > before {
                faces.push(face);
            }
        }
    }
    faces.sort_unstable();
    faces.dedup();
    faces
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::dev::sample::Sample;
    use crate::energy::Energy;
    use crate::surface::tests::of_sample;

    /// As their definition reads.
    fn at_borders(clusters: &Clusters<'_, Energy>, of: &[u32]) -> Vec<u32> {
        let is_due = |&face: &u32| {
            let own = clusters.label(face);
            let mut beside = clusters.graph.neighbours_of(face).iter().map(|&near| clusters.label(near));
            beside.any(|near| near != own && (of.contains(&own) || of.contains(&near)))
        };
        (0..clusters.labels().len() as u32).filter(is_due).collect()
    }

    #[test]
    fn faces_at_borders_are_those_of_the_definition_as_faces_move() {
        let surface = of_sample(Sample::Parts, 3000);
        let faces = surface.faces() as u32;
        let mut clusters = Clusters::new(&surface, (0..faces).map(|face| face / 100).collect());
        let mut borders = Borders::default();
        let numbers = clusters.numbers();
        let mut by_lists = 0;
        // few clusters, many, and few again: those are found by their lists
        for step in [9, 13, 2, 1, 3, 1, 5, 11, 17, 29, 7, 1] {
            let of: Vec<u32> = numbers.clone().skip(step % 3).step_by(step).collect();
            by_lists += usize::from(clusters.faces_of(&of) + borders.moved.len() <= borders.faces.len());
            let at_borders = at_borders(&clusters, &of);
            assert_eq!(borders.of(&clusters, &of), at_borders, "every {step}th cluster");
            assert_eq!(along_lists(&clusters, &of), at_borders);
            let mut moves = 0;
            for face in at_borders.into_iter().step_by(3) {
                let own = clusters.label(face);
                let beside = surface.neighbours_of(face).iter().map(|&near| clusters.label(near));
                if let Some(to) = beside.filter(|&to| to != own).last() {
                    clusters.relabel(std::iter::once((face, to)));
                    borders.follow(&clusters, face);
                    moves += 1;
                }
            }
            assert!(moves > 0, "nothing to test");
        }
        assert!((1..12).contains(&by_lists), "{by_lists} by lists");
    }
}
