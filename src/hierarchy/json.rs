//! A hierarchy as JSON: for programs that want to walk the tree rather than to cut it.
//!
//! Leaves are the faces, with the numbers 0 … n − 1, and are not listed; merge i makes node n + i. Rows are written one
//! by one as they come, with one number a face in memory.

use std::io::{self, Write};
use std::ops::RangeInclusive;

use serde::Serialize;
use serde_json::{Map, Value};
use utoipa::ToSchema;

use super::stored::Stored;
use super::{Level, Nodes, Tree, contradiction};
use crate::energy::Merged;
use crate::energy::shape_kind::Kind as ShapeKind;
use crate::error::names::Name;
use crate::error::{Error, Result};

/// A hierarchy: what `--hierarchy OUT.json` writes.
#[derive(Debug, Serialize, ToSchema)]
pub struct Hierarchy {
    /// The algorithm, as in parameters.
    #[schema(example = "pml")]
    pub algorithm: String,
    /// The parameters it ran with, defaults filled in.
    pub parameters: Map<String, Value>,
    /// Number of faces n: the leaves.
    pub faces: u32,
    /// The rounds within the limits on the number of clusters, in order.
    pub levels: Vec<Level>,
    /// The merges within these limits, in order: children before parents.
    pub nodes: Vec<Node>,
    /// The nodes, leaves too, that are no child in `nodes`, ascending: the clusters at the end of the list.
    pub roots: Vec<u32>,
    /// The clusters of the cut that the parameter `clusters` names; absent without it.
    pub cut: Option<CutNodes>,
}

/// The clusters of a cut as nodes of the tree, in the order of their labels.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, ToSchema)]
pub struct CutNodes {
    /// The node of each cluster.
    pub nodes: Vec<u32>,
    /// The node that each cluster becomes a part of. Null for a cluster that the hierarchy ends with.
    pub parents: Vec<Option<u32>>,
}

/// Two clusters that became one.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, ToSchema)]
pub struct Node {
    /// Number of the node, n or more.
    pub id: u32,
    /// The two that merged: nodes, or faces below n.
    pub children: [u32; 2],
    /// Round of the merge, from 1.
    pub round: u32,
    /// Clusters left after the merge.
    pub clusters_left: u32,
    /// Rise of the energy by the merge, source units. Null when it overflows.
    #[schema(value_type = Option<f64>)]
    pub cost: f64,
    /// Energy of the merged cluster before any optimisation, source units. Null when it overflows.
    #[schema(value_type = Option<f64>)]
    pub energy: f64,
    /// Faces of the merged cluster. Optimisation moves faces, so it may differ from the sum of the children's.
    pub faces: u32,
    /// Its area, source units. Null when it overflows.
    #[schema(value_type = Option<f64>)]
    pub weight: f64,
    /// Its area-weighted mean centroid, source units; with the energy l21, its mean normal.
    pub proxy: [f64; 3],
    /// The type of its shape, with the energies planes and shapes; absent otherwise.
    #[serde(rename = "type", skip_serializing_if = "Option::is_none")]
    #[schema(nullable = false)]
    pub shape: Option<ShapeKind>,
}

/// Which part of a hierarchy is written: the levels and nodes that leave a number of clusters within limits.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct Limits {
    /// The least number.
    pub min_clusters: Option<u64>,
    /// The largest number.
    pub max_clusters: Option<u64>,
    /// A cut whose clusters are written as nodes in addition.
    pub clusters: Option<u64>,
}

impl Limits {
    /// Whether any limit was given.
    pub fn are_given(&self) -> bool {
        *self != Self::default()
    }

    /// What is wrong with them, if anything.
    pub fn check(&self) -> Result<()> {
        match (self.min_clusters, self.max_clusters) {
            (Some(min), Some(max)) if min > max => Err(Error::parameter(format_args!(
                "{} must not be above {}: {min} and {max}",
                Name::MIN_CLUSTERS,
                Name::MAX_CLUSTERS
            ))),
            _ => Ok(()),
        }
    }

    fn range(self) -> RangeInclusive<u64> {
        self.min_clusters.unwrap_or(0)..=self.max_clusters.unwrap_or(u64::MAX)
    }
}

