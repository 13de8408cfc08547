//! Accessors: typed elements in buffer views, some of them replaced one by one.
//!
//! Opening an accessor compares all that it declares with the bytes that are there, before anything is allocated; so
//! reading cannot fail. Each is opened once however often it is used.

use std::cell::{Cell, OnceCell};

use gltf::json;
use gltf::json::accessor::{ComponentType, Type};
use gltf::json::validation::Checked;

use super::buffers::{Buffers, View};
use super::document::lookup;
use super::slots::{Slots, part};
use crate::error::{Error, Result};

/// Elements that an accessor without a buffer view, which takes them from nowhere, may have however small the file is.
const FREE_ZEROS: u64 = 1 << 16;

/// The accessors of a document.
pub struct Accessors<'b> {
    buffers: &'b Buffers<'b>,
    opened: Vec<OnceCell<Elements<'b>>>,
    /// Elements replaced by all sparse accessors opened.
    replaced: Cell<u64>,
}

impl<'b> Accessors<'b> {
    /// The accessors that look into `buffers`.
    pub fn new(buffers: &'b Buffers<'b>) -> Self {
        let accessors = &buffers.document().accessors;
        Self { buffers, opened: accessors.iter().map(|_| OnceCell::new()).collect(), replaced: Cell::new(0) }
    }

    /// The buffers.
    pub fn buffers(&self) -> &'b Buffers<'b> {
        self.buffers
    }

    /// What accessor `index`, which `whence` refers to, says about itself.
    pub fn describe(&self, index: usize, whence: &str) -> Result<&'b json::Accessor> {
        lookup(&self.buffers.document().accessors, index, "accessor", whence)
    }

    /// The elements of accessor `index`, which `whence` refers to.
    pub fn open(&self, index: usize, whence: &str) -> Result<&Elements<'b>> {
        let accessor = self.describe(index, whence)?;
        let cell = &self.opened[index];
        if let Some(elements) = cell.get() {
            return Ok(elements);
        }
        let elements = Elements::open(self, accessor, index)?;
        Ok(cell.get_or_init(|| elements))
    }

    /// Accounts for sparse values: as many as there are bytes, unless accessors share them over and over.
    fn take_replaced(&self, count: u64, whence: &str) -> Result<()> {
        let replaced = self.replaced.get().saturating_add(count);
        if replaced > self.buffers.bytes() {
            return Err(Error::too_large(format_args!(
                "the sparse accessors up to {whence} replace more elements than the file has bytes: {replaced}"
            )));
        }
        self.replaced.set(replaced);
        Ok(())
    }
}

/// The elements of an accessor.
#[derive(Debug)]
pub struct Elements<'b> {
    /// The accessor's index in the document.
    pub index: usize,
    /// Number of elements.
    pub count: usize,
    /// Type of each component.
    pub component: ComponentType,
    /// Components of an element.
    pub components: usize,
    /// Whether integers stand for 0 … 1 or −1 … 1.
    normalized: bool,
    /// The elements; zeros where there are none.
    base: Option<Slots<'b>>,
    /// Those that are replaced.
    sparse: Option<Sparse<'b>>,
}

/// Replaced elements.
#[derive(Debug)]
struct Sparse<'b> {
    /// Which, increasing.
    indices: Slots<'b>,
    /// Type of the indices.
    kind: ComponentType,
    /// By what.
    values: Slots<'b>,
}

impl<'b> Elements<'b> {
    fn open(accessors: &Accessors<'b>, accessor: &json::Accessor, index: usize) -> Result<Self> {
        let me = format!("accessor {index}");
        let (Checked::Valid(component), Checked::Valid(shape)) = (accessor.component_type, accessor.type_) else {
            return Err(Error::mesh(format_args!(
                "{me} has an unknown componentType or type (componentType is one of 5120 to 5123, 5125 and 5126, type \
                 one of SCALAR, VEC2, VEC3 and VEC4)"
            )));
        };
        let component = component.0;
        let components = match shape {
            Type::Scalar => 1,
            Type::Vec2 => 2,
            Type::Vec3 => 3,
            Type::Vec4 => 4,
            Type::Mat2 | Type::Mat3 | Type::Mat4 => {
                return Err(Error::mesh(format_args!("{me} holds matrices, which geometry does not use")));
            }
        };
        let size = component.size() * components;
        let count = accessor.count.0;
        let base = match accessor.buffer_view {
            Some(view) => {
                let view = accessors.buffers.view(view.value(), &me)?;
                let offset = accessor.byte_offset.map_or(0, |offset| offset.0);
                Some(Slots::new(view, offset, size, count, &me)?)
            }
            // zeros, by the specification
            None => None,
        };
        let sparse = match &accessor.sparse {
            Some(sparse) => Some(Sparse::open(accessors, sparse, size, count, &me)?),
            None => None,
        };
        let most = accessors.buffers.bytes().max(FREE_ZEROS);
        if base.is_none() && count > most {
            return Err(Error::mesh(format_args!(
                "{me} has no bufferView, so its elements are zeros, and may have {most} of them in a file of this \
                 size: {count}"
            )));
        }
        Ok(Self { index, count: count as usize, component, components, normalized: accessor.normalized, base, sparse })
    }

