//! From points with neighbours to a [`Prepared`] job.

use std::time::Instant;

use rayon::prelude::*;

use super::plan::plan;
use super::subject::with_planned;
use super::{InputFile, JobSpec, Planned, Points, Prepared, Refusal, Subject, Width, milliseconds};
use crate::artifacts::Artifact;
use crate::data::{
    self, ClusterEdge, Format, Graph, Laid, Members, PointCluster, PointSet, PointTable, image, lay, npz,
};
use crate::device::FREE;
use crate::energy::{Functional, OfPoints};
use crate::error::Error;
use crate::error::names::{are_flags, more_than};
use crate::mesh::Limits;
use crate::parameters::{Algorithm, Name, Neighbours, Parameters};
use crate::report::{Input, PointsInput, Timings, WeightedBy};
use crate::surface::{DualGraph, Items, Moves, Units};

/// A job on points in a file.
#[derive(Debug, Clone, Copy)]
pub struct PointsRequest<'a> {
    /// The bytes of the file.
    pub bytes: &'a [u8],
    /// Its format.
    pub format: Format,
    /// Bytes that may be inflated, and the largest number of items.
    pub limits: Limits,
    /// What to do.
    pub parameters: &'a Parameters,
    /// A file with edges: a sparse matrix, as `scipy.sparse.save_npz` writes it.
    pub graph: Option<&'a [u8]>,
    /// A list of seeds, as in a [`Request`](super::Request): numbers of items.
    pub seeds: Option<&'a [u8]>,
    /// A file with one weight an item, `.npy` with floats.
    pub weights: Option<&'a [u8]>,
    /// What will be written of the job: the [cluster table](super::Outcome::table) is made if one of these needs it.
    pub outputs: &'a [&'a Artifact],
}

impl PointsRequest<'_> {
    /// How large the points are, as far as the heads of their files say.
    pub fn size(&self) -> Result<data::Size, Refusal> {
        let Self { bytes, format, limits, parameters, graph, .. } = *self;
        let listed = parameters.graph.as_ref().and_then(Neighbours::graph);
        let size = data::Size::of(bytes, format, listed.as_ref(), limits.max_bytes);
        let mut size = size.map_err(Refusal::of(InputFile::Mesh))?;
        if let Some(graph) = graph {
            let inflated = npz::inflated_of_graph(graph, limits.max_bytes).map_err(Refusal::of(InputFile::Graph))?;
            size.inflated = size.inflated.saturating_add(inflated);
        }
        Ok(size)
    }
}

/// A job on points in memory.
#[derive(Debug)]
pub struct PointsInMemory<'a> {
    /// The points.
    pub set: PointSet,
    /// The format that they were read from.
    pub format: Option<Format>,
    /// Largest number of items.
    pub max_items: u64,
    /// What to do; its graph is that of the points.
    pub parameters: &'a Parameters,
    /// A list of seeds, as in a [`PointsRequest`].
    pub seeds: Option<&'a [u8]>,
    /// When the points began to be read.
    pub started: Instant,
}

/// Reads, checks and prepares points. Needs no device.
pub fn prepare_points(request: &PointsRequest<'_>) -> Result<Prepared, Refusal> {
    let PointsRequest { format, limits, parameters, graph, seeds, weights, .. } = *request;
    let started = Instant::now();
    check_points(parameters, format, graph.is_some(), weights.is_some())?;
    let set = if format.is_image() { superpixels(request)? } else { arrays(request)? };
    let format = Some(format);
    let max_items = limits.max_faces;
    let prepared = prepare_points_in_memory(PointsInMemory { set, format, max_items, parameters, seeds, started })?;
    Ok(Prepared { wants_table: request.outputs.iter().any(|output| output.is_made_of_input()), ..prepared })
}

/// The cluster table of labels, one an item, of points in a file.
pub fn table_of_points(request: &PointsRequest<'_>, labels: &[u32], clusters: u64) -> Result<PointTable, Refusal> {
    // how they were clustered, and from which start, makes no difference
    let &Parameters { compactness, bridge_components, ref graph, .. } = request.parameters;
    let parameters = &Parameters {
        algorithm: Algorithm::Pml,
        clusters: request.parameters.superpixels(),
        compactness,
        bridge_components,
        graph: graph.clone(),
        ..Parameters::default()
    };
    let prepared = prepare_points(&PointsRequest { parameters, seeds: None, ..*request })?;
    let points = prepared.subject.points().filter(|points| points.members.items() == labels.len());
    let table = points.map(|points| points.table(labels, clusters));
    Ok(table.ok_or_else(|| Error::internal("labels are of other points"))?)
}

