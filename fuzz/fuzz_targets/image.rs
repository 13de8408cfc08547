//! Images: png and jpeg.
#![no_main]

use libfuzzer_sys::fuzz_target;
use tesserae_mesh::data::image;

fuzz_target!(|bytes: &[u8]| {
    if let Ok(decoded) = image::decode(bytes, 1 << 16, 1 << 24) {
        let set = image::superpixels(&decoded, None, 9, 10.0).expect("what is decoded has as many samples as it says");
        let _ = set.check();
    }
});
