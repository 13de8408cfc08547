//! Uploads as multipart/form-data with the boundary `b`, through the whole intake.
#![no_main]

use libfuzzer_sys::fuzz_target;
use tesserae_service::fuzzing;

fuzz_target!(|bytes: &[u8]| {
    fuzzing::form(bytes);
});
