//! Wavefront OBJ.
use super::{Limits, PolygonMesh};
use crate::error::{Error, Result};
/// Reads an OBJ file.
pub fn read(_bytes: &[u8], _limits: &Limits) -> Result<PolygonMesh> {
    Err(Error::mesh("under construction"))
}
