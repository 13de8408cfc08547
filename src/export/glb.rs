//! Binary glTF 2.0 with clusters: colours and feature ids of vertices, and a table of clusters.
//!
//! | attribute | type | what |
//! |---|---|---|
//! | `POSITION` | f32 | relative to the centre of the bounding box, to which the node moves it back |
//! | `COLOR_0` | u8, normalised | the colour of the cluster ([`super::colour`]) |
//! | `_FEATURE_ID_0` | u16; f32 above 65,536 clusters | the cluster, for `EXT_mesh_features` |
//!
//! A vertex attribute cannot be u32, and f32 counts to 2²⁴: a mesh with more clusters has no ids. The table of clusters
//! is a property table of `EXT_structural_metadata`, which viewers of maps show for a picked cluster. Both extensions
//! are optional. There are no normals, so viewers shade facets; the one material is double-sided and not metallic.
//!
//! A mesh is [cut apart](super::Split) where clusters meet, and nowhere else. Triangles are in upload order.

mod container;

use serde_json::{Value, json};

use self::container::Container;
use super::{Clusters, Geometry, Split, colour, fan, single};
use crate::error::{Error, Result};
use crate::mesh::Faces;

/// Most clusters that u16 counts.
const IDS_OF_U16: u64 = 1 << 16;

/// Most clusters that f32 counts.
const IDS_OF_F32: u64 = 1 << 24;

/// A property of every cluster.
#[derive(Debug, Clone)]
pub struct Column {
    /// Its name.
    pub name: &'static str,
    /// One value a cluster.
    pub values: Values,
}

/// Values of a property.
#[derive(Debug, Clone)]
pub enum Values {
    /// Whole numbers.
    U32(Vec<u32>),
    /// Numbers.
    F64(Vec<f64>),
    /// Positions or directions.
    Vec3(Vec<[f64; 3]>),
}

/// A mesh with `clusters` clusters and their table as GLB.
///
/// # Errors
/// It has no triangle, leaves single precision, or does not fit in the 4 GiB of the format.
pub fn mesh(geometry: &Geometry<'_>, clusters: u64, table: &[Column]) -> Result<Vec<u8>> {
    let (points, cluster_of_vertex, corners);
    let split;
    match geometry.clusters {
        Clusters::OfFaces(labels) => {
            split = Split::new(geometry, labels, clusters as usize);
            points = split.positions(geometry);
            cluster_of_vertex = split.cluster_of_vertex();
            corners = &split.corners[..];
        }
        Clusters::OfPoints(of_points) => {
            points = geometry.points.to_vec();
            cluster_of_vertex = of_points.to_vec();
            corners = geometry.faces.all_corners();
        }
    }
    let faces = 0..geometry.faces.len();
    let triangles = faces.flat_map(|face| fan(&corners[geometry.faces.corner_range(face)])).flatten();
    let indices: Vec<u32> = triangles.collect();

    let mut file = Container::default();
    let centre = centre_of(&points);
    let positions = file.positions(&single(points.iter().copied(), centre, "GLB")?);
    let mut attributes = json!({ "POSITION": positions, "COLOR_0": colours(&mut file, &cluster_of_vertex) });
    let mut primitive = json!({ "indices": file.indices(&indices)?, "material": 0, "mode": 4 });
    let mut document = json!({
        "nodes": [{ "mesh": 0, "name": "clusters", "translation": centre }],
        "materials": [material()],
    });
    if let Some(ids) = feature_ids(&mut file, &cluster_of_vertex, clusters) {
        attributes["_FEATURE_ID_0"] = ids.into();
        primitive["extensions"] = json!({ "EXT_mesh_features": { "featureIds": [
            { "featureCount": clusters, "attribute": 0, "label": "cluster", "propertyTable": 0 },
        ] } });
        document["extensionsUsed"] = json!(["EXT_mesh_features", "EXT_structural_metadata"]);
        document["extensions"] = json!({ "EXT_structural_metadata": property_table(&mut file, clusters, table) });
    }
    primitive["attributes"] = attributes;
    document["meshes"] = json!([{ "primitives": [primitive] }]);
    document["scenes"] = json!([{ "nodes": [0] }]);
    file.finish(document)
}