/// Checks what can be checked before the points are read: what their format does not go with. `has_graph` and
/// `has_weights` say which files came with them.
pub fn check_points(parameters: &Parameters, format: Format, has_graph: bool, has_weights: bool) -> Result<(), Error> {
    parameters.check_points()?;
    if let (Some(graph), true) = (&parameters.graph, has_graph && !are_flags()) {
        return Err(Error::parameter(format_args!(
            "{} and the part of that name exclude each other: leave out {graph}",
            Name::GRAPH
        )));
    }
    if !format.is_image() {
        let error = |compactness| format!("{} goes with images, not with arrays: {compactness}", Name::COMPACTNESS);
        return parameters.compactness.map_or(Ok(()), |compactness| Err(Error::parameter(error(compactness))));
    }
    let others = [(Name::GRAPH, has_graph || parameters.graph.is_some()), (Name::WEIGHTS, has_weights)];
    if let Some((name, _)) = others.into_iter().find(|&(_, is_given)| is_given) {
        return Err(Error::parameter(format_args!(
            "{name} goes with arrays, not with images, whose pixels are neighbours in a grid and weigh the same: leave \
             it out"
        )));
    }
    parameters.superpixels().map(drop).ok_or_else(|| size_is_missing(parameters))
}

fn size_is_missing(parameters: &Parameters) -> Error {
    let missing = format_args!("{} is missing", Name::CLUSTERS);
    let why = "the size of superpixels decides how much the place of a pixel counts";
    match parameters.algorithm.is_hierarchical() {
        true => Error::parameter(format_args!("{missing}: {why}; {} does as well", Name::LEVELS)),
        false => Error::parameter(format_args!("{missing}: {why}")),
    }
}

/// Refuses a file with edges by its first bytes.
pub fn check_head_of_graph(head: &[u8]) -> Result<(), Error> {
    match head.starts_with(npz::MAGIC) {
        true => Ok(()),
        false => Err(Error::parameter(
            "the graph is no .npz file: save a sparse matrix with scipy.sparse.save_npz(\"graph.npz\", A.tocsr())",
        )),
    }
}

/// The points of arrays.
fn arrays(request: &PointsRequest<'_>) -> Result<PointSet, Refusal> {
    let PointsRequest { bytes, limits, parameters, graph, weights, .. } = *request;
    let neighbours = parameters.graph.as_ref().filter(|_| graph.is_none()).and_then(Neighbours::graph);
    let mut set = data::read(bytes, neighbours, limits.max_bytes).map_err(Refusal::of(InputFile::Mesh))?;
    if let Some(graph) = graph {
        let edges = npz::graph(graph, limits.max_bytes);
        set = edges.and_then(|edges| set.with_edges(edges)).map_err(Refusal::of(InputFile::Graph))?;
    }
    if let Some(weights) = weights {
        let weights = data::read_weights(weights);
        set = weights.and_then(|weights| set.with_weights(weights)).map_err(Refusal::of(InputFile::Weights))?;
    }
    Ok(set)
}

/// The pixels of an image.
fn superpixels(request: &PointsRequest<'_>) -> Result<PointSet, Refusal> {
    let PointsRequest { bytes, limits, parameters, .. } = *request;
    let clusters = parameters.superpixels().ok_or_else(|| size_is_missing(parameters))?;
    let compactness = image::compactness(parameters.compactness);
    image::decode(bytes, limits.max_faces, limits.max_bytes)
        .and_then(|image| image::superpixels(&image, None, clusters, compactness))
        .map_err(Refusal::of(InputFile::Mesh))
}

/// Refuses more clusters than items before anything is made of these.
fn check_clusters(parameters: &Parameters, items: usize) -> Result<(), Error> {
    match parameters.clusters {
        Some(clusters) if items > 0 && clusters > items as u64 => {
            Err(more_than(Name::CLUSTERS, clusters, "items", items))
        }
        _ => Ok(()),
    }
}

