//! Accessors: typed elements in buffer views, some of them replaced one by one.
//!
//! Opening an accessor compares everything it claims with the bytes that are there, so that reading it cannot fail but
//! for sparse indices, and a claim costs nothing before it is believed.

use gltf::json::accessor::{ComponentType, Type};
use gltf::json::validation::Checked;

use super::buffers::{Buffers, View};
use crate::error::{Error, Result};

/// Elements that an accessor without a buffer view, which takes them from nowhere, may have however small the file is.
const FREE_ZEROS: u64 = 1 << 16;

/// An accessor whose bytes are there.
#[derive(Debug)]
pub struct Elements<'b> {
    /// Its index in the document.
    pub index: usize,
    /// Number of elements.
    pub count: usize,
    /// Type of each component.
    pub component: ComponentType,
    /// Components of an element.
    pub components: usize,
    /// Whether integers stand for 0 … 1 or −1 … 1.
    pub normalized: bool,
    /// The elements; zeros where there are none.
    base: Option<Slots<'b>>,
    /// Those that are replaced: which, and by what.
    sparse: Option<Sparse<'b>>,
}

#[derive(Debug)]
struct Sparse<'b> {
    indices: Vec<u32>,
    values: Slots<'b>,
}

/// Elements at equal distances.
#[derive(Debug, Clone, Copy)]
struct Slots<'b> {
    bytes: &'b [u8],
    stride: usize,
    size: usize,
    count: usize,
}

impl<'b> Slots<'b> {
    /// `count` elements of `size` bytes from `offset` on.
    fn new(view: View<'b>, offset: u64, size: usize, count: u64, whence: &str) -> Result<Self> {
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
        Ok(Self { bytes: &view.bytes[offset as usize..], stride, size, count: count as usize })
    }

    /// Calls `visit` for each element.
    #[inline]
    fn each<const SIZE: usize>(&self, mut visit: impl FnMut(usize, &[u8; SIZE])) {
        if self.stride == SIZE {
            let elements = self.bytes.as_chunks::<SIZE>().0;
            for (index, element) in elements.iter().take(self.count).enumerate() {
                visit(index, element);
            }
            return;
        }
        for (index, element) in self.bytes.chunks(self.stride).take(self.count).enumerate() {
            if let Some(element) = element.first_chunk() {
                visit(index, element);
            }
        }
    }
}

impl<'b> Elements<'b> {
    /// Opens accessor `index`, which `whence` refers to.
    pub fn open(buffers: &'b Buffers<'_>, index: usize, whence: &str) -> Result<Self> {
        let accessor = buffers.document().accessor(index, whence)?;
        let me = format!("accessor {index}");
        let (Checked::Valid(component), Checked::Valid(shape)) = (accessor.component_type, accessor.type_) else {
            return Err(Error::mesh(format_args!("{me} has an unknown componentType or type")));
        };
        let component = component.0;
        let components = match shape {
            Type::Scalar => 1,
            Type::Vec2 => 2,
            Type::Vec3 => 3,
            Type::Vec4 => 4,
            Type::Mat2 | Type::Mat3 | Type::Mat4 => {
                return Err(Error::mesh(format_args!("{me} holds matrices ({whence})")));
            }
        };
        let size = component.size() * components;
        let count = accessor.count.0;
        let offset = accessor.byte_offset.map_or(0, |offset| offset.0);
        let base = match accessor.buffer_view {
            Some(view) => {
                let view = buffers.view(view.value(), &me)?;
                Some(Slots::new(view, offset, size, count, &me)?)
            }
            None => {
                if accessor.sparse.is_none() {
                    return Err(Error::mesh(format_args!("{me} has neither a bufferView nor sparse values")));
                }
                let most = buffers.bytes().max(FREE_ZEROS);
                if count > most {
                    return Err(Error::mesh(format_args!(
                        "{me} has no bufferView, and may then have {most} elements: {count}"
                    )));
                }
                None
            }
        };
        let sparse = match &accessor.sparse {
            Some(sparse) => {
                let replaced = sparse.count.0;
                if replaced > count {
                    return Err(Error::mesh(format_args!("{me} has {count} elements, but replaces more: {replaced}")));
                }
                let Checked::Valid(kind) = sparse.indices.component_type else {
                    return Err(Error::mesh(format_args!("the sparse indices of {me} have an unknown componentType")));
                };
                let open = |view: usize, offset: u64, size: usize, what: &str| {
                    let me = format!("sparse {what} of {me}");
                    let view = View { stride: None, ..buffers.view(view, &me)? };
                    Slots::new(view, offset, size, replaced, &me)
                };
                let (indices, values) = (&sparse.indices, &sparse.values);
                let slots = open(indices.buffer_view.value(), indices.byte_offset.0, kind.0.size(), "indices")?;
                let values = open(values.buffer_view.value(), values.byte_offset.0, size, "values")?;
                let indices = integers(&slots, kind.0);
                check_sparse(&indices, count, &me)?;
                Some(Sparse { indices, values })
            }
            None => None,
        };
        Ok(Self { index, count: count as usize, component, components, normalized: accessor.normalized, base, sparse })
    }

