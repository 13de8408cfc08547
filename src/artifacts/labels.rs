//! Encodings of results.

use std::io::{self, Write};

use super::npy_header;
use crate::cluster::record::Record;
use crate::hierarchy::Cut;

/// How labels are written.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum LabelFormat {
    /// `{"clusters": K, "labels": […]}`.
    Json,
    /// NumPy's `.npy`, format version 1.0, one-dimensional uint32, little-endian.
    Npy,
    /// One u32 a face, little-endian, nothing else.
    Raw,
}

impl LabelFormat {
    /// Every format, the default one first.
    pub const ALL: [LabelFormat; 3] = [LabelFormat::Json, LabelFormat::Npy, LabelFormat::Raw];

    /// IANA media type (`application/x-npy` is not registered, but usual).
    pub fn media_type(self) -> &'static str {
        match self {
            LabelFormat::Json => "application/json",
            LabelFormat::Npy => "application/x-npy",
            LabelFormat::Raw => "application/octet-stream",
        }
    }

    /// File extension, without the dot.
    pub fn extension(self) -> &'static str {
        match self {
            LabelFormat::Json => "json",
            LabelFormat::Npy => "npy",
            LabelFormat::Raw => "bin",
        }
    }
}

/// Writes labels, one a face in upload order, of `clusters` clusters.
pub fn write_labels(out: &mut dyn Write, format: LabelFormat, clusters: u64, labels: &[u32]) -> io::Result<()> {
    match format {
        LabelFormat::Json => {
            write!(out, "{{\"clusters\":{clusters},\"labels\":")?;
            serde_json::to_writer(&mut *out, labels).map_err(io::Error::from)?;
            out.write_all(b"}\n")
        }
        LabelFormat::Npy => {
            out.write_all(&npy_header("<u4", &format!("({},)", labels.len())))?;
            write_u32(out, labels)
        }
        LabelFormat::Raw => write_u32(out, labels),
    }
}

/// Writes the labels of a cut; as JSON with the members `cut` and `energy`, which say what it is.
pub fn write_cut(out: &mut dyn Write, format: LabelFormat, cut: &Cut) -> io::Result<()> {
    let clusters = cut.clusters();
    match format {
        LabelFormat::Json => {
            write!(out, "{{\"clusters\":{clusters},\"cut\":\"{}\",\"energy\":", cut.kind())?;
            serde_json::to_writer(&mut *out, &cut.energy).map_err(io::Error::from)?;
            out.write_all(b",\"labels\":")?;
            serde_json::to_writer(&mut *out, &cut.labels).map_err(io::Error::from)?;
            out.write_all(b"}\n")
        }
        LabelFormat::Npy | LabelFormat::Raw => write_labels(out, format, clusters, &cut.labels),
    }
}

/// Writes the labels of several iterations as one array of two dimensions in NumPy's format, a row an iteration.
pub fn write_snapshots(out: &mut dyn Write, snapshots: &Record, faces: u64) -> io::Result<()> {
    out.write_all(&npy_header("<u4", &format!("({}, {faces})", snapshots.iterations().len())))?;
    snapshots.replay(|_, labels| write_u32(out, labels))
}

/// Writes numbers as u32 little-endian, on any host.
fn write_u32(out: &mut dyn Write, numbers: &[u32]) -> io::Result<()> {
    let mut bytes = Vec::with_capacity(4 * 16_384);
    for chunk in numbers.chunks(16_384) {
        bytes.clear();
        bytes.extend(chunk.iter().flat_map(|number| number.to_le_bytes()));
        out.write_all(&bytes)?;
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    fn written(format: LabelFormat, labels: &[u32]) -> Vec<u8> {
        let mut out = Vec::new();
        write_labels(&mut out, format, 3, labels).expect("a vector takes everything");
        out
    }

    #[test]
    fn npy_data_begins_at_a_multiple_of_64() {
        let bytes = written(LabelFormat::Npy, &[7, 1 << 31]);
        assert_eq!(bytes.len() % 64, 8);
        assert_eq!(&bytes[bytes.len() - 8..], [7, 0, 0, 0, 0, 0, 0, 128]);
        assert_eq!(&bytes[..8], b"\x93NUMPY\x01\x00");
    }

    #[test]
    fn json_names_the_clusters_and_lists_the_labels() {
        let value: serde_json::Value = serde_json::from_slice(&written(LabelFormat::Json, &[0, 2, 1])).expect("JSON");
        assert_eq!(value, serde_json::json!({"clusters": 3, "labels": [0, 2, 1]}));
    }
}
