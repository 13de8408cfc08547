//! The JSON of a glTF file: the parts of it that geometry needs, and whether this reader understands them.
//!
//! Accessors, buffers and meshes are the `gltf` crate's. Nodes are read here because their transforms are wanted in f64.
//! Materials, textures, images, animations and cameras are passed over, so nothing in them can fail or be opened.
//! No reference is followed without a check: each goes through [`lookup`].

use std::collections::BTreeMap;

use gltf::json;
use serde::Deserialize;

use crate::error::{Error, Result};
use crate::mesh::allowance::Allowance;

/// Largest number of JSON values: they take more memory than text, objects the most, which are counted apart.
const MAX_VALUES: usize = 8 << 20;

/// Extensions that change geometry and are read here.
const READ: [&str; 4] =
    ["EXT_mesh_gpu_instancing", "EXT_meshopt_compression", "KHR_mesh_quantization", "KHR_meshopt_compression"];

/// Extensions that do not change geometry: they may be required and are not looked at.
const IRRELEVANT: [&str; 46] = [
    "ADOBE_materials_clearcoat_specular",
    "ADOBE_materials_clearcoat_tint",
    "ADOBE_materials_thin_transparency",
    "AGI_articulations",
    "AGI_stk_metadata",
    "CESIUM_primitive_outline",
    "EXT_instance_features",
    "EXT_lights_ies",
    "EXT_lights_image_based",
    "EXT_mesh_features",
    "EXT_mesh_manifold",
    "EXT_structural_metadata",
    "EXT_texture_astc",
    "EXT_texture_avif",
    "EXT_texture_webp",
    "FB_ngon_encoding",
    "GODOT_single_root",
    "KHR_animation_pointer",
    "KHR_lights_punctual",
    "KHR_materials_anisotropy",
    "KHR_materials_clearcoat",
    "KHR_materials_diffuse_transmission",
    "KHR_materials_dispersion",
    "KHR_materials_emissive_strength",
    "KHR_materials_ior",
    "KHR_materials_iridescence",
    "KHR_materials_pbrSpecularGlossiness",
    "KHR_materials_sheen",
    "KHR_materials_specular",
    "KHR_materials_transmission",
    "KHR_materials_unlit",
    "KHR_materials_variants",
    "KHR_materials_volume",
    "KHR_materials_volume_scatter",
    "KHR_node_hoverability",
    "KHR_node_selectability",
    "KHR_texture_basisu",
    "KHR_texture_transform",
    "KHR_xmp",
    "KHR_xmp_json_ld",
    "MPEG_texture_video",
    "MSFT_packing_normalRoughnessMetallic",
    "MSFT_packing_occlusionRoughnessMetallic",
    "MSFT_texture_dds",
    "NV_materials_mdl",
    "VRMC_materials_mtoon",
];

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

/// A node of the scene graph.
#[derive(Debug, Default, Deserialize)]
pub struct Node {
    /// Name, for people.
    pub name: Option<String>,
    /// Its children.
    #[serde(default)]
    pub children: Vec<u32>,
    /// The mesh it places.
    pub mesh: Option<u32>,
    /// The skin that would deform the mesh.
    pub skin: Option<u32>,
    /// Transform as a matrix, column by column.
    pub matrix: Option<Box<[f64; 16]>>,
    /// Otherwise: translation,
    pub translation: Option<[f64; 3]>,
    /// rotation as a quaternion x, y, z, w,
    pub rotation: Option<[f64; 4]>,
    /// and scale.
    pub scale: Option<[f64; 3]>,
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

#[derive(Debug, Deserialize)]
struct Head {
    asset: Asset,
}

#[derive(Debug, Deserialize)]
#[serde(rename_all = "camelCase")]
struct Asset {
    version: String,
    min_version: Option<String>,
}

impl Document {
    /// Reads the JSON and refuses what this reader does not understand.
    pub fn parse(json: &[u8]) -> Result<Self> {
        let json = json.strip_prefix(b"\xef\xbb\xbf").unwrap_or(json);
        let (values, objects) = count_values(json);
        if values > MAX_VALUES {
            return Err(Error::too_large(format_args!(
                "the glTF JSON may have {MAX_VALUES} values, it has about {values}"
            )));
        }
        Allowance::new(json.len() as u64).check_objects(objects)?;
        // versions come first: another version's JSON does not have the form of this one's
        let head: Head = serde_json::from_slice(json).map_err(unreadable)?;
        head.asset.check()?;
        let document: Self = serde_json::from_slice(json).map_err(unreadable)?;
        document.check_extensions()?;
        Ok(document)
    }

    fn check_extensions(&self) -> Result<()> {
        let unknown = self
            .extensions_required
            .iter()
            .find(|name| !READ.contains(&name.as_str()) && !IRRELEVANT.contains(&name.as_str()));
        match unknown {
            Some(name) => Err(Error::unsupported(format_args!(
                "the glTF file requires an extension that is not supported: {name}"
            ))),
            None => Ok(()),
        }
    }
}

impl Asset {
    fn check(&self) -> Result<()> {
        let wanted = self.min_version.as_ref().unwrap_or(&self.version);
        let known = match self.min_version {
            Some(_) => wanted == "2.0",
            None => wanted.split('.').next() == Some("2"),
        };
        if known {
            return Ok(());
        }
        Err(Error::unsupported(format_args!("only version 2.0 of glTF is read, this file needs {wanted:?}")))
    }
}

/// The element that a reference in the document means; `kind` and `whence` say what refers to what.
pub fn lookup<'a, T>(elements: &'a [T], index: usize, kind: &str, whence: &str) -> Result<&'a T> {
    elements.get(index).ok_or_else(|| {
        Error::mesh(format_args!("{whence} refers to {kind} {index}, but the file has {}", elements.len()))
    })
}

fn unreadable(error: serde_json::Error) -> Error {
    let what = if error.is_eof() { "the glTF JSON is truncated" } else { "the glTF JSON cannot be read" };
    Error::mesh(format_args!("{what}: {error}"))
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
