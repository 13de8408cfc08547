//! Hierarchies as files: any bytes are a tree that can be cut, or an error.
#![no_main]

use libfuzzer_sys::fuzz_target;
use tesserae_mesh::hierarchy::stored::{self, Stored};

fuzz_target!(|bytes: &[u8]| {
    if let Ok(tree) = Stored::read(bytes, bytes.len() as u64, 10_000) {
        let mut out = Vec::new();
        tree.write(&mut out).expect("memory takes everything");
    }
    let _ = stored::cut(bytes, bytes.len() as u64, 10_000, 3);
});
