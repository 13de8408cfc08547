//! glTF 2.0, binary (`.glb`) and JSON (`.gltf`).
//!
//! ```text
//! container ─→ document ─→ scene: placements ─→ primitives, instances (accessors, buffers) ─→ faces
//! ```
//!
//! Everything is opened, which compares what is claimed with the bytes that are there, and counted against the limits
//! before anything is built: a small file can place a mesh very often.
//!
//! Triangles come by node, depth first, then by instance, by primitive, and in their own order. A mesh that is placed
//! twice counts twice, each with its own vertices. Materials and animations are not looked at.

mod accessor;
mod buffers;
mod container;
mod document;
mod meshopt;
mod primitive;
mod scene;
mod transform;

pub use container::check_head as check_glb_head;

use self::buffers::Buffers;
use self::document::Document;
use self::primitive::{Primitive, Skipped};
use self::scene::{Instances, Placement};
use self::transform::Affine;
use super::{Faces, Format, Limits, Part, PolygonMesh, Resources, part_name};
use crate::error::{Error, Result};

/// Reads a `.glb` file.
pub fn read_binary(bytes: &[u8], resources: &dyn Resources, limits: &Limits) -> Result<PolygonMesh> {
    let container = container::open(bytes)?;
    let document = Document::parse(container.json)?;
    let size = bytes.len() as u64;
    let buffers = Buffers::new(&document, container.binary, resources, limits, size);
    read(&buffers, Format::Glb, limits)
}

/// Reads a `.gltf` file.
pub fn read_json(bytes: &[u8], resources: &dyn Resources, limits: &Limits) -> Result<PolygonMesh> {
    let document = Document::parse(bytes)?;
    let buffers = Buffers::new(&document, None, resources, limits, bytes.len() as u64);
    read(&buffers, Format::Gltf, limits)
}

/// A mesh of the document.
struct Mesh<'b> {
    primitives: Vec<Primitive<'b>>,
    triangles: u64,
    vertices: u64,
}

fn read(buffers: &Buffers<'_>, format: Format, limits: &Limits) -> Result<PolygonMesh> {
    let document = buffers.document();
    let mut skipped = Skipped::default();
    let mut meshes: Vec<Option<Mesh<'_>>> = document.meshes.iter().map(|_| None).collect();
    let mut placed = Vec::new();
    let mut total = Total::default();
    for placement in scene::placements(document)? {
        let node = &document.nodes[placement.node];
        let whence = format!("node {}", placement.node);
        if meshes.get(placement.mesh).is_none_or(Option::is_none) {
            let mesh = open_mesh(buffers, placement.mesh, &whence, &mut skipped)?;
            total.stored += mesh.vertices;
            meshes[placement.mesh] = Some(mesh);
        }
        let Some(mesh) = &meshes[placement.mesh] else {
            continue;
        };
        skipped.skinned += u64::from(node.skin.is_some());
        let instances = match &node.extensions.instancing {
            Some(instancing) => Instances::open(buffers, placement.node, instancing)?,
            None => Instances::single(placement.node),
        };
        total.add(mesh, instances.count as u64, limits)?;
        placed.push((placement, instances));
    }
    let mut builder = Builder::new(&total);
    for (placement, instances) in &placed {
        let Some(mesh) = meshes[placement.mesh].as_mut() else {
            continue;
        };
        if mesh.triangles > 0 {
            let name = document.nodes[placement.node].name.as_deref();
            let is_instanced = document.nodes[placement.node].extensions.instancing.is_some();
            builder.place(placement, instances, mesh, name.map(part_name), is_instanced)?;
        }
    }
    Ok(PolygonMesh {
        format,
        positions: builder.positions,
        faces: Faces::from_triangles(builder.corners),
        parts: builder.parts,
        warnings: skipped.warnings(),
    })
}

fn open_mesh<'b>(buffers: &'b Buffers<'_>, mesh: usize, whence: &str, skipped: &mut Skipped) -> Result<Mesh<'b>> {
    let primitives = primitive::open(buffers, mesh, whence, skipped)?;
    Ok(Mesh {
        triangles: primitives.iter().map(|p| p.triangles as u64).sum(),
        vertices: primitives.iter().map(|p| p.positions.count as u64).sum(),
        primitives,
    })
}

