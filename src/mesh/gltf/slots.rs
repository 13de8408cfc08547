//! Elements at equal distances in a buffer view, all of them known to be there.

use gltf::json::accessor::ComponentType;

use super::buffers::View;
use crate::error::{Error, Result};

/// Elements at equal distances.
#[derive(Debug, Clone, Copy)]
pub struct Slots<'b> {
    /// The bytes from the first element on.
    pub bytes: &'b [u8],
    /// Bytes from one element to the next.
    pub stride: usize,
    /// Number of elements.
    pub count: usize,
}

impl<'b> Slots<'b> {
    /// `count` elements of `size` bytes from `offset` on.
    pub fn new(view: View<'b>, offset: u64, size: usize, count: u64, whence: &str) -> Result<Self> {
        let stride = view.stride.unwrap_or(size);
        if stride < size {
            return Err(Error::mesh(format_args!(
                "{whence} has elements of {size} bytes in a bufferView of a smaller byteStride: {stride}"
            )));
        }
        let length = view.bytes.len() as u64;
        let end = match count {
            0 => Some(offset),
            _ => (count - 1)
                .checked_mul(stride as u64)
                .and_then(|last| last.checked_add(offset))
                .and_then(|last| last.checked_add(size as u64)),
        };
        if end.is_none_or(|end| end > length) {
            return Err(Error::mesh(format_args!(
                "{whence} ends beyond its bufferView, which has {length} bytes: \
                 byteOffset {offset}, byteStride {stride}, count {count}"
            )));
        }
        Ok(Self { bytes: &view.bytes[offset as usize..], stride, count: count as usize })
    }

    /// The bytes from element `index` on.
    #[inline]
    pub fn from(&self, index: usize) -> &'b [u8] {
        &self.bytes[index * self.stride..]
    }

    /// Element `index` as an unsigned integer.
    #[inline]
    pub fn integer(&self, index: usize, kind: ComponentType) -> u32 {
        let bytes = self.from(index);
        match kind {
            ComponentType::U8 => u32::from(bytes[0]),
            ComponentType::U16 => u32::from(u16::from_le_bytes(part(bytes, 0))),
            ComponentType::U32 => u32::from_le_bytes(part(bytes, 0)),
            // no type of an index: `is_index` and the type of sparse indices see to it
            ComponentType::I8 | ComponentType::I16 | ComponentType::F32 => 0,
        }
    }

    /// All elements as unsigned integers.
    pub fn integers(&self, kind: ComponentType) -> Vec<u32> {
        // the common cases: back to back, at the speed of memory
        match (kind, self.stride) {
            (ComponentType::U32, 4) => {
                self.bytes.as_chunks().0[..self.count].iter().map(|&b| u32::from_le_bytes(b)).collect()
            }
            (ComponentType::U16, 2) => {
                self.bytes.as_chunks().0[..self.count].iter().map(|&b| u32::from(u16::from_le_bytes(b))).collect()
            }
            _ => (0..self.count).map(|index| self.integer(index, kind)).collect(),
        }
    }
}

/// The `axis`-th component of an element, of as many bytes as `SIZE`.
#[inline]
pub fn part<const SIZE: usize>(element: &[u8], axis: usize) -> [u8; SIZE] {
    let bytes = element.get(axis * SIZE..).and_then(|bytes| bytes.first_chunk());
    bytes.copied().unwrap_or([0; SIZE])
}