/// A mesh without clusters as GLB: the vertices of the upload, triangles in upload order. Where a face is no triangle,
/// `extras.faces` of the mesh is the number of a buffer view with the face of each triangle (u32, little-endian).
///
/// # Errors
/// It has no triangle, leaves single precision, or does not fit in the 4 GiB of the format.
pub fn plain(points: &[[f64; 3]], faces: &Faces) -> Result<Vec<u8>> {
    let triangles = (0..faces.len()).flat_map(|face| fan(faces.corners(face))).flatten();
    let indices: Vec<u32> = triangles.collect();
    let mut file = Container::default();
    let centre = centre_of(points);
    let positions = file.positions(&single(points.iter().copied(), centre, "GLB")?);
    let indices = file.indices(&indices)?;
    let primitive = json!({ "attributes": { "POSITION": positions }, "indices": indices, "material": 0, "mode": 4 });
    let mut mesh = json!({ "primitives": [primitive] });
    if (0..faces.len()).any(|face| faces.corners(face).len() != 3) {
        let of_triangles = (0..faces.len()).flat_map(|face| fan(faces.corners(face)).map(move |_| face as u32));
        let view = file.view(of_triangles.flat_map(u32::to_le_bytes).collect(), None);
        mesh["extras"] = json!({ "faces": view });
    }
    file.finish(json!({
        "scenes": [{ "nodes": [0] }],
        "nodes": [{ "mesh": 0, "name": "mesh", "translation": centre }],
        "meshes": [mesh],
        "materials": [material()],
    }))
}

/// Polylines as GLB; `clusters` has the cluster of each, by whose colour it is drawn.
///
/// # Errors
/// There is no line, or the positions leave single precision.
pub fn lines(points: &[[f64; 3]], lines: &Faces, clusters: &[u32]) -> Result<Vec<u8>> {
    if lines.is_empty() {
        let message = "there are no boundaries, and a GLB file cannot be without lines: take json, obj or vtp";
        return Err(Error::conflict(message));
    }
    // a vertex a line and corner: colours are attributes of vertices
    let mut indices = Vec::new();
    let mut cluster_of_vertex = Vec::new();
    for line in 0..lines.len() {
        let corners = lines.corner_range(line);
        indices.extend(corners.clone().zip(corners.clone().skip(1)).flat_map(|(one, next)| [one as u32, next as u32]));
        cluster_of_vertex.extend(corners.map(|_| clusters[line]));
    }
    let mut file = Container::default();
    let centre = centre_of(points);
    let vertices = lines.all_corners().iter().map(|&point| points[point as usize]);
    let positions = file.positions(&single(vertices, centre, "GLB")?);
    let attributes = json!({ "POSITION": positions, "COLOR_0": colours(&mut file, &cluster_of_vertex) });
    let primitive = json!({ "attributes": attributes, "indices": file.indices(&indices)?, "material": 0, "mode": 1 });
    file.finish(json!({
        "scenes": [{ "nodes": [0] }],
        "nodes": [{ "mesh": 0, "name": "boundaries", "translation": centre }],
        "meshes": [{ "primitives": [primitive] }],
        "materials": [material()],
    }))
}

