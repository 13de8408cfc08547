//! Points of any number of coordinates with neighbours: images, volumes, maps, clouds, tables (P§8).
//!
//! ```text
//! bytes ─ npy, npz, image ─→ PointSet ─ lay ─→ Laid: points, weights and neighbours on the integer lattice
//! ```
//!
//! A [`PointSet`] is what was uploaded: n items of d coordinates, in upload order. [`lay()`] turns it into what
//! algorithms see: integer points (`frame`), neighbours (`grid`, `csr`, `knn`), components (`neighbours`; `bridge`
//! joins them) and weights, in an internal order that keeps neighbours close in memory (`order`).
//! `docs/arithmetic.md` has the bounds.
//!
//! Everything up to the lattice is scalar f64 in a fixed order; what is decided after it is decided in integers. So a
//! result is the same on every machine and for any number of threads.
//!
//! It knows no mesh format, no job and no device.

mod bridge;
mod csr;
mod format;
mod frame;
mod grid;
pub mod image;
mod knn;
mod lay;
mod members;
mod neighbours;
pub mod npy;
pub mod npz;
mod order;
mod read;
mod size;
mod table;

pub use csr::Csr;
pub use format::Format;
pub use frame::{bits, width};
pub use knn::{MOST_NEIGHBOURS, knn};
pub use lay::{Laid, lay};
pub use members::Members;
pub use read::{USUAL_NEIGHBOURS, Weights, read, read_weights};
pub use size::Size;
pub use table::{ClusterEdge, PointCluster, PointTable};

pub use crate::surface::Rows;

use crate::error::{Error, Result};
use crate::parallel;

/// Coordinates that an item may have.
pub const MOST_DIMENSIONS: usize = 64;

/// Items as they were uploaded, and what makes them neighbours.
#[derive(Debug, Clone, PartialEq)]
pub struct PointSet {
    /// d, the coordinates of an item: from 1 to [`MOST_DIMENSIONS`].
    pub dimensions: usize,
    /// n × d coordinates, those of an item one after the other.
    pub values: Values,
    /// One an item, finite and above 0 where it takes part; all weigh the same where there are none.
    pub weights: Option<Vec<f64>>,
    /// Whether an item takes part, one an item; all do where there is none.
    pub mask: Option<Vec<bool>>,
    /// Shape of the items: that of the grid, or their number.
    pub shape: Vec<usize>,
    /// What makes items neighbours.
    pub graph: Graph,
}

/// What makes items neighbours.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Graph {
    /// The place in a grid of 2 or 3 dimensions: 4 or 6 neighbours, or 8 or 26 in a full one.
    Grid {
        /// Whether corners count, too.
        full: bool,
    },
    /// A list of edges.
    Rows(Csr),
    /// One is among the nearest of the other, as many as this says: exactly, of equally near ones those whose numbers
    /// come next.
    Knn(u32),
}

/// Coordinates as they were uploaded.
#[derive(Debug, Clone, PartialEq)]
pub enum Values {
    /// 4-byte floats.
    F4(Vec<f32>),
    /// 8-byte floats.
    F8(Vec<f64>),
    /// Bytes.
    U1(Vec<u8>),
    /// 2-byte whole numbers.
    U2(Vec<u16>),
    /// 4-byte whole numbers with a sign.
    I4(Vec<i32>),
}

impl Values {
    /// How many there are.
    pub fn len(&self) -> usize {
        match self {
            Self::F4(values) => values.len(),
            Self::F8(values) => values.len(),
            Self::U1(values) => values.len(),
            Self::U2(values) => values.len(),
            Self::I4(values) => values.len(),
        }
    }

    /// Whether there are none.
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// One of them; every type fits exactly.
    #[inline]
    pub fn at(&self, index: usize) -> f64 {
        match self {
            Self::F4(values) => values[index].into(),
            Self::F8(values) => values[index],
            Self::U1(values) => values[index].into(),
            Self::U2(values) => values[index].into(),
            Self::I4(values) => values[index].into(),
        }
    }
}

impl PointSet {
    /// Number of items, those that take no part included.
    pub fn items(&self) -> usize {
        self.shape.iter().product()
    }

    /// A coordinate of an item.
    #[inline]
    pub fn at(&self, item: usize, axis: usize) -> f64 {
        self.values.at(item * self.dimensions + axis)
    }

