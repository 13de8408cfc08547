//! Results as responses: what is stored, and what is made of it on request. Handlers use these, and not the other way
//! round.

mod checked;
pub(crate) mod derived;
pub(crate) mod encoded;
pub(crate) mod hierarchy;
pub(crate) mod labels;
pub(crate) mod snapshots;
pub(crate) mod stored;
