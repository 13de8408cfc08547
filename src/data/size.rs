//! How large points are, as far as the heads of their files say: before memory is taken for them.

use super::{Format, Graph, image, npy, npz};
use crate::error::{Error, Result};

/// How large points are.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Size {
    /// Items, those that a mask leaves out included.
    pub items: u64,
    /// Coordinates of an item.
    pub dimensions: u64,
    /// Neighbours of an item that no file lists, at the most.
    pub neighbours: u64,
    /// Bytes that come of compressed files, at the most.
    pub inflated: u64,
}

impl Size {
    /// Reads the head of a file. `limit` bounds the bytes that may be inflated.
    pub fn of(bytes: &[u8], format: Format, graph: Option<&Graph>, limit: u64) -> Result<Self> {
        if format.is_image() {
            let (width, height) = image::size(bytes)?;
            let items = u64::from(width) * u64::from(height);
            // two bytes a sample of at most four channels
            return Ok(Self { items, dimensions: 5, neighbours: 4, inflated: items.saturating_mul(8) });
        }
        let (shape, inflated) = match format {
            Format::Npz => {
                let (head, inflated) = npz::head_of_points(bytes, limit)?;
                (npy::shape(&head, "array X")?, inflated)
            }
            _ => (npy::shape(bytes, "array of points")?, 0),
        };
        let neighbours = match graph {
            Some(Graph::Grid { full: false }) => 6,
            Some(Graph::Grid { full: true }) => 26,
            Some(Graph::Knn(nearest)) => 2 * u64::from(*nearest),
            Some(Graph::Rows(_)) | None => 2 * u64::from(super::USUAL_NEIGHBOURS),
        };
        let (&dimensions, of_items) = shape.split_last().unwrap_or((&1, &[]));
        let items = of_items.iter().try_fold(1u64, |items, &length| items.checked_mul(length as u64));
        let items = items.ok_or_else(|| {
            Error::too_large(format_args!("there are more items than can be counted: the shape is {shape:?}"))
        })?;
        Ok(Self { items, dimensions: dimensions as u64, neighbours, inflated })
    }
}
