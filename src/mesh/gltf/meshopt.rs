//! `EXT_meshopt_compression` and its successor `KHR_meshopt_compression`: buffer views that are decompressed when read.
//!
//! The codecs are the `meshopt` crate's. They are safe on any bytes, but allocate as much as the count says and assert
//! that the shape is right; so both are checked first, the count against the most that the bytes can hold. The filters
//! are written here: those of the library differ in the last bit between processors (fused multiply-adds, reciprocal
//! square roots), and positions must not.

use std::fmt::Debug;

use gltf::json;
use serde::Deserialize;

use crate::error::{Brief, Error, Result, wrong_json};

const NAMES: [&str; 2] = ["EXT_meshopt_compression", "KHR_meshopt_compression"];

/// The attribute codec spends at least a quarter byte for 256 bytes.
const MAX_RATIO: u64 = 1024;

/// How a buffer view is compressed.
#[derive(Debug, Deserialize)]
#[serde(rename_all = "camelCase")]
pub struct Compressed {
    /// The buffer with the compressed bytes,
    pub buffer: u32,
    /// where they begin,
    #[serde(default)]
    pub byte_offset: u64,
    /// and their number.
    pub byte_length: u64,
    /// Bytes of an element, decompressed.
    pub byte_stride: usize,
    count: u64,
    mode: Mode,
    #[serde(default)]
    filter: Filter,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "UPPERCASE")]
enum Mode {
    Attributes,
    Triangles,
    Indices,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Deserialize)]
#[serde(rename_all = "UPPERCASE")]
enum Filter {
    #[default]
    None,
    Octahedral,
    Quaternion,
    Exponential,
    /// Colours, which are not read.
    Color,
}

/// The name of a mode or filter in the file.
fn name(value: impl Debug) -> String {
    format!("{value:?}").to_uppercase()
}

impl Compressed {
    /// The compression of a buffer view, if it is compressed; `whence` names the view.
    pub fn of(view: &json::buffer::View, whence: &str) -> Result<Option<Self>> {
        let extensions = view.extensions.as_ref();
        let compression = NAMES.iter().find_map(|&name| {
            let value = extensions?.others.get(name)?;
            Some((name, value))
        });
        let Some((name, value)) = compression else {
            return Ok(None);
        };
        let compressed = Self::deserialize(value).map_err(|error| {
            Error::mesh(format_args!("{name} of {whence} cannot be read: {}", Brief(wrong_json(&error))))
        })?;
        Ok(Some(compressed))
    }

    /// Refuses what `encoded` cannot be; returns the number of bytes that it decompresses to.
    pub fn check(&self, encoded: &[u8], whence: &str) -> Result<u64> {
        let (count, stride) = (self.count, self.byte_stride);
        self.check_shape().map_err(|what| Error::mesh(format_args!("the meshopt compression of {whence}: {what}")))?;
        let length = encoded.len() as u64;
        let most = match self.mode {
            Mode::Attributes => length * MAX_RATIO / stride as u64,
            Mode::Triangles => 3 * length,
            Mode::Indices => length,
        };
        if count > most {
            return Err(Error::mesh(format_args!(
                "the meshopt compression of {whence} has {length} bytes, which cannot hold the declared count: {count}"
            )));
        }
        Ok(count * stride as u64)
    }

    /// What is wrong with mode, filter, count and stride by themselves.
    fn check_shape(&self) -> Result<(), String> {
        let Self { count, byte_stride: stride, mode, filter, .. } = *self;
        let stride_fits = match mode {
            Mode::Attributes => stride > 0 && stride <= 256 && stride.is_multiple_of(4),
            Mode::Triangles | Mode::Indices => matches!(stride, 2 | 4),
        };
        if !stride_fits {
            let wanted = match mode {
                Mode::Attributes => "a multiple of 4 from 4 to 256",
                Mode::Triangles | Mode::Indices => "2 or 4",
            };
            return Err(format!("byteStride must be {wanted} with mode {}: {stride}", name(mode)));
        }
        if mode == Mode::Triangles && !count.is_multiple_of(3) {
            return Err(format!("count must be a multiple of 3 with mode TRIANGLES: {count}"));
        }
        if filter != Filter::None && mode != Mode::Attributes {
            return Err(format!("filter {} is for mode ATTRIBUTES only, not for {}", name(filter), name(mode)));
        }
        let (filter_fits, wanted) = match filter {
            Filter::None | Filter::Exponential => (true, ""),
            Filter::Octahedral | Filter::Color => (matches!(stride, 4 | 8), "4 or 8"),
            Filter::Quaternion => (stride == 8, "8"),
        };
        if !filter_fits {
            return Err(format!("filter {} needs a byteStride of {wanted}: {stride}", name(filter)));
        }
        Ok(())
    }

    /// Decompresses what [`check`](Self::check) let pass.
    pub fn decode(&self, encoded: &[u8], whence: &str) -> Result<Vec<u8>> {
        let count = self.count as usize;
        let of_shorts = |indices: Vec<u16>| indices.into_iter().flat_map(u16::to_le_bytes).collect();
        let of_words = |indices: Vec<u32>| indices.into_iter().flat_map(u32::to_le_bytes).collect();
        let decoded = match (self.mode, self.byte_stride) {
            (Mode::Attributes, stride) => decode_attributes(encoded, count, stride),
            (Mode::Triangles, 2) => ::meshopt::decode_index_buffer(encoded, count).map(of_shorts),
            (Mode::Triangles, _) => ::meshopt::decode_index_buffer(encoded, count).map(of_words),
            (Mode::Indices, 2) => ::meshopt::decode_index_sequence(encoded, count).map(of_shorts),
            (Mode::Indices, _) => ::meshopt::decode_index_sequence(encoded, count).map(of_words),
        };
        let mut bytes: Vec<u8> = decoded.map_err(|_| {
            Error::mesh(format_args!(
                "the meshopt-compressed bytes of {whence} are truncated or damaged: export the mesh again"
            ))
        })?;
        match self.filter {
            Filter::None => {}
            Filter::Exponential => exponential(&mut bytes),
            Filter::Quaternion => quaternion(&mut bytes),
            Filter::Octahedral if self.byte_stride == 4 => octahedral_8(&mut bytes),
            Filter::Octahedral => octahedral_16(&mut bytes),
            Filter::Color => {
                return Err(Error::unsupported(format_args!("{whence} is filtered as a colour, but used as geometry")));
            }
        }
        Ok(bytes)
    }
}