impl Stored {
    /// Writes a [`Hierarchy`] in many small pieces, in one line. The cut must be one that the tree has.
    pub fn write_json(&self, out: &mut dyn Write, limits: Limits) -> io::Result<()> {
        let cut = limits.clusters.map(|clusters| self.tree.nodes_at(clusters));
        let cut = cut.transpose().map_err(io::Error::other)?;
        let range = limits.range();
        out.write_all(b"{\"algorithm\":")?;
        serde_json::to_writer(&mut *out, &self.header.algorithm)?;
        out.write_all(b",\"parameters\":")?;
        serde_json::to_writer(&mut *out, &self.header.parameters)?;
        write!(out, ",\"faces\":{},\"levels\":", self.tree.faces)?;
        write_array(out, self.tree.levels().filter(|level| range.contains(&level.clusters)))?;
        out.write_all(b",\"nodes\":")?;
        let mut nodes = Nodes::new(self.tree.faces);
        // merges beyond the range must not happen: the roots are what is left then
        let until = u64::from(self.tree.faces).saturating_sub(*range.start());
        let until = usize::try_from(until).unwrap_or(usize::MAX);
        let made = self.tree.nodes(&mut nodes).take(until);
        write_array(out, made.filter(|node| range.contains(&u64::from(node.clusters_left))))?;
        out.write_all(b",\"roots\":")?;
        write_array(out, nodes.roots().into_iter())?;
        if let Some(cut) = cut {
            out.write_all(b",\"cut\":")?;
            serde_json::to_writer(&mut *out, &cut)?;
        }
        out.write_all(b"}\n")
    }
}

impl Tree {
    /// The clusters of [`Self::labels_at`] as nodes. The merges of a cut at k clusters are the first n − k, because
    /// every merge ends one cluster.
    fn nodes_at(&self, clusters: u64) -> Result<CutNodes> {
        let (_, mut replay, _) = self.replay_to(clusters)?;
        let merges = u64::from(self.faces) - clusters;
        let Some((made, later)) = self.merges.split_at_checked(merges as usize) else {
            return contradiction("merges before a cut", merges);
        };
        let mut nodes = Nodes::new(self.faces);
        made.iter().for_each(|merge| _ = nodes.merge(merge));
        let mut node_of_cluster = nodes.node_of_cluster.clone();
        // labels go by the first face of a cluster
        let ended = u32::MAX;
        let first =
            replay.clusters().iter().map(|&cluster| std::mem::replace(&mut node_of_cluster[cluster as usize], ended));
        let of_cut: Vec<u32> = first.filter(|&node| node != ended).collect();
        let mut parent = vec![None; self.faces as usize + self.merges.len()];
        for merge in later {
            let (id, children) = nodes.merge(merge);
            children.into_iter().for_each(|child| parent[child as usize] = Some(id));
        }
        let parents = of_cut.iter().map(|&node| parent[node as usize]).collect();
        Ok(CutNodes { nodes: of_cut, parents })
    }

    /// Every round.
    fn levels(&self) -> impl Iterator<Item = Level> {
        let mut ends = (0, 0);
        self.rounds.iter().enumerate().map(move |(index, round)| {
            let before = std::mem::replace(&mut ends, (round.merges_end, round.moves_end));
            Level {
                round: index as u32 + 1,
                clusters: u64::from(round.clusters),
                energy: round.energy.is_finite().then_some(round.energy),
                merges: u64::from(round.merges_end - before.0),
                moves: round.moves_end - before.1,
            }
        })
    }

    /// Every merge as a node.
    fn nodes(&self, nodes: &mut Nodes) -> impl Iterator<Item = Node> {
        let mut round = 0;
        self.merges.iter().enumerate().map(move |(index, merge)| {
            while self.rounds[round].merges_end as usize <= index {
                round += 1;
            }
            let (id, children) = nodes.merge(merge);
            let Merged { cost, energy, faces, weight, proxy, shape } = merge.made;
            Node {
                id,
                children,
                round: round as u32 + 1,
                clusters_left: self.faces - index as u32 - 1,
                cost,
                energy,
                faces,
                weight,
                proxy,
                shape,
            }
        })
    }
}

/// Writes items as they come.
fn write_array<T: Serialize>(out: &mut dyn Write, items: impl Iterator<Item = T>) -> io::Result<()> {
    let mut separator = "[";
    for item in items {
        out.write_all(separator.as_bytes())?;
        serde_json::to_writer(&mut *out, &item)?;
        separator = ",";
    }
    out.write_all(if separator == "[" { b"[]" } else { b"]" })
}
