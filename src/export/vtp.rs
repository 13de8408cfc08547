//! VTK's XML format of polygons and lines, `.vtp`: numbers appended as they are, after 64-bit lengths.

use std::fmt::Write as _;
use std::io::{self, Write};

use super::{Clusters, Geometry, colour};
use crate::mesh::Faces;

/// What the cells of a file are.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Cells {
    /// Polygons.
    Polys,
    /// Polylines.
    Lines,
}

/// Numbers of cells or points.
#[derive(Debug, Clone)]
pub struct Numbers {
    name: &'static str,
    kind: &'static str,
    components: usize,
    bytes: Vec<u8>,
}

impl Numbers {
    /// One u32 each.
    pub fn u32(name: &'static str, numbers: &[u32]) -> Self {
        Self { name, kind: "UInt32", components: 1, bytes: numbers.iter().flat_map(|x| x.to_le_bytes()).collect() }
    }

    /// One i64 each.
    pub fn i64(name: &'static str, numbers: impl Iterator<Item = i64>) -> Self {
        Self { name, kind: "Int64", components: 1, bytes: numbers.flat_map(i64::to_le_bytes).collect() }
    }

    /// The colours of clusters.
    fn colours(clusters: &[u32]) -> Self {
        let bytes = clusters.iter().flat_map(|&cluster| colour::of_cluster(cluster)).collect();
        Self { name: "RGB", kind: "UInt8", components: 3, bytes }
    }

    fn points(points: &[[f64; 3]]) -> Self {
        let bytes = points.iter().flatten().flat_map(|x| x.to_le_bytes()).collect();
        Self { name: "Points", kind: "Float64", components: 3, bytes }
    }
}

/// Writes a VTP with the cluster and the colour of each polygon or point.
pub fn write(out: &mut dyn Write, geometry: &Geometry<'_>) -> io::Result<()> {
    let numbers = geometry.clusters.numbers();
    let clusters = vec![Numbers::u32("cluster", numbers), Numbers::colours(numbers)];
    let (of_points, of_cells) = match geometry.clusters {
        Clusters::OfPoints(_) => (clusters, Vec::new()),
        Clusters::OfFaces(_) => (Vec::new(), clusters),
    };
    write_cells(out, geometry.points, Cells::Polys, geometry.faces, &of_points, &of_cells)
}

/// Writes points and cells with numbers of each.
pub fn write_cells(
    out: &mut dyn Write,
    points: &[[f64; 3]],
    kind: Cells,
    cells: &Faces,
    of_points: &[Numbers],
    of_cells: &[Numbers],
) -> io::Result<()> {
    let tag = match kind {
        Cells::Polys => "Polys",
        Cells::Lines => "Lines",
    };
    let (lines, polygons) = match kind {
        Cells::Polys => (0, cells.len()),
        Cells::Lines => (cells.len(), 0),
    };
    let positions = [Numbers::points(points)];
    let ends = (0..cells.len()).map(|cell| cells.corner_range(cell).end as i64);
    let corners = [
        Numbers::i64("connectivity", cells.all_corners().iter().map(|&corner| i64::from(corner))),
        Numbers::i64("offsets", ends),
    ];
    let sections: [(&str, &[Numbers]); 4] =
        [("PointData", of_points), ("CellData", of_cells), ("Points", &positions), (tag, &corners)];
    let mut head = format!(
        "<?xml version=\"1.0\"?>\n\
         <VTKFile type=\"PolyData\" version=\"1.0\" byte_order=\"LittleEndian\" header_type=\"UInt64\">\n<PolyData>\n\
         <Piece NumberOfPoints=\"{}\" NumberOfVerts=\"0\" NumberOfLines=\"{lines}\" NumberOfStrips=\"0\" \
         NumberOfPolys=\"{polygons}\">\n",
        points.len()
    );
    let mut offset = 0;
    for (section, arrays) in sections {
        let scalars = match arrays.first() {
            Some(first) if section.ends_with("Data") => format!(" Scalars=\"{}\"", first.name),
            _ => String::new(),
        };
        let _ = writeln!(head, "<{section}{scalars}>");
        for Numbers { name, kind, components, bytes } in arrays {
            let _ = writeln!(
                head,
                "<DataArray type=\"{kind}\" Name=\"{name}\" NumberOfComponents=\"{components}\" format=\"appended\" \
                 offset=\"{offset}\"/>"
            );
            offset += size_of::<u64>() + bytes.len();
        }
        let _ = writeln!(head, "</{section}>");
    }
    head.push_str("</Piece>\n</PolyData>\n<AppendedData encoding=\"raw\">\n_");
    out.write_all(head.as_bytes())?;
    for Numbers { bytes, .. } in sections.iter().flat_map(|(_, arrays)| *arrays) {
        out.write_all(&(bytes.len() as u64).to_le_bytes())?;
        out.write_all(bytes)?;
    }
    out.write_all(b"\n</AppendedData>\n</VTKFile>\n")
}
