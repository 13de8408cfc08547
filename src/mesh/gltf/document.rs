//! The JSON of a glTF file: the parts of it that geometry needs, and whether this reader understands them.
//!
//! Accessors, buffers and meshes are the `gltf` crate's. Nodes are read here because their transforms are wanted in
//! f64. Materials, textures, images, animations and cameras are passed over, so nothing in them can fail or be opened.
//! No reference is followed without a check: each goes through [`lookup`].

use std::collections::BTreeMap;

use gltf::json;
use serde::Deserialize;

use super::{extensions, head};
use crate::error::{Error, Result};
use crate::mesh::allowance::Allowance;
use crate::mesh::without_mark;

/// Largest number of JSON values: they take more memory than text, objects the most, which are counted apart.
const MAX_VALUES: usize = 8 << 20;

/// A glTF document.
#[derive(Debug, Deserialize)]
#[serde(rename_all = "camelCase")]
pub struct Document {
    /// Views on buffers with an element type.
    #[serde(default)]
    pub accessors: Vec<json::Accessor>,
    /// Ranges of buffers.
    #[serde(default)]
    pub buffer_views: Vec<json::buffer::View>,
    /// Bytes.
    #[serde(default)]
    pub buffers: Vec<json::Buffer>,
    /// Meshes.
    #[serde(default)]
    pub meshes: Vec<json::Mesh>,
    /// Nodes.
    #[serde(default)]
    pub nodes: Vec<Node>,
    /// Scenes.
    #[serde(default)]
    pub scenes: Vec<Scene>,
    /// The default scene.
    pub scene: Option<u32>,
    #[serde(default)]
    extensions_required: Vec<String>,
}

/// A node of the scene graph. What few nodes have is boxed: a mebibyte has 90,000 nodes.
#[derive(Debug, Default, Deserialize)]
pub struct Node {
    /// Its name.
    pub name: Option<Box<str>>,
    /// Its children.
    #[serde(default)]
    pub children: Box<[u32]>,
    /// The mesh it places.
    pub mesh: Option<u32>,
    /// The skin that would deform the mesh.
    pub skin: Option<u32>,
    /// Transform as a matrix, column by column.
    pub matrix: Option<Box<[f64; 16]>>,
    /// Otherwise: translation,
    pub translation: Option<Box<[f64; 3]>>,
    /// rotation as a quaternion x, y, z, w,
    pub rotation: Option<Box<[f64; 4]>>,
    /// and scale.
    pub scale: Option<Box<[f64; 3]>>,
    /// Extensions.
    #[serde(default)]
    pub extensions: NodeExtensions,
}

/// Extensions of a node.
#[derive(Debug, Default, Deserialize)]
pub struct NodeExtensions {
    /// The mesh is placed many times.
    #[serde(rename = "EXT_mesh_gpu_instancing")]
    pub instancing: Option<Box<Instancing>>,
    /// The node and those below it may not be shown.
    #[serde(rename = "KHR_node_visibility")]
    visibility: Option<Visibility>,
}

impl NodeExtensions {
    /// Whether the node and those below it are not shown.
    pub fn is_hidden(&self) -> bool {
        self.visibility.as_ref().is_some_and(|visibility| visibility.visible == Some(false))
    }
}

/// `KHR_node_visibility`.
#[derive(Debug, Deserialize)]
struct Visibility {
    /// True where it is left out.
    visible: Option<bool>,
}

/// `EXT_mesh_gpu_instancing`.
#[derive(Debug, Deserialize)]
pub struct Instancing {
    /// Accessors with an element an instance, by name: `TRANSLATION`, `ROTATION`, `SCALE` and others.
    pub attributes: BTreeMap<String, u32>,
}

/// A scene.
#[derive(Debug, Default, Deserialize)]
pub struct Scene {
    /// Its root nodes.
    #[serde(default)]
    pub nodes: Vec<u32>,
}

impl Document {
    /// Reads the JSON and refuses what this reader does not understand.
    pub fn parse(json: &[u8]) -> Result<Self> {
        let json = without_mark(json);
        let (values, objects) = count_values(json);
        if values > MAX_VALUES {
            return Err(Error::too_large(format_args!(
                "the glTF JSON may have {MAX_VALUES} values, it has about {values}"
            )));
        }
        Allowance::new(json.len() as u64).check_objects(objects)?;
        // versions come first: another version's JSON does not have the form of this one's
        head::check(json)?;
        let document: Self = serde_json::from_slice(json).map_err(|error| head::unreadable::<Self>(json, error))?;
        extensions::check_required(&document.extensions_required)?;
        Ok(document)
    }
}

/// The element that a reference in the document means; `kind` and `whence` say what refers to what.
pub fn lookup<'a, T>(elements: &'a [T], index: usize, kind: &str, whence: &str) -> Result<&'a T> {
    elements.get(index).ok_or_else(|| {
        Error::mesh(format_args!(
            "{whence} refers to {kind} {index}, but the file has {}, counted from 0",
            elements.len()
        ))
    })
}

/// An upper bound on the number of values in the JSON text, and the number of objects among them.
fn count_values(json: &[u8]) -> (usize, u64) {
    let mut values = 1;
    let mut objects = 0;
    let mut bytes = json.iter();
    while let Some(byte) = bytes.next() {
        match byte {
            b',' | b'[' => values += 1,
            b'{' => {
                values += 1;
                objects += 1;
            }
            b'"' => {
                while let Some(byte) = bytes.next() {
                    match byte {
                        b'"' => break,
                        b'\\' => _ = bytes.next(),
                        _ => {}
                    }
                }
            }
            _ => {}
        }
    }
    (values, objects)
}
