//! The labels of chosen iterations, kept as a run passes them (the paper's Figures 1 and 5).
//!
//! Only the first labels are kept whole; of every later snapshot, the faces whose labels differ from those of the one
//! before. So memory is in proportion to the faces that moved.

use super::numbers;
use crate::surface::Loose;

/// Labels that are kept at most, counted as if each snapshot were whole: 512 MiB as files.
const MOST_LABELS: u64 = 1 << 27;

/// Iterations whose labels are kept; 0 is the initial growth.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Snapshots {
    /// 0 and every multiple of this, which is at least 1.
    Every(u32),
    /// These, ascending, each once.
    At(Vec<u32>),
}

impl Snapshots {
    /// The first of them that is above `iteration`, or with none the first of all.
    pub fn next_after(&self, iteration: Option<u32>) -> Option<u32> {
        let from = iteration.map_or(Some(0), |iteration| iteration.checked_add(1))?;
        match self {
            Snapshots::Every(step) => from.checked_next_multiple_of(*step),
            Snapshots::At(list) => list.get(list.partition_point(|&at| at < from)).copied(),
        }
    }
}

/// The labels of chosen iterations.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct Record {
    wanted: Option<Snapshots>,
    /// The labels of the first snapshot, one a face.
    first: Vec<u32>,
    /// Iteration of each snapshot, and (face, label) where it differs from the one before.
    snapshots: Vec<(u32, Vec<(u32, u32)>)>,
    /// The labels of the last snapshot.
    last: Vec<u32>,
    /// The last wanted iteration that the run has passed, kept or not.
    passed: Option<u32>,
    /// Number of snapshots that were not kept, because there was no room.
    pub left_out: u64,
}

impl Record {
    /// Will keep what is wanted.
    pub fn new(wanted: Option<Snapshots>) -> Self {
        Self { wanted, ..Self::default() }
    }

    /// The next iteration whose labels are wanted; none when no more are.
    pub fn next(&self) -> Option<u32> {
        self.wanted.as_ref()?.next_after(self.passed)
    }

    /// Whether the labels of an iteration are wanted and were not kept before.
    pub fn wants(&self, iteration: u32) -> bool {
        self.next() == Some(iteration)
    }

    /// Keeps the labels of an iteration that it wants.
    pub fn keep(&mut self, iteration: u32, labels: Vec<u32>) {
        self.passed = Some(iteration);
        if self.snapshots.is_empty() {
            self.snapshots.push((iteration, Vec::new()));
            self.first.clone_from(&labels);
        } else if (self.snapshots.len() as u64 + 1) * labels.len() as u64 > MOST_LABELS {
            self.left_out += 1;
            return;
        } else {
            let pairs = labels.iter().zip(&self.last).enumerate();
            let differences = pairs.filter(|(_, (new, old))| new != old).map(|(face, (&new, _))| (face as u32, new));
            self.snapshots.push((iteration, differences.collect()));
        }
        self.last = labels;
    }

    /// Labels with the numbers of the last ones that were kept: of clusters with the most faces in common.
    pub fn numbered_like_last(&self, labels: Vec<u32>) -> Vec<u32> {
        if self.last.is_empty() { labels } else { numbers::kept(&self.last, &labels) }
    }

    /// The iterations whose labels are here, ascending.
    pub fn iterations(&self) -> Vec<u32> {
        self.snapshots.iter().map(|&(iteration, _)| iteration).collect()
    }

    /// Wanted iterations above the last of the run; of `N` none.
    pub fn beyond(&self) -> &[u32] {
        match &self.wanted {
            Some(Snapshots::At(list)) => {
                let end = self.passed.map_or(0, |passed| list.partition_point(|&at| at <= passed));
                &list[end..]
            }
            Some(Snapshots::Every(_)) | None => &[],
        }
    }

    /// Calls `visit` with the iteration and the labels of every snapshot, in order.
    pub fn replay<E>(&self, mut visit: impl FnMut(u32, &[u32]) -> Result<(), E>) -> Result<(), E> {
        let mut labels = self.first.clone();
        for (iteration, differences) in &self.snapshots {
            for &(face, label) in differences {
                labels[face as usize] = label;
            }
            visit(*iteration, &labels)?;
        }
        Ok(())
    }

