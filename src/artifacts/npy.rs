//! NumPy's array format, `.npy`.

use std::io::{self, Write};

/// Header of an array in NumPy's format, version 1.0, padded to a multiple of 64 bytes as it asks.
pub fn npy_header(kind: &str, shape: &str) -> Vec<u8> {
    const PREFIX: usize = 10;
    let mut dictionary = format!("{{'descr': '{kind}', 'fortran_order': False, 'shape': {shape}, }}");
    while !(PREFIX + dictionary.len() + 1).is_multiple_of(64) {
        dictionary.push(' ');
    }
    dictionary.push('\n');
    let mut header = b"\x93NUMPY\x01\x00".to_vec();
    header.extend_from_slice(&(dictionary.len() as u16).to_le_bytes());
    header.extend_from_slice(dictionary.as_bytes());
    header
}

/// Writes numbers as u32 little-endian, on any host.
pub(super) fn write_u32(out: &mut dyn Write, numbers: &[u32]) -> io::Result<()> {
    let mut bytes = Vec::with_capacity(4 * 16_384);
    for chunk in numbers.chunks(16_384) {
        bytes.clear();
        bytes.extend(chunk.iter().flat_map(|number| number.to_le_bytes()));
        out.write_all(&bytes)?;
    }
    Ok(())
}
