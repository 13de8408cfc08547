//! Which required extensions a file may have.
//!
//! A file requires an extension when it cannot be loaded without it. For a viewer that is true of a texture format too;
//! here only geometry counts: where vertices are, which of them make faces, and where meshes are placed. An extension
//! that cannot change any of these never refuses a file. One that is not known may change them, and ignoring it would
//! cluster another mesh than the file describes, so it does.

use crate::error::{Error, Quoted, Result};

/// The extension that replaces a primitive's accessors by compressed bytes.
pub const DRACO: &str = "KHR_draco_mesh_compression";

/// Extensions that change geometry and are read here.
const READ: [&str; 5] = [
    "EXT_mesh_gpu_instancing",
    "EXT_meshopt_compression",
    "KHR_mesh_quantization",
    "KHR_meshopt_compression",
    "KHR_node_visibility",
];

/// The second word of a name `VENDOR_word_…` of extensions about what is not geometry.
const HARMLESS_WORDS: [&str; 14] = [
    "animation",
    "audio",
    "collision",
    "environment",
    "image",
    "interactivity",
    "lights",
    "materials",
    "packing",
    "physics",
    "rigid",
    "techniques",
    "texture",
    "xmp",
];

/// Other extensions that cannot change geometry: metadata, selection, outlines, articulations, avatars, shapes of
/// colliders, baked light.
const HARMLESS: [&str; 22] = [
    "AGI_articulations",
    "AGI_stk_metadata",
    "CESIUM_primitive_outline",
    "EXT_instance_features",
    "EXT_lightmap",
    "EXT_mesh_features",
    "EXT_mesh_manifold",
    "EXT_structural_metadata",
    "FB_geometry_metadata",
    "FB_ngon_encoding",
    "GODOT_single_root",
    "GRIFFEL_bim_data",
    "KHR_implicit_shapes",
    "KHR_node_hoverability",
    "KHR_node_selectability",
    "KHR_xmp",
    "MOZ_lightmap",
    "MPEG_media",
    "VRM",
    "VRMC_node_constraint",
    "VRMC_springBone",
    "VRMC_vrm",
];

/// Refuses a file that requires an extension which changes geometry, or may, and is not read here.
pub fn check_required(required: &[String]) -> Result<()> {
    match required.iter().find(|name| !READ.contains(&name.as_str()) && !is_harmless(name)) {
        None => Ok(()),
        Some(name) if name == DRACO => Err(Error::unsupported(format_args!(
            "the glTF file is compressed with Draco, which is not read: export it without compression, or compressed \
             with meshopt (extensionsRequired: {})",
            Quoted(name)
        ))),
        Some(name) => Err(Error::unsupported(format_args!(
            "the glTF file requires an extension that is not read and may change its geometry: export it without, \
             or take it out of extensionsRequired if it does not concern geometry: {}",
            Quoted(name)
        ))),
    }
}

/// Whether an extension cannot change geometry.
fn is_harmless(name: &str) -> bool {
    let mut words = name.split('_');
    let (vendor, word) = (words.next().unwrap_or_default(), words.next().unwrap_or_default());
    let is_vendor = !vendor.is_empty() && vendor.bytes().all(|byte| byte.is_ascii_uppercase() || byte.is_ascii_digit());
    HARMLESS.contains(&name) || is_vendor && HARMLESS_WORDS.contains(&word)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn only_what_may_change_geometry_is_refused() {
        for name in [
            "KHR_texture_basisu",
            "KHR_texture_ktx",
            "GOOGLE_texture_basis",
            "EXT_texture_webp",
            "MSFT_texture_dds",
            "KHR_techniques_webgl",
            "KHR_materials_unlit",
            "KHR_materials_of_next_year",
            "KHR_lights_punctual",
            "EXT_lights_image_based",
            "KHR_animation_pointer",
            "KHR_xmp_json_ld",
            "MSFT_packing_normalRoughnessMetallic",
            "VRMC_materials_mtoon",
            "EXT_mesh_features",
            "MPEG_media",
            "FB_geometry_metadata",
            "VRM",
            "VRMC_vrm",
            "KHR_physics_rigid_bodies",
            "OMI_physics_body",
            "OMI_physics_shape",
            "KHR_implicit_shapes",
            "KHR_collision_shapes",
            "MSFT_collision",
            "KHR_rigid_bodies",
            "KHR_interactivity",
            "EXT_lightmap",
            "MOZ_lightmap",
            "GRIFFEL_bim_data",
            "EXT_mesh_gpu_instancing",
            "KHR_node_visibility",
        ] {
            assert_eq!(check_required(&[name.to_owned()]), Ok(()), "{name}");
        }
        for name in [
            "KHR_draco_mesh_compression",
            "KHR_mesh_of_next_year",
            "EXT_mesh_primitive_restart",
            "MSFT_lod",
            "MPEG_mesh_linking",
            "VENDOR_unheard_of",
            "materials",
            "_texture_x",
            "",
        ] {
            let error = check_required(&["KHR_materials_unlit".to_owned(), name.to_owned()]).expect_err("refused");
            assert!(error.message.contains(&Quoted(name).to_string()), "{error}");
        }
    }
}
