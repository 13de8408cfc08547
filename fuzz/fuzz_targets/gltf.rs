//! glTF and GLB, buffers included: what follows a line `===` is the buffer that every URI leads to.
#![no_main]

use libfuzzer_sys::fuzz_target;
use tesserae_mesh::fuzzing;
use tesserae_mesh::mesh::{self, Format, Limits};

fuzz_target!(|bytes: &[u8]| {
    let limits = Limits { max_bytes: 1 << 20, max_faces: 10_000, ..Limits::default() };
    let (json, buffer) = fuzzing::split(bytes, b"\n===\n");
    let format = if bytes.starts_with(b"glTF") { Format::Glb } else { Format::Gltf };
    let _ = mesh::read(if format == Format::Glb { bytes } else { json }, format, &fuzzing::One(buffer), &limits);
});
