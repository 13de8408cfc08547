//! The query and the JSON part of a job request: what follows the first line is the JSON part.
#![no_main]

use libfuzzer_sys::fuzz_target;
use tesserae_mesh::fuzzing::split;
use tesserae_service::fuzzing;

fuzz_target!(|bytes: &[u8]| {
    let (query, json) = split(bytes, b"\n");
    fuzzing::request(query, json);
});
