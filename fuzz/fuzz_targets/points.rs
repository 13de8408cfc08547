//! Points: npy, npz, sparse matrices, and arrays in an archive that is sound.
#![no_main]

use libfuzzer_sys::fuzz_target;
use tesserae_mesh::fuzzing;

fuzz_target!(|bytes: &[u8]| {
    fuzzing::points(bytes);
});
