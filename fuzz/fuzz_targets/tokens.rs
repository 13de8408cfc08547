//! The file of tokens, and tokens.
#![no_main]

use libfuzzer_sys::fuzz_target;
use tesserae_service::fuzzing;

fuzz_target!(|bytes: &[u8]| {
    fuzzing::tokens(bytes);
});
