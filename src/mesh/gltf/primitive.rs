//! Primitives: positions, indices and what they mean as triangles.

use gltf::json;
use gltf::json::accessor::ComponentType;
use gltf::json::mesh::{Mode, Semantic};
use gltf::json::validation::Checked;

use super::accessor::{Accessors, Elements};
use super::document::{Document, lookup};
use super::extensions::DRACO;
use crate::error::{Error, Quoted, Result};

/// A primitive made of triangles whose bytes are there.
#[derive(Debug)]
pub struct Primitive<'b> {
    /// Its index in its mesh.
    pub index: usize,
    /// Positions of its vertices.
    pub positions: &'b Elements<'b>,
    /// The requested attribute: a number for each vertex.
    pub numbers: Option<&'b Elements<'b>>,
    /// Number of triangles.
    pub triangles: usize,
    indices: Option<&'b Elements<'b>>,
    shape: Shape,
}

/// How corners make triangles.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Shape {
    List,
    Strip,
    Fan,
}

/// What was passed over.
#[derive(Debug, Clone, Copy, Default)]
pub struct Skipped {
    /// Primitives of points or lines.
    pub points_and_lines: u64,
    /// Primitives without positions.
    pub without_positions: u64,
    /// Primitives with a last triangle that lacks corners.
    pub incomplete: u64,
    /// Primitives with fewer than three vertices or indices.
    pub without_triangles: u64,
    /// Meshes without primitives.
    pub empty_meshes: u64,
    /// Primitives with morph targets.
    pub morphed: u64,
    /// Placements with a skin.
    pub skinned: u64,
    /// Nodes with a mesh that are not shown.
    pub hidden: u64,
}

impl Skipped {
    /// Whether a primitive has no triangles.
    fn is_any_without_triangles(&self) -> bool {
        self.points_and_lines + self.without_positions + self.without_triangles + self.empty_meshes > 0
    }

    /// In words.
    pub fn warnings(&self) -> Vec<String> {
        [
            (self.points_and_lines, "primitives of points or lines were skipped"),
            (self.without_positions, "primitives without POSITION were skipped"),
            (self.incomplete, "primitives end with an incomplete triangle, which was skipped"),
            (self.morphed, "primitives have morph targets, which were ignored"),
            (self.skinned, "nodes have a skin, which was ignored: the mesh is in its rest pose"),
            (self.hidden, "nodes with a mesh are hidden by KHR_node_visibility and were left out"),
        ]
        .into_iter()
        .filter(|(count, _)| *count > 0)
        .map(|(count, what)| format!("{what}: {count}"))
        .collect()
    }

    /// Why none of the primitives placed by the scene has a triangle.
    fn reasons(&self) -> String {
        let reasons = [
            (self.points_and_lines, "made of points or lines"),
            (self.without_positions, "without a POSITION attribute"),
            (self.without_triangles, "with fewer than 3 vertices or indices"),
        ];
        let reasons: Vec<String> = reasons
            .into_iter()
            .filter(|(count, _)| *count > 0)
            .map(|(count, what)| format!("{what}: {count}"))
            .collect();
        match reasons.is_empty() {
            true => "the meshes have no primitives".to_owned(),
            false => format!("only triangles are faces, and the meshes have primitives {}", reasons.join(", ")),
        }
    }
}

/// The error of a document whose scene has no triangles; `placements` of its nodes place a mesh.
pub fn no_faces(document: &Document, placements: usize, skipped: &Skipped) -> Error {
    let meshes = document.meshes.len();
    let why = if meshes == 0 {
        "the glTF file has no meshes".to_owned()
    } else if placements == 0 && skipped.hidden > 0 {
        format!("KHR_node_visibility hides every node of the scene that has a mesh: {}", skipped.hidden)
    } else if placements == 0 {
        let scene = document.scene.map_or("its scene".to_owned(), |scene| format!("scene {scene}"));
        format!("no node of {scene} has a mesh (add nodes that have one to the scene); meshes in the file: {meshes}")
    } else if skipped.is_any_without_triangles() {
        skipped.reasons()
    } else {
        "EXT_mesh_gpu_instancing places it 0 times".to_owned()
    };
    Error::mesh(format_args!("the mesh has no faces: {why}"))
}

