//! The audit log: which tenant, by which token and from which address, changed what; and which requests were denied.
//!
//! Lines have the target `tesserae::audit`, so that they can be kept apart from the access log, which may be sampled.
//! They name tokens by their id, never by their secret.

use std::fmt::Display;

use tesserae_mesh::error::Kind;

use crate::guard::access::Caller;
use crate::ops::trace::Origin;
use crate::settings::logging::AUDIT;

/// What a tenant did to a job.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Action {
    /// A job was made, of an upload of this many bytes.
    Accepted(u64),
    /// A request came again that had made the job (`Idempotency-Key`).
    Repeated,
    /// A job was cancelled, or is to be.
    Cancelled,
    /// A job was deleted with its results.
    Deleted,
    /// A job that was given up runs again.
    Retried,
}

/// Writes that `caller` did something to a job.
pub(crate) fn record(action: Action, caller: &Caller, job: impl Display) {
    let (name, bytes) = match action {
        Action::Accepted(bytes) => ("accepted", Some(bytes)),
        Action::Repeated => ("asked for again", None),
        Action::Cancelled => ("asked to cancel", None),
        Action::Deleted => ("deleted", None),
        Action::Retried => ("retried", None),
    };
    let origin = caller.origin.as_ref();
    tracing::info!(
        target: AUDIT,
        parent: None,
        job = %job,
        bytes,
        tenant = caller.tenant.as_ref().map(|tenant| tenant.name.as_str()),
        token = caller.token_id(),
        client = origin.map(|origin| tracing::field::display(origin.client)),
        request = origin.map(|origin| origin.request.as_str()),
        trace = origin.map(|origin| origin.trace.trace()),
        "{name}"
    );
}

/// Writes that a request was denied.
pub(crate) fn denied(kind: Kind, method: impl Display, path: &str, origin: Option<&Origin>) {
    tracing::info!(
        target: AUDIT,
        parent: None,
        reason = kind.slug(),
        method = %method,
        path,
        client = origin.map(|origin| tracing::field::display(origin.client)),
        request = origin.map(|origin| origin.request.as_str()),
        trace = origin.map(|origin| origin.trace.trace()),
        "denied"
    );
}
