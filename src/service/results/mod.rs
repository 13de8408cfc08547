//! Results as responses: what is stored, and what is made of it on request. Handlers use these, and not the other way
//! round.

mod body;
mod checked;
pub(super) mod derived;
pub(super) mod encoded;
pub(super) mod hierarchy;
pub(super) mod labels;
pub(super) mod snapshots;
pub(super) mod stored;