/// Opens the primitives of a mesh that have triangles, and `attribute` of each.
pub fn open<'b>(
    accessors: &'b Accessors<'b>,
    mesh: usize,
    whence: &str,
    attribute: Option<&str>,
    skipped: &mut Skipped,
) -> Result<Vec<Primitive<'b>>> {
    let mut primitives = Vec::new();
    let found = lookup(&accessors.buffers().document().meshes, mesh, "mesh", whence)?;
    skipped.empty_meshes += u64::from(found.primitives.is_empty());
    for (index, primitive) in found.primitives.iter().enumerate() {
        let me = format!("primitive {index} of mesh {mesh}");
        let Some(shape) = Shape::of(primitive, &me)? else {
            skipped.points_and_lines += 1;
            continue;
        };
        let positions = primitive.attributes.get(&Checked::Valid(Semantic::Positions));
        let Some(positions) = positions.map(|accessor| accessor.value()) else {
            skipped.without_positions += 1;
            continue;
        };
        let indices = primitive.indices.map(|accessor| accessor.value());
        let is_draco = primitive.extensions.as_ref().is_some_and(|extensions| extensions.others.contains_key(DRACO));
        if is_draco {
            refuse_without_fallback(accessors, positions, &me)?;
            indices.map_or(Ok(()), |indices| refuse_without_fallback(accessors, indices, &me))?;
        }
        let positions = open_positions(accessors, positions, &me)?;
        let indices = indices.map(|indices| open_indices(accessors, indices, &me)).transpose()?;
        let corners = indices.map_or(positions.count, |indices| indices.count);
        let triangles = shape.count(corners as u64) as usize;
        let incomplete = match shape {
            Shape::List => !corners.is_multiple_of(3),
            Shape::Strip | Shape::Fan => matches!(corners, 1 | 2),
        };
        skipped.incomplete += u64::from(incomplete);
        let targets = primitive.targets.as_ref();
        skipped.morphed += u64::from(targets.is_some_and(|targets| !targets.is_empty()));
        if triangles == 0 {
            skipped.without_triangles += 1;
        } else {
            let numbers =
                attribute.map(|name| open_numbers(accessors, primitive, name, positions.count, &me)).transpose()?;
            primitives.push(Primitive { index, positions, numbers, triangles, indices, shape });
        }
    }
    Ok(primitives)
}

/// Refuses an accessor that has its elements only in compressed form.
fn refuse_without_fallback(accessors: &Accessors<'_>, accessor: usize, whence: &str) -> Result<()> {
    let accessor = accessors.describe(accessor, whence)?;
    if accessor.buffer_view.is_none() && accessor.sparse.is_none() {
        return Err(Error::unsupported(format_args!(
            "{whence} is compressed with Draco, which is not read: export it without compression, or compressed with \
             meshopt ({DRACO})"
        )));
    }
    Ok(())
}

fn open_positions<'b>(accessors: &'b Accessors<'b>, accessor: usize, whence: &str) -> Result<&'b Elements<'b>> {
    let whence = format!("POSITION of {whence}");
    let positions = accessors.open(accessor, &whence)?;
    if positions.components != 3 || positions.component == ComponentType::U32 {
        return Err(Error::mesh(format_args!(
            "accessor {accessor} cannot be {whence}: it must be VEC3 of floats, or of bytes or shorts by \
             KHR_mesh_quantization"
        )));
    }
    Ok(positions)
}

/// Opens an attribute that has one number for each vertex.
fn open_numbers<'b>(
    accessors: &'b Accessors<'b>,
    primitive: &json::mesh::Primitive,
    name: &str,
    vertices: usize,
    whence: &str,
) -> Result<&'b Elements<'b>> {
    // the crate's name for it is without the underscore
    let semantic = Semantic::Extras(name.strip_prefix('_').unwrap_or(name).to_owned());
    let Some(accessor) = primitive.attributes.get(&Checked::Valid(semantic)) else {
        return Err(Error::mesh(format_args!("{whence} has no attribute of this name: {}", Quoted(name))));
    };
    let accessor = accessor.value();
    let whence = format!("{} of {whence}", Quoted(name));
    let numbers = accessors.open(accessor, &whence)?;
    if numbers.components != 1 || numbers.count != vertices {
        return Err(Error::mesh(format_args!(
            "accessor {accessor} cannot be {whence}: it must be SCALAR with one element for each of {vertices} \
             vertices, and has {} of {} components",
            numbers.count, numbers.components
        )));
    }
    Ok(numbers)
}

