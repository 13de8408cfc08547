//! The labels of iterations, as the service stores them; the command line writes them as [`LABELS`](super::LABELS).

use super::npy::write_u32;
use super::{Artifact, Content, Encoding, Form, Need, given, npy_header};
use crate::error::Result;

/// The labels of iterations.
pub static SNAPSHOTS: Artifact = Artifact {
    name: "snapshots",
    about: "The labels of the iterations that were asked for.",
    needs: &[Need::Snapshots, Need::Report],
    forms: &[SNAPSHOTS_NPY, SNAPSHOTS_JSON],
    choices: &[],
    flags: &[],
    is_of_points: true,
    is_served: false,
};

/// An array of two dimensions in NumPy's format, a row an iteration.
pub const SNAPSHOTS_NPY: Form =
    Form { file: "snapshots.npy", media_type: "application/x-npy", is_stored: true, schema: None, encode: npy };

/// The list of those iterations.
pub const SNAPSHOTS_JSON: Form =
    Form { file: "snapshots.json", media_type: "application/json", is_stored: true, schema: None, encode: json };

fn npy<'a>(content: &Content<'a>) -> Result<Encoding<'a>> {
    let (snapshots, report) = (given(content.snapshots)?, given(content.report)?);
    let shape = format!("({}, {})", report.snapshots.len(), report.input.items());
    Ok(Box::new(move |out| {
        out.write_all(&npy_header("<u4", &shape))?;
        snapshots.replay(|_, labels| write_u32(out, labels))
    }))
}

fn json<'a>(content: &Content<'a>) -> Result<Encoding<'a>> {
    let report = given(content.report)?;
    Ok(Box::new(move |out| Ok(serde_json::to_writer(out, &report.snapshots)?)))
}
