//! NumPy's archives of arrays, `.npz`, and the header of one array, `.npy`.

use std::io::{self, Write};

use super::archive::Archive;

/// An array.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Array {
    /// As NumPy writes it: `<u4`.
    kind: String,
    shape: Vec<usize>,
    bytes: Vec<u8>,
}

impl Array {
    /// u8 numbers.
    pub fn u8(shape: &[usize], numbers: Vec<u8>) -> Self {
        Self { kind: "|u1".to_owned(), shape: shape.to_vec(), bytes: numbers }
    }

    /// u16 numbers.
    pub fn u16(shape: &[usize], numbers: &[u16]) -> Self {
        Self::of("<u2", shape, numbers.iter().flat_map(|x| x.to_le_bytes()))
    }

    /// u32 numbers.
    pub fn u32(shape: &[usize], numbers: &[u32]) -> Self {
        Self::of("<u4", shape, numbers.iter().flat_map(|x| x.to_le_bytes()))
    }

    /// i32 numbers.
    pub fn i32(shape: &[usize], numbers: &[i32]) -> Self {
        Self::of("<i4", shape, numbers.iter().flat_map(|x| x.to_le_bytes()))
    }

    /// i64 numbers.
    pub fn i64(shape: &[usize], numbers: &[i64]) -> Self {
        Self::of("<i8", shape, numbers.iter().flat_map(|x| x.to_le_bytes()))
    }

    /// f64 numbers.
    pub fn f64(shape: &[usize], numbers: &[f64]) -> Self {
        Self::of("<f8", shape, numbers.iter().flat_map(|x| x.to_le_bytes()))
    }

    /// One string of bytes, without dimensions.
    pub fn bytes(text: &[u8]) -> Self {
        Self { kind: format!("|S{}", text.len()), shape: Vec::new(), bytes: text.to_vec() }
    }

    fn of(kind: &str, shape: &[usize], bytes: impl Iterator<Item = u8>) -> Self {
        Self { kind: kind.to_owned(), shape: shape.to_vec(), bytes: bytes.collect() }
    }

    /// The array as a file.
    fn npy(&self) -> Vec<u8> {
        let shape: Vec<String> = self.shape.iter().map(usize::to_string).collect();
        let shape = match shape.as_slice() {
            [only] => format!("({only},)"),
            shape => format!("({})", shape.join(", ")),
        };
        let mut bytes = npy_header(&self.kind, &shape);
        bytes.extend_from_slice(&self.bytes);
        bytes
    }
}

/// Writes an archive of named arrays.
pub fn write(out: &mut dyn Write, arrays: &[(&str, Array)]) -> io::Result<()> {
    let mut archive = Archive::new(out);
    for (name, array) in arrays {
        archive.add(&format!("{name}.npy"), &array.npy())?;
    }
    archive.finish()
}

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

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn arrays_have_their_kinds_and_shapes() {
        let header = |array: &Array| String::from_utf8_lossy(&array.npy()[10..120]).into_owned();
        let matrix = Array::f64(&[2, 3], &[0.0; 6]);
        assert!(header(&matrix).starts_with("{'descr': '<f8', 'fortran_order': False, 'shape': (2, 3), }"));
        assert!(header(&Array::u16(&[1], &[7])).contains("'<u2', 'fortran_order': False, 'shape': (1,),"));
        let text = Array::bytes(b"csr");
        assert!(header(&text).contains("'|S3', 'fortran_order': False, 'shape': (),"));
        assert_eq!(text.npy().len(), 128 + 3);
    }
}