fn open_indices<'b>(accessors: &'b Accessors<'b>, accessor: usize, whence: &str) -> Result<&'b Elements<'b>> {
    let whence = format!("indices of {whence}");
    let indices = accessors.open(accessor, &whence)?;
    if !indices.is_index() {
        return Err(Error::mesh(format_args!(
            "accessor {accessor} cannot be {whence}: it must be SCALAR of unsigned integers"
        )));
    }
    Ok(indices)
}

impl Primitive<'_> {
    /// The corners of the triangles, three each, as indices of the primitive's vertices.
    pub fn corners(&self) -> Result<Vec<u32>> {
        let corners = match &self.indices {
            Some(indices) => {
                let corners = indices.integers();
                let vertices = self.positions.count;
                // one look at the largest, since nearly all are sound
                if corners.iter().max().is_some_and(|&most| most as usize >= vertices) {
                    let at = corners.iter().position(|&corner| corner as usize >= vertices);
                    let at = at.unwrap_or_default();
                    return Err(Error::mesh(format_args!(
                        "element {at} of accessor {} is no index of the {vertices} vertices of accessor {}: {}",
                        indices.index, self.positions.index, corners[at]
                    )));
                }
                corners
            }
            None => (0..self.positions.count as u32).collect(),
        };
        Ok(self.shape.triangles(corners))
    }
}

impl Shape {
    /// The shape of a primitive; none of points or lines.
    fn of(primitive: &json::mesh::Primitive, whence: &str) -> Result<Option<Self>> {
        match primitive.mode {
            Checked::Valid(Mode::Triangles) => Ok(Some(Shape::List)),
            Checked::Valid(Mode::TriangleStrip) => Ok(Some(Shape::Strip)),
            Checked::Valid(Mode::TriangleFan) => Ok(Some(Shape::Fan)),
            Checked::Valid(Mode::Points | Mode::Lines | Mode::LineLoop | Mode::LineStrip) => Ok(None),
            Checked::Invalid => Err(Error::mesh(format_args!("{whence} has an unknown mode (0 to 6 are known)"))),
        }
    }

    /// Triangles of so many corners.
    fn count(self, corners: u64) -> u64 {
        match self {
            Shape::List => corners / 3,
            Shape::Strip | Shape::Fan => corners.saturating_sub(2),
        }
    }

    /// Spells out the triangles, each wound as the specification says.
    fn triangles(self, mut corners: Vec<u32>) -> Vec<u32> {
        match self {
            Shape::List => {
                corners.truncate(corners.len() / 3 * 3);
                corners
            }
            Shape::Strip => corners
                .windows(3)
                .enumerate()
                .flat_map(|(index, corner)| match index % 2 {
                    0 => [corner[0], corner[1], corner[2]],
                    _ => [corner[0], corner[2], corner[1]],
                })
                .collect(),
            Shape::Fan => match corners.split_first() {
                Some((&hub, rim)) => rim.windows(2).flat_map(|corner| [corner[0], corner[1], hub]).collect(),
                None => Vec::new(),
            },
        }
    }
}

#[cfg(test)]
mod tests {
    use super::Shape;

    #[test]
    fn strips_alternate_and_fans_share_their_first_corner() {
        let corners = vec![4, 5, 6, 7, 8];
        assert_eq!(Shape::List.triangles(corners.clone()), [4, 5, 6]);
        assert_eq!(Shape::Strip.triangles(corners.clone()), [4, 5, 6, 5, 7, 6, 6, 7, 8]);
        assert_eq!(Shape::Fan.triangles(corners), [5, 6, 4, 6, 7, 4, 7, 8, 4]);
        for shape in [Shape::List, Shape::Strip, Shape::Fan] {
            for few in 0..3 {
                assert!(shape.triangles(vec![0; few]).is_empty());
            }
        }
    }
}
