//! The clustering on the cpu: definitions, proofs, qualities, hierarchies, and labels that stay the same.

#[allow(dead_code, reason = "every test binary uses its own part")]
#[path = "../common/command.rs"]
mod command;
#[path = "../common/mod.rs"]
mod common;

mod boundary;
mod bounds;
mod bridges;
mod connected;
mod cube;
mod density;
mod features;
mod hierarchy;
mod labels;
mod loose;
mod normals;
mod plain;
mod quality;
mod reference;
mod sample;
mod shapes;
mod snapshots;
mod tolerance;
mod trees;