    /// Puts the faces of all snapshots into the order of the upload, and gives their clusters other numbers. Loose
    /// faces have the labels of their hosts.
    pub fn renumber(&mut self, new_face: &[u32], loose: &[Loose], new_label: &[u32]) {
        if self.snapshots.is_empty() {
            return;
        }
        let mut first = vec![0; new_face.len() + loose.len()];
        for (&label, &face) in self.first.iter().zip(new_face) {
            first[face as usize] = new_label[label as usize];
        }
        let mut by_host = loose.to_vec();
        by_host.sort_by_key(|loose| loose.host);
        loose.iter().for_each(|loose| first[loose.face as usize] = first[loose.host as usize]);
        self.first = first;
        self.last = Vec::new();
        for (_, differences) in &mut self.snapshots {
            for (face, label) in differences.iter_mut() {
                *face = new_face[*face as usize];
                *label = new_label[*label as usize];
            }
            if !by_host.is_empty() {
                add_hosted(differences, &by_host);
            }
        }
    }

    /// Makes the faces of all snapshots items of a longer list, in which others have the label `free`.
    pub fn spread(&mut self, item_of_face: impl Fn(u32) -> u32, items: usize, free: u32) {
        if self.first.len() == items || self.snapshots.is_empty() {
            return;
        }
        let mut first = vec![free; items];
        for (face, &label) in (0..).zip(&self.first) {
            first[item_of_face(face) as usize] = label;
        }
        self.first = first;
        let differences = self.snapshots.iter_mut().flat_map(|(_, differences)| differences);
        differences.for_each(|(face, _)| *face = item_of_face(*face));
    }
}

/// Adds the loose faces of the faces in a list of (face, label).
fn add_hosted(differences: &mut Vec<(u32, u32)>, by_host: &[Loose]) {
    for at in 0..differences.len() {
        let (host, label) = differences[at];
        let begin = by_host.partition_point(|loose| loose.host < host);
        let hosted = by_host[begin..].iter().take_while(|loose| loose.host == host);
        differences.extend(hosted.map(|loose| (loose.face, label)));
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn kept(record: &Record) -> Vec<(u32, Vec<u32>)> {
        let mut all = Vec::new();
        let done: Result<(), ()> = record.replay(|iteration, labels| {
            all.push((iteration, labels.to_vec()));
            Ok(())
        });
        assert_eq!(done, Ok(()));
        all
    }

    #[test]
    fn what_is_wanted_is_kept_once_and_comes_back() {
        let mut record = Record::new(Some(Snapshots::At(vec![0, 2, 9])));
        let mut wanted = 0;
        for (iteration, labels) in [(0, [0, 1, 1]), (1, [0, 0, 1]), (2, [0, 0, 0]), (2, [1, 1, 1]), (3, [2, 2, 2])] {
            if record.wants(iteration) {
                wanted += 1;
                record.keep(iteration, labels.to_vec());
            }
        }
        assert_eq!((wanted, record.next(), record.beyond()), (2, Some(9), &[9][..]));
        assert_eq!(kept(&record), [(0, vec![0, 1, 1]), (2, vec![0, 0, 0])]);
        record.renumber(&[2, 0, 1], &[Loose { face: 3, host: 2 }], &[7, 5]);
        assert_eq!(kept(&record), [(0, vec![5, 5, 7, 7]), (2, vec![7, 7, 7, 7])]);
    }

    #[test]
    fn there_is_an_end_to_what_is_kept() {
        let mut record = Record::new(Some(Snapshots::Every(1)));
        let faces = MOST_LABELS as usize / 3 + 1;
        for iteration in 0..4 {
            record.keep(iteration, vec![0; faces]);
        }
        assert_eq!((record.iterations(), record.left_out), (vec![0, 1], 2));
    }

    #[test]
    fn they_follow_each_other() {
        let all = |snapshots: &Snapshots| {
            let mut last = None;
            std::iter::from_fn(|| {
                last = snapshots.next_after(last);
                last
            })
            .take(3)
            .collect::<Vec<_>>()
        };
        assert_eq!(all(&Snapshots::Every(7)), [0, 7, 14]);
        assert_eq!(all(&Snapshots::At(vec![3, 9])), [3, 9]);
        assert_eq!(Snapshots::Every(1).next_after(Some(u32::MAX)), None);
    }
}
