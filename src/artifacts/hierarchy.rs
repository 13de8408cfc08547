//! Hierarchies: the file that cuts are made from, JSON, and scipy's linkage matrix.

use super::{Artifact, Content, Encoding, Flag, Form, Need, given, npy_header, schema_of};
use crate::error::Result;
use crate::hierarchy::json::Hierarchy;

/// A hierarchy.
pub static HIERARCHY: Artifact = Artifact {
    name: "hierarchy",
    about: "All merges, from which cuts at any number of clusters are made.",
    needs: &[Need::Hierarchy],
    forms: &[HIERARCHY_JSON, LINKAGE_NPY, HIERARCHY_TSR],
    choices: &[],
    flags: &[
        Flag {
            name: "--hierarchy",
            value: "OUT",
            help: "Where to write the hierarchy: OUT.tsr, from which `tesserae cut` takes labels, OUT.json, or - for \
                   JSON on standard output",
        },
        Flag {
            name: "--linkage",
            value: "OUT.npy",
            help: "Where to write scipy's linkage matrix of a nested tree with one root: OUT.npy",
        },
    ],
    is_of_points: true,
    is_served: true,
};

/// [`crate::hierarchy::json::Hierarchy`].
pub const HIERARCHY_JSON: Form = Form {
    file: "hierarchy.json",
    media_type: "application/json",
    is_stored: false,
    schema: Some(schema_of::<Hierarchy>),
    encode: json,
};

/// scipy's linkage matrix, float64: a row a merge.
pub const LINKAGE_NPY: Form =
    Form { file: "linkage.npy", media_type: "application/x-npy", is_stored: false, schema: None, encode: linkage };

/// [`crate::hierarchy::stored`], for `tesserae cut`.
pub const HIERARCHY_TSR: Form =
    Form { file: "hierarchy.tsr", media_type: "application/octet-stream", is_stored: true, schema: None, encode: tsr };

fn json<'a>(content: &Content<'a>) -> Result<Encoding<'a>> {
    let (stored, limits) = (given(content.hierarchy)?, content.limits);
    Ok(Box::new(move |out| stored.write_json(out, limits)))
}

fn linkage<'a>(content: &Content<'a>) -> Result<Encoding<'a>> {
    let linkage = given(content.hierarchy)?.linkage()?;
    Ok(Box::new(move |out| {
        let rows = linkage.rows();
        out.write_all(&npy_header("<f8", &format!("({}, 4)", rows.len())))?;
        for number in rows.flatten() {
            out.write_all(&number.to_le_bytes())?;
        }
        Ok(())
    }))
}

fn tsr<'a>(content: &Content<'a>) -> Result<Encoding<'a>> {
    let stored = given(content.hierarchy)?;
    Ok(Box::new(move |out| stored.write(out)))
}
