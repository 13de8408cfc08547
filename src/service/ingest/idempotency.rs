//! The `Idempotency-Key` header (draft-ietf-httpapi-idempotency-key-header-07): a client that got no answer repeats its
//! request with the same key, and gets the same job.
//!
//! A key belongs to a tenant and to one request as long as the job is kept: its parameters, format, file names and
//! every byte of its files. Headers about the answer (`Prefer`, `Accept`) do not count.

use axum::http::HeaderMap;
use serde_json::json;
use sha2::{Digest, Sha256};
use tesserae_mesh::error::{Error, Kind, Result};

use crate::store::{Idempotency, Spec};

/// Longest key, in characters.
const MAX_KEY: usize = 255;

/// The key of a request, as it is written: quotes count.
pub(crate) fn key(headers: &HeaderMap) -> Result<Option<String>> {
    let mut values = headers.get_all("idempotency-key").iter();
    let Some(value) = values.next() else { return Ok(None) };
    let key = value.to_str().unwrap_or_default().trim();
    if (1..=MAX_KEY).contains(&key.len()) && values.next().is_none() {
        return Ok(Some(key.to_owned()));
    }
    let message = format_args!("Idempotency-Key must be one string of 1 to {MAX_KEY} printable ASCII characters");
    Err(Error::new(Kind::BadRequest, message))
}

/// The key with what it stands for.
pub(crate) fn idempotency(key: String, spec: &Spec, digests: &[[u8; 32]]) -> Idempotency {
    // the key is the tenant's already, each attempt has its own trace, and the digests cover what the mesh claims
    let spec = Spec { tenant: String::new(), trace_parent: None, ..spec.clone() };
    let request = json!({ "spec": spec, "digests": digests }).to_string();
    let request = Sha256::digest(request).iter().map(|byte| format!("{byte:02x}")).collect();
    Idempotency { key, request }
}

#[cfg(test)]
mod tests {
    use axum::http::HeaderValue;

    use super::*;
    use crate::store::tests::new_job;

    fn of(values: &[&str]) -> Result<Option<String>> {
        let mut headers = HeaderMap::new();
        for value in values {
            headers.append("idempotency-key", HeaderValue::from_str(value).expect("a value"));
        }
        key(&headers)
    }

    #[test]
    fn a_key_is_one_short_string() {
        assert_eq!(of(&[]), Ok(None));
        for value in ["\"8e03978e\"", "8e03978e", r#""a\"b\\c d""#] {
            assert_eq!(of(&[value]), Ok(Some(value.to_owned())));
        }
        let long = "x".repeat(256);
        for values in [&[""][..], &["ü"], &["a", "a"], &[&long]] {
            assert_eq!(of(values).expect_err("no key").kind, Kind::BadRequest, "{values:?}");
        }
        assert!(of(&[&long[1..]]).is_ok());
    }

    #[test]
    fn any_other_byte_or_parameter_is_another_request() {
        let spec = new_job().spec;
        let digest = |spec: &Spec, digests: &[[u8; 32]]| idempotency("k".into(), spec, digests).request;
        let first = digest(&spec, &[[0; 32]]);
        let another_trace = Spec { tenant: "other".into(), trace_parent: Some("x".into()), ..spec.clone() };
        assert_eq!(digest(&another_trace, &[[0; 32]]), first);
        assert_ne!(digest(&spec, &[[1; 32]]), first);
        assert_ne!(digest(&spec, &[[0; 32], [0; 32]]), first);
        let mut other = spec.clone();
        other.parameters.seed = 1;
        assert_ne!(digest(&other, &[[0; 32]]), first);
        assert_ne!(digest(&Spec { file_name: Some("x".into()), ..spec }, &[[0; 32]]), first);
    }
}
