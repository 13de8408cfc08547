//! Images: a pixel is an item, its coordinates are its colour and its place, and pixels beside each other are
//! neighbours. Clusters are then superpixels, with the distance of SLIC (Achanta et al. 2012).
//!
//! Colours are those of CIELAB under D65, computed from sRGB as `rgb2lab` of scikit-image does, in f64 with the powers
//! and roots of `libm`: the same on every machine.

use std::fmt::Display;
use std::io::Cursor;

use zune_jpeg::JpegDecoder;
use zune_jpeg::zune_core::bytestream::ZCursor;
use zune_jpeg::zune_core::colorspace::ColorSpace;
use zune_jpeg::zune_core::options::DecoderOptions;

use super::{Format, Graph, PointSet, Values};
use crate::error::names::{Name, more_than};
use crate::error::{Error, Result};
use crate::parallel;

/// The compactness of an image: where none is given that of scikit-image.
pub fn compactness(given: Option<f64>) -> f64 {
    given.unwrap_or(10.0)
}

/// Refuses a compactness out of bounds.
pub fn check_compactness(compactness: f64) -> Result<()> {
    let [least, most] = [1e-3, 1e6];
    if (least..=most).contains(&compactness) {
        return Ok(());
    }
    Err(Error::parameter(format_args!("{} must be from {least} to {most}: {compactness}", Name::COMPACTNESS)))
}

/// Pixels that a thread takes at once.
const PIECE: usize = 1 << 12;

/// The rows of the matrix from linear sRGB to XYZ, each over the white of D65.
const XYZ_OF_RGB: [([f64; 3], f64); 3] = [
    ([0.412453, 0.357580, 0.180423], 0.95047),
    ([0.212671, 0.715160, 0.072169], 1.0),
    ([0.019334, 0.119193, 0.950227], 1.08883),
];

/// The rows of the inverse of that matrix.
const RGB_OF_XYZ: [[f64; 3]; 3] = [
    [3.240_481_34, -1.537_151_52, -0.498_536_33],
    [-0.969_254_95, 1.875_99, 0.041_555_93],
    [0.055_646_64, -0.204_041_34, 1.057_311_07],
];

/// [`root`] where it changes from the cube root to a line.
const ROOT_OF_LINEAR: f64 = 0.206_893_03;

/// An image in sRGB.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Image {
    /// Pixels of a row.
    pub width: usize,
    /// Number of rows.
    pub height: usize,
    /// 1 grey, 2 grey and alpha, 3 red, green and blue, 4 these and alpha.
    pub channels: usize,
    /// height × width × channels samples.
    pub samples: Samples,
}

/// Samples of an image, from 0 to the largest of their type.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Samples {
    /// Of 8 bits.
    U8(Vec<u8>),
    /// Of 16 bits.
    U16(Vec<u16>),
}

impl Samples {
    /// How many there are.
    pub fn len(&self) -> usize {
        match self {
            Self::U8(samples) => samples.len(),
            Self::U16(samples) => samples.len(),
        }
    }

    /// Whether there are none.
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }

    #[inline]
    fn at(&self, index: usize) -> usize {
        match self {
            Self::U8(samples) => samples[index].into(),
            Self::U16(samples) => samples[index].into(),
        }
    }

    /// Linear light of each value that a sample can have.
    fn linear(&self) -> Vec<f64> {
        let most = match self {
            Self::U8(_) => u8::MAX.into(),
            Self::U16(_) => u16::MAX,
        };
        let linear = |value: u16| match f64::from(value) / f64::from(most) {
            value if value > 0.04045 => libm::pow((value + 0.055) / 1.055, 2.4),
            value => value / 12.92,
        };
        (0..=most).map(linear).collect()
    }
}

/// Reads a PNG or JPEG file of at most so many pixels. A decoder takes no more than `max_bytes` bytes.
pub fn decode(bytes: &[u8], max_pixels: u64, max_bytes: u64) -> Result<Image> {
    let max_pixels = max_pixels.min(ANY_PIXELS.saturating_add(PIXELS_A_BYTE.saturating_mul(bytes.len() as u64)));
    let check = |width: usize, height: usize, bytes_of_all: Option<usize>| {
        if width as u64 * height as u64 > max_pixels {
            return Err(Error::too_large(format_args!(
                "the image has more pixels than allowed, {max_pixels}: {width} × {height}"
            )));
        }
        match bytes_of_all.filter(|&bytes| bytes as u64 <= max_bytes) {
            Some(bytes) => Ok(bytes),
            None => Err(Error::too_large(format_args!(
                "the pixels of the image take more bytes than allowed, {max_bytes}: {width} × {height}"
            ))),
        }
    };
    match Format::of(bytes) {
        Some(Format::Png) => decode_png(bytes, max_bytes, check),
        Some(Format::Jpeg) => decode_jpeg(bytes, check),
        _ => Err(of_no_format()),
    }
}

/// Bytes that are taken for what a PNG file has before its pixels.
const HEAD_OF_PNG: u64 = 1 << 20;

