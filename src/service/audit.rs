//! The audit log: which tenant, by which token and from which address, changed what; and which requests were denied.
//!
//! Lines have the target `tesserae::audit`, so that they can be kept apart from the access log, which may be sampled.
//! They name tokens by their id, never by their secret.

use std::fmt::Display;

use super::access::Caller;
use super::logging::AUDIT;
use super::trace::Origin;
use crate::error::Kind;

/// What a tenant did to a job, or the operator to a worker.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Action {
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
    /// A worker claims no more jobs.
    Drained,
    /// It claims jobs again.
    Resumed,
}

/// Writes that `caller` did something to a job or a worker, which the line names in the field of that name.
pub(super) fn record(action: Action, caller: &Caller, of: impl Display) {
    let (name, bytes) = match action {
        Action::Accepted(bytes) => ("accepted", Some(bytes)),
        Action::Repeated => ("asked for again", None),
        Action::Cancelled => ("asked to cancel", None),
        Action::Deleted => ("deleted", None),
        Action::Retried => ("retried", None),
        Action::Drained => ("drained", None),
        Action::Resumed => ("resumed", None),
    };
    let is_worker = matches!(action, Action::Drained | Action::Resumed);
    let origin = caller.origin.as_ref();
    tracing::info!(
        target: AUDIT,
        parent: None,
        job = (!is_worker).then(|| tracing::field::display(&of)),
        worker = is_worker.then(|| tracing::field::display(&of)),
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
pub(super) fn denied(kind: Kind, method: impl Display, path: &str, origin: Option<&Origin>) {
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
