//! glTF 2.0.
use super::{Limits, PolygonMesh, Resources};
use crate::error::{Error, Result};
/// Reads a `.glb` file.
pub fn read_binary(_bytes: &[u8], _resources: &dyn Resources, _limits: &Limits) -> Result<PolygonMesh> {
    Err(Error::mesh("under construction"))
}
/// Reads a `.gltf` file.
pub fn read_json(_bytes: &[u8], _resources: &dyn Resources, _limits: &Limits) -> Result<PolygonMesh> {
    Err(Error::mesh("under construction"))
}
/// Refuses what is plainly no GLB.
pub fn check_glb_head(_head: &[u8], _length: Option<u64>) -> Result<()> {
    Ok(())
}
