//! Coarser graphs, whose faces are connected groups of faces, for clusterings that go from coarse to fine.
//!
//! In internal order, every face that is in no group yet forms one with its neighbours that are in none; then groups of
//! one face join the smallest neighbouring group. On triangles a group has 2.6 faces on average.
//!
//! Which neighbours are free follows no pattern: the loops that form and number groups compute both outcomes and select
//! one (`benches/results/2026-11-22-two-cores/deleted.md`).

use std::hint::select_unpredictable;

use super::components::Component;
use super::graph::DualGraph;
use super::rows::Rows;
use crate::energy::{Functional, Sums};
use crate::parallel;

/// No group yet.
const NONE: u32 = u32::MAX;
/// Groups of a chunk.
const RUN: usize = 4096;

/// Faces that form a group, at most; single faces may join it later.
const MOST_FACES: usize = 4;

/// A coarser graph and where its faces lie.
#[derive(Debug)]
pub struct Coarse<E: Functional> {
    /// Each face of it is a group.
    pub graph: DualGraph<E>,
    /// The group that each face of the finer graph is in.
    pub group_of_face: Vec<u32>,
}

impl<E: Functional> Coarse<E> {
    /// Labels of the finer graph from labels of this one.
    pub fn refined(&self, labels: &[u32]) -> Vec<u32> {
        self.group_of_face.iter().map(|&group| labels[group as usize]).collect()
    }
}

/// Groups of faces, numbered in the order of their first faces.
#[derive(Debug)]
pub struct Grouping {
    group_of_face: Vec<u32>,
    /// First group of each component, and one past the last.
    offsets: Vec<u32>,
}

impl Grouping {
    /// Number of groups.
    pub fn groups(&self) -> u32 {
        self.offsets.last().copied().unwrap_or(0)
    }

    /// Groups of each component.
    pub fn groups_of_components(&self) -> impl Iterator<Item = u32> + '_ {
        self.offsets.windows(2).map(|ends| ends[1] - ends[0])
    }
}

impl<E: Functional> DualGraph<E> {
    /// A lower bound of the number of groups that [`grouped`](Self::grouped) makes.
    pub fn least_groups(&self, heaviest: &[u64]) -> u64 {
        let of_component = |(component, &heaviest): (&Component, &u64)| match heaviest {
            0 => u64::from(component.faces),
            // a face that is heavier is a group of its own
            _ => {
                let weights = self.weights[component.range()].iter();
                weights.map(|&weight| u64::from(weight).min(heaviest)).sum::<u64>().div_ceil(heaviest)
            }
        };
        self.components.iter().zip(heaviest).map(of_component).sum()
    }

    /// Groups neighbouring faces; `heaviest[c]` is the most that a group of component c may weigh, if it is not a
    /// single face. Groups are connected.
    pub fn grouped(&self, heaviest: &[u64]) -> Grouping {
        let mut groups = Groups { group_of_face: vec![NONE; self.faces()], faces: Vec::new(), weights: Vec::new() };
        for (component, &heaviest) in self.components.iter().zip(heaviest) {
            // no face weighs more, either
            let heaviest = heaviest.min(1 << 31);
            groups.form(self, component, heaviest);
            groups.merge_single_faces(self, component, heaviest);
        }
        self.grouping(groups.group_of_face, groups.faces.len())
    }

    /// Connected groups, fewer than a number and each inside of a component, which are numbered anew.
    pub fn grouping(&self, mut group_of_face: Vec<u32>, groups: usize) -> Grouping {
        number_by_first_face(&mut group_of_face, groups);
        // a component's faces follow those of the ones before it, and so do its groups
        let mut offsets = vec![0];
        let mut end = 0;
        for component in &self.components {
            end = group_of_face[component.range()].iter().fold(end, |end, &group| end.max(group + 1));
            offsets.push(end);
        }
        Grouping { group_of_face, offsets }
    }

