//! Tesserae clusters the faces of polygon meshes, fast and reproducibly. This crate is the engine; `src/service` is the
//! HTTP service, `src/cli` the program, and `python/` the Python package.
//!
//! The algorithms are those of the paper "Parallel Mesh Clustering"; `P§3.2` is its section 3.2. `docs/glossary.md`
//! defines each term and says where it comes from.
//!
//! # Bird's-eye view
//!
//! ```text
//! bytes ─ mesh ─→ PolygonMesh ─ surface ─→ Surface ─ cluster (on a device) ─→ labels, Tree ─ artifacts ─→ bytes
//! ```
//!
//! A module imports only modules above it in this table; `tests/architecture` checks that.
//!
//! | module | what is there |
//! |---|---|
//! | [`mod@error`] | the one error type; names of parameters in messages |
//! | [`mesh`] | formats of meshes, read into polygons |
//! | [`energy`] | what is minimised: sums, proxies, costs, gains; `shaders/energy/` is its WGSL |
//! | [`surface`] | welding, adjacency, components, the integer lattice, face order, coarser graphs |
//! | [`data`] | points of any number of coordinates (P§8): readers, neighbours, the lattice, order |
//! | [`complex`] | how clusters meet: cells, arcs, junctions; boundaries, graph, cluster table |
//! | [`remesh`] | a triangle mesh with a vertex a cluster |
//! | [`device`] | the steps of algorithms: `plain` defines them, `cpu` and `gpu` (with `shaders/`) are in use |
//! | [`hierarchy`] | hierarchies: their file, their JSON, cuts, scipy's matrix |
//! | [`cluster`] | the algorithms: their definitions, proofs and drivers |
//! | [`shapes`] | planes, spheres, cylinders and cones in place of centres: energies, fits, merges, moves |
//! | [`parameters`] | what a job may ask for |
//! | [`report`] | what is said about a job |
//! | [`export`] | formats of geometry, written |
//! | [`artifacts`] | outputs: one table of what a job can be written as |
//! | [`job`] | one job from bytes to results |
//! | [`dev`] | tools: meshes made from nothing, time of each stage, the paper's tables, pictures; numbers of tests |
//!
//! Below all of them: `union_find`, `power`, `parallel` and `prefetch`. The feature `gpu` has the device of that name
//! (wgpu); without it, everything else works on the cpu.
//!
//! # Where to begin
//!
//! | question | answer |
//! |---|---|
//! | what a boundary iteration is (P§3.2) | definition, proof: [`cluster::flat`]; as code: [`device::plain::iterate`] |
//! | the same on the cpu | `BoundaryPhase::moves` in `device/cpu/boundary.rs`; [`device::cpu`] has the reading order |
//! | the same on the gpu | `boundary_propose`, `boundary_apply` and `proxies_fit` in `shaders/`; [`device::gpu`] |
//! | what connected moves are | [`mod@cluster::connected::settle`]; as code: [`device::plain::ConnectedMoves`] |
//! | what a merge costs (P§6) | `merge_cost` in `energy/cvd.rs` and `shaders/energy/cvd.wgsl` |
//! | which merge is next (P§5.4) | the order: [`device::dual_edge`]; the rounds: [`cluster::hierarchy`] |
//! | from a label to an answer | [`job::finish()`]; `service/work/pipeline/stages.rs`, `service/http/api/outputs.rs` |
//! | what a new mesh format needs | `mesh/format.rs` says it; a reader gives a [`mesh::PolygonMesh`] |
//! | what a new energy needs | [`energy`] |
//! | what a new kernel needs | [`device::gpu::kernels`] |
//! | what a new route or setting needs | `service/lib.rs` |
//!
//! # Invariants
//!
//! 1. Labels are a function of the mesh and the parameters only. Everything that decides a label is integer arithmetic
//!    ([`surface`] says how positions become integers); no floating-point sum, hash-map order, thread count or arrival
//!    order takes part.
//! 2. The energy F never rises within a phase. A phase ends when no admissible move is left, or at a limit on
//!    iterations that the caller or quality `fast` sets, or at a bound on work that scans do not reach.
//! 3. Exactly k clusters, none empty, each connected across shared edges unless the caller allows otherwise.
//! 4. Label i belongs to face i of the upload, whatever happens inside.
//! 5. [`cluster`] knows no wgpu type, [`device`] knows no file format, and this crate knows nothing of HTTP.
//! 6. Nothing that input reaches panics.

pub mod artifacts;
pub mod cluster;
pub mod complex;
pub mod data;
pub mod dev;
pub mod device;
pub mod energy;
pub mod error;
pub mod export;
#[cfg(any(fuzzing, test))]
pub mod fuzzing;
pub mod hierarchy;
pub mod job;
pub mod mesh;
mod parallel;
pub mod parameters;
mod power;
mod prefetch;
pub mod remesh;
pub mod report;
pub mod shapes;
pub mod surface;
mod union_find;

pub use error::{Error, Kind, Result};