    /// Calls `visit` for every element as numbers, those that are replaced twice, the second time with what counts.
    /// There must be `N` components.
    pub fn each_vector<const N: usize>(&self, mut visit: impl FnMut(usize, [f64; N])) {
        match &self.base {
            Some(base) => self.each_in(base, &mut visit),
            None => (0..self.count).for_each(|index| visit(index, [0.0; N])),
        }
        if let Some(sparse) = &self.sparse {
            self.each_in(&sparse.values, &mut |at, value| visit(sparse.indices[at] as usize, value));
        }
    }

    #[inline]
    fn each_in<const N: usize>(&self, slots: &Slots<'_>, visit: &mut impl FnMut(usize, [f64; N])) {
        /// Bytes of a component, as many as `SIZE`, the `axis`-th of an element.
        fn part<const SIZE: usize>(element: &[u8], axis: usize) -> [u8; SIZE] {
            let bytes = element.get(axis * SIZE..).and_then(|bytes| bytes.first_chunk());
            bytes.copied().unwrap_or([0; SIZE])
        }
        /// One arm: elements of `N` components of a type, each divided by what stands for 1.
        macro_rules! each {
            ($kind:ty, $one:expr) => {{
                const SIZE: usize = size_of::<$kind>();
                let one = if self.normalized { $one } else { 1.0 };
                let lowest = if self.normalized { -1.0 } else { f64::NEG_INFINITY };
                for index in 0..slots.count {
                    let element = &slots.bytes[index * slots.stride..];
                    visit(
                        index,
                        std::array::from_fn(|axis| {
                            let value = <$kind>::from_le_bytes(part::<SIZE>(element, axis));
                            (f64::from(value) / one).max(lowest)
                        }),
                    );
                }
            }};
        }
        match self.component {
            ComponentType::F32 if N == 3 => slots.each(|index, element: &[u8; 12]| {
                visit(index, std::array::from_fn(|axis| f64::from(f32::from_le_bytes(part(element, axis)))));
            }),
            ComponentType::F32 => {
                for index in 0..slots.count {
                    let element = &slots.bytes[index * slots.stride..];
                    visit(index, std::array::from_fn(|axis| f64::from(f32::from_le_bytes(part(element, axis)))));
                }
            }
            ComponentType::I8 => each!(i8, 127.0),
            ComponentType::U8 => each!(u8, 255.0),
            ComponentType::I16 => each!(i16, 32767.0),
            ComponentType::U16 => each!(u16, 65535.0),
            ComponentType::U32 => each!(u32, f64::from(u32::MAX)),
        }
    }

    /// The elements as unsigned integers. They must be scalars of an unsigned type.
    pub fn indices(&self) -> Vec<u32> {
        let mut values = match &self.base {
            Some(base) => integers(base, self.component),
            None => vec![0; self.count],
        };
        if let Some(sparse) = &self.sparse {
            let replaced = integers(&sparse.values, self.component);
            for (&index, value) in sparse.indices.iter().zip(replaced) {
                values[index as usize] = value;
            }
        }
        values
    }

    /// Whether the elements can be indices.
    pub fn is_index(&self) -> bool {
        let unsigned = matches!(self.component, ComponentType::U8 | ComponentType::U16 | ComponentType::U32);
        unsigned && self.components == 1
    }
}

/// Refuses sparse indices that do not increase or are not below `count`.
fn check_sparse(indices: &[u32], count: u64, whence: &str) -> Result<()> {
    let falling = indices.windows(2).position(|pair| pair[0] >= pair[1]);
    if let Some(at) = falling {
        return Err(Error::mesh(format_args!(
            "sparse indices of {whence} must increase, number {} is {}",
            at + 1,
            indices[at + 1]
        )));
    }
    match indices.last() {
        Some(&last) if u64::from(last) >= count => {
            Err(Error::mesh(format_args!("{whence} has {count} elements, but replaces that of index {last}")))
        }
        _ => Ok(()),
    }
}

/// The elements as integers, of an unsigned type.
fn integers(slots: &Slots<'_>, kind: ComponentType) -> Vec<u32> {
    let mut values = Vec::with_capacity(slots.count);
    match kind {
        ComponentType::U8 => slots.each(|_, bytes: &[u8; 1]| values.push(u32::from(bytes[0]))),
        ComponentType::U16 => {
            slots.each(|_, bytes| values.push(u32::from(u16::from_le_bytes(*bytes))));
        }
        ComponentType::U32 => slots.each(|_, bytes| values.push(u32::from_le_bytes(*bytes))),
        // refused before: see `is_index`
        ComponentType::I8 | ComponentType::I16 | ComponentType::F32 => {}
    }
    values
}