/// Checks and prepares points in memory.
pub fn prepare_points_in_memory(job: PointsInMemory<'_>) -> Result<Prepared, Refusal> {
    let PointsInMemory { set, format, max_items, parameters, seeds, started } = job;
    parameters.check_points()?;
    if set.items() as u64 > max_items {
        let error = format_args!("there are more items than allowed, {max_items}: {}", set.items());
        return Err(Refusal::of(InputFile::Mesh)(Error::too_large(error)));
    }
    let parsed = Instant::now();
    let mut spec = JobSpec::new(parameters, seeds)?;
    let members = Members::new(set.items(), set.mask.as_deref());
    check_clusters(parameters, members.len())?;
    if let Some(listed) = spec.clustering.listed_seeds() {
        renumber(listed, &members).map_err(Refusal::of(InputFile::Seeds))?;
    }
    let moves = spec.moves();
    let bridge = spec.bridge_components;
    let of_points = Refusal::of(InputFile::Mesh);
    let clustering = &spec.clustering;
    let mut about = About::default();
    macro_rules! planned {
        ($width:ident, $d:literal) => {{
            let items = about.items(lay::<$d>(&set, &members, bridge).map_err(of_points)?, moves);
            Width::$width(Planned { plan: plan(&items, clustering)?, items })
        }};
    }
    let planned = match data::width(set.dimensions) {
        3 => planned!(D3, 3),
        8 => planned!(D8, 8),
        _ => planned!(D64, 64),
    };
    let input = Input::Points(PointsInput {
        format,
        items: set.items() as u64,
        masked: (set.items() - members.len()) as u64,
        dimensions: set.dimensions as u64,
        shape: set.shape.iter().map(|&length| length as u64).collect(),
        edges: about.edges,
        components: about.components,
        graph: match &set.graph {
            Graph::Grid { full: false } => "grid".to_owned(),
            Graph::Grid { full: true } => "grid:full".to_owned(),
            Graph::Rows(_) => "edges".to_owned(),
            Graph::Knn(nearest) => format!("knn:{nearest}"),
        },
        lattice_unit: libm::ldexp(1.0, -about.exponent),
    });
    // colours are not columns that could be scaled: of grey ones, two of the three are rounding
    let is_image = parameters.compactness.is_some() || format.is_some_and(Format::is_image);
    let warnings = if is_image { Vec::new() } else { about.warnings };
    let weighted_by = set.weights.iter().map(|_| WeightedBy::Weights).collect();
    Ok(Prepared {
        subject: Subject::Points(Box::new(Points { set, members, planned })),
        spec,
        input,
        weighted_by,
        warnings,
        mesh: None,
        wants_table: false,
        origin: None,
        viewer: None,
        timings: Timings {
            parse: milliseconds(parsed - started),
            topology: milliseconds(parsed.elapsed()),
            ..Timings::default()
        },
    })
}

/// Listed items as numbers among those that take part.
fn renumber(listed: &mut [u32], members: &Members) -> Result<(), Error> {
    for item in listed {
        if *item as usize >= members.items() {
            let items = members.items();
            return Err(Error::parameter(format_args!("a seed is no item, of which there are {items}: {item}")));
        }
        let masked = || Error::parameter(format_args!("a seed is masked, and can have no cluster: {item}"));
        *item = members.member(*item).ok_or_else(masked)?;
    }
    Ok(())
}

/// What the report says of points on the lattice.
#[derive(Default)]
struct About {
    edges: u64,
    components: u64,
    exponent: i32,
    warnings: Vec<String>,
}

impl About {
    fn items<const D: usize>(&mut self, laid: Laid<D>, moves: Moves) -> Items<OfPoints<D>> {
        let Laid { points, weights, neighbours, components, .. } = laid;
        self.edges = laid.edges;
        self.components = laid.components_found;
        self.exponent = laid.exponent;
        self.warnings = laid.warnings;
        let graph: DualGraph<OfPoints<D>> = DualGraph { points, weights, neighbours, components, moves };
        let mut centre = [0.0; D];
        centre[..laid.centre.len()].copy_from_slice(&laid.centre);
        let units = Units { centre, exponent: laid.exponent, weight_exponent: -laid.weight_exponent, density: 1.0 };
        Items { noun: "items", ..Items::new(graph, laid.member, units) }
    }
}

