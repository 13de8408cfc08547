//! Structs that Rust and WGSL share, byte for byte. [`shared!`] makes the Rust struct and its WGSL text from one list
//! of members: of `u32`, `u64`, the types below, and arrays of them.
//!
//! The energy has such structs, because it decides which words a face and a proxy take; a device has others.

/// An atomic number in WGSL.
pub type Atomic = u32;

/// A vector in WGSL.
pub type Vec3 = [i32; 3];

/// An array without end in WGSL.
pub type List = [u32; 1];

/// A struct that WGSL has, too.
#[derive(Debug, Clone, Copy)]
pub struct Struct {
    /// Its name.
    pub name: &'static str,
    /// Its size in bytes in Rust.
    pub size: usize,
    /// Name, type and offset of each member, in Rust.
    pub members: &'static [(&'static str, &'static str, usize)],
}

impl Struct {
    /// Its declaration.
    pub fn wgsl(&self) -> String {
        let member = |(name, ty, _): &(&str, &str, usize)| format!("    {name}: {},\n", wgsl_type(ty));
        format!("struct {} {{\n{}}}\n", self.name, self.members.iter().map(member).collect::<String>())
    }
}

/// The WGSL type of a member.
fn wgsl_type(ty: &str) -> String {
    let array = ty.strip_prefix('[').and_then(|array| array.strip_suffix(']')?.split_once("; "));
    match (ty, array) {
        (_, Some((item, length))) => format!("array<{}, {length}>", wgsl_type(item)),
        ("Atomic", _) => "atomic<u32>".to_owned(),
        ("Vec3", _) => "vec3<i32>".to_owned(),
        ("List", _) => "array<u32>".to_owned(),
        _ => ty.to_owned(),
    }
}

/// Defines structs and lists them in `STRUCTS`.
macro_rules! shared {
    ($($(#[$doc:meta])* $name:ident { $($(#[$member_doc:meta])* $member:ident: $ty:ty,)* })*) => {
        $(
            $(#[$doc])*
            #[derive(Debug, Clone, Copy, PartialEq, Eq)]
            #[cfg_attr(feature = "gpu", derive(bytemuck::Pod, bytemuck::Zeroable))]
            #[repr(C)]
            pub struct $name { $($(#[$member_doc])* pub $member: $ty,)* }
        )*

        /// All structs that this file shares with WGSL.
        pub const STRUCTS: &[$crate::energy::shared::Struct] = &[$($crate::energy::shared::Struct {
            name: stringify!($name),
            size: size_of::<$name>(),
            members: &[$((stringify!($member), stringify!($ty), std::mem::offset_of!($name, $member))),*],
        }),*];
    };
}

pub(crate) use shared;
