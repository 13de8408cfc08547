//! PLY files made on the spot, in any encoding and with any properties, and short ways to read them.

use tesserae_mesh::Result;
use tesserae_mesh::mesh::{self, Format, Limits, NoResources, PolygonMesh};

/// How the rows of a file are written.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Encoding {
    Text,
    Little,
    Big,
}

pub const ENCODINGS: [Encoding; 3] = [Encoding::Text, Encoding::Little, Encoding::Big];

/// An element: its name, its properties as the header has them, and for each row the values of each property.
pub type Element = (&'static str, Vec<String>, Vec<Vec<Vec<f64>>>);

/// A PLY file; `end` ends its lines.
pub fn write(encoding: Encoding, elements: &[Element], end: &str) -> Vec<u8> {
    let format = match encoding {
        Encoding::Text => "ascii",
        Encoding::Little => "binary_little_endian",
        Encoding::Big => "binary_big_endian",
    };
    let mut header = format!("ply{end}format {format} 1.0{end}comment made by a test{end}obj_info none{end}");
    for (name, properties, rows) in elements {
        header += &format!("element {name} {}{end}", rows.len());
        for property in properties {
            header += &format!("property {property}{end}");
        }
    }
    header += &format!("end_header{end}");
    let mut bytes = header.into_bytes();
    for (_, properties, rows) in elements {
        for row in rows {
            add_row(&mut bytes, encoding, properties, row, end);
        }
    }
    bytes
}

fn add_row(bytes: &mut Vec<u8>, encoding: Encoding, properties: &[String], row: &[Vec<f64>], end: &str) {
    let mut line = String::new();
    for (property, values) in properties.iter().zip(row) {
        let words: Vec<&str> = property.split(' ').collect();
        let typed: Vec<(&str, f64)> = match words[..] {
            ["list", count, value, _] => {
                let values = values.iter().map(|&number| (value, number));
                [(count, values.len() as f64)].into_iter().chain(values).collect()
            }
            _ => vec![(words[0], values[0])],
        };
        for (kind, number) in typed {
            match encoding {
                Encoding::Text => line += &format!("{number} "),
                Encoding::Little => bytes.extend(little(kind, number)),
                Encoding::Big => bytes.extend(little(kind, number).iter().rev()),
            }
        }
    }
    if encoding == Encoding::Text && !properties.is_empty() {
        bytes.extend(line.trim_end().bytes().chain(end.bytes()));
    }
}

/// A value of a type, least significant byte first.
fn little(kind: &str, number: f64) -> Vec<u8> {
    match kind {
        "char" | "int8" => (number as i8).to_le_bytes().to_vec(),
        "uchar" | "uint8" => (number as u8).to_le_bytes().to_vec(),
        "short" | "int16" => (number as i16).to_le_bytes().to_vec(),
        "ushort" | "uint16" => (number as u16).to_le_bytes().to_vec(),
        "int" | "int32" => (number as i32).to_le_bytes().to_vec(),
        "uint" | "uint32" => (number as u32).to_le_bytes().to_vec(),
        "float" | "float32" => (number as f32).to_le_bytes().to_vec(),
        "double" | "float64" => number.to_le_bytes().to_vec(),
        _ => panic!("a type: {kind}"),
    }
}

/// The names of properties, one a word: `words("float x", …)`.
pub fn properties(names: &[&str]) -> Vec<String> {
    names.iter().map(|name| (*name).to_owned()).collect()
}

/// Vertices of three floats.
pub fn vertices(positions: &[[f64; 3]]) -> Element {
    let rows = positions.iter().map(|position| position.iter().map(|&coordinate| vec![coordinate]).collect());
    ("vertex", properties(&["float x", "float y", "float z"]), rows.collect())
}

/// Faces of lists with a length of one byte and indices of four.
pub fn faces(corners: &[&[u32]]) -> Element {
    let rows = corners.iter().map(|corners| vec![corners.iter().map(|&corner| corner.into()).collect()]);
    ("face", properties(&["list uchar int vertex_indices"]), rows.collect())
}

/// The unit square as two triangles.
pub fn square() -> Vec<Element> {
    vec![vertices(&crate::make::SQUARE), faces(&[&[0, 1, 2], &[0, 2, 3]])]
}

/// Reads a PLY file.
pub fn ply(bytes: impl AsRef<[u8]>) -> Result<PolygonMesh> {
    mesh::read(bytes.as_ref(), Format::Ply, &NoResources, &Limits::default())
}