    /// The graph whose faces are the groups.
    pub fn contracted(&self, grouping: Grouping) -> Coarse<E> {
        let groups = grouping.groups() as usize;
        let Grouping { group_of_face, offsets } = grouping;
        let faces = Rows::grouped(&group_of_face, groups);
        let runs: Vec<Run<E>> = parallel::pieces(groups, RUN, &|groups| {
            Run::of(self, &group_of_face, groups.map(|group| (group as u32, faces.of(group as u32))))
        });

        let components = self.components.iter().zip(offsets.windows(2)).map(|(component, ends)| Component {
            first_face: ends[0],
            faces: ends[1] - ends[0],
            ..*component
        });
        let components = components.collect();
        let (mut points, mut weights) = (Vec::with_capacity(groups), Vec::with_capacity(groups));
        let mut pieces = Vec::with_capacity(runs.len());
        for run in runs {
            points.extend(run.points);
            weights.extend(run.weights);
            pieces.push(run.rows);
        }
        let graph = Self { points, weights, neighbours: Rows::joined(pieces), components, moves: self.moves };
        Coarse { graph, group_of_face }
    }
}

/// Some groups, one after the other, as faces of a graph.
struct Run<E: Functional> {
    points: Vec<E::Point>,
    weights: Vec<u32>,
    /// Ascending for each group, without the end of the last.
    rows: Rows,
}

impl<E: Functional> Run<E> {
    fn of<'a>(
        graph: &DualGraph<E>,
        group_of_face: &[u32],
        groups: impl ExactSizeIterator<Item = (u32, &'a [u32])>,
    ) -> Self {
        let mut run = Self {
            points: Vec::with_capacity(groups.len()),
            weights: Vec::with_capacity(groups.len()),
            rows: Rows { offsets: Vec::with_capacity(groups.len()), items: Vec::with_capacity(6 * groups.len()) },
        };
        let mut others = Vec::new();
        for (group, faces) in groups {
            let mut sums = E::Sums::default();
            for &face in faces {
                sums.add_face(graph.face(face as usize), 1);
                others.extend(graph.neighbours_of(face).iter().map(|&near| group_of_face[near as usize]));
            }
            others.sort_unstable();
            others.dedup();
            run.rows.offsets.push(run.rows.items.len() as u32);
            run.rows.items.extend(others.drain(..).filter(|&other| other != group));
            // a group, which has faces, lies where its proxy would
            run.points.extend(sums.proxy());
            run.weights.push(sums.weight() as u32);
        }
        run
    }
}

/// Groups that are being formed.
struct Groups {
    group_of_face: Vec<u32>,
    faces: Vec<u32>,
    weights: Vec<u64>,
}

impl Groups {
    /// Puts every face of a component into a group.
    fn form<E: Functional>(&mut self, graph: &DualGraph<E>, component: &Component, heaviest: u64) {
        for face in component.range() {
            if self.group_of_face[face] != NONE {
                continue;
            }
            let group = self.faces.len() as u32;
            self.group_of_face[face] = group;
            let mut faces = 1;
            let mut weight = u64::from(graph.weights[face]);
            for &near in graph.neighbours_of(face as u32) {
                if faces == MOST_FACES {
                    break;
                }
                let near_weight = u64::from(graph.weights[near as usize]);
                let of_near = &mut self.group_of_face[near as usize];
                let joins = (*of_near == NONE) & (weight + near_weight <= heaviest);
                *of_near = select_unpredictable(joins, group, *of_near);
                faces += usize::from(joins);
                weight += select_unpredictable(joins, near_weight, 0);
            }
            self.faces.push(faces as u32);
            self.weights.push(weight);
        }
    }

    /// Groups of one face join the neighbouring group with the fewest faces, the smaller number of equal ones.
    fn merge_single_faces<E: Functional>(&mut self, graph: &DualGraph<E>, component: &Component, heaviest: u64) {
        for face in component.range() {
            let single = self.group_of_face[face] as usize;
            if self.faces[single] != 1 {
                continue;
            }
            let groups =
                graph.neighbours_of(face as u32).iter().map(|&near| self.group_of_face[near as usize] as usize);
            let has_room = |group: &usize| *group != single && self.weights[*group] + self.weights[single] <= heaviest;
            if let Some(group) = groups.filter(has_room).min_by_key(|&group| (self.faces[group], group)) {
                self.group_of_face[face] = group as u32;
                self.faces[group] += 1;
                self.weights[group] += self.weights[single];
                self.faces[single] = 0;
            }
        }
    }
}

