//! NumPy's array format, `.npy`.

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
