//! OFF: any bytes are a mesh or an error.
#![no_main]

use libfuzzer_sys::fuzz_target;
use tesserae_mesh::mesh::{self, Format, Limits, NoResources};

fuzz_target!(|bytes: &[u8]| {
    let limits = Limits { max_bytes: 1 << 20, max_faces: 10_000, ..Limits::default() };
    let _ = mesh::read(bytes, Format::Off, &NoResources, &limits);
});
