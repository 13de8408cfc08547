//! What a hierarchy file says about where it comes from.

use serde::{Deserialize, Serialize};
use serde_json::{Map, Value};

/// Where a hierarchy comes from.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Header {
    /// Version of the program that made it.
    #[serde(rename = "tesserae")]
    pub version: String,
    /// The algorithm, as in parameters.
    pub algorithm: String,
    /// The parameters it ran with, defaults filled in.
    pub parameters: Map<String, Value>,
    /// The mesh: `format`, `vertices`, `faces`, `components`.
    pub input: Value,
}

impl Header {
    /// Connected components of what was clustered, where the header says.
    pub fn components(&self) -> Option<u64> {
        match self.parameters.get("bridge_components") {
            Some(Value::Bool(true)) => Some(1),
            _ => self.input.get("components").and_then(Value::as_u64),
        }
    }

    /// The shape of points, if it is that of this number of items.
    pub fn shape_of(&self, items: usize) -> Option<Vec<usize>> {
        let lengths = self.input.get("shape")?.as_array()?.iter();
        let shape: Vec<usize> = lengths.map(|length| length.as_u64()?.try_into().ok()).collect::<Option<_>>()?;
        let product = shape.iter().try_fold(1usize, |product, &length| product.checked_mul(length));
        (!shape.is_empty() && product == Some(items)).then_some(shape)
    }
}