    /// The weight of an item.
    #[inline]
    pub fn weight(&self, item: usize) -> f64 {
        self.weights.as_ref().map_or(1.0, |weights| weights[item])
    }

    /// Whether an item takes part.
    #[inline]
    pub fn takes_part(&self, item: usize) -> bool {
        self.mask.as_ref().is_none_or(|mask| mask[item])
    }

    /// Refuses what is no set of points: see the fields.
    pub fn check(&self) -> Result<()> {
        let d = self.dimensions;
        if !(1..=MOST_DIMENSIONS).contains(&d) {
            return Err(Error::parameter(format_args!("items must have from 1 to {MOST_DIMENSIONS} columns: {d}")));
        }
        let items = self.shape.iter().try_fold(1usize, |items, &length| items.checked_mul(length));
        let Some(items) = items.filter(|items| items.checked_mul(d) == Some(self.values.len())) else {
            return Err(Error::parameter(format_args!(
                "items of the shape {:?} and {d} columns cannot have so many values: {}",
                self.shape,
                self.values.len()
            )));
        };
        if items == 0 {
            return Err(Error::parameter("there are no items"));
        }
        if items >= 1 << 31 {
            return Err(Error::too_large(format_args!("there may be at most {} items: {items}", (1u32 << 31) - 1)));
        }
        self.check_graph(items)?;
        self.check_mask(items)?;
        self.check_weights(items)?;
        self.check_values(items)
    }

    fn check_graph(&self, items: usize) -> Result<()> {
        match &self.graph {
            Graph::Grid { .. } if !(2..=3).contains(&self.shape.len()) => Err(Error::parameter(format_args!(
                "a grid has 2 or 3 dimensions, before that of the columns; these items have the shape: {:?}",
                self.shape
            ))),
            Graph::Rows(csr) if csr.items() != items => Err(Error::parameter(format_args!(
                "the graph must have a row for each of {items} items, but has rows: {}",
                csr.items()
            ))),
            Graph::Knn(neighbours) if !(1..=MOST_NEIGHBOURS).contains(neighbours) => Err(Error::parameter(
                format_args!("the number of nearest neighbours must be from 1 to {MOST_NEIGHBOURS}: {neighbours}"),
            )),
            Graph::Grid { .. } | Graph::Rows(_) | Graph::Knn(_) => Ok(()),
        }
    }

    fn check_mask(&self, items: usize) -> Result<()> {
        match &self.mask {
            Some(mask) if mask.len() != items => Err(Error::parameter(format_args!(
                "the mask must have one entry for each of {items} items: {}",
                mask.len()
            ))),
            Some(mask) if !mask.contains(&true) => Err(Error::parameter("the mask leaves no item")),
            Some(_) | None => Ok(()),
        }
    }

    fn check_weights(&self, items: usize) -> Result<()> {
        let Some(weights) = &self.weights else { return Ok(()) };
        if weights.len() != items {
            return Err(Error::parameter(format_args!(
                "there must be one weight an item, {items}, not {}",
                weights.len()
            )));
        }
        let is_wrong = |item: usize| self.takes_part(item) && !(weights[item].is_finite() && weights[item] > 0.0);
        match parallel::first(items, parallel::LEAST, is_wrong) {
            Some(item) => Err(Error::parameter(format_args!(
                "weights must be finite and above 0; that of item {item} is {}",
                weights[item]
            ))),
            None => Ok(()),
        }
    }

    fn check_values(&self, items: usize) -> Result<()> {
        if !matches!(self.values, Values::F4(_) | Values::F8(_)) {
            return Ok(());
        }
        let wrong = |item: usize| (0..self.dimensions).find(|&axis| !self.at(item, axis).is_finite());
        let is_wrong = |item: usize| self.takes_part(item) && wrong(item).is_some();
        match parallel::first(items, parallel::LEAST, is_wrong) {
            Some(item) => {
                let axis = wrong(item).unwrap_or(0);
                Err(Error::parameter(format_args!(
                    "values must be finite, or a mask must leave the item out; item {item}, column {axis} is {}",
                    self.at(item, axis)
                )))
            }
            None => Ok(()),
        }
    }
}

#[cfg(test)]
mod tests;
