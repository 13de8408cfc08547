//! The gpu device against the cpu: the same labels, counts of dispatches, kernels against the host's code, failures.

#[path = "../common/mod.rs"]
mod common;

mod axes;
mod counts;
mod dual_edges;
mod equals_cpu;
mod failures;
mod hierarchy;
mod oracle;
mod pages;
mod shader_layout;
mod shapes;
