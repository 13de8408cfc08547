//! What came out, in words and numbers for people; the report has all digits.

use std::fmt::{self, Display};

use tesserae_mesh::data::Format;
use tesserae_mesh::remesh::Summary;
use tesserae_mesh::report::{Input, Report};

/// A count with a comma before each group of three digits.
pub fn count(number: u64) -> String {
    let digits = number.to_string();
    let mut text = String::new();
    for (at, digit) in digits.chars().enumerate() {
        if at > 0 && (digits.len() - at).is_multiple_of(3) {
            text.push(',');
        }
        text.push(digit);
    }
    text
}

/// A number of some unit with six digits.
pub fn number(value: f64) -> String {
    const DIGITS: i32 = 6;
    let exponent = if value == 0.0 { 0 } else { value.abs().log10().floor() as i32 };
    match exponent {
        -5..DIGITS => format!("{value:.*}", (DIGITS - 1 - exponent).max(0) as usize),
        _ => format!("{value:.*e}", DIGITS as usize - 1),
    }
}

/// How many faces the largest cluster has, over the mean.
#[derive(Debug, Clone, Copy)]
pub struct Balance {
    largest: u64,
    ratio: f64,
}

impl Balance {
    /// Of labels, of which those from `clusters` on are of masked items; none of no labels.
    pub fn of(labels: &[u32], clusters: u64) -> Option<Self> {
        let mut faces = vec![0u64; usize::try_from(clusters).ok()?];
        for &label in labels {
            if let Some(faces) = faces.get_mut(label as usize) {
                *faces += 1;
            }
        }
        let all: u64 = faces.iter().sum();
        let largest = faces.into_iter().max().filter(|&largest| largest > 0)?;
        Some(Self { largest, ratio: largest as f64 * clusters as f64 / all as f64 })
    }
}

impl Display for Balance {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "largest {} ({:.2} × the mean)", count(self.largest), self.ratio)
    }
}

/// A clustering or a cut, as a line or a row of a table.
#[derive(Debug, Clone, Default)]
pub struct SummaryRow {
    /// The mesh.
    pub name: String,
    /// Faces of the mesh.
    pub faces: u64,
    /// Whether these are items of points.
    pub are_items: bool,
    /// Whether they are of an image.
    pub are_pixels: bool,
    /// Clusters; none of a whole hierarchy.
    pub clusters: Option<u64>,
    /// The largest cluster.
    pub balance: Option<Balance>,
    /// Source units.
    pub energy: Option<f64>,
    /// Over the energy of hexagons.
    pub hexagon_ratio: Option<f64>,
    /// Seconds from the first byte to the last.
    pub seconds: f64,
    /// Where it ran.
    pub device: String,
    /// Of a whole hierarchy: rounds, and clusters that are left.
    pub tree: Option<(u32, u64)>,
    /// The remesh.
    pub remesh: Option<Summary>,
}

impl SummaryRow {
    /// Of a job with these labels, if it has any.
    pub fn new(name: String, report: &Report, labels: Option<&[u32]>) -> Self {
        Self {
            name,
            faces: report.input.items(),
            are_items: matches!(report.input, Input::Points(_)),
            are_pixels: match &report.input {
                Input::Points(points) => points.format.is_some_and(Format::is_image),
                Input::Mesh(_) => false,
            },
            clusters: labels.map(|_| report.clusters),
            balance: labels.and_then(|labels| Balance::of(labels, report.clusters)),
            energy: report.energy.final_.filter(|_| labels.is_some()),
            hexagon_ratio: report.energy.hexagon_ratio.filter(|_| labels.is_some()),
            seconds: report.timings_ms.total / 1000.0,
            device: report.device.name.clone(),
            tree: report.levels.last().map(|level| (level.round, report.clusters)),
            remesh: report.remesh,
        }
    }

    /// The lines of one result.
    pub fn lines(&self) -> Vec<String> {
        let mut parts = vec![self.what()];
        parts.extend(self.balance.map(|balance| balance.to_string()));
        parts.extend(self.energy.map(|energy| format!("energy {}", number(energy))));
        parts.push(format!("{:.3} s on {}", self.seconds, self.device));
        let mut lines = vec![parts.join(", ")];
        lines.extend(self.remesh.as_ref().map(remesh_line));
        lines
    }

    fn what(&self) -> String {
        let faces = format!("{} {}", count(self.faces), if self.are_items { "items" } else { "faces" });
        match (self.clusters, self.tree) {
            (Some(clusters), _) => clusters_of(clusters, &faces),
            (None, Some((rounds, 1))) => format!("a hierarchy of {faces} in {} rounds", count(rounds.into())),
            (None, Some((rounds, left))) => {
                format!("a hierarchy of {faces} in {} rounds, up to {} clusters", count(rounds.into()), count(left))
            }
            (None, None) => format!("a hierarchy of {faces}"),
        }
    }
}

/// So many clusters of what.
pub fn clusters_of(clusters: u64, what: &str) -> String {
    format!("{} {} of {what}", count(clusters), if clusters == 1 { "cluster" } else { "clusters" })
}

