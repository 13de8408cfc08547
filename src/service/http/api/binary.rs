//! Bodies of bytes, for `openapi.yaml`.

use utoipa::ToSchema;

/// Bytes.
#[derive(ToSchema)]
#[schema(value_type = String, format = Binary)]
#[expect(dead_code, reason = "describes bodies for openapi.yaml")]
pub(crate) struct Binary(String);
