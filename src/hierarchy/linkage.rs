//! A nested hierarchy as scipy's linkage matrix, for `dendrogram`, `fcluster` and the rest of
//! `scipy.cluster.hierarchy`.
//!
//! A row a merge: two clusters (faces below n, row i makes n + i), their distance, the number of faces. The distance is
//! √(2·cost), scipy's own scale for Ward linkage: the distance of two points of weight 1 that merge.
//!
//! Only neighbours merge, so a merge can be cheaper than one below it (it *inverts*), which scipy does not allow: the
//! distance of a row is the largest of its own and those below it, and rows are in its order, children before parents.
//! Inverted rows therefore tie with one below them, and a threshold that takes one takes the other: `fcluster` with
//! `maxclust` may return fewer clusters than requested. Exactly K clusters come from [`Tree::labels_at`].

use super::stored::Stored;
use super::{Nodes, Tree};
use crate::error::names::Name;
use crate::error::{Error, Result};

/// One row of the matrix.
#[derive(Debug, Clone, Copy, PartialEq)]
struct MergeRow {
    children: [u32; 2],
    /// The largest cost of the merge and those below it.
    cost: f64,
    faces: u32,
}

/// A linkage matrix, checked and in order.
#[derive(Debug, Clone, PartialEq)]
pub struct Linkage {
    rows: Vec<MergeRow>,
}

impl Stored {
    /// The linkage matrix. [`Kind::Conflict`](crate::Kind) when the tree has none, with what to ask for to get one.
    pub fn linkage(&self) -> Result<Linkage> {
        let conflict = |message: String| Err(Error::conflict(message));
        let tree = &self.tree;
        let roots = u64::from(tree.roots());
        if !tree.is_nested() {
            return conflict(format!(
                "a linkage matrix needs a nested tree, but faces moved between clusters; ask for {}: {} moves",
                Name::OPTIMIZE.with("none"),
                tree.moves.len()
            ));
        }
        if tree.faces < 2 {
            return conflict(format!("a linkage matrix needs at least two faces, not {}", tree.faces));
        }
        let components = self.header.components().unwrap_or(1);
        if roots > 1 && roots <= components {
            let has_features = self.header.parameters.get("features").is_some_and(|features| !features.is_null());
            return conflict(no_single_root(components, has_features));
        }
        if roots > 1 {
            return conflict(format!(
                "a linkage matrix needs a whole tree, but this one ends early; leave {} out: {roots} roots",
                Name::CLUSTERS
            ));
        }
        let linkage = Linkage::of(tree);
        // the last merge costs most
        match linkage.rows.last().is_some_and(|row| row.cost.is_infinite()) {
            true => conflict("a linkage matrix needs costs below 10³⁰⁸, scale the coordinates down".to_owned()),
            false => Ok(linkage),
        }
    }
}

/// Why a mesh in several pieces has no linkage matrix.
pub fn no_single_root(components: u64, has_features: bool) -> String {
    let (pieces, way_out) = match has_features {
        false => ("connected components", format!("{} joins them", Name::BRIDGE_COMPONENTS)),
        true => ("regions between feature edges", format!("leave {} out", Name::FEATURES)),
    };
    format!(
        "a linkage matrix needs a tree with a single root, but there are {components} {pieces} and the hierarchy as \
         many roots; {way_out}"
    )
}

impl Linkage {
    fn of(tree: &Tree) -> Self {
        let mut nodes = Nodes::new(tree.faces);
        let mut rows: Vec<MergeRow> = Vec::with_capacity(tree.merges.len());
        for merge in &tree.merges {
            let (_, children) = nodes.merge(merge);
            // no cost is below 0, and a NaN loses
            let mut row = MergeRow { children, cost: merge.made.cost.max(0.0), faces: 0 };
            for child in children {
                let below = child.checked_sub(tree.faces).map(|row| rows[row as usize]);
                row.cost = row.cost.max(below.map_or(0.0, |below| below.cost));
                row.faces += below.map_or(1, |below| below.faces);
            }
            rows.push(row);
        }
        // Stable, and a parent comes after its children and costs no less: it stays after them.
        let mut order: Vec<u32> = (0..rows.len() as u32).collect();
        order.sort_by(|&a, &b| rows[a as usize].cost.total_cmp(&rows[b as usize].cost));
        let mut place = vec![0; rows.len()];
        for (at, &row) in order.iter().enumerate() {
            place[row as usize] = at as u32;
        }
        let moved = |node: u32| node.checked_sub(tree.faces).map_or(node, |row| tree.faces + place[row as usize]);
        let rows = order
            .iter()
            .map(|&row| {
                let row = rows[row as usize];
                let [a, b] = row.children.map(moved);
                MergeRow { children: [a.min(b), a.max(b)], ..row }
            })
            .collect();
        Self { rows }
    }

    /// The rows, one less than there are faces: two clusters, their distance, their number of faces.
    pub fn rows(&self) -> impl ExactSizeIterator<Item = [f64; 4]> {
        self.rows.iter().map(|row| {
            let [a, b] = row.children.map(f64::from);
            [a, b, (2.0 * row.cost).sqrt(), f64::from(row.faces)]
        })
    }
}
