//! Structs that WGSL has, too. [`shared!`] makes a Rust struct and its WGSL text from one list of members: of `u32`,
//! `u64`, the types below, and arrays of them. [`wide!`] lists structs whose size depends on the number of axes of a
//! point; Rust writes and reads their words.
//!
//! The energy has such structs, because it decides which words a face and a proxy take; a device has others.

use super::functional::{Functional, Item};

/// An atomic number in WGSL.
pub type Atomic = u32;

/// An array without end in WGSL.
pub type List = [u32; 1];

/// A struct that WGSL has, too.
#[derive(Debug, Clone, Copy)]
pub struct Struct {
    /// Its name.
    pub name: &'static str,
    /// Name and type of each member.
    pub members: &'static [(&'static str, &'static str)],
    /// What Rust knows of its layout.
    pub layout: Layout,
}

/// What Rust knows of the layout of a struct.
#[derive(Debug, Clone, Copy)]
pub enum Layout {
    /// The size in bytes, and the offset of each member.
    Twin(usize, &'static [usize]),
    /// The number of words for so many axes.
    Words(fn(usize) -> usize),
}

impl Struct {
    /// Its size for points of so many axes.
    pub fn bytes(&self, axes: usize) -> usize {
        match self.layout {
            Layout::Twin(bytes, _) => bytes,
            Layout::Words(words) => words(axes) * size_of::<u32>(),
        }
    }

    /// Its declaration.
    pub fn wgsl(&self) -> String {
        let member = |(name, ty): &(&str, &str)| format!("    {name}: {},\n", wgsl_type(ty));
        format!("struct {} {{\n{}}}\n", self.name, self.members.iter().map(member).collect::<String>())
    }
}

/// The WGSL type of a member.
fn wgsl_type(ty: &str) -> String {
    let array = ty.strip_prefix('[').and_then(|array| array.strip_suffix(']')?.split_once("; "));
    match (ty, array) {
        (_, Some((item, length))) => format!("array<{}, {length}>", wgsl_type(item)),
        ("Atomic", _) => "atomic<u32>".to_owned(),
        ("List", _) => "array<u32>".to_owned(),
        _ => ty.to_owned(),
    }
}

/// An energy whose numbers a gpu has as words.
pub trait Words: Functional {
    /// Coordinates of a point.
    const AXES: usize;

    /// The point with these coordinates.
    fn point(coordinate: impl FnMut(usize) -> i32) -> Self::Point;

    /// The words of a face.
    fn of_face(face: Item<Self::Point>) -> impl Iterator<Item = u32>;

    /// Those of the proxy of a cluster without faces.
    fn of_unfitted(energy_shift: u32) -> impl Iterator<Item = u32>;

    /// The sums of a cluster from their words, the low one of each number first, and the number of its faces.
    fn sums(words: &[u32], faces: u32) -> Self::Sums;
}

/// Defines structs and lists them in `STRUCTS`.
#[cfg(feature = "gpu")]
macro_rules! shared {
    ($($(#[$doc:meta])* $name:ident { $($(#[$member_doc:meta])* $member:ident: $ty:ty,)* })*) => {
        $(
            $(#[$doc])*
            #[derive(Debug, Clone, Copy, PartialEq, Eq)]
            #[derive(bytemuck::Pod, bytemuck::Zeroable)]
            #[repr(C)]
            pub struct $name { $($(#[$member_doc])* pub $member: $ty,)* }
        )*

        /// All structs that this file shares with WGSL.
        pub const STRUCTS: &[$crate::energy::shared::Struct] = &[$($crate::energy::shared::Struct {
            name: stringify!($name),
            members: &[$((stringify!($member), stringify!($ty))),*],
            layout: $crate::energy::shared::Layout::Twin(
                size_of::<$name>(),
                &[$(std::mem::offset_of!($name, $member)),*],
            ),
        }),*];
    };
}

/// Lists structs of `axes`, their words and members, and all of them in `WIDE`.
macro_rules! wide {
    ($(
        $(#[$doc:meta])* $constant:ident = $name:ident($words:expr) {
            $($(#[$member_doc:meta])* $member:ident: $ty:ty,)*
        }
    )*) => {
        $(
            $(#[$doc])*
            pub const $constant: $crate::energy::shared::Struct = $crate::energy::shared::Struct {
                name: stringify!($name),
                members: &[$((stringify!($member), stringify!($ty))),*],
                layout: $crate::energy::shared::Layout::Words($words),
            };
        )*

        /// All of these structs.
        pub const WIDE: &[$crate::energy::shared::Struct] = &[$($constant),*];
    };
}

#[cfg(feature = "gpu")]
pub(crate) use shared;
pub(crate) use wide;
