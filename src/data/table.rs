//! The cluster table of points, and which clusters are neighbours.

use serde::Serialize;
use utoipa::ToSchema;

/// A row of the cluster table of points, in the units of their columns. A number that f64 cannot hold is null in JSON.
#[derive(Debug, Clone, PartialEq, Serialize, ToSchema)]
pub struct PointCluster {
    /// The number of the cluster.
    pub cluster: u32,
    /// Number of items.
    pub items: u64,
    /// Sum of their weights.
    pub weight: f64,
    /// Its share of the energy: the sum over its items of weight × squared distance to the mean.
    pub energy: f64,
    /// Number of clusters with a neighbour of one of its items.
    pub neighbours: u64,
    /// Number of the component that its items are in.
    pub component: u32,
    /// Weighted mean of its items, a number a column.
    pub mean: Vec<f64>,
}

/// Two clusters that are neighbours.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, ToSchema)]
#[schema(as = PointClusterEdge)]
pub struct ClusterEdge {
    /// The cluster with the smaller number.
    pub source: u32,
    /// The other one.
    pub target: u32,
    /// Pairs of neighbouring items, one in each.
    pub pairs: u64,
}

/// The cluster table of points, and their edges.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct PointTable {
    /// A row a cluster.
    pub rows: Vec<PointCluster>,
    /// Pairs of clusters, ascending.
    pub edges: Vec<ClusterEdge>,
}
