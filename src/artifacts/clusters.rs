//! The cluster table.

use serde::Serialize;
use utoipa::ToSchema;

use super::{Artifact, Content, Encoding, Flag, Form, Need, given, schema_of};
use crate::complex::{Cluster, Graph};
use crate::data::{PointCluster, PointTable};
use crate::error::Result;

/// The cluster table.
pub static CLUSTERS: Artifact = Artifact {
    name: "clusters",
    about: "A row a cluster: size, place, shape, neighbours, energy.",
    needs: &[Need::Labels, Need::Mesh],
    forms: &[
        Form {
            file: "clusters.json",
            media_type: "application/json",
            is_stored: false,
            schema: Some(schema_of::<ClusterTable<'_>>),
            encode: json,
        },
        Form { file: "clusters.csv", media_type: "text/csv", is_stored: false, schema: None, encode: csv },
    ],
    choices: &[],
    flags: &[Flag {
        name: "--clusters-table",
        value: "OUT",
        help: "Where to write the cluster table: OUT.json or OUT.csv, or - for JSON on standard output",
    }],
    is_of_points: true,
    is_served: true,
};

/// The cluster table as JSON.
#[derive(Debug, Serialize, ToSchema)]
pub struct ClusterTable<'a> {
    /// Version of this format: 1.
    tesserae: u32,
    /// A row a cluster.
    clusters: Rows<'a>,
}

/// Rows of the cluster table.
#[derive(Debug, Serialize, ToSchema)]
#[serde(untagged)]
#[schema(as = ClusterRows)]
enum Rows<'a> {
    /// Of a mesh.
    Mesh(Vec<Cluster>),
    /// Of points.
    Points(&'a [PointCluster]),
}

/// Cluster table and neighbours of a content.
pub(super) enum Clusters<'a> {
    Mesh(Graph),
    Points(&'a PointTable),
}

impl<'a> Clusters<'a> {
    pub fn of(content: &Content<'a>) -> Result<Self> {
        if let Some(table) = content.points {
            return Ok(Self::Points(table));
        }
        let labels = given(content.labels)?;
        Ok(Self::Mesh(Graph::new(given(content.mesh)?, labels.labels, labels.clusters)?))
    }

    /// Names of the columns, and the types of their values in GraphML.
    pub fn columns(&self) -> Vec<(String, &'static str)> {
        match self {
            Self::Mesh(_) => COLUMNS.iter().map(|column| (column.name.to_owned(), column.kind)).collect(),
            Self::Points(table) => {
                let dimensions = table.rows.first().map_or(0, |row| row.mean.len());
                let means = (0..dimensions).map(|axis| (format!("mean_{axis}"), "double"));
                POINT_COLUMNS.iter().map(|column| (column.name.to_owned(), column.kind)).chain(means).collect()
            }
        }
    }

    /// Values of each row as text; none where JSON has null.
    pub fn rows(&self) -> Vec<Vec<Option<String>>> {
        match self {
            Self::Mesh(graph) => {
                graph.nodes.iter().map(|row| COLUMNS.iter().map(|column| (column.value)(row)).collect()).collect()
            }
            Self::Points(table) => {
                let values = |row: &PointCluster| {
                    let means = row.mean.iter().map(|&mean| number(mean));
                    POINT_COLUMNS.iter().map(|column| (column.value)(row)).chain(means).collect()
                };
                table.rows.iter().map(values).collect()
            }
        }
    }
}

fn json<'a>(content: &Content<'a>) -> Result<Encoding<'a>> {
    let clusters = match Clusters::of(content)? {
        Clusters::Mesh(graph) => Rows::Mesh(graph.nodes),
        Clusters::Points(table) => Rows::Points(&table.rows),
    };
    let table = ClusterTable { tesserae: 1, clusters };
    Ok(Box::new(move |out| {
        serde_json::to_writer(&mut *out, &table)?;
        out.write_all(b"\n")
    }))
}

fn csv<'a>(content: &Content<'a>) -> Result<Encoding<'a>> {
    let clusters = Clusters::of(content)?;
    Ok(Box::new(move |out| {
        let names: Vec<String> = clusters.columns().into_iter().map(|(name, _)| name).collect();
        writeln!(out, "{}", names.join(","))?;
        for row in clusters.rows() {
            let values: Vec<String> = row.into_iter().map(Option::unwrap_or_default).collect();
            writeln!(out, "{}", values.join(","))?;
        }
        Ok(())
    }))
}

