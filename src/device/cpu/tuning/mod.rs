//! Tuning of the cpu device: how long a step takes, and never what it computes. Prefetching is in [`crate::prefetch`],
//! because building a surface uses it too.

pub mod chunks;
pub mod face_set;
pub mod stored_bound;
