//! Labels: one a face, in upload order.

use png::{BitDepth, ColorType};
use serde::Serialize;
use utoipa::ToSchema;

use super::npy::write_u32;
use super::{Artifact, Content, Encoding, Flag, Form, Need, given, image, npy_header, schema_of};
use crate::error::Result;
use crate::hierarchy::Cut;

/// The labels of a job, an iteration or a cut.
pub static LABELS: Artifact = Artifact {
    name: "labels",
    about: "The cluster of each face or item, in upload order.",
    needs: &[Need::Labels, Need::Faces],
    forms: &[LABELS_JSON, LABELS_NPY, LABELS_BIN, LABELS_TXT, LABELS_CSV, LABELS_PNG],
    choices: &[],
    flags: &[Flag {
        name: "--labels",
        value: "OUT",
        help: "Where to write the labels: OUT.npy, OUT.txt (a number a line, as METIS writes), OUT.csv, OUT.json, \
               OUT.bin (u32, little-endian), OUT.png (of images), or - for JSON on standard output",
    }],
    is_of_points: true,
    is_served: true,
};

/// `{"clusters": K, "labels": […]}`; of a cut also its kind and energy.
pub const LABELS_JSON: Form = Form {
    file: "labels.json",
    media_type: "application/json",
    is_stored: false,
    schema: Some(schema_of::<Labels>),
    encode: json,
};

/// NumPy's `.npy`, format version 1.0, uint32, little-endian: one dimension, or the shape of a grid of points.
pub const LABELS_NPY: Form =
    Form { file: "labels.npy", media_type: "application/x-npy", is_stored: true, schema: None, encode: npy };

/// One u32 a face, little-endian, nothing else: what follows the header of the `.npy`.
pub const LABELS_BIN: Form =
    Form { file: "labels.bin", media_type: "application/octet-stream", is_stored: false, schema: None, encode: raw };

/// A number a line, as METIS writes partitions.
pub const LABELS_TXT: Form =
    Form { file: "labels.txt", media_type: "text/plain", is_stored: false, schema: None, encode: text };

/// A table with the columns `face`, of points `item`, and `cluster`.
pub const LABELS_CSV: Form =
    Form { file: "labels.csv", media_type: "text/csv", is_stored: false, schema: None, encode: csv };

/// An image of the shape of a grid of points: 16-bit grey, 65,535 where a mask leaves an item out. Of more clusters,
/// red, green, blue and alpha are the bytes of the label, the lowest first.
pub const LABELS_PNG: Form =
    Form { file: "labels.png", media_type: "image/png", is_stored: false, schema: None, encode: png };

/// Labels as JSON; the other formats hold the same numbers.
#[derive(Debug, Clone, Copy, Serialize, ToSchema)]
pub struct Labels<'a> {
    /// Number of clusters.
    pub clusters: u64,
    /// Of labels cut from a hierarchy: `exact` for a state that the run had, `merged` for the last one with more
    /// clusters and the next round's cheapest merges on top.
    #[serde(skip_serializing_if = "Option::is_none")]
    #[schema(value_type = Option<CutKind>)]
    pub cut: Option<&'static str>,
    /// Of labels cut from a hierarchy: their energy, source units. Null when it overflows.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub energy: Option<f64>,
    /// The cluster of each face, in upload order: 0 … clusters − 1.
    pub labels: &'a [u32],
}

/// What a cut of a hierarchy is
#[derive(Debug, Serialize, ToSchema)]
#[serde(rename_all = "lowercase")]
pub enum CutKind {
    /// A state that the run had.
    Exact,
    /// The last state with more clusters, and the next round's cheapest merges.
    Merged,
}

impl<'a> Labels<'a> {
    /// Labels that are not cut from a hierarchy.
    pub fn new(clusters: u64, labels: &'a [u32]) -> Self {
        Self { clusters, cut: None, energy: None, labels }
    }
}

impl<'a> From<&'a Cut> for Labels<'a> {
    fn from(cut: &'a Cut) -> Self {
        Self { clusters: cut.clusters(), cut: Some(cut.kind()), energy: Some(cut.energy), labels: &cut.labels }
    }
}

fn json<'a>(content: &Content<'a>) -> Result<Encoding<'a>> {
    let labels = given(content.labels)?;
    Ok(Box::new(move |out| {
        serde_json::to_writer(&mut *out, &labels)?;
        out.write_all(b"\n")
    }))
}

fn npy<'a>(content: &Content<'a>) -> Result<Encoding<'a>> {
    let labels = given(content.labels)?.labels;
    let shape = match content.shape {
        Some(shape @ [_, _, ..]) => format!("({})", shape.iter().map(usize::to_string).collect::<Vec<_>>().join(", ")),
        Some(_) | None => format!("({},)", labels.len()),
    };
    Ok(Box::new(move |out| {
        out.write_all(&npy_header("<u4", &shape))?;
        write_u32(out, labels)
    }))
}

