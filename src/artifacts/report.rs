//! The report.

use super::{Artifact, Content, Encoding, Flag, Form, Need, given, schema_of};
use crate::error::Result;
use crate::report::Report;

/// The [report](crate::report) of a job.
pub static REPORT: Artifact = Artifact {
    name: "report",
    about: "What was read, the energies, every iteration, the timings.",
    needs: &[Need::Report],
    forms: &[REPORT_JSON],
    choices: &[],
    flags: &[Flag {
        name: "--report",
        value: "OUT.json",
        help: "Where to write the report (JSON): a file, or - for standard output",
    }],
    is_of_points: true,
    is_served: true,
};

/// [`crate::report::Report`].
pub const REPORT_JSON: Form = Form {
    file: "report.json",
    media_type: "application/json",
    is_stored: true,
    schema: Some(schema_of::<Report>),
    encode: json,
};

fn json<'a>(content: &Content<'a>) -> Result<Encoding<'a>> {
    let (report, is_indented) = (given(content.report)?, content.is_indented);
    Ok(Box::new(move |out| {
        match is_indented {
            true => serde_json::to_writer_pretty(&mut *out, report)?,
            false => serde_json::to_writer(&mut *out, report)?,
        }
        out.write_all(b"\n")
    }))
}
