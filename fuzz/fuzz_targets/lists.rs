//! Seeds and weights: npy, JSON and text.
#![no_main]

use libfuzzer_sys::fuzz_target;
use tesserae::fuzzing;

fuzz_target!(|bytes: &[u8]| {
    fuzzing::lists(bytes);
});
