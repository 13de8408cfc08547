//! OBJ: any bytes are a mesh, with the groups of its faces, or an error.
#![no_main]

use libfuzzer_sys::fuzz_target;
use tesserae_mesh::mesh::{self, Format, Limits, NoResources, Source};

fuzz_target!(|bytes: &[u8]| {
    let limits = Limits { max_bytes: 1 << 20, max_faces: 10_000, ..Limits::default() };
    let source = Source { groups: true, ..Source::new(bytes, Format::Obj, &NoResources, &limits) };
    let _ = mesh::open(source, |opened| opened.read());
});