/// What all placements come to.
#[derive(Debug, Default)]
struct Total {
    triangles: u64,
    vertices: u64,
    /// Vertices with each mesh counted once.
    stored: u64,
}

impl Total {
    /// Adds a mesh that is placed `times` times, unless that is too much.
    fn add(&mut self, mesh: &Mesh<'_>, times: u64, limits: &Limits) -> Result<()> {
        if mesh.triangles == 0 {
            return Ok(());
        }
        let grow = |sum: u64, one: u64| sum.saturating_add(one.saturating_mul(times));
        self.triangles = grow(self.triangles, mesh.triangles);
        self.vertices = grow(self.vertices, mesh.vertices);
        limits.check_faces(self.triangles)?;
        // what faces can use, and what is stored anyway
        let most = limits.max_faces.saturating_mul(3).saturating_add(self.stored);
        let most = most.min(u64::from(u32::MAX));
        let corners = self.triangles.saturating_mul(3);
        if self.vertices > most || corners > u64::from(u32::MAX) {
            return Err(Error::too_large(format_args!(
                "the mesh has more vertices than the limits allow, each placement counted: {}",
                self.vertices.max(corners)
            )));
        }
        Ok(())
    }
}

/// The mesh as it grows.
struct Builder {
    positions: Vec<[f64; 3]>,
    corners: Vec<u32>,
    parts: Vec<Part>,
}

impl Builder {
    fn new(total: &Total) -> Self {
        Self {
            positions: Vec::with_capacity(total.vertices as usize),
            corners: Vec::with_capacity(3 * total.triangles as usize),
            parts: Vec::new(),
        }
    }

    /// Adds a mesh at every instance of a node.
    fn place(
        &mut self,
        placement: &Placement,
        instances: &Instances<'_>,
        mesh: &Mesh<'_>,
        name: Option<String>,
        is_instanced: bool,
    ) -> Result<()> {
        let corners: Vec<Vec<u32>> = mesh.primitives.iter().map(Primitive::corners).collect::<Result<_>>()?;
        for (instance, transform) in instances.transforms().enumerate() {
            let world = placement.world.after(&transform?);
            for (primitive, corners) in mesh.primitives.iter().zip(&corners) {
                let part = Part {
                    node: Some(placement.node as u32),
                    mesh: Some(placement.mesh as u32),
                    primitive: Some(primitive.index as u32),
                    instance: is_instanced.then_some(instance as u32),
                    group: name.clone(),
                    first_face: self.corners.len() as u64 / 3,
                    faces: primitive.triangles as u64,
                };
                self.add(primitive, corners, &world, &part)?;
                self.parts.push(part);
            }
        }
        Ok(())
    }

    /// Adds a primitive at one place.
    fn add(&mut self, primitive: &Primitive<'_>, corners: &[u32], world: &Affine, part: &Part) -> Result<()> {
        let first = self.positions.len();
        self.positions.resize(first + primitive.positions.count, [0.0; 3]);
        let positions = &mut self.positions[first..];
        primitive.positions.each_vector(|vertex, position| positions[vertex] = world.apply(position));
        let is_finite = |position: &[f64; 3]| position.iter().all(|c| c.is_finite());
        if let Some(vertex) = positions.iter().position(|position| !is_finite(position)) {
            return Err(Error::mesh(format_args!(
                "accessor {}, vertex {vertex}: the position is not finite where node {} puts it: {:?}",
                primitive.positions.index,
                part.node.unwrap_or_default(),
                positions[vertex]
            )));
        }
        let first = first as u32;
        if world.mirrors() {
            let turned = corners.chunks_exact(3).flat_map(|c| [c[0], c[2], c[1]]);
            self.corners.extend(turned.map(|corner| first + corner));
        } else {
            self.corners.extend(corners.iter().map(|corner| first + corner));
        }
        Ok(())
    }
}
