//! Numbers as NumPy and the raw format store them.

use std::io::{self, Write};

/// Writes numbers as u32 little-endian, on any host.
pub(super) fn write_u32(out: &mut dyn Write, numbers: &[u32]) -> io::Result<()> {
    let mut bytes = Vec::with_capacity(4 * 16_384);
    for chunk in numbers.chunks(16_384) {
        bytes.clear();
        bytes.extend(chunk.iter().flat_map(|number| number.to_le_bytes()));
        out.write_all(&bytes)?;
    }
    Ok(())
}