/// A mesh with a node, `cluster-17`, for every cluster that has a triangle; its vertices are its own.
///
/// # Errors
/// As those of [`mesh()`].
pub fn nodes(geometry: &Geometry<'_>, split: &Split) -> Result<Vec<u8>> {
    let points = split.positions(geometry);
    let centre = centre_of(&points);
    let near = single(points.iter().copied(), centre, "GLB")?;
    let mut file = Container::default();
    let (mut indices, mut ranges) = (Vec::new(), Vec::new());
    for cluster in 0..split.clusters() {
        let vertices = split.vertices(cluster);
        let begin = indices.len();
        for &face in split.faces_of(cluster) {
            let corners = &split.corners[geometry.faces.corner_range(face as usize)];
            indices.extend(fan(corners).flatten().map(|vertex| vertex - vertices.start as u32));
        }
        if indices.len() > begin {
            ranges.push((cluster, vertices, begin..indices.len()));
        }
    }
    if ranges.is_empty() {
        return Err(no_triangles());
    }
    let position_view = file.vertices(near.iter().flatten().flat_map(|x| x.to_le_bytes()).collect(), 12);
    let colour_view = file.vertices(split.cluster_of_vertex().into_iter().flat_map(rgba).collect(), 4);
    let index_view = file.view(indices.iter().flat_map(|x| x.to_le_bytes()).collect(), Some(container::INDICES));
    let (mut nodes, mut meshes) = (Vec::new(), Vec::new());
    for (cluster, vertices, corners) in ranges {
        let positions = file.positions_at(position_view, vertices.start, &near[vertices.clone()]);
        let colours = file.accessor(json!({
            "bufferView": colour_view, "byteOffset": 4 * vertices.start, "componentType": container::UNSIGNED_BYTE,
            "normalized": true, "type": "VEC4", "count": vertices.len(),
        }));
        let indices = file.accessor(json!({
            "bufferView": index_view, "byteOffset": 4 * corners.start, "componentType": container::UNSIGNED_INT,
            "type": "SCALAR", "count": corners.len(),
        }));
        nodes.push(json!({ "mesh": meshes.len(), "name": format!("cluster-{cluster}") }));
        meshes.push(json!({ "primitives": [{
            "attributes": { "POSITION": positions, "COLOR_0": colours }, "indices": indices, "material": 0, "mode": 4,
        }] }));
    }
    let children: Vec<usize> = (0..nodes.len()).collect();
    nodes.push(json!({ "name": "clusters", "translation": centre, "children": children }));
    file.finish(json!({
        "scenes": [{ "nodes": [nodes.len() - 1] }],
        "nodes": nodes,
        "meshes": meshes,
        "materials": [material()],
    }))
}

/// The one material. A metallic one, the default, would be black without surroundings to mirror.
fn material() -> Value {
    json!({
        "name": "clusters", "doubleSided": true, "pbrMetallicRoughness": { "metallicFactor": 0, "roughnessFactor": 1 },
    })
}

/// The error of a mesh without triangles, which glTF cannot express.
fn no_triangles() -> Error {
    Error::conflict("the mesh has no triangle, which a GLB file must have: take ply, vtp or obj")
}

/// The centre of the bounding box; the origin without points.
fn centre_of(points: &[[f64; 3]]) -> [f64; 3] {
    let mut low = [f64::INFINITY; 3];
    let mut high = [f64::NEG_INFINITY; 3];
    for point in points {
        for axis in 0..3 {
            low[axis] = low[axis].min(point[axis]);
            high[axis] = high[axis].max(point[axis]);
        }
    }
    match points.is_empty() {
        true => [0.0; 3],
        // halves first: the sum of two finite numbers may not be finite
        false => std::array::from_fn(|axis| low[axis] / 2.0 + high[axis] / 2.0),
    }
}

fn rgba(cluster: u32) -> [u8; 4] {
    let [red, green, blue] = colour::of_cluster(cluster);
    [red, green, blue, u8::MAX]
}

/// The colours of vertices; gives their accessor.
fn colours(file: &mut Container, clusters: &[u32]) -> usize {
    let view = file.vertices(clusters.iter().flat_map(|&cluster| rgba(cluster)).collect(), 4);
    file.accessor(json!({
        "bufferView": view, "componentType": container::UNSIGNED_BYTE, "normalized": true, "type": "VEC4",
        "count": clusters.len(),
    }))
}

/// The clusters of vertices; gives their accessor. None where no type of a vertex attribute holds them.
fn feature_ids(file: &mut Container, of_vertices: &[u32], clusters: u64) -> Option<usize> {
    let (kind, bytes): (u32, Vec<u8>) = if clusters <= IDS_OF_U16 {
        // vertices begin at multiples of four bytes
        let padded = |&cluster: &u32| [cluster as u8, (cluster >> 8) as u8, 0, 0];
        (container::UNSIGNED_SHORT, of_vertices.iter().flat_map(padded).collect())
    } else if clusters <= IDS_OF_F32 {
        (container::FLOAT, of_vertices.iter().flat_map(|&id| (id as f32).to_le_bytes()).collect())
    } else {
        return None;
    };
    let view = file.vertices(bytes, 4);
    Some(file.accessor(json!({
        "bufferView": view, "componentType": kind, "type": "SCALAR", "count": of_vertices.len(),
    })))
}

