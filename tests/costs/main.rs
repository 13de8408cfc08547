//! Hostile input costs processor time in proportion to its bytes, in every parser and at every route.
//!
//! `inputs` lists what is known to be expensive; a new one is a line there. `make costs` runs these tests: the bounds
//! are those of code with some optimisation.

mod files;
mod inputs;
mod make;
mod measure;
mod routes;
