//! Which faces a pass of settling looks at.

use super::clusters::Clusters;
use crate::energy::Functional;

/// The boundary faces of clusters and those beside them, kept from pass to pass: most clusters of a pass change in the
/// next one, too, and few of their faces are boundary faces. It belongs to one [`Clusters`], of which it must
/// [follow](Self::follow) all moves.
#[derive(Debug, Default)]
pub struct Borders {
    /// Whether all boundary faces of a cluster, and those beside them, are in `faces` or `moved`.
    is_listed: Vec<bool>,
    /// Ascending; some may be boundary faces no longer.
    faces: Vec<u32>,
    /// Faces that moved since they were last added to `faces`, and those beside them.
    moved: Vec<u32>,
}

impl Borders {
    /// The boundary faces of some clusters, and the faces beside them in others, ascending.
    pub fn around<E: Functional>(&mut self, clusters: &Clusters<'_, E>, changed: &[u32]) -> Vec<u32> {
        if clusters.faces_of(changed) + self.moved.len() <= self.faces.len() {
            return along_lists(clusters, changed);
        }
        self.is_listed.resize(clusters.numbers().len(), false);
        let new: Vec<u32> = changed.iter().copied().filter(|&cluster| !self.is_listed[cluster as usize]).collect();
        new.iter().for_each(|&cluster| self.is_listed[cluster as usize] = true);
        let faces = clusters.labels().len();
        if clusters.faces_of(&new) > faces / 4 * 3 {
            self.faces = (0..faces as u32).collect();
            self.moved.clear();
        } else {
            self.faces.append(&mut self.moved);
            self.faces.extend(along_lists(clusters, &new));
            self.faces.sort();
            self.faces.dedup();
        }
        let mut is_changed = vec![false; clusters.numbers().len()];
        changed.iter().for_each(|&cluster| is_changed[cluster as usize] = true);
        let mut due = Vec::new();
        self.faces.retain(|&face| {
            let own = clusters.label(face);
            let labels = clusters.graph.neighbours_of(face).iter().map(|&near| clusters.label(near));
            let mut others = labels.filter(|&label| label != own).peekable();
            let is_boundary = others.peek().is_some();
            if is_boundary && (is_changed[own as usize] || others.any(|label| is_changed[label as usize])) {
                due.push(face);
            }
            is_boundary
        });
        due
    }

    /// Notes that a face has moved.
    pub fn follow<E: Functional>(&mut self, clusters: &Clusters<'_, E>, face: u32) {
        self.moved.push(face);
        self.moved.extend(clusters.graph.neighbours_of(face));
    }
}

/// The same, from the faces of the clusters.
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
    fn by_definition(clusters: &Clusters<'_, Energy>, changed: &[u32]) -> Vec<u32> {
        let is_due = |&face: &u32| {
            let own = clusters.label(face);
            let mut beside = clusters.graph.neighbours_of(face).iter().map(|&near| clusters.label(near));
            beside.any(|near| near != own && (changed.contains(&own) || changed.contains(&near)))
        };
        (0..clusters.labels().len() as u32).filter(is_due).collect()
    }

    /// In how many of some passes, after which faces move, the kept faces are those of the definition, and in how many
    /// they come from the faces of the clusters.
    fn passes_that_agree(follows: bool) -> (usize, usize) {
        let surface = of_sample(Sample::Parts, 3000);
        let faces = surface.faces() as u32;
        let mut clusters = Clusters::new(&surface, (0..faces).map(|face| face / 100).collect());
        let mut borders = Borders::default();
        let (mut agree, mut from_faces) = (0, 0);
        for step in STEPS {
            let changed: Vec<u32> = clusters.numbers().skip(step % 3).step_by(step).collect();
            from_faces += usize::from(clusters.faces_of(&changed) + borders.moved.len() <= borders.faces.len());
            let due = by_definition(&clusters, &changed);
            agree += usize::from(borders.around(&clusters, &changed) == due);
            assert_eq!(along_lists(&clusters, &changed), due);
            for face in due.into_iter().step_by(3) {
                let own = clusters.label(face);
                let beside = surface.neighbours_of(face).iter().map(|&near| clusters.label(near));
                if let Some(to) = beside.rev().find(|&to| to != own) {
                    clusters.relabel(std::iter::once((face, to)));
                    if follows {
                        borders.follow(&clusters, face);
                    }
                }
            }
        }
        (agree, from_faces)
    }

    /// A pass is over one in so many clusters.
    const STEPS: [usize; 12] = [9, 13, 2, 1, 3, 1, 5, 11, 17, 29, 7, 1];

    #[test]
    fn kept_faces_are_those_of_the_definition_as_faces_move() {
        let (agree, from_faces) = passes_that_agree(true);
        assert_eq!(agree, STEPS.len());
        assert!((1..STEPS.len()).contains(&from_faces), "{from_faces}");
        assert!(passes_that_agree(false).0 < STEPS.len(), "moves that are not followed are missed");
    }
}
