//! Numbers of OBJ, PLY and STL: what is read is what the standard library reads.
#![no_main]

use libfuzzer_sys::fuzz_target;
use tesserae_mesh::fuzzing;

fuzz_target!(|bytes: &[u8]| {
    fuzzing::number(bytes);
});