/// A class and a table of its properties.
fn property_table(file: &mut Container, clusters: u64, table: &[Column]) -> Value {
    let (mut class, mut properties) = (json!({}), json!({}));
    for Column { name, values } in table {
        let (kind, component, bytes): (_, _, Vec<u8>) = match values {
            Values::U32(numbers) => ("SCALAR", "UINT32", numbers.iter().flat_map(|x| x.to_le_bytes()).collect()),
            Values::F64(numbers) => ("SCALAR", "FLOAT64", numbers.iter().flat_map(|x| x.to_le_bytes()).collect()),
            Values::Vec3(rows) => ("VEC3", "FLOAT64", rows.iter().flatten().flat_map(|x| x.to_le_bytes()).collect()),
        };
        class[*name] = json!({ "type": kind, "componentType": component });
        properties[*name] = json!({ "values": file.view(bytes, None) });
    }
    json!({
        "schema": { "id": "tesserae", "classes": { "cluster": { "properties": class } } },
        "propertyTables": [{
            "name": "clusters", "class": "cluster", "count": clusters, "properties": properties,
        }],
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::dev::sample::{Sample, generate};
    use crate::error::Kind;
    use crate::mesh::{self, Format, Limits, NoResources};

    fn json_of(file: &[u8]) -> Value {
        let length = u32::from_le_bytes(file[12..16].try_into().expect("four bytes")) as usize;
        serde_json::from_slice(&file[20..20 + length]).expect("JSON")
    }

    #[test]
    fn a_mesh_is_read_back_with_its_triangles_in_upload_order() {
        let original = generate(Sample::Quads, 600).expect("a sample");
        let labels: Vec<u32> = (0..original.faces.len() as u32).map(|face| face / 100).collect();
        let geometry =
            Geometry { points: &original.positions, faces: &original.faces, clusters: Clusters::OfFaces(&labels) };
        let faces = Values::U32(vec![100; 6]);
        let file = mesh(&geometry, 6, &[Column { name: "faces", values: faces }]).expect("a file");
        let read = mesh::read(&file, Format::Glb, &NoResources, &Limits::default()).expect("a mesh");
        let fans: Vec<[u32; 3]> = (0..original.faces.len()).flat_map(|f| fan(original.faces.corners(f))).collect();
        assert_eq!(read.faces.len(), fans.len());
        for (face, triangle) in fans.iter().enumerate() {
            for (&corner, &point) in read.faces.corners(face).iter().zip(triangle) {
                let (found, wanted) = (read.positions[corner as usize], original.positions[point as usize]);
                assert!((0..3).all(|axis| (found[axis] - wanted[axis]).abs() < 1e-5), "{found:?} {wanted:?}");
            }
        }
        let document = json_of(&file);
        let table = &document["extensions"]["EXT_structural_metadata"]["propertyTables"][0];
        assert_eq!((&table["count"], &table["class"]), (&6.into(), &"cluster".into()));
        let split = Split::new(&geometry, &labels, 6);
        assert_eq!(document["accessors"][0]["count"], split.points.len());
        let apart = nodes(&geometry, &split).expect("a file");
        assert_eq!(json_of(&apart)["nodes"].as_array().map(Vec::len), Some(7));
        let apart = mesh::read(&apart, Format::Glb, &NoResources, &Limits::default()).expect("a mesh");
        assert_eq!(apart.faces.len(), fans.len());
    }

    #[test]
    fn ids_are_of_the_narrowest_type_that_holds_them() {
        let mut file = Container::default();
        for (clusters, kind) in [
            (1 << 16, Some(container::UNSIGNED_SHORT)),
            ((1 << 16) + 1, Some(container::FLOAT)),
            (1 << 24, Some(container::FLOAT)),
            ((1 << 24) + 1, None),
        ] {
            let accessor = feature_ids(&mut file, &[0, 1], clusters);
            assert_eq!(accessor.is_some(), kind.is_some(), "{clusters}");
        }
    }

    #[test]
    fn what_gltf_cannot_express_is_refused() {
        let mut faces = Faces::default();
        faces.push(&[0, 1]);
        let points = [[0.0; 3], [1.0; 3]];
        let geometry = Geometry { points: &points, faces: &faces, clusters: Clusters::OfFaces(&[0]) };
        for refused in [
            mesh(&geometry, 1, &[]),
            nodes(&geometry, &Split::new(&geometry, &[0], 1)),
            lines(&points, &Faces::default(), &[]),
        ] {
            assert_eq!(refused.expect_err("nothing to draw").kind, Kind::Conflict);
        }
        assert!(lines(&points, &faces, &[0]).is_ok());
    }
}
