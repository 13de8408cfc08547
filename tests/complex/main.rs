//! How clusters meet and the remesh of their labels, against checks that share no code with them.

#[path = "../common/mod.rs"]
mod common;

mod boundaries;
mod checker;
mod labels;
mod remesh;
mod threads;
