//! Writing meshes as OBJ and GLB.

use std::io::{self, Write};

use serde_json::{Value, json};

use crate::mesh::{Part, PolygonMesh};

/// Writes a mesh as OBJ: polygons stay polygons, every part begins with an `o` line, positions read back exactly.
pub fn write_obj(out: &mut dyn Write, mesh: &PolygonMesh) -> io::Result<()> {
    for [x, y, z] in &mesh.positions {
        writeln!(out, "v {x} {y} {z}")?;
    }
    for part in &mesh.parts {
        if let Some(name) = &part.group {
            writeln!(out, "o {name}")?;
        }
        for face in face_range(part) {
            out.write_all(b"f")?;
            for corner in mesh.faces.corners(face) {
                write!(out, " {}", u64::from(*corner) + 1)?;
            }
            out.write_all(b"\n")?;
        }
    }
    Ok(())
}

/// Writes a mesh as binary glTF 2.0: f32 positions, u32 indices, one node and mesh a part. Polygons are cut into fans.
///
/// # Errors
/// Besides those of `out`: when the file would not fit in the 4 GiB of the format.
pub fn write_glb(out: &mut dyn Write, mesh: &PolygonMesh) -> io::Result<()> {
    let sections: Vec<Section> = mesh.parts.iter().filter_map(|part| Section::of(mesh, part)).collect();
    let json = document(mesh, &sections).to_string();
    let padding = json.len().next_multiple_of(4) - json.len();
    let json_length = (json.len() + padding) as u64;
    let binary_length: u64 = sections.iter().map(|s| s.position_bytes() + s.index_bytes()).sum();
    let total = u32::try_from(12 + 8 + json_length + 8 + binary_length)
        .map_err(|_| io::Error::other("the mesh does not fit in the 4 GiB of a GLB file"))?;

    out.write_all(b"glTF")?;
    write_u32s(out, &[2, total, json_length as u32])?;
    out.write_all(b"JSON")?;
    out.write_all(json.as_bytes())?;
    out.write_all(&b"   "[..padding])?;
    write_u32s(out, &[binary_length as u32])?;
    out.write_all(b"BIN\0")?;
    for section in &sections {
        for position in section.positions(mesh) {
            write_u32s(out, &position.map(|x| (x as f32).to_bits()))?;
        }
    }
    for section in &sections {
        for face in section.faces.clone() {
            for [a, b, c] in fan(mesh.faces.corners(face)) {
                write_u32s(out, &[a, b, c].map(|corner| corner - section.first_vertex))?;
            }
        }
    }
    Ok(())
}

/// What one part takes in the binary chunk: the vertices between the first and the last that it uses, and indices.
struct Section {
    name: Option<String>,
    faces: std::ops::Range<usize>,
    triangles: u64,
    first_vertex: u32,
    vertices: u64,
}

impl Section {
    /// None for a part without triangles, which glTF cannot express.
    fn of(mesh: &PolygonMesh, part: &Part) -> Option<Self> {
        let faces = face_range(part);
        let corners = || faces.clone().flat_map(|face| fan(mesh.faces.corners(face)));
        let triangles = corners().count() as u64;
        let first_vertex = corners().flatten().min()?;
        let last_vertex = corners().flatten().max()?;
        Some(Self {
            name: part.group.as_deref().map(str::to_owned),
            faces,
            triangles,
            first_vertex,
            vertices: u64::from(last_vertex - first_vertex) + 1,
        })
    }

    fn positions<'m>(&self, mesh: &'m PolygonMesh) -> impl Iterator<Item = &'m [f64; 3]> {
        mesh.positions.iter().skip(self.first_vertex as usize).take(self.vertices as usize)
    }

    fn position_bytes(&self) -> u64 {
        12 * self.vertices
    }

    fn index_bytes(&self) -> u64 {
        12 * self.triangles
    }
}

/// The JSON chunk: all positions first, then all indices; accessors 2·i and 2·i + 1 belong to section i.
fn document(mesh: &PolygonMesh, sections: &[Section]) -> Value {
    const FLOAT: u32 = 5126;
    const UNSIGNED_INT: u32 = 5125;
    let position_bytes: u64 = sections.iter().map(Section::position_bytes).sum();
    let index_bytes: u64 = sections.iter().map(Section::index_bytes).sum();
    let (mut accessors, mut meshes, mut nodes) = (Vec::new(), Vec::new(), Vec::new());
    let (mut position_offset, mut index_offset) = (0, 0);
    for (number, section) in sections.iter().enumerate() {
        let (mut least, mut most) = ([f64::INFINITY; 3], [f64::NEG_INFINITY; 3]);
        for position in section.positions(mesh) {
            for axis in 0..3 {
                let x = f64::from(position[axis] as f32);
                least[axis] = least[axis].min(x);
                most[axis] = most[axis].max(x);
            }
        }
        accessors.push(json!({
            "bufferView": 0, "byteOffset": position_offset, "componentType": FLOAT, "type": "VEC3",
            "count": section.vertices, "min": least, "max": most,
        }));
        accessors.push(json!({
            "bufferView": 1, "byteOffset": index_offset, "componentType": UNSIGNED_INT, "type": "SCALAR",
            "count": 3 * section.triangles,
        }));
        meshes.push(json!({
            "primitives": [{"attributes": {"POSITION": 2 * number}, "indices": 2 * number + 1}],
        }));
        nodes.push(match &section.name {
            Some(name) => json!({"name": name, "mesh": number}),
            None => json!({"mesh": number}),
        });
        position_offset += section.position_bytes();
        index_offset += section.index_bytes();
    }
    json!({
        "asset": {"version": "2.0", "generator": "tesserae"},
        "scene": 0,
        "scenes": [{"nodes": (0..sections.len()).collect::<Vec<_>>()}],
        "nodes": nodes,
        "meshes": meshes,
        "accessors": accessors,
        "bufferViews": [
            {"buffer": 0, "byteOffset": 0, "byteLength": position_bytes, "target": 34962},
            {"buffer": 0, "byteOffset": position_bytes, "byteLength": index_bytes, "target": 34963},
        ],
        "buffers": [{"byteLength": position_bytes + index_bytes}],
    })
}

/// The faces of a part.
fn face_range(part: &Part) -> std::ops::Range<usize> {
    part.first_face as usize..(part.first_face + part.faces) as usize
}

/// The triangles of a polygon, as a fan from its first corner.
fn fan(corners: &[u32]) -> impl Iterator<Item = [u32; 3]> {
    let first = corners.first().copied().unwrap_or_default();
    corners.windows(2).skip(1).map(move |pair| [first, pair[0], pair[1]])
}

fn write_u32s(out: &mut dyn Write, numbers: &[u32]) -> io::Result<()> {
    for number in numbers {
        out.write_all(&number.to_le_bytes())?;
    }
    Ok(())
}