/// An element of `4 * WORDS` bytes.
#[derive(Clone)]
struct Element<const WORDS: usize>([u32; WORDS]);

impl<const WORDS: usize> Default for Element<WORDS> {
    fn default() -> Self {
        Self([0; WORDS])
    }
}

/// Decodes elements of `stride` bytes: the crate wants their size as a type.
fn decode_attributes(encoded: &[u8], count: usize, stride: usize) -> ::meshopt::Result<Vec<u8>> {
    fn decode<const WORDS: usize>(encoded: &[u8], count: usize) -> ::meshopt::Result<Vec<u8>> {
        let elements = ::meshopt::decode_vertex_buffer::<Element<WORDS>>(encoded, count)?;
        let words = elements.iter().flat_map(|element| element.0);
        let mut bytes = Vec::with_capacity(4 * WORDS * count);
        words.for_each(|word| bytes.extend_from_slice(&word.to_ne_bytes()));
        Ok(bytes)
    }
    macro_rules! by_size {
        ($($words:literal)*) => {
            match stride / 4 {
                $($words => decode::<$words>(encoded, count),)*
                _ => Ok(Vec::new()),
            }
        };
    }
    by_size!(
        1 2 3 4 5 6 7 8 9 10 11 12 13 14 15 16 17 18 19 20 21 22 23 24 25 26 27 28 29 30 31 32
        33 34 35 36 37 38 39 40 41 42 43 44 45 46 47 48 49 50 51 52 53 54 55 56 57 58 59 60 61 62 63 64
    )
}

/// Every word, an 8-bit exponent above a 24-bit mantissa, becomes the f32 mantissa × 2^exponent.
fn exponential(bytes: &mut [u8]) {
    for word in bytes.as_chunks_mut::<4>().0 {
        let value = i32::from_le_bytes(*word);
        let (mantissa, exponent) = (value << 8 >> 8, value >> 24);
        let power = f64::from_bits(((1023 + exponent) as u64) << 52);
        *word = ((f64::from(mantissa) * power) as f32).to_le_bytes();
    }
}

/// Three components and a scale, whose low bits name the fourth, become a unit quaternion of normalised i16.
fn quaternion(bytes: &mut [u8]) {
    for element in bytes.as_chunks_mut::<8>().0 {
        let [x, y, z, w] = words(element);
        let scale = f64::from(w | 3);
        let [x, y, z] = [x, y, z].map(|c| f64::from(c) / scale * std::f64::consts::FRAC_1_SQRT_2);
        let largest = (1.0 - x * x - y * y - z * z).max(0.0).sqrt();
        let at = w as usize & 3;
        let mut turned = [0; 4];
        turned[(at + 1) & 3] = normalised(x, 32767.0) as i16;
        turned[(at + 2) & 3] = normalised(y, 32767.0) as i16;
        turned[(at + 3) & 3] = normalised(z, 32767.0) as i16;
        turned[at] = normalised(largest, 32767.0) as i16;
        put_words(element, turned);
    }
}

/// Octahedral x and y, with z the scale, become a unit vector of normalised i8; w stays.
fn octahedral_8(bytes: &mut [u8]) {
    for element in bytes.as_chunks_mut::<4>().0 {
        let [x, y, z, _] = element.map(|byte| f64::from(byte as i8));
        let unit = octahedral([x, y, z]);
        for (byte, value) in element.iter_mut().zip(unit) {
            *byte = normalised(value, 127.0) as i8 as u8;
        }
    }
}

/// The same in i16.
fn octahedral_16(bytes: &mut [u8]) {
    for element in bytes.as_chunks_mut::<8>().0 {
        let [x, y, z, w] = words(element);
        let [x, y, z] = octahedral([x, y, z].map(f64::from)).map(|c| normalised(c, 32767.0) as i16);
        put_words(element, [x, y, z, w]);
    }
}

fn octahedral([x, y, one]: [f64; 3]) -> [f64; 3] {
    let z = one - x.abs() - y.abs();
    let fold = z.min(0.0);
    let x = if x >= 0.0 { x + fold } else { x - fold };
    let y = if y >= 0.0 { y + fold } else { y - fold };
    let length = (x * x + y * y + z * z).sqrt();
    [x, y, z].map(|c| if length > 0.0 { c / length } else { 0.0 })
}

/// The integer nearest to `value` × `scale`, halves away from zero.
fn normalised(value: f64, scale: f64) -> f64 {
    (value * scale + if value >= 0.0 { 0.5 } else { -0.5 }).trunc()
}

fn words(element: &[u8; 8]) -> [i16; 4] {
    let [a, b, c, d, e, f, g, h] = *element;
    [[a, b], [c, d], [e, f], [g, h]].map(i16::from_le_bytes)
}

fn put_words(element: &mut [u8; 8], words: [i16; 4]) {
    for (bytes, word) in element.as_chunks_mut::<2>().0.iter_mut().zip(words) {
        *bytes = word.to_le_bytes();
    }
}
