//! Hostile input costs processor time in proportion to its bytes, in every parser and at every route.
//!
//! `inputs` lists what is known to be expensive; a new one is a line there.

mod files;
mod inputs;
mod make;
mod measure;
mod routes;