/// Pixels that a byte of a file may stand for, as many as images of one colour have,
const PIXELS_A_BYTE: u64 = 1000;
/// beyond these: small images may be very regular.
const ANY_PIXELS: u64 = 1 << 20;

/// The marker at the end of a JPEG file,
const END_OF_JPEG: [u8; 2] = [0xff, 0xd9];
/// which lies within so many bytes of it: some cameras write a little behind it.
const JPEG_TAIL: usize = 1 << 12;

/// The error of a decoder.
fn broken(error: impl Display) -> Error {
    Error::parameter(format_args!("the image cannot be read: {error}"))
}

/// A PNG file of which all before the pixels was read.
fn open_png(bytes: &[u8], max_bytes: u64) -> Result<png::Reader<Cursor<&[u8]>>> {
    let limits = png::Limits { bytes: usize::try_from(max_bytes).unwrap_or(usize::MAX) };
    let mut decoder = png::Decoder::new_with_limits(Cursor::new(bytes), limits);
    // palettes become colours, transparent colours alpha, and fewer than 8 bits 8
    decoder.set_transformations(png::Transformations::EXPAND);
    decoder.set_ignore_text_chunk(true);
    decoder.set_ignore_iccp_chunk(true);
    decoder.read_info().map_err(|error| match error {
        png::DecodingError::LimitsExceeded => {
            Error::too_large(format_args!("the image needs more than {max_bytes} bytes of memory"))
        }
        error => broken(error),
    })
}

fn decode_png(
    bytes: &[u8],
    max_bytes: u64,
    check: impl Fn(usize, usize, Option<usize>) -> Result<usize>,
) -> Result<Image> {
    let mut reader = open_png(bytes, max_bytes)?;
    let (width, height) = (reader.info().width as usize, reader.info().height as usize);
    let mut samples = vec![0; check(width, height, reader.output_buffer_size())?];
    reader.next_frame(&mut samples).map_err(broken)?;
    let (colour, depth) = reader.output_color_type();
    let channels = colour.samples();
    let samples = match depth {
        png::BitDepth::Sixteen => {
            Samples::U16(samples.as_chunks().0.iter().map(|bytes| u16::from_be_bytes(*bytes)).collect())
        }
        _ => Samples::U8(samples),
    };
    Ok(Image { width, height, channels, samples })
}

/// As large as the format allows, without vector instructions.
fn options() -> DecoderOptions {
    let most = u16::MAX.into();
    DecoderOptions::default().set_max_width(most).set_max_height(most).set_use_unsafe(false)
}

/// A JPEG file of which all before the pixels was read.
fn open_jpeg(bytes: &[u8]) -> Result<JpegDecoder<ZCursor<&[u8]>>> {
    let mut decoder = JpegDecoder::new_with_options(ZCursor::new(bytes), options());
    decoder.decode_headers().map_err(broken)?;
    Ok(decoder)
}

/// Columns and rows of a PNG or JPEG file, as its head says.
pub fn size(bytes: &[u8]) -> Result<(u32, u32)> {
    match Format::of(bytes) {
        Some(Format::Png) => {
            let reader = open_png(bytes, HEAD_OF_PNG)?;
            Ok((reader.info().width, reader.info().height))
        }
        Some(Format::Jpeg) => {
            let (width, height) = open_jpeg(bytes)?.dimensions().ok_or_else(|| broken("it has no size"))?;
            Ok((width as u32, height as u32))
        }
        _ => Err(of_no_format()),
    }
}

/// The error of a file that is no image.
fn of_no_format() -> Error {
    Error::parameter("the image cannot be read: it is neither PNG nor JPEG")
}

fn decode_jpeg(bytes: &[u8], check: impl Fn(usize, usize, Option<usize>) -> Result<usize>) -> Result<Image> {
    // a decoder fills what is missing with grey
    let tail = &bytes[bytes.len().saturating_sub(JPEG_TAIL)..];
    if !tail.windows(2).any(|marker| marker == END_OF_JPEG) {
        return Err(broken("it ends early"));
    }
    let mut decoder = open_jpeg(bytes)?;
    let is_grey = decoder.input_colorspace() == Some(ColorSpace::Luma);
    let (colours, channels) = if is_grey { (ColorSpace::Luma, 1) } else { (ColorSpace::RGB, 3) };
    decoder.set_options(options().jpeg_set_out_colorspace(colours));
    let (width, height) = decoder.dimensions().ok_or_else(|| broken("it has no size"))?;
    let mut samples = vec![0; check(width, height, decoder.output_buffer_size())?];
    decoder.decode_into(&mut samples).map_err(broken)?;
    Ok(Image { width, height, channels, samples: Samples::U8(samples) })
}

