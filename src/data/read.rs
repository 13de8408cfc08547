//! From files to points.

use super::npy::{self, Array};
use super::{Csr, Graph, PointSet, Values, npz};
use crate::error::names::Name;
use crate::error::{Error, Result};

/// Element types of coordinates.
const VALUES: [&str; 5] = ["<f4", "<f8", "|u1", "<u2", "<i4"];
/// The same in words.
const VALUES_IN_WORDS: &str =
    "floats of 4 or 8 bytes, unsigned whole numbers of 1 or 2 bytes or signed ones of 4, little-endian";

/// Neighbours of an item where no graph is named.
pub const USUAL_NEIGHBOURS: u32 = 8;

/// Points in a `.npy` file (n × d, or the shape of a grid and then d), or in an `.npz` file with arrays X and, if they
/// are there, weights, mask, indptr and indices.
///
/// Neighbours are as `graph` says; without it by the edges of the `.npz` file, else the nearest 8. `limit` bounds the
/// bytes that are inflated.
pub fn read(bytes: &[u8], graph: Option<Graph>, limit: u64) -> Result<PointSet> {
    if !bytes.starts_with(npz::MAGIC) {
        let x = npy::parse(bytes, "array of points", &VALUES, VALUES_IN_WORDS)?;
        return Arrays { x, weights: None, mask: None, csr: None }.points(graph);
    }
    let npz::Npz { x, weights, mask, csr } = npz::open(bytes, limit)?;
    let read_mask = |bytes| npy::parse(bytes, "array mask", &["|b1", "|u1"], "True and False, or bytes");
    Arrays {
        x: npy::parse(&x, "array X", &VALUES, VALUES_IN_WORDS)?,
        weights: weights.as_deref().map(|bytes| floats(bytes, "array weights")).transpose()?,
        mask: mask.as_deref().map(read_mask).transpose()?,
        csr,
    }
    .points(graph)
}

/// Weights in a file of their own, not yet compared with the items.
#[derive(Debug)]
pub struct Weights<'a>(Array<'a>);

/// Weights in a `.npy` file.
pub fn read_weights(bytes: &[u8]) -> Result<Weights<'_>> {
    floats(bytes, "file of weights").map(Weights)
}

fn floats<'a>(bytes: &'a [u8], what: &str) -> Result<Array<'a>> {
    npy::parse(bytes, what, &["<f4", "<f8"], "little-endian floats of 4 or 8 bytes")
}

/// Arrays as they were uploaded, not yet compared with each other.
struct Arrays<'a> {
    x: Array<'a>,
    weights: Option<Array<'a>>,
    mask: Option<Array<'a>>,
    csr: Option<Csr>,
}

impl<'a> Arrays<'a> {
    fn points(self, graph: Option<Graph>) -> Result<PointSet> {
        let graph = match (graph, self.csr) {
            (Some(_), Some(_)) => return Err(graph_twice()),
            (Some(graph), None) => graph,
            (None, Some(csr)) => Graph::Rows(csr),
            (None, None) => Graph::Knn(USUAL_NEIGHBOURS),
        };
        let is_grid = matches!(graph, Graph::Grid { .. });
        let Some((&dimensions, shape)) = self.x.shape.split_last().filter(|(_, shape)| is_grid || shape.len() == 1)
        else {
            return Err(Error::parameter(format_args!(
                "points must be an array of items × columns, as X.reshape(-1, d) makes it, or a grid of 2 or 3 \
                 dimensions × columns ({} grid), not of the shape: {:?}",
                Name::GRAPH,
                self.x.shape
            )));
        };
        let weights = self.weights.map(|array| of_items(array, "weights", shape)).transpose()?;
        let weights = weights.map(|array| array.floats());
        let mask = self.mask.map(|array| of_items(array, "mask", shape)).transpose()?;
        let mask = mask.map(|array| array.is_set().collect());
        let shape = shape.to_vec();
        let set = PointSet { dimensions, values: Values::of(&self.x), weights, mask, shape, graph };
        set.check()?;
        Ok(set)
    }
}

fn of_items<'a>(array: Array<'a>, what: &str, shape: &[usize]) -> Result<Array<'a>> {
    match array.shape == shape {
        true => Ok(array),
        false => Err(Error::parameter(format_args!(
            "the {what} must have the shape of the items, {shape:?}, not {:?}",
            array.shape
        ))),
    }
}

fn graph_twice() -> Error {
    Error::parameter("a graph is there twice: in the .npz file and beside it")
}

impl PointSet {
    /// Adds the weights of a separate file. Refuses another shape, values that are not finite and above 0, and weights
    /// beside those of an `.npz` file.
    pub fn with_weights(mut self, Weights(array): Weights<'_>) -> Result<Self> {
        if self.weights.is_some() {
            return Err(Error::parameter("weights are there twice: in the .npz file and beside it"));
        }
        self.weights = Some(of_items(array, "weights", &self.shape)?.floats());
        self.check_weights(self.items())?;
        Ok(self)
    }

    /// Adds the edges of a separate file, in place of the neighbours that [`read`] gives without a graph. Refuses
    /// another number of rows, and edges beside those of an `.npz` file.
    pub fn with_edges(mut self, edges: Csr) -> Result<Self> {
        if matches!(self.graph, Graph::Rows(_)) {
            return Err(graph_twice());
        }
        self.graph = Graph::Rows(edges);
        self.check_graph(self.items())?;
        Ok(self)
    }
}

impl Values {
    /// Those of an array of one of the types in `VALUES`.
    fn of(array: &Array<'_>) -> Self {
        let (twos, fours, eights) = (array.data.as_chunks().0, array.data.as_chunks().0, array.data.as_chunks().0);
        match array.kind {
            "<f4" => Self::F4(fours.iter().map(|bytes| f32::from_le_bytes(*bytes)).collect()),
            "<i4" => Self::I4(fours.iter().map(|bytes| i32::from_le_bytes(*bytes)).collect()),
            "<u2" => Self::U2(twos.iter().map(|bytes| u16::from_le_bytes(*bytes)).collect()),
            "|u1" => Self::U1(array.data.to_vec()),
            _ => Self::F8(eights.iter().map(|bytes| f64::from_le_bytes(*bytes)).collect()),
        }
    }
}
