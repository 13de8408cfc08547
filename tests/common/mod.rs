//! What several tests share: a zoo of meshes, and a plain version of boundary-based clustering to compare with.
#![allow(dead_code, missing_docs, reason = "every test binary uses its own part")]

pub mod oracle;
pub mod zoo;
