//! The cryptography of connections that the service opens, as to webhooks and to the database.

/// Chooses it for the process, once; what is chosen already stays.
pub(crate) fn prepare() {
    // An error says that it was chosen before.
    let _ = rustls::crypto::ring::default_provider().install_default();
}
