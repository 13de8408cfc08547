//! Which clusters are neighbours, as data.

use serde::Serialize;
use utoipa::ToSchema;

use super::arcs::Complex;
use super::surface::{CutSurface, check_labels};
use super::table::{Cluster, table};
use crate::error::Result;
use crate::mesh::PolygonMesh;

/// The clusters and which of them are neighbours.
#[derive(Debug, Clone, PartialEq)]
pub struct Graph {
    /// The cluster table.
    pub nodes: Vec<Cluster>,
    /// Neighbours, by `source`, then by `target`.
    pub edges: Vec<Edge>,
}

/// Two clusters that have a curve between them.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, ToSchema)]
pub struct Edge {
    /// One cluster.
    pub source: u32,
    /// The other, a higher number.
    pub target: u32,
    /// Length of the curves between them, source units.
    pub length: f64,
    /// Number of curves between them.
    pub arcs: u32,
}

impl Graph {
    /// The cluster table and the neighbours. Fails like [`check_labels`], and for meshes that are too large to number.
    pub fn new(mesh: &PolygonMesh, labels: &[u32], clusters: u64) -> Result<Self> {
        check_labels(mesh, labels, clusters)?;
        let surface = CutSurface::new(mesh)?;
        let cells = surface.labels(labels);
        let crossing = surface.halves.crossing(&cells);
        let complex = Complex::new(&surface.halves, &cells, &crossing);
        let euler = surface.halves.euler_of_cells(&cells, clusters as usize, &crossing);
        let mut lengths: Vec<(u32, Option<u32>, f64)> = complex
            .arcs
            .iter()
            .map(|arc| (arc.left, arc.right, complex.chain(arc).iter().map(|&half| surface.length(half)).sum()))
            .collect();
        let mut nodes = table(mesh, &surface, labels, &euler);
        let in_source_units = |length: f64| libm::ldexp(length, -surface.frame.exponent);
        for &(left, right, length) in &lengths {
            for cluster in [Some(left), right].into_iter().flatten() {
                nodes[cluster as usize].perimeter += length;
            }
            nodes[left as usize].open |= right.is_none();
        }
        lengths.retain(|(_, right, _)| right.is_some());
        let edges = lengths.chunk_by(|one, other| (one.0, one.1) == (other.0, other.1)).filter_map(|arcs| {
            let length = arcs.iter().map(|arc| arc.2).sum();
            let (source, target) = (arcs[0].0, arcs[0].1?);
            Some(Edge { source, target, length: in_source_units(length), arcs: arcs.len() as u32 })
        });
        let edges: Vec<Edge> = edges.collect();
        for edge in &edges {
            nodes[edge.source as usize].neighbours += 1;
            nodes[edge.target as usize].neighbours += 1;
        }
        for node in &mut nodes {
            node.perimeter = in_source_units(node.perimeter);
            let roundness = 4.0 * std::f64::consts::PI * node.area / (node.perimeter * node.perimeter);
            node.roundness = Some(roundness).filter(|roundness| roundness.is_finite());
        }
        Ok(Self { nodes, edges })
    }
}
