//! The tree of a hierarchical run, as its rounds are recorded. Clusters have internal numbers here, and those of the
//! upload in the tree.

use crate::energy::{Functional, Merged};
use crate::hierarchy::{FaceMove, Merge, Round, Tree};
use crate::parallel;
use crate::surface::{Items, Loose};

/// Merges that a thread records at least.
const MERGES_A_THREAD: usize = 256;

/// Builds the tree of a run.
pub(crate) struct Builder<'a, E: Functional> {
    pub items: &'a Items<E>,
    pub tree: Tree,
    /// Σ w·|g|² of each cluster, exactly.
    moments: Vec<i128>,
    /// The component that each cluster lies in, while it lives.
    pub component_of_cluster: Vec<u32>,
    /// Loose faces, by host.
    loose: Vec<Loose>,
    /// How many of them each cluster has; empty where there are none.
    loose_in: Vec<u32>,
}

impl<'a, E: Functional> Builder<'a, E> {
    /// A tree with room for `merges` merges. Loose faces go to their hosts first, at no cost, in a round of their own.
    pub fn new(items: &'a Items<E>, merges: usize) -> Self {
        let moments = (0..items.faces()).map(|face| E::constant(items.face(face))).collect();
        let merges = Vec::with_capacity(merges + items.loose.len());
        let tree = Tree { faces: items.upload_faces() as u32, merges, ..Tree::default() };
        let component_of_cluster = items.component_of_face();
        let mut builder = Self { items, tree, moments, component_of_cluster, loose: Vec::new(), loose_in: Vec::new() };
        if !items.loose.is_empty() {
            builder.add_loose();
        }
        builder
    }

    fn add_loose(&mut self) {
        let items = self.items;
        let internal = items.internal_faces();
        self.loose_in = vec![0; items.faces()];
        self.loose.clone_from(&items.loose);
        self.loose.sort_by_key(|loose| loose.host);
        for &Loose { face, host } in &items.loose {
            let cluster = internal[host as usize];
            let loose = &mut self.loose_in[cluster as usize];
            *loose += 1;
            let alone = items.sums_over([cluster]);
            let component = self.component_of_cluster[cluster as usize];
            let made = items.merged(&alone, &E::Sums::default(), self.moments[cluster as usize], component);
            let made = Merged { faces: 1 + *loose, cost: 0.0, energy: 0.0, ..made };
            self.tree.merges.push(Merge { into: host, from: face, made });
        }
        let (clusters, merges_end) = (items.faces() as u32, self.tree.merges.len() as u32);
        self.tree.rounds.push(Round { clusters, energy: 0.0, merges_end, moves_end: 0 });
    }

    /// Records merges (from, into), of which no cluster is in two, with the sums of both ends before, in either order.
    pub fn merge(&mut self, pairs: &[(u32, u32)], sums: &[[E::Sums; 2]]) {
        let Self { items, moments, component_of_cluster, .. } = self;
        let made: Vec<Merged> = parallel::map(pairs.len(), MERGES_A_THREAD, |nth| {
            let ((from, into), [a, b]) = (pairs[nth], &sums[nth]);
            let moment = moments[from as usize] + moments[into as usize];
            items.merged(a, b, moment, component_of_cluster[into as usize])
        });
        pairs.iter().zip(made).for_each(|(&pair, made)| self.record(pair, made));
    }

    /// Records a merge (from, into), given what it makes but for loose faces.
    pub fn record(&mut self, (from, into): (u32, u32), mut made: Merged) {
        self.moments[into as usize] += std::mem::take(&mut self.moments[from as usize]);
        if !self.loose_in.is_empty() {
            self.loose_in[into as usize] += std::mem::take(&mut self.loose_in[from as usize]);
            made.faces += self.loose_in[into as usize];
        }
        let [into, from] = [into, from].map(|cluster| self.items.upload_face[cluster as usize]);
        self.tree.merges.push(Merge { into, from, made });
    }

    /// Records moves: (face, from, to).
    pub fn moves(&mut self, moves: &[(u32, u32, u32)]) {
        let upload = &self.items.upload_face;
        for &(face, from, to) in moves {
            let moment = E::constant(self.items.face(face as usize));
            self.moments[from as usize] -= moment;
            self.moments[to as usize] += moment;
            self.tree.moves.push(FaceMove { face: upload[face as usize], to: upload[to as usize] });
            if !self.loose_in.is_empty() {
                self.move_loose(upload[face as usize], from, to);
            }
        }
    }

    /// Records that the loose faces of a host move with it.
    fn move_loose(&mut self, host: u32, from: u32, to: u32) {
        let first = self.loose.partition_point(|loose| loose.host < host);
        for loose in self.loose[first..].iter().take_while(|loose| loose.host == host) {
            self.loose_in[from as usize] -= 1;
            self.loose_in[to as usize] += 1;
            self.tree.moves.push(FaceMove { face: loose.face, to: self.items.upload_face[to as usize] });
        }
    }

    /// Ends a round with so many clusters and this energy, source units.
    pub fn end_round(&mut self, clusters: u64, energy: f64) {
        self.tree.rounds.push(Round {
            clusters: clusters as u32,
            energy,
            merges_end: self.tree.merges.len() as u32,
            moves_end: self.tree.moves.len() as u64,
        });
    }
}
