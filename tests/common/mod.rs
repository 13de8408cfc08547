//! What several tests share: a zoo of meshes.
#![allow(dead_code, missing_docs, reason = "every test binary uses its own part")]

pub mod zoo;
