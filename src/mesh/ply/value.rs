//! Types of values: their two sets of names, their sizes, and how they are read in either byte order.

/// Which byte of a number comes first.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Order {
    /// The least significant one.
    Little,
    /// The most significant one.
    Big,
}

impl Order {
    /// The other one.
    pub fn other(self) -> Self {
        match self {
            Self::Little => Self::Big,
            Self::Big => Self::Little,
        }
    }
}

/// The type of a value.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Type {
    I8,
    U8,
    I16,
    U16,
    I32,
    U32,
    F32,
    F64,
}

/// Reads an integer from the first bytes of a value; 0 where they are too few.
pub type Integer = fn(&[u8]) -> i64;
/// Reads a number from the first bytes of a value; 0 where they are too few.
pub type Float = fn(&[u8]) -> f64;

/// A reader of one type of numbers in one byte order.
macro_rules! reader {
    ($number:ty, $from:ident, $wide:ty) => {
        |bytes| bytes.first_chunk().map_or(<$wide>::default(), |bytes| <$wide>::from(<$number>::$from(*bytes)))
    };
}

impl Type {
    /// The type of this name: `uchar`, as PLY began, or `uint8`, as most programs write.
    pub fn of(name: &[u8]) -> Option<Self> {
        Some(match name {
            b"char" | b"int8" => Self::I8,
            b"uchar" | b"uint8" => Self::U8,
            b"short" | b"int16" => Self::I16,
            b"ushort" | b"uint16" => Self::U16,
            b"int" | b"int32" => Self::I32,
            b"uint" | b"uint32" => Self::U32,
            b"float" | b"float32" => Self::F32,
            b"double" | b"float64" => Self::F64,
            _ => return None,
        })
    }

    /// Bytes of a value in a binary file.
    pub fn size(self) -> usize {
        match self {
            Self::I8 | Self::U8 => 1,
            Self::I16 | Self::U16 => 2,
            Self::I32 | Self::U32 | Self::F32 => 4,
            Self::F64 => 8,
        }
    }

    /// Whether values are integers.
    pub fn is_integer(self) -> bool {
        !matches!(self, Self::F32 | Self::F64)
    }

    /// What reads values as integers; those of other types are 0.
    pub fn integer(self, order: Order) -> Integer {
        match (self, order) {
            (Self::I8, _) => reader!(i8, from_le_bytes, i64),
            (Self::U8, _) => reader!(u8, from_le_bytes, i64),
            (Self::I16, Order::Little) => reader!(i16, from_le_bytes, i64),
            (Self::I16, Order::Big) => reader!(i16, from_be_bytes, i64),
            (Self::U16, Order::Little) => reader!(u16, from_le_bytes, i64),
            (Self::U16, Order::Big) => reader!(u16, from_be_bytes, i64),
            (Self::I32, Order::Little) => reader!(i32, from_le_bytes, i64),
            (Self::I32, Order::Big) => reader!(i32, from_be_bytes, i64),
            (Self::U32, Order::Little) => reader!(u32, from_le_bytes, i64),
            (Self::U32, Order::Big) => reader!(u32, from_be_bytes, i64),
            (Self::F32 | Self::F64, _) => |_| 0,
        }
    }

    /// What reads values as f64, exactly.
    pub fn float(self, order: Order) -> Float {
        match (self, order) {
            (Self::I8, _) => reader!(i8, from_le_bytes, f64),
            (Self::U8, _) => reader!(u8, from_le_bytes, f64),
            (Self::I16, Order::Little) => reader!(i16, from_le_bytes, f64),
            (Self::I16, Order::Big) => reader!(i16, from_be_bytes, f64),
            (Self::U16, Order::Little) => reader!(u16, from_le_bytes, f64),
            (Self::U16, Order::Big) => reader!(u16, from_be_bytes, f64),
            (Self::I32, Order::Little) => reader!(i32, from_le_bytes, f64),
            (Self::I32, Order::Big) => reader!(i32, from_be_bytes, f64),
            (Self::U32, Order::Little) => reader!(u32, from_le_bytes, f64),
            (Self::U32, Order::Big) => reader!(u32, from_be_bytes, f64),
            (Self::F32, Order::Little) => reader!(f32, from_le_bytes, f64),
            (Self::F32, Order::Big) => reader!(f32, from_be_bytes, f64),
            (Self::F64, Order::Little) => reader!(f64, from_le_bytes, f64),
            (Self::F64, Order::Big) => reader!(f64, from_be_bytes, f64),
        }
    }
}