/// What a remesh has, and why it has more vertices than there are clusters.
fn remesh_line(remesh: &Summary) -> String {
    let vertices = remesh.vertices;
    let more = vertices.split + vertices.boundary + vertices.extra;
    let line = format!("remesh: {} vertices, {} triangles", count(vertices.clusters + more), count(remesh.triangles));
    if more == 0 {
        return line;
    }
    // of a surface with c components and b boundary circles, the Euler number is 2c − 2·handles − b
    let handles = (2 * remesh.components as i64 - remesh.loops as i64 - remesh.euler) / 2;
    let mut reasons = Vec::new();
    if handles > 0 {
        let word = if handles == 1 { "handle" } else { "handles" };
        reasons.push(format!("{} {word}", count(handles.unsigned_abs())));
    }
    if vertices.boundary > 0 {
        reasons.push(format!("{} on the boundary", count(vertices.boundary)));
    }
    if reasons.is_empty() {
        reasons.push("clusters that are no disks".to_owned());
    }
    format!("{line} ({} more than clusters: {})", count(more), reasons.join(", "))
}

/// A heading of a table, and what it has of a row.
type Column = (&'static str, fn(&SummaryRow) -> String);

/// The rows as a table, names to the left and numbers to the right, and below it their remeshes.
pub fn table(rows: &[SummaryRow]) -> Vec<String> {
    const COLUMNS: [Column; 7] = [
        ("mesh", |row| row.name.clone()),
        ("faces", |row| count(row.faces)),
        ("clusters", |row| row.clusters.map_or_else(String::new, count)),
        ("largest / mean", |row| row.balance.map_or_else(String::new, |balance| format!("{:.2}", balance.ratio))),
        ("energy", |row| row.energy.map_or_else(String::new, number)),
        ("hexagon ratio", |row| row.hexagon_ratio.map_or_else(String::new, |ratio| format!("{ratio:.4}"))),
        ("seconds", |row| format!("{:.3}", row.seconds)),
    ];
    let cells: Vec<[String; 7]> = [COLUMNS.map(|(heading, _)| heading.to_owned())]
        .into_iter()
        .chain(rows.iter().map(|row| COLUMNS.map(|(_, of)| of(row))))
        .collect();
    let width = |column: usize| cells.iter().map(|row| row[column].chars().count()).max().unwrap_or_default();
    let line = |row: &[String; 7]| {
        let cells = row.iter().enumerate().map(|(column, cell)| {
            let space = " ".repeat(width(column) - cell.chars().count());
            if column == 0 { format!("{cell}{space}") } else { format!("{space}{cell}") }
        });
        cells.collect::<Vec<_>>().join("  ")
    };
    let remesh = |row: &SummaryRow| {
        let clusters = row.clusters.map_or_else(String::new, count);
        Some(format!("{}, {clusters} clusters: {}", row.name, remesh_line(row.remesh.as_ref()?)))
    };
    cells.iter().map(line).chain(rows.iter().filter_map(remesh)).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use tesserae_mesh::remesh::{Placement, VertexCounts};

    #[test]
    fn numbers_are_written_as_people_do() {
        assert_eq!([0, 999, 1000, 96966, 1234567].map(count), ["0", "999", "1,000", "96,966", "1,234,567"]);
        for (value, text) in [
            (5.077100516, "5.07710"),
            (803.3259878, "803.326"),
            (123456.7, "123457"),
            (1234567.0, "1.23457e6"),
            (0.00012345678, "0.000123457"),
            (1.2587e-9, "1.25870e-9"),
            (0.0, "0.00000"),
        ] {
            assert_eq!(number(value), text);
        }
    }

    #[test]
    fn balance_is_that_of_the_largest_cluster() {
        let balance = Balance::of(&[0, 0, u32::MAX, 0, 1, 2, 2], 3).expect("labels");
        assert_eq!((balance.largest, balance.ratio), (3, 1.5));
        assert!(Balance::of(&[], 0).is_none());
    }

    #[test]
    fn a_remesh_says_why_it_has_more_vertices_than_clusters() {
        let vertices = VertexCounts { clusters: 2000, split: 604, boundary: 0, extra: 320 };
        let remesh = Summary {
            placement: Placement::Fit,
            vertices,
            triangles: 6046,
            euler: -108,
            loops: 0,
            components: 1,
            cut_edges: 0,
            flipped: 0,
            checked: true,
        };
        let line = "remesh: 2,924 vertices, 6,046 triangles (924 more than clusters: 55 handles)";
        assert_eq!(remesh_line(&remesh), line);
        let plain = Summary { vertices: VertexCounts { split: 0, extra: 0, ..vertices }, euler: 2, ..remesh };
        assert_eq!(remesh_line(&plain), "remesh: 2,000 vertices, 6,046 triangles");
        let vertices = VertexCounts { boundary: 10, ..vertices };
        let open = Summary { vertices, euler: 1, loops: 1, ..remesh };
        assert!(remesh_line(&open).ends_with("(934 more than clusters: 10 on the boundary)"));
        let pieces = Summary { euler: 2, ..remesh };
        assert!(remesh_line(&pieces).ends_with("(924 more than clusters: clusters that are no disks)"));
    }

    #[test]
    fn a_table_has_its_columns_below_each_other() {
        let row =
            SummaryRow { name: "a.obj".into(), faces: 1000, clusters: Some(10), seconds: 0.5, ..SummaryRow::default() };
        let lines = table(&[row.clone(), SummaryRow { name: "é, a longer name".into(), faces: 1, ..row }]);
        let widths: Vec<usize> = lines.iter().map(|line| line.chars().count()).collect();
        assert_eq!(widths, vec![widths[0]; 3], "{lines:?}");
        assert!(lines[0].starts_with("mesh  ") && lines[1].starts_with("a.obj  "), "{lines:?}");
    }
}
