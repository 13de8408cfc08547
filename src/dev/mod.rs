//! Tools for the development of the crate, each a command: `sample` makes meshes from nothing, `bench` measures the
//! time of each stage, `evaluate` makes the paper's tables, `plot` draws reports. `random` has the numbers of tests.

pub mod bench;
pub mod evaluate;
mod markdown;
pub mod plot;
mod random;
pub mod sample;

pub use self::random::random;
