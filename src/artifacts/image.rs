//! Images, as PNG.

use std::io::{self, Write};

use png::{BitDepth, ColorType, Encoder};

use super::Content;
use crate::error::{Error, Result};

/// Writes an image. `samples` has the bytes of its rows, one after the other; those of 16 bits begin with the high
/// byte.
pub(super) fn write(
    out: &mut dyn Write,
    [rows, columns]: [u32; 2],
    colour: ColorType,
    depth: BitDepth,
    samples: &[u8],
) -> io::Result<()> {
    let mut encoder = Encoder::new(out, columns, rows);
    encoder.set_color(colour);
    encoder.set_depth(depth);
    let mut writer = encoder.write_header()?;
    writer.write_image_data(samples)?;
    Ok(writer.finish()?)
}

/// Rows and columns of labels in a grid of two dimensions. `file` is what they are to be written to.
pub(super) fn size(content: &Content<'_>, file: &str) -> Result<[u32; 2]> {
    let size = match content.shape {
        Some(&[rows, columns]) => u32::try_from(rows).ok().zip(u32::try_from(columns).ok()),
        _ => None,
    };
    let (rows, columns) = size.ok_or_else(|| {
        Error::conflict(format_args!(
            "{file} is of labels in rows and columns: of an image, or a grid of two dimensions"
        ))
    })?;
    Ok([rows, columns])
}
