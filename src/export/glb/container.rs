//! The container of a GLB file: a chunk of JSON, and one of bytes that buffer views cut into pieces.

use serde_json::{Value, json};

use super::no_triangles;
use crate::error::{Error, Result};

pub const UNSIGNED_BYTE: u32 = 5121;
pub const UNSIGNED_SHORT: u32 = 5123;
pub const UNSIGNED_INT: u32 = 5125;
pub const FLOAT: u32 = 5126;

/// The target of a view of vertex attributes.
const VERTICES: u32 = 34962;
/// The target of a view of indices.
pub const INDICES: u32 = 34963;

/// Where a view begins: a multiple of the size of every type.
const ALIGNED: usize = 8;

/// A GLB file in the making.
#[derive(Debug, Default)]
pub struct Container {
    bytes: Vec<u8>,
    views: Vec<Value>,
    accessors: Vec<Value>,
}

impl Container {
    /// Adds bytes; gives the number of their view.
    pub fn view(&mut self, bytes: Vec<u8>, target: Option<u32>) -> usize {
        let mut view = json!({ "buffer": 0, "byteOffset": self.bytes.len(), "byteLength": bytes.len() });
        if let Some(target) = target {
            view["target"] = target.into();
        }
        self.bytes.extend(bytes);
        self.bytes.resize(self.bytes.len().next_multiple_of(ALIGNED), 0);
        self.views.push(view);
        self.views.len() - 1
    }

    /// Adds attributes of vertices, `stride` bytes apart; gives the number of their view.
    pub fn vertices(&mut self, bytes: Vec<u8>, stride: u32) -> usize {
        let view = self.view(bytes, Some(VERTICES));
        // needed as soon as several accessors share the view
        self.views[view]["byteStride"] = stride.into();
        view
    }

    /// Adds an accessor; gives its number.
    pub fn accessor(&mut self, accessor: Value) -> usize {
        self.accessors.push(accessor);
        self.accessors.len() - 1
    }

    /// Adds positions in a view of their own; gives their accessor.
    pub fn positions(&mut self, positions: &[[f32; 3]]) -> usize {
        let view = self.vertices(positions.iter().flatten().flat_map(|x| x.to_le_bytes()).collect(), 12);
        self.positions_at(view, 0, positions)
    }

    /// Adds an accessor of positions that begin with vertex `first` of a view.
    pub fn positions_at(&mut self, view: usize, first: usize, positions: &[[f32; 3]]) -> usize {
        let (mut low, mut high) = ([f32::INFINITY; 3], [f32::NEG_INFINITY; 3]);
        for position in positions {
            for axis in 0..3 {
                low[axis] = low[axis].min(position[axis]);
                high[axis] = high[axis].max(position[axis]);
            }
        }
        self.accessor(json!({
            "bufferView": view, "byteOffset": 12 * first, "componentType": FLOAT, "type": "VEC3",
            "count": positions.len(), "min": low.map(f64::from), "max": high.map(f64::from),
        }))
    }

    /// Adds indices of vertices; gives their accessor.
    ///
    /// # Errors
    /// There are none: glTF has no empty accessors.
    pub fn indices(&mut self, indices: &[u32]) -> Result<usize> {
        if indices.is_empty() {
            return Err(no_triangles());
        }
        let view = self.view(indices.iter().flat_map(|x| x.to_le_bytes()).collect(), Some(INDICES));
        Ok(self.accessor(json!({
            "bufferView": view, "componentType": UNSIGNED_INT, "type": "SCALAR", "count": indices.len(),
        })))
    }

    /// The file, with a document that refers to accessors and views.
    ///
    /// # Errors
    /// It does not fit in the 4 GiB of the format.
    pub fn finish(self, mut document: Value) -> Result<Vec<u8>> {
        document["asset"] = json!({ "version": "2.0", "generator": "tesserae" });
        document["scene"] = 0.into();
        document["buffers"] = json!([{ "byteLength": self.bytes.len() }]);
        document["bufferViews"] = self.views.into();
        document["accessors"] = self.accessors.into();
        let mut text = document.to_string().into_bytes();
        text.resize(text.len().next_multiple_of(4), b' ');
        let length = 12 + 8 + text.len() + 8 + self.bytes.len();
        let too_large = |_| {
            Error::too_large(format_args!("a GLB file holds 4 GiB (take ply or vtp), and this one has bytes: {length}"))
        };
        let length = u32::try_from(length).map_err(too_large)?;
        let mut file = Vec::with_capacity(length as usize);
        file.extend(b"glTF");
        file.extend([2, length, text.len() as u32].iter().flat_map(|x| x.to_le_bytes()));
        file.extend(b"JSON");
        file.extend(text);
        file.extend((self.bytes.len() as u32).to_le_bytes());
        file.extend(b"BIN\0");
        file.extend(self.bytes);
        Ok(file)
    }
}
