//! gpu
pub mod kernels;
pub mod layout;
