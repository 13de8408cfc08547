//! Work away from the runtime.

use tesserae_mesh::error::{Error, Result};

/// Runs work where blocking is allowed.
pub(crate) async fn blocking<T: Send + 'static>(work: impl FnOnce() -> T + Send + 'static) -> Result<T> {
    tokio::task::spawn_blocking(work)
        .await
        .map_err(|error| Error::internal(format_args!("work on a file did not end: {error}")))
}
