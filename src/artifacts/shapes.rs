//! The shapes of clusters: those of the report, alone.

use super::{Artifact, Content, Encoding, Flag, Form, Need, given, schema_of};
use crate::error::Result;
use crate::shapes::table::ClusterShape;

/// The shape of each cluster. Over HTTP the report has it.
pub static SHAPES: Artifact = Artifact {
    name: "shapes",
    about: "The shape of each cluster, with its parameters, residuals and neighbours; of energies of shapes.",
    needs: &[Need::Labels, Need::Shapes, Need::Report],
    forms: &[Form {
        file: "shapes.json",
        media_type: "application/json",
        is_stored: false,
        schema: Some(schema_of::<ClusterShape>),
        encode: json,
    }],
    choices: &[],
    flags: &[Flag {
        name: "--shapes-out",
        value: "OUT.json",
        help: "Energies planes and shapes: where to write the shape of each cluster (JSON): a file, or - for standard \
               output",
    }],
    is_of_points: false,
    is_served: false,
};

fn json<'a>(content: &Content<'a>) -> Result<Encoding<'a>> {
    let shapes = given(given(content.report)?.shapes.as_ref())?;
    Ok(Box::new(move |out| {
        serde_json::to_writer_pretty(&mut *out, shapes)?;
        out.write_all(b"\n")
    }))
}
