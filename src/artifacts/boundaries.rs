//! The curves between clusters.

use super::{Artifact, Content, Encoding, Flag, Form, Need, given, schema_of};
use crate::complex::Boundaries;
use crate::error::Result;
use crate::export::glb;
use crate::export::vtp::{self, Cells, Numbers};
use crate::mesh::Faces;

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
        Form {
            file: "boundaries.glb",
            media_type: "model/gltf-binary",
            is_stored: false,
            schema: None,
            encode: as_glb,
        },
        Form {
            file: "boundaries.vtp",
            media_type: "application/x-vtp",
            is_stored: false,
            schema: None,
            encode: as_vtp,
        },
    ],
    choices: &[],
    flags: &[Flag {
        name: "--boundaries",
        value: "OUT",
        help: "Where to write the curves between clusters: OUT.json; lines as OUT.obj, OUT.glb or OUT.vtp; or - for \
               JSON on standard output",
    }],
    is_of_points: false,
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

/// The curves as polylines; closed ones return to their beginning.
fn polylines(boundaries: &Boundaries) -> Faces {
    let mut lines = Faces::default();
    for curve in &boundaries.curves {
        let again = curve.points.iter().take(usize::from(curve.closed));
        lines.push(&curve.points.iter().chain(again).copied().collect::<Vec<u32>>());
    }
    lines
}

/// Lines in the colours of the clusters on their left.
fn as_glb<'a>(content: &Content<'a>) -> Result<Encoding<'a>> {
    let boundaries = boundaries(content)?;
    let left: Vec<u32> = boundaries.curves.iter().map(|curve| curve.left).collect();
    let bytes = glb::lines(&boundaries.points, &polylines(&boundaries), &left)?;
    Ok(Box::new(move |out| out.write_all(&bytes)))
}

/// Lines with the clusters on both sides; −1 on the right of the boundary of the mesh.
fn as_vtp<'a>(content: &Content<'a>) -> Result<Encoding<'a>> {
    let boundaries = boundaries(content)?;
    let lines = polylines(&boundaries);
    let left: Vec<u32> = boundaries.curves.iter().map(|curve| curve.left).collect();
    let right = boundaries.curves.iter().map(|curve| curve.right.map_or(-1, i64::from));
    let sides = [Numbers::u32("left", &left), Numbers::i64("right", right)];
    Ok(Box::new(move |out| vtp::write_cells(out, &boundaries.points, Cells::Lines, &lines, &[], &sides)))
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