/// Numbers groups, given by numbers below `groups`, in the order of their first faces.
pub fn number_by_first_face(group_of_face: &mut [u32], groups: usize) {
    let mut number_of_group = vec![NONE; groups];
    let mut groups = 0;
    for group in group_of_face {
        let number = &mut number_of_group[*group as usize];
        let is_first = *number == NONE;
        *number = select_unpredictable(is_first, groups, *number);
        groups += u32::from(is_first);
        *group = *number;
    }
}

#[cfg(test)]
mod tests {
    use super::Coarse;
    use crate::dev::sample::Sample;
    use crate::energy::Energy;
    use crate::surface::DualGraph;
    use crate::surface::tests::of_sample;

    /// Two groups are neighbours exactly if faces of them are; the neighbours of each come in order, each once.
    fn assert_neighbours_are_those_of_the_faces(graph: &DualGraph, coarse: &Coarse<Energy>) {
        let mut expected: Vec<(u32, u32)> = (0..graph.faces() as u32)
            .flat_map(|face| graph.neighbours_of(face).iter().map(move |&near| (face, near)))
            .map(|(a, b)| (coarse.group_of_face[a as usize], coarse.group_of_face[b as usize]))
            .filter(|(a, b)| a != b)
            .collect();
        expected.sort_unstable();
        expected.dedup();
        let found: Vec<(u32, u32)> = (0..coarse.graph.faces() as u32)
            .flat_map(|group| coarse.graph.neighbours_of(group).iter().map(move |&near| (group, near)))
            .collect();
        assert_eq!(found, expected);
    }

    #[test]
    fn groups_are_connected_light_and_keep_what_adds_up() {
        for (sample, faces) in [(Sample::Sphere, 2000), (Sample::Plane, 900), (Sample::Parts, 500)] {
            let surface = of_sample(sample, faces);
            let heaviest: Vec<u64> = surface.components.iter().map(|component| component.weight / 12).collect();
            let coarse = surface.contracted(surface.grouped(&heaviest));
            let component_of_face = surface.component_of_face();
            let component_of_group = coarse.graph.component_of_face();
            let mut weights = vec![0u64; coarse.graph.faces()];
            let mut sizes = vec![0u32; coarse.graph.faces()];
            for face in 0..surface.faces() {
                let group = coarse.group_of_face[face] as usize;
                assert_eq!(component_of_group[group], component_of_face[face], "{sample:?}");
                weights[group] += u64::from(surface.weights[face]);
                sizes[group] += 1;
            }
            for (group, &weight) in weights.iter().enumerate() {
                assert_eq!(weight, u64::from(coarse.graph.weights[group]), "{sample:?}");
                assert!(weight <= heaviest[component_of_group[group] as usize] || sizes[group] == 1, "{sample:?}");
            }
            assert_eq!(crate::device::pieces::disconnected_clusters(&surface, weights.len(), &coarse.group_of_face), 0);
            assert_neighbours_are_those_of_the_faces(&surface, &coarse);
            // groups of groups have more neighbours
            let heavier: Vec<u64> = heaviest.iter().map(|heaviest| 4 * heaviest).collect();
            let coarser = coarse.graph.contracted(coarse.graph.grouped(&heavier));
            assert_neighbours_are_those_of_the_faces(&coarse.graph, &coarser);
            assert!(coarse.graph.faces() * 3 <= surface.faces() * 2, "{sample:?}");
            let least = surface.least_groups(&heaviest);
            assert!(least >= 12 && least <= coarse.graph.faces() as u64, "{sample:?}: {least}");
        }
    }

    #[test]
    fn nothing_is_grouped_that_would_be_too_heavy() {
        let surface = of_sample(Sample::Sphere, 300);
        let coarse = surface.contracted(surface.grouped(&[1]));
        assert_eq!(coarse.group_of_face, (0..surface.faces() as u32).collect::<Vec<_>>());
        assert_eq!(coarse.graph.points, surface.points);
    }
}
