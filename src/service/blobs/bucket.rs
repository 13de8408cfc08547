//! Blobs in a bucket of S3, or of a server that speaks its protocol.
//! `docs/durability.md` has the variables `AWS_…` that say where it is, and with which key it is used.
//!
//! A request is repeated three times within 15 s at the most; then its failure is one of the storage, and the service
//! waits until the bucket answers again ([`Storage`](crate::files::storage::Storage)).

use std::net::IpAddr;
use std::time::Duration;

use object_store::aws::{AmazonS3, AmazonS3Builder, AmazonS3ConfigKey};
use object_store::path::Path;
use object_store::prefix::PrefixStore;
use object_store::{BackoffConfig, ClientConfigKey, ClientOptions, RetryConfig};
use reqwest::Url;
use tesserae_mesh::error::{Error, Result};

pub(super) fn open(name: &str, prefix: &Path) -> Result<PrefixStore<AmazonS3>> {
    let cannot = |error: object_store::Error| {
        Error::parameter(format_args!("the bucket cannot be used (--blobs, AWS_…): {name}: {error}"))
    };
    let builder = AmazonS3Builder::from_env().with_bucket_name(name);
    let of = |key| builder.get_config_value(&key);
    let endpoint = of(AmazonS3ConfigKey::S3Endpoint).or_else(|| of(AmazonS3ConfigKey::Endpoint));
    let allows_http = of(AmazonS3ConfigKey::Client(ClientConfigKey::AllowHttp)).is_some_and(|value| value == "true");
    let is_local = endpoint.as_deref().is_some_and(is_on_this_machine);
    if let Some(endpoint) = endpoint.filter(|url| url.starts_with("http://") && !is_local && !allows_http) {
        return Err(Error::parameter(format_args!(
            "uploads and results would cross the network without encryption: give an https URL in AWS_ENDPOINT_URL, or \
             AWS_ALLOW_HTTP=true beside it; it is {endpoint}"
        )));
    }
    let options = ClientOptions::new()
        .with_allow_http(allows_http || is_local)
        .with_connect_timeout(Duration::from_secs(5))
        // without a byte: a whole answer may take longer, because clients read it at their pace
        .with_read_timeout(Duration::from_secs(30))
        .with_timeout_disabled();
    let retry = RetryConfig {
        backoff: BackoffConfig { max_backoff: Duration::from_secs(2), ..BackoffConfig::default() },
        max_retries: 3,
        retry_timeout: Duration::from_secs(15),
    };
    let bucket = builder.with_client_options(options).with_retry(retry).build().map_err(cannot)?;
    Ok(PrefixStore::new(bucket, prefix.clone()))
}

fn is_on_this_machine(url: &str) -> bool {
    let Ok(url) = Url::parse(url) else { return false };
    let host = url.host_str().unwrap_or_default();
    let address = host.trim_start_matches('[').trim_end_matches(']').parse();
    host == "localhost" || address.is_ok_and(|address: IpAddr| address.to_canonical().is_loopback())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn this_machine_is_known_by_its_addresses() {
        for url in ["http://127.0.0.1:9000", "http://localhost/x", "http://[::1]:1", "https://127.8.8.8"] {
            assert!(is_on_this_machine(url), "{url}");
        }
        for url in ["http://127.0.0.1.example:9000", "http://10.0.0.1", "http://s3", "localhost", ""] {
            assert!(!is_on_this_machine(url), "{url}");
        }
    }
}
