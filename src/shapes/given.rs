//! Clusterings that are given, with the shapes that fit them best.

use super::best::Allowed;
use super::faces::Faces;
use super::kind::Kind;
use super::prices::Prices;
use super::run::{Clustering, Run};
use crate::error::{Error, Result};

/// Clusters as they are, with their best shapes.
///
/// # Errors
/// A cluster that lies in several components.
pub fn as_given(
    faces: Faces<'_>,
    kinds: &[Kind],
    resolution: f64,
    labels: Vec<u32>,
    clusters: usize,
) -> Result<Clustering> {
    let prices = Prices::of(faces.graph, clusters, resolution);
    let allowed = Allowed { kinds, prices: &prices, tolerance: None };
    let mut component_of_cluster = vec![None; clusters];
    for (&label, component) in labels.iter().zip(faces.graph.component_of_face()) {
        if *component_of_cluster[label as usize].get_or_insert(component) != component {
            return Err(Error::parameter(format_args!("a cluster lies in several connected components: {label}")));
        }
    }
    let component_of_cluster = component_of_cluster.into_iter().map(Option::unwrap_or_default).collect();
    Ok(Run::of(faces, allowed, labels, component_of_cluster, &vec![None; clusters])?.ended_at_once())
}