/// A column of the table, for formats without nested values.
#[derive(Debug, Clone, Copy)]
struct Column<Row> {
    name: &'static str,
    /// Type of its values in GraphML.
    kind: &'static str,
    /// A value as text; none where JSON has null.
    value: fn(&Row) -> Option<String>,
}

/// All columns of points but their means.
const POINT_COLUMNS: [Column<PointCluster>; 6] = [
    column("cluster", "long", |row| Some(row.cluster.to_string())),
    column("items", "long", |row| Some(row.items.to_string())),
    column("weight", "double", |row| number(row.weight)),
    column("energy", "double", |row| number(row.energy)),
    column("neighbours", "long", |row| Some(row.neighbours.to_string())),
    column("component", "long", |row| Some(row.component.to_string())),
];

/// All columns of a mesh.
const COLUMNS: [Column<Cluster>; 24] = [
    column("cluster", "long", |row| Some(row.cluster.to_string())),
    column("faces", "long", |row| Some(row.faces.to_string())),
    column("area", "double", |row| number(row.area)),
    column("perimeter", "double", |row| number(row.perimeter)),
    column("centroid_x", "double", |row| number(row.centroid?[0])),
    column("centroid_y", "double", |row| number(row.centroid?[1])),
    column("centroid_z", "double", |row| number(row.centroid?[2])),
    column("normal_x", "double", |row| number(row.normal?[0])),
    column("normal_y", "double", |row| number(row.normal?[1])),
    column("normal_z", "double", |row| number(row.normal?[2])),
    column("normal_cone", "double", |row| number(row.normal_cone?)),
    column("low_x", "double", |row| number(row.bbox?[0][0])),
    column("low_y", "double", |row| number(row.bbox?[0][1])),
    column("low_z", "double", |row| number(row.bbox?[0][2])),
    column("high_x", "double", |row| number(row.bbox?[1][0])),
    column("high_y", "double", |row| number(row.bbox?[1][1])),
    column("high_z", "double", |row| number(row.bbox?[1][2])),
    column("roundness", "double", |row| number(row.roundness?)),
    column("planarity", "double", |row| number(row.planarity?)),
    column("euler", "long", |row| Some(row.euler.to_string())),
    column("neighbours", "long", |row| Some(row.neighbours.to_string())),
    column("component", "long", |row| Some(row.component?.to_string())),
    column("open", "boolean", |row| Some(row.open.to_string())),
    column("energy", "double", |row| number(row.energy)),
];

const fn column<Row>(name: &'static str, kind: &'static str, value: fn(&Row) -> Option<String>) -> Column<Row> {
    Column { name, kind, value }
}

/// The shortest text that is read as this number; none of one that is not finite.
pub(super) fn number(value: f64) -> Option<String> {
    value.is_finite().then(|| format!("{value:?}"))
}

#[cfg(test)]
mod tests {
    use super::super::tests::written;
    use super::*;
    use serde_json::Value;

    #[test]
    fn both_forms_have_the_same_numbers() {
        let [json, csv] = [0, 1].map(|form| written(&CLUSTERS, form));
        let json: Value = serde_json::from_slice(&json).expect("JSON");
        let csv = String::from_utf8(csv).expect("text");
        let mut lines = csv.lines();
        let names: Vec<&str> = lines.next().expect("a header").split(',').collect();
        let rows: Vec<Vec<&str>> = lines.map(|line| line.split(',').collect()).collect();
        assert_eq!(json["tesserae"], 1);
        assert_eq!(json["clusters"].as_array().expect("rows").len(), rows.len());
        for (row, values) in json["clusters"].as_array().expect("rows").iter().zip(rows) {
            for (name, text) in names.iter().zip(values) {
                let axis = || ["x", "y", "z"].iter().position(|axis| name.ends_with(axis)).expect("an axis");
                let value = match name.split_once('_') {
                    Some(("centroid", _)) => &row["centroid"][axis()],
                    Some(("normal", "x" | "y" | "z")) => &row["normal"][axis()],
                    Some(("low", _)) => &row["bbox"][0][axis()],
                    Some(("high", _)) => &row["bbox"][1][axis()],
                    _ => &row[*name],
                };
                match value {
                    Value::Null => assert_eq!(text, "", "{name}"),
                    Value::Number(number) => {
                        // serde_json reads numbers to the last digit but one
                        let (one, other) = (number.as_f64().expect("a number"), text.parse::<f64>().expect("a number"));
                        assert!((one - other).abs() <= 1e-14 * one.abs(), "{name}: {one} {other}");
                    }
                    other => assert_eq!(other.to_string(), text, "{name}"),
                }
            }
        }
    }
}
