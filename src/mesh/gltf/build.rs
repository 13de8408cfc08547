//! Building the mesh: every primitive of every placement, transformed.

use std::collections::HashMap;
use std::sync::Arc;

use super::document::Document;
use super::join::Placed;
use super::primitive::Primitive;
use super::scene::{Instances, Placement};
use super::transform::Affine;
use crate::error::{Error, Result};
use crate::mesh::allowance::Allowance;
use crate::mesh::{Part, part_name};

/// The mesh as it grows.
pub struct Builder<'a> {
    /// Positions of the vertices in the scene.
    pub positions: Vec<[f64; 3]>,
    /// Corners of the triangles.
    pub corners: Vec<u32>,
    /// The requested attribute: a number for each vertex.
    pub numbers: Option<Vec<f64>>,
    /// Where they come from.
    pub parts: Vec<Part>,
    /// Runs of vertices under one transform, by first vertex.
    pub placed: Vec<Placed>,
    /// Vertices that no triangle uses and that are not kept, each placement counted.
    pub vertices_left_out: u64,
    /// Transforms so far, each with its number.
    transforms: HashMap<[u64; 12], u32>,
    /// Number of corners at the end.
    all_corners: usize,
    document: &'a Document,
    /// Vertices that may still be added though no triangle may use them.
    spare: u64,
}

/// The corners of a primitive and the vertices they use.
struct Corners {
    corners: Vec<u32>,
    /// The vertices that are used, which `corners` then count; none when all are there.
    used: Option<Vec<u32>>,
}

impl<'a> Builder<'a> {
    /// An empty mesh with room for a number of triangles and parts.
    pub fn new(document: &'a Document, triangles: u64, parts: u64, allowance: Allowance, has_numbers: bool) -> Self {
        Self {
            positions: Vec::new(),
            corners: Vec::with_capacity(3 * triangles as usize),
            numbers: has_numbers.then(Vec::new),
            parts: Vec::with_capacity(parts as usize),
            placed: Vec::new(),
            vertices_left_out: 0,
            transforms: HashMap::new(),
            all_corners: 3 * triangles as usize,
            document,
            spare: allowance.spare_vertices(),
        }
    }

    /// Adds the primitives of a mesh at every instance of a node.
    pub fn place(
        &mut self,
        placement: &Placement,
        instances: &Instances<'_>,
        primitives: &[Primitive<'_>],
    ) -> Result<()> {
        let node = &self.document.nodes[placement.node];
        let is_instanced = node.extensions.instancing.is_some();
        let group: Option<Arc<str>> = node.name.as_deref().map(|name| part_name(name).into());
        let mut all_corners = Vec::with_capacity(primitives.len());
        for primitive in primitives {
            all_corners.push(self.corners_of(primitive, instances.count)?);
        }
        for instance in 0..instances.count {
            let world = placement.world.after(&instances.transform(instance)?);
            let is_last = instance + 1 == instances.count;
            let next = self.transforms.len() as u32;
            let transform = *self.transforms.entry(world.bits()).or_insert(next);
            if self.placed.last().is_none_or(|last| last.transform != transform) {
                self.placed.push(Placed { first_vertex: self.positions.len() as u32, transform });
            }
            for (primitive, corners) in primitives.iter().zip(&mut all_corners) {
                self.parts.push(Part {
                    node: Some(placement.node as u32),
                    mesh: Some(placement.mesh as u32),
                    primitive: Some(primitive.index as u32),
                    instance: is_instanced.then_some(instance as u32),
                    group: group.clone(),
                    first_face: self.corners.len() as u64 / 3,
                    faces: primitive.triangles as u64,
                });
                let used = corners.used.as_deref();
                let first = self.add_vertices(primitive, used, &world, placement.node)?;
                if is_last && first == 0 && corners.corners.len() == self.all_corners && !world.mirrors() {
                    // the only primitive, as most often: nothing to change, nothing to copy
                    self.corners = std::mem::take(&mut corners.corners);
                } else {
                    self.add_corners(&corners.corners, first, world.mirrors());
                }
            }
        }
        Ok(())
    }

    /// The corners of a primitive that is placed `times` times.
    ///
    /// Vertices that no triangle uses are kept up to a number: primitives may share a large accessor of which each uses
    /// little, and a small file can place it very often.
    fn corners_of(&mut self, primitive: &Primitive<'_>, times: usize) -> Result<Corners> {
        let mut corners = primitive.corners()?;
        let count = primitive.positions.count;
        let spare = (count as u64).checked_mul(times as u64).and_then(|vertices| self.spare.checked_sub(vertices));
        if count <= corners.len() {
            return Ok(Corners { corners, used: None });
        }
        if let Some(spare) = spare {
            self.spare = spare;
            return Ok(Corners { corners, used: None });
        }
        let mut used = corners.clone();
        used.sort_unstable();
        used.dedup();
        for corner in &mut corners {
            *corner = used.partition_point(|vertex| vertex < corner) as u32;
        }
        Ok(Corners { corners, used: Some(used) })
    }

    /// Adds the vertices of a primitive at one place, all or the `used` ones; returns the number of the first.
    fn add_vertices(
        &mut self,
        primitive: &Primitive<'_>,
        used: Option<&[u32]>,
        world: &Affine,
        node: usize,
    ) -> Result<u32> {
        let source = primitive.positions;
        let first = self.positions.len();
        let count = used.map_or(source.count, <[u32]>::len);
        if first + count > u32::MAX as usize {
            return Err(Error::too_large(format_args!(
                "the mesh has more vertices than can be numbered, each placement counted: {}",
                first + count
            )));
        }
        self.vertices_left_out += (source.count - count) as u64;
        let placed = match used {
            Some(used) => {
                let vectors = used.iter().map(|&vertex| source.vector(vertex as usize));
                self.positions.extend(vectors.map(|position| world.apply(position)));
                &self.positions[first..]
            }
            None => {
                let positions = &mut self.positions;
                match first {
                    0 => positions.reserve_exact(count),
                    _ => positions.reserve(count),
                }
                source.each_vector(|vertex, position| match positions.get_mut(first + vertex) {
                    Some(replaced) => *replaced = world.apply(position),
                    None => positions.push(world.apply(position)),
                });
                &self.positions[first..]
            }
        };
        if let (Some(numbers), Some(source)) = (&mut self.numbers, primitive.numbers) {
            let number = |vertex: usize| source.vector::<1>(vertex)[0];
            match used {
                Some(used) => numbers.extend(used.iter().map(|&vertex| number(vertex as usize))),
                None => numbers.extend((0..count).map(number)),
            }
        }
        let is_finite = |position: &[f64; 3]| position.iter().all(|c| c.is_finite());
        if let Some(at) = placed.iter().position(|position| !is_finite(position)) {
            let vertex = used.map_or(at, |used| used[at] as usize);
            return Err(Error::mesh(format_args!(
                "accessor {}, vertex {vertex}: the position is not finite where node {node} puts it: {:?}",
                source.index, placed[at]
            )));
        }
        Ok(first as u32)
    }

    /// Adds the corners of a primitive whose first vertex is `first`.
    fn add_corners(&mut self, corners: &[u32], first: u32, mirrored: bool) {
        if mirrored {
            let turned = corners.chunks_exact(3).flat_map(|c| [c[0], c[2], c[1]]);
            self.corners.extend(turned.map(|corner| first + corner));
        } else {
            self.corners.extend(corners.iter().map(|corner| first + corner));
        }
    }
}
