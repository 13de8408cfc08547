//! glTF 2.0, binary (`.glb`) and JSON (`.gltf`).
//!
//! ```text
//! container ─→ document ─→ scene: placements ─→ primitives, instances (accessors, buffers) ─→ faces
//! ```
//!
//! Everything is opened, which compares what is claimed with the bytes that are there, and counted against the limits
//! before anything is built: a small file can place a mesh very often.
//!
//! Vertices of different placements that are equal but for rounding are joined at the end (`join`).
//!
//! Triangles come by node, depth first, then by instance, by primitive, and in their own order. A mesh that is placed
//! twice counts twice, each with its own vertices. Materials and animations are not looked at:
//! a primitive has one material, so groups of faces are those of primitives.

mod accessor;
mod buffers;
mod build;
mod container;
mod document;
mod extensions;
mod head;
mod join;
mod meshopt;
mod primitive;
mod scene;
mod slots;
mod transform;

pub use container::check_head as check_binary_head;

use std::collections::BTreeMap;
use std::collections::btree_map::Entry;

use self::accessor::Accessors;
use self::buffers::Buffers;
use self::build::Builder;
use self::document::Document;
use self::primitive::{Primitive, Skipped};
use self::scene::{Instances, Placement};
use super::allowance::Allowance;
use super::groups::Groups;
use super::{Adjusted, Faces, Format, Opened, Part, PolygonMesh, ReadMesh, Source, without_mark};
use crate::error::{Error, Result};

/// Whether a file with these first bytes is a GLB.
pub fn is_binary(head: &[u8]) -> bool {
    head.starts_with(container::MAGIC)
}

/// Whether a file with these first bytes is a JSON object.
pub fn is_json(head: &[u8]) -> bool {
    without_mark(head).trim_ascii_start().first() == Some(&b'{')
}

/// Refuses what begins like no glTF JSON.
pub fn check_json_head(head: &[u8]) -> Result<()> {
    if !is_json(head) {
        return Err(Format::Gltf.is_not("it does not begin with {, as every glTF JSON does"));
    }
    Ok(())
}

/// Opens a `.glb` file.
pub fn open_binary(source: Source<'_>, then: &mut dyn FnMut(Opened<'_>)) -> Result<()> {
    let container = container::open(source.bytes)?;
    open(source, container.json, container.binary, then)
}

/// Opens a `.gltf` file.
pub fn open_json(source: Source<'_>, then: &mut dyn FnMut(Opened<'_>)) -> Result<()> {
    open(source, source.bytes, None, then)
}

/// Opens a document with its binary chunk, if it has one.
fn open(source: Source<'_>, json: &[u8], binary: Option<&[u8]>, then: &mut dyn FnMut(Opened<'_>)) -> Result<()> {
    let Source { bytes, resources, limits, attribute, groups, .. } = source;
    let document = &Document::parse(json)?;
    let buffers = Buffers::new(document, binary, resources, limits, bytes.len() as u64);
    let accessors = &Accessors::new(&buffers);
    let mut skipped = Skipped::default();
    let mut meshes: BTreeMap<usize, (u64, Vec<Primitive<'_>>)> = BTreeMap::new();
    let mut instances = BTreeMap::new();
    let (mut triangles, mut parts) = (0u64, 0u64);
    let (mut placements, hidden) = scene::placements(document)?;
    skipped.hidden = hidden;
    let (placed, mut kept) = (placements.len(), 0);
    for at in 0..placed {
        let Placement { node: index, mesh, .. } = placements[at];
        let node = &document.nodes[index];
        let (once, primitives) = match meshes.entry(mesh) {
            Entry::Occupied(entry) => entry.into_mut(),
            Entry::Vacant(entry) => {
                let whence = format!("node {index}");
                let primitives = primitive::open(accessors, mesh, &whence, attribute, &mut skipped)?;
                entry.insert((primitives.iter().map(|p| p.triangles as u64).sum(), primitives))
            }
        };
        if primitives.is_empty() {
            continue;
        }
        skipped.skinned += u64::from(node.skin.is_some());
        let count = match &node.extensions.instancing {
            Some(instancing) => {
                let of_node = Instances::open(accessors, index, instancing)?;
                instances.entry(index).or_insert(of_node).count
            }
            None => 1,
        };
        if count == 0 {
            continue;
        }
        triangles = triangles.saturating_add(once.saturating_mul(count as u64));
        limits.check_faces(triangles)?;
        parts = parts.saturating_add((primitives.len() as u64).saturating_mul(count as u64));
        placements.swap(kept, at);
        kept += 1;
    }
    placements.truncate(kept);
    if triangles == 0 {
        return Err(primitive::no_faces(document, placed, &skipped));
    }
    if triangles > u64::from(u32::MAX / 3) {
        return Err(Error::too_large(format_args!(
            "the mesh has more triangles than can be numbered, {}: {triangles}",
            u32::MAX / 3
        )));
    }
    // only now are all the bytes that matter there
    let allowance = accessors.buffers().allowance();
    allowance.check_faces(triangles, limits.max_faces_per_byte)?;
    allowance.check_parts(parts)?;
    let placed = Placed { document, meshes, placements, instances, triangles, parts, allowance, skipped };
    then(Opened::new(triangles, move || placed.build(source.format, attribute.is_some(), groups)));
    Ok(())
}

/// The placements of a document and the primitives that they place, all of them opened.
struct Placed<'b> {
    document: &'b Document,
    /// Of each mesh its triangles and primitives.
    meshes: BTreeMap<usize, (u64, Vec<Primitive<'b>>)>,
    placements: Vec<Placement>,
    /// Of each node that has instances.
    instances: BTreeMap<usize, Instances<'b>>,
    triangles: u64,
    parts: u64,
    allowance: Allowance,
    skipped: Skipped,
}

impl Placed<'_> {
    /// Builds the mesh, with the attribute and the groups if these are wanted.
    fn build(self, format: Format, has_numbers: bool, has_groups: bool) -> Result<ReadMesh> {
        let Self { document, meshes, placements, instances, triangles, parts, allowance, skipped } = self;
        let mut builder = Builder::new(document, triangles, parts, allowance, has_numbers);
        for placement in &placements {
            let primitives = meshes.get(&placement.mesh).map_or(&[][..], |(_, primitives)| primitives);
            let single = Instances::single(placement.node);
            builder.place(placement, instances.get(&placement.node).unwrap_or(&single), primitives)?;
        }
        let mut warnings = skipped.warnings();
        warnings.extend(allowance.limit_names(&mut builder.parts));
        let adjusted = Adjusted {
            vertices_left_out: builder.vertices_left_out,
            joined_across_parts: join::across_placements(&mut builder.positions, &builder.corners, &builder.placed),
        };
        let mesh = PolygonMesh {
            format,
            positions: builder.positions,
            faces: Faces::from_triangles(builder.corners),
            parts: builder.parts,
            warnings,
            adjusted,
        };
        let groups = has_groups.then(|| groups(&mesh.parts));
        Ok(ReadMesh { mesh, numbers: builder.numbers, groups })
    }
}

/// The group of each face: the primitive of the file that it is of, wherever that is placed. It has one material.
fn groups(parts: &[Part]) -> Vec<u32> {
    let mut groups = Groups::with_capacity(parts.last().map_or(0, Part::end));
    parts.iter().for_each(|part| groups.add_to(part.end(), (part.mesh, part.primitive)));
    groups.finish()
}
