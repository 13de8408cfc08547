//! Tesserae clusters the faces of polygon meshes, fast and reproducibly.
//!
//! # Bird's-eye view
//!
//! ```text
//! bytes ─ mesh ─→ PolygonMesh ─ surface ─→ Surface ─ cluster (on a device) ─→ labels, Tree, Report ─ output, tree ─→ bytes
//! ```
//!
//! | to change | look in |
//! |---|---|
//! | a mesh format | [`mesh`] |
//! | welding, adjacency, components, the integer lattice, face order | [`surface`] |
//! | what is minimised: sums, proxies, costs, gains | [`energy`] |
//! | an algorithm: its definition, its proof, its driver | [`cluster`] |
//! | how a step is carried out | [`device`]`::cpu`, [`device`]`::gpu` with `shaders/` |
//! | what a job may ask for | [`parameters`] |
//! | what is said about a job | [`report`] |
//! | encodings of labels | [`output`] |
//! | hierarchies: their file, their JSON, cuts, scipy's matrix | [`tree`] |
//! | pictures of reports | [`plot`] |
//! | the paper's tables and figure, measured anew | [`evaluate`] |
//! | what a device takes for each stage | [`mod@bench`] |
//! | one job from bytes to results | [`job`] |
//! | the HTTP service | [`service`] |
//! | the command line | [`cli`] |
//! | meshes made from nothing | [`sample`] |
//! | settings of the allocator | `memory` |
//! | prefetching | `prefetch` |
//! | union-find | `union_find` |
//!
//! # Invariants
//!
//! 1. Labels are a function of the mesh and the parameters only. Everything that decides a label is integer arithmetic
//!    ([`surface`] says how positions become integers); no floating-point sum, hash-map order, thread count or arrival
//!    order takes part.
//! 2. The energy F never rises within a phase. A phase ends when no admissible move is left, or at a limit on
//!    iterations that the caller or quality `fast` sets.
//! 3. Exactly k clusters, none empty, each connected across shared edges unless the caller allows otherwise.
//! 4. Label i belongs to face i of the upload, whatever happens inside.
//! 5. [`cluster`] knows no wgpu type, [`device`] knows no file format, and nothing below [`service`] knows of HTTP.
//! 6. Nothing that input reaches panics.

pub mod bench;
pub mod cli;
pub mod cluster;
pub mod device;
pub mod energy;
pub mod error;
pub mod evaluate;
#[cfg(fuzzing)]
pub mod fuzzing;
pub mod job;
mod markdown;
mod memory;
pub mod mesh;
mod npy;
pub mod output;
pub mod parameters;
pub mod plot;
mod prefetch;
pub mod report;
pub mod sample;
pub mod service;
pub mod surface;
pub mod tree;
mod union_find;

pub use error::{Error, Kind, Result};