fn raw<'a>(content: &Content<'a>) -> Result<Encoding<'a>> {
    let labels = given(content.labels)?.labels;
    Ok(Box::new(move |out| write_u32(out, labels)))
}

fn text<'a>(content: &Content<'a>) -> Result<Encoding<'a>> {
    let labels = given(content.labels)?.labels;
    Ok(Box::new(move |out| labels.iter().try_for_each(|label| writeln!(out, "{label}"))))
}

fn csv<'a>(content: &Content<'a>) -> Result<Encoding<'a>> {
    let labels = given(content.labels)?.labels;
    // points have a shape
    let noun = if content.shape.is_some() { "item" } else { "face" };
    Ok(Box::new(move |out| {
        writeln!(out, "{noun},cluster")?;
        labels.iter().enumerate().try_for_each(|(face, label)| writeln!(out, "{face},{label}"))
    }))
}

fn png<'a>(content: &Content<'a>) -> Result<Encoding<'a>> {
    let Labels { clusters, labels, .. } = given(content.labels)?;
    let size = image::size(content, LABELS_PNG.file)?;
    Ok(Box::new(move |out| match clusters <= u16::MAX.into() {
        true => {
            let grey = labels.iter().flat_map(|&label| (label as u16).to_be_bytes());
            image::write(out, size, ColorType::Grayscale, BitDepth::Sixteen, &grey.collect::<Vec<_>>())
        }
        false => {
            let bytes: Vec<u8> = labels.iter().flat_map(|label| label.to_le_bytes()).collect();
            image::write(out, size, ColorType::Rgba, BitDepth::Eight, &bytes)
        }
    }))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::device::FREE;

    fn written(form: &Form, labels: Labels<'_>) -> Vec<u8> {
        let content = Content { labels: Some(labels), ..Content::default() };
        let mut out = Vec::new();
        (form.encode)(&content).expect("labels")(&mut out).expect("a vector takes everything");
        out
    }

    #[test]
    fn npy_data_begins_at_a_multiple_of_64() {
        let labels = Labels::new(3, &[7, 1 << 31]);
        let bytes = written(&LABELS_NPY, labels);
        assert_eq!(bytes.len() % 64, 8);
        assert_eq!(&bytes[bytes.len() - 8..], [7, 0, 0, 0, 0, 0, 0, 128]);
        assert_eq!(&bytes[..8], b"\x93NUMPY\x01\x00");
        assert_eq!(written(&LABELS_BIN, labels), bytes[bytes.len() - 8..]);
    }

    #[test]
    fn text_has_a_number_a_line_and_csv_its_face_too() {
        let labels = Labels::new(3, &[0, 2, 1]);
        assert_eq!(written(&LABELS_TXT, labels), b"0\n2\n1\n");
        assert_eq!(written(&LABELS_CSV, labels), b"face,cluster\n0,0\n1,2\n2,1\n");
    }

    #[test]
    fn images_have_the_shape_of_the_grid_and_hold_every_label() {
        let read = |clusters, labels: &[u32]| {
            let content =
                Content { labels: Some(Labels::new(clusters, labels)), shape: Some(&[2, 3]), ..Content::default() };
            let mut out = Vec::new();
            (LABELS_PNG.encode)(&content).expect("an image")(&mut out).expect("a vector takes everything");
            let mut reader = png::Decoder::new(std::io::Cursor::new(out)).read_info().expect("PNG");
            let mut samples = vec![0; reader.output_buffer_size().expect("a size")];
            reader.next_frame(&mut samples).expect("PNG");
            assert_eq!((reader.info().width, reader.info().height), (3, 2));
            samples
        };
        assert_eq!(read(300, &[0, 1, 2, 299, 256, FREE]), [0, 0, 0, 1, 0, 2, 1, 43, 1, 0, 255, 255]);
        let many = read(70_000, &[0, 1, 2, 69_999, 256, FREE]);
        let labels = many.as_chunks().0.iter().map(|bytes| u32::from_le_bytes(*bytes));
        assert_eq!(labels.collect::<Vec<_>>(), [0, 1, 2, 69_999, 256, FREE]);
        let list = Content { labels: Some(Labels::new(3, &[0, 2, 1])), ..Content::default() };
        assert!((LABELS_PNG.encode)(&list).is_err());
    }

    #[test]
    fn json_names_the_clusters_and_lists_the_labels() {
        let labels = Labels::new(3, &[0, 2, 1]);
        assert_eq!(written(&LABELS_JSON, labels), b"{\"clusters\":3,\"labels\":[0,2,1]}\n");
        let cut = Labels { cut: Some("exact"), energy: Some(f64::INFINITY), ..labels };
        let json = b"{\"clusters\":3,\"cut\":\"exact\",\"energy\":null,\"labels\":[0,2,1]}\n";
        assert_eq!(written(&LABELS_JSON, cut), json);
    }
}