impl<const D: usize> Planned<OfPoints<D>> {
    /// Position, weight and label of each internal item, in source units. Positions are about no centre: beside one
    /// item far away, differences to the middle of the range would leave no digit of the others.
    fn source<'a>(
        &'a self,
        points: &'a Points,
        label: impl Fn(usize) -> u32 + Copy + 'a,
    ) -> impl Iterator<Item = ([f64; D], f64, u32)> + Clone + 'a {
        let Points { set, members, .. } = points;
        self.items.upload_face.iter().enumerate().map(move |(internal, &member)| {
            let item = members.item(member) as usize;
            let mut position = [0.0; D];
            for (axis, x) in position.iter_mut().enumerate().take(set.dimensions) {
                *x = set.at(item, axis);
            }
            (position, set.weight(item), label(internal))
        })
    }

    /// Energy of labels of internal items, in source units.
    fn energy(&self, points: &Points, label: impl Fn(usize) -> u32 + Copy, clusters: usize) -> f64 {
        OfPoints::<D>::source_terms(self.source(points, label), clusters).map(|(_, term)| term).sum()
    }

    /// The cluster table of labels of internal items.
    fn table(&self, points: &Points, labels: &[u32], clusters: usize) -> PointTable {
        let items = &self.items;
        let of_cluster = |cluster| {
            let mean = vec![0.0; points.set.dimensions];
            PointCluster { cluster, items: 0, weight: 0.0, energy: 0.0, neighbours: 0, component: 0, mean }
        };
        let mut rows: Vec<PointCluster> = (0..clusters as u32).map(of_cluster).collect();
        let source = self.source(points, |item| labels[item]);
        for (position, weight, label) in source.clone() {
            let row = &mut rows[label as usize];
            row.items += 1;
            row.weight += weight;
            row.mean.iter_mut().zip(position).for_each(|(sum, x)| *sum += weight * x);
        }
        for row in &mut rows {
            row.mean.iter_mut().for_each(|sum| *sum /= row.weight);
        }
        OfPoints::<D>::source_terms(source, clusters).for_each(|(label, term)| rows[label as usize].energy += term);
        for (component, of_component) in (0..).zip(&items.components) {
            of_component.range().for_each(|item| rows[labels[item] as usize].component = component);
        }
        let mut pairs: Vec<(u32, u32)> = Vec::new();
        for item in 0..items.faces() as u32 {
            let label = labels[item as usize];
            let near = items.neighbours_of(item).iter().map(|&near| labels[near as usize]);
            pairs.extend(near.filter(|&near| label < near).map(|near| (label, near)));
        }
        pairs.par_sort_unstable();
        let edge = |pairs: &[(u32, u32)]| {
            let (source, target) = pairs[0];
            ClusterEdge { source, target, pairs: pairs.len() as u64 }
        };
        let edges: Vec<ClusterEdge> = pairs.chunk_by(|a, b| a == b).map(edge).collect();
        for ClusterEdge { source, target, .. } in &edges {
            rows[*source as usize].neighbours += 1;
            rows[*target as usize].neighbours += 1;
        }
        PointTable { rows, edges }
    }
}

impl Points {
    /// Energy of labels of internal items, in source units: Σ weight × squared distance to the mean of the cluster.
    pub(super) fn energy(&self, label: impl Fn(usize) -> u32 + Copy, clusters: usize) -> f64 {
        with_planned!(&self.planned, |planned| planned.energy(self, label, clusters))
    }

    /// The cluster table of labels, one an item, as [`with_masked`](Self::with_masked) gives them.
    pub fn table(&self, labels: &[u32], clusters: u64) -> PointTable {
        with_planned!(&self.planned, |planned| {
            let label = |&member: &u32| labels[self.members.item(member) as usize];
            let internal: Vec<u32> = planned.items.upload_face.iter().map(label).collect();
            planned.table(self, &internal, clusters as usize)
        })
    }

    /// Labels of those that take part as labels of all items: [`FREE`] of those that a mask leaves out.
    pub fn with_masked(&self, labels: Vec<u32>) -> Vec<u32> {
        if labels.len() == self.set.items() {
            return labels;
        }
        let mut all = vec![FREE; self.set.items()];
        for (member, label) in (0..).zip(labels) {
            all[self.members.item(member) as usize] = label;
        }
        all
    }
}

#[cfg(test)]
mod tests;