/// The pixels of an image as points in a grid: (L, a, b) / `compactness`, of a grey image L alone, and then column and
/// row over √(pixels / `clusters`), the side of a superpixel. Pixels without opacity, and those that `mask` names with
/// false, take no part and count as none.
///
/// # Errors
/// An image whose samples or mask are not as many as it says; a number of clusters of 0; a compactness out of bounds.
pub fn superpixels(image: &Image, mask: Option<&[bool]>, clusters: u64, compactness: f64) -> Result<PointSet> {
    let Image { width, height, channels, ref samples } = *image;
    let pixels = width.saturating_mul(height);
    if !(1..=4).contains(&channels) || pixels.checked_mul(channels) != Some(samples.len()) {
        return Err(Error::parameter(format_args!(
            "an image of {width} × {height} pixels with {channels} channels, of which there must be 1 to 4, cannot \
             have so many samples: {}",
            samples.len()
        )));
    }
    if let Some(mask) = mask.filter(|mask| mask.len() != pixels) {
        return Err(Error::parameter(format_args!(
            "the mask must have one entry for each of {pixels} pixels: {}",
            mask.len()
        )));
    }
    if clusters == 0 {
        return Err(Error::parameter("the number of superpixels must be at least 1: 0"));
    }
    check_compactness(compactness)?;
    let has_alpha = channels % 2 == 0;
    let is_opaque = |pixel: usize| !has_alpha || samples.at(pixel * channels + channels - 1) > 0;
    let takes_part = |pixel: usize| is_opaque(pixel) && mask.is_none_or(|mask| mask[pixel]);
    let mask: Option<Vec<bool>> = (has_alpha || mask.is_some()).then(|| (0..pixels).map(takes_part).collect());
    let taking_part = mask.as_ref().map_or(pixels, |mask| mask.iter().filter(|&&takes_part| takes_part).count());
    if pixels > 0 && taking_part == 0 {
        return Err(Error::parameter("no pixel takes part: all are transparent, or left out by a mask"));
    }
    if pixels > 0 && clusters > taking_part as u64 {
        return Err(more_than(Name::CLUSTERS, clusters, "items", taking_part));
    }
    let side = (taking_part.max(1) as f64 / clusters as f64).sqrt();

    let linear = samples.linear();
    let colours = if channels < 3 { 1 } else { 3 };
    let dimensions = colours + 2;
    let mut values = vec![0.0f32; pixels * dimensions];
    let mut pieces: Vec<&mut [f32]> = values.chunks_mut(PIECE * dimensions).collect();
    parallel::runs_mut(&mut pieces, 1, &|first, pieces| {
        let values = pieces.iter_mut().flat_map(|piece| piece.chunks_exact_mut(dimensions));
        for (pixel, value) in (first * PIECE..).zip(values) {
            let light = |channel: usize| linear[samples.at(pixel * channels + channel)];
            let colour = match colours {
                1 => [lightness(root(light(0))), 0.0, 0.0],
                _ => lab([light(0), light(1), light(2)]),
            };
            let place = [(pixel % width) as f64 / side, (pixel / width) as f64 / side];
            let colour = colour.iter().take(colours).map(|x| x / compactness);
            value.iter_mut().zip(colour.chain(place)).for_each(|(to, x)| *to = x as f32);
        }
    });
    Ok(PointSet {
        dimensions,
        values: Values::F4(values),
        weights: None,
        mask,
        shape: vec![height, width],
        graph: Graph::Grid { full: false },
    })
}

/// L, a and b of linear red, green and blue.
fn lab(rgb: [f64; 3]) -> [f64; 3] {
    let [x, y, z] = XYZ_OF_RGB.map(|(row, white)| root((row[0] * rgb[0] + row[1] * rgb[1] + row[2] * rgb[2]) / white));
    [lightness(y), 500.0 * (x - y), 200.0 * (y - z)]
}

/// The colour in sRGB of a mean of coordinates of pixels, which had this compactness.
pub fn colour(mean: &[f64], compactness: f64) -> [u8; 3] {
    let [l, a, b] = match mean {
        [l, a, b, _, _] => [l * compactness, a * compactness, b * compactness],
        [l, ..] => [l * compactness, 0.0, 0.0],
        [] => [0.0; 3],
    };
    let y = (l + 16.0) / 116.0;
    let cubed = |root: f64| if root > ROOT_OF_LINEAR { root * root * root } else { (root - 16.0 / 116.0) / 7.787 };
    let white = XYZ_OF_RGB.map(|(_, white)| white);
    let xyz = [cubed(y + a / 500.0) * white[0], cubed(y) * white[1], cubed(y - b / 200.0) * white[2]];
    RGB_OF_XYZ.map(|row| {
        let linear = row[0] * xyz[0] + row[1] * xyz[1] + row[2] * xyz[2];
        let value = if linear > 0.0031308 { 1.055 * libm::pow(linear, 1.0 / 2.4) - 0.055 } else { 12.92 * linear };
        (value * 255.0).round().clamp(0.0, 255.0) as u8
    })
}

/// L of the root of relative luminance.
fn lightness(root: f64) -> f64 {
    116.0 * root - 16.0
}

/// The cube root of CIELAB, linear near 0.
fn root(value: f64) -> f64 {
    if value > 0.008856 { libm::cbrt(value) } else { 7.787 * value + 16.0 / 116.0 }
}

#[cfg(test)]
mod tests;
