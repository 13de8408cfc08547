//! Headers that are read by hand: traceparent, Range, If-None-Match, Accept, Prefer, webhook URLs.
#![no_main]

use libfuzzer_sys::fuzz_target;
use tesserae_service::fuzzing;

fuzz_target!(|bytes: &[u8]| {
    fuzzing::headers(bytes);
});
