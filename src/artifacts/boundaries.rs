//! The curves between clusters.

use super::{Artifact, Content, Encoding, Flag, Form, Need, given, schema_of};
use crate::complex::Boundaries;
use crate::error::Result;

/// The curves between clusters.
pub static BOUNDARIES: Artifact = Artifact {
    name: "boundaries",
    about: "The curves between clusters and the points where they meet.",
    needs: &[Need::Labels, Need::Mesh],
    forms: &[
        Form {
            file: "boundaries.json",
            media_type: "application/json",
            is_stored: false,
            schema: Some(schema_of::<Boundaries>),
            encode: json,
        },
        Form { file: "boundaries.obj", media_type: "model/obj", is_stored: false, schema: None, encode: obj },
    ],
    choices: &[],
    flags: &[Flag {
        name: "--boundaries",
        value: "OUT",
        help: "Where to write the curves between clusters: OUT.json, OUT.obj (lines), or - for JSON on standard output",
    }],
    is_served: true,
};

/// The boundaries of a content.
pub(super) fn boundaries(content: &Content<'_>) -> Result<Boundaries> {
    let labels = given(content.labels)?;
    Boundaries::new(given(content.mesh)?, labels.labels, labels.clusters)
}

fn json<'a>(content: &Content<'a>) -> Result<Encoding<'a>> {
    let boundaries = boundaries(content)?;
    Ok(Box::new(move |out| {
        serde_json::to_writer(&mut *out, &boundaries)?;
        out.write_all(b"\n")
    }))
}

/// A line a curve. VTK does not count groups of lines, so there are none.
fn obj<'a>(content: &Content<'a>) -> Result<Encoding<'a>> {
    let Boundaries { points, curves, .. } = boundaries(content)?;
    Ok(Box::new(move |out| {
        for [x, y, z] in &points {
            writeln!(out, "v {x:?} {y:?} {z:?}")?;
        }
        for curve in &curves {
            write!(out, "l")?;
            let again = curve.points.iter().take(usize::from(curve.closed));
            for point in curve.points.iter().chain(again) {
                write!(out, " {}", point + 1)?;
            }
            writeln!(out)?;
        }
        Ok(())
    }))
}

#[cfg(test)]
mod tests {
    use super::super::tests::written;
    use super::*;
    use serde_json::Value;

    #[test]
    fn lines_are_the_curves_and_closed_ones_return() {
        let [json, obj] = [0, 1].map(|form| written(&BOUNDARIES, form));
        let json: Value = serde_json::from_slice(&json).expect("JSON");
        let obj = String::from_utf8(obj).expect("text");
        let of = |prefix: &'static str| obj.lines().filter_map(move |line| line.strip_prefix(prefix));
        assert_eq!(of("v ").count(), json["points"].as_array().expect("points").len());
        let lines: Vec<Vec<u64>> =
            of("l ").map(|line| line.split(' ').map(|number| number.parse().expect("a number")).collect()).collect();
        let curves = json["curves"].as_array().expect("curves");
        assert_eq!(lines.len(), curves.len());
        assert!(curves.iter().any(|curve| curve["right"].is_null()) && json["tesserae"] == 1);
        for (line, curve) in lines.iter().zip(curves) {
            let mut points: Vec<u64> =
                curve["points"].as_array().expect("points").iter().filter_map(Value::as_u64).collect();
            if curve["closed"] == true {
                points.push(points[0]);
            }
            assert_eq!(*line, points.iter().map(|point| point + 1).collect::<Vec<_>>());
        }
    }
}
