//! Tuning of the cpu device: how long a step takes, and never what it computes.
//!
//! | file | what |
//! |---|---|
//! | [`chunks`] | how much work a thread takes at a time |
//! | [`filter`] | a filter without a branch that depends on the items |
//! | [`face_set`] | one bit a face |
//! | [`stored_bound`] | the bound of a face in 16 bytes |
//!
//! Prefetching is in [`crate::prefetch`], because building a surface uses it too.

pub mod chunks;
pub mod face_set;
pub mod filter;
pub mod stored_bound;