    /// Calls `visit` for every element as numbers; for those that are replaced twice, the second time with what counts.
    /// There must be `N` components.
    pub fn each_vector<const N: usize>(&self, mut visit: impl FnMut(usize, [f64; N])) {
        match &self.base {
            Some(base) if self.component == ComponentType::F32 && base.stride == 4 * N => {
                // the common case: floats back to back
                let floats = base.bytes.as_chunks::<4>().0.chunks_exact(N);
                for (index, element) in floats.take(self.count).enumerate() {
                    visit(index, std::array::from_fn(|axis| f64::from(f32::from_le_bytes(element[axis]))));
                }
            }
            Some(base) => (0..self.count).for_each(|index| visit(index, self.vector_in(base, index))),
            None => (0..self.count).for_each(|index| visit(index, [0.0; N])),
        }
        if let Some(sparse) = &self.sparse {
            for at in 0..sparse.values.count {
                let index = sparse.indices.integer(at, sparse.kind);
                visit(index as usize, self.vector_in(&sparse.values, at));
            }
        }
    }

    /// Element `index` as numbers. There must be `N` components.
    pub fn vector<const N: usize>(&self, index: usize) -> [f64; N] {
        let replacing = self.sparse.as_ref().and_then(|sparse| {
            let at = sparse.find(index as u32)?;
            Some(self.vector_in(&sparse.values, at))
        });
        let base = self.base.as_ref();
        replacing.or_else(|| base.map(|base| self.vector_in(base, index))).unwrap_or([0.0; N])
    }

    #[inline]
    fn vector_in<const N: usize>(&self, slots: &Slots<'_>, index: usize) -> [f64; N] {
        let element = slots.from(index);
        let normalise = |value: f64, one: f64| match self.normalized {
            true => (value / one).max(-1.0),
            false => value,
        };
        std::array::from_fn(|axis| match self.component {
            ComponentType::I8 => normalise(f64::from(i8::from_le_bytes(part(element, axis))), 127.0),
            ComponentType::U8 => normalise(f64::from(u8::from_le_bytes(part(element, axis))), 255.0),
            ComponentType::I16 => normalise(f64::from(i16::from_le_bytes(part(element, axis))), 32767.0),
            ComponentType::U16 => normalise(f64::from(u16::from_le_bytes(part(element, axis))), 65535.0),
            ComponentType::U32 => f64::from(u32::from_le_bytes(part(element, axis))),
            ComponentType::F32 => f64::from(f32::from_le_bytes(part(element, axis))),
        })
    }

    /// The elements as unsigned integers; [`is_index`](Self::is_index) must hold.
    pub fn integers(&self) -> Vec<u32> {
        let base = self.base.as_ref();
        let mut values = base.map_or_else(|| vec![0; self.count], |base| base.integers(self.component));
        if let Some(sparse) = &self.sparse {
            for at in 0..sparse.values.count {
                let index = sparse.indices.integer(at, sparse.kind) as usize;
                values[index] = sparse.values.integer(at, self.component);
            }
        }
        values
    }

    /// Whether each element has bytes of its own, not only those that are replaced.
    pub fn has_bytes(&self) -> bool {
        self.base.is_some()
    }

    /// Whether the elements can be indices.
    pub fn is_index(&self) -> bool {
        let is_unsigned = matches!(self.component, ComponentType::U8 | ComponentType::U16 | ComponentType::U32);
        is_unsigned && self.components == 1
    }
}

impl<'b> Sparse<'b> {
    /// Opens what replaces elements of `size` bytes, of which there are `count`.
    fn open(
        accessors: &Accessors<'b>,
        sparse: &json::accessor::sparse::Sparse,
        size: usize,
        count: u64,
        whence: &str,
    ) -> Result<Self> {
        let replaced = sparse.count.0;
        if replaced > count {
            return Err(Error::mesh(format_args!("{whence} has {count} elements, but replaces more: {replaced}")));
        }
        let Checked::Valid(kind) = sparse.indices.component_type else {
            return Err(Error::mesh(format_args!("the sparse indices of {whence} have an unknown componentType")));
        };
        let kind = kind.0;
        let open = |view: usize, offset: u64, size: usize, what: &str| {
            let me = format!("the sparse {what} of {whence}");
            let view = View { stride: None, ..accessors.buffers.view(view, &me)? };
            Slots::new(view, offset, size, replaced, &me)
        };
        let (indices, values) = (&sparse.indices, &sparse.values);
        let indices = open(indices.buffer_view.value(), indices.byte_offset.0, kind.size(), "indices")?;
        let values = open(values.buffer_view.value(), values.byte_offset.0, size, "values")?;
        accessors.take_replaced(replaced, whence)?;
        let mut least = 0;
        for at in 0..indices.count {
            let index = u64::from(indices.integer(at, kind));
            if index < least || index >= count {
                return Err(Error::mesh(format_args!(
                    "the sparse indices of {whence} must increase and be below {count}, number {at} is {index}"
                )));
            }
            least = index + 1;
        }
        Ok(Self { indices, kind, values })
    }

    /// Which of the values replaces element `index`, if one does.
    fn find(&self, index: u32) -> Option<usize> {
        let (mut low, mut high) = (0, self.indices.count);
        while low < high {
            let middle = low.midpoint(high);
            match self.indices.integer(middle, self.kind).cmp(&index) {
                std::cmp::Ordering::Less => low = middle + 1,
                std::cmp::Ordering::Equal => return Some(middle),
                std::cmp::Ordering::Greater => high = middle,
            }
        }
        None
    }
}
