//! Encodings of results.

mod labels;
mod npy;

pub use labels::{LabelFormat, write_cut, write_labels, write_snapshots};
pub use npy::npy_header;
