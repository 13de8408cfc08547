//! The scene graph: which meshes are placed where, in which order.

use super::accessor::{Accessors, Elements};
use super::document::{Document, Instancing, lookup};
use super::transform::Affine;
use crate::error::{Error, Quoted, Result};

/// A node that places a mesh.
#[derive(Debug, Clone, PartialEq)]
pub struct Placement {
    /// The node.
    pub node: usize,
    /// The mesh.
    pub mesh: usize,
    /// From the mesh to the scene.
    pub world: Affine,
}

/// The placements of the default scene, else of the first, else of all nodes: depth first, children in their order.
/// Nodes that are not shown (`KHR_node_visibility`), and nodes below them, place nothing; how many of them have a mesh.
pub fn placements(document: &Document) -> Result<(Vec<Placement>, u64)> {
    let parents = parents(document)?;
    let scene = match document.scene {
        Some(scene) => Some(lookup(&document.scenes, scene as usize, "scene", "the file")?),
        None => document.scenes.first(),
    };
    let roots: Vec<usize> = match scene {
        Some(scene) => scene.nodes.iter().map(|&node| node as usize).collect(),
        None => (0..document.nodes.len()).filter(|&node| parents[node].is_none()).collect(),
    };
    let mut placements = Vec::with_capacity(document.nodes.iter().filter(|node| node.mesh.is_some()).count());
    let (mut open, mut hidden) = (Vec::new(), 0);
    let mut reached = vec![false; document.nodes.len()];
    for root in roots {
        open.push((root, Affine::IDENTITY, false));
        while let Some((index, outer, is_below_hidden)) = open.pop() {
            let node = lookup(&document.nodes, index, "node", "the scene")?;
            if std::mem::replace(&mut reached[index], true) {
                return Err(Error::mesh(format_args!(
                    "the nodes are no tree: a node is its own ancestor, or is listed in the scene twice or beside its \
                     parent: {index}"
                )));
            }
            let world = outer.after(&Affine::of_node(node, format_args!("node {index}"))?);
            let is_hidden = is_below_hidden || node.extensions.is_hidden();
            if is_hidden {
                hidden += u64::from(node.mesh.is_some());
            } else if let Some(mesh) = node.mesh {
                placements.push(Placement { node: index, mesh: mesh as usize, world });
            }
            let children = node.children.iter().rev();
            open.extend(children.map(|&child| (child as usize, world, is_hidden)));
        }
    }
    if let (None, Some(lost)) = (scene, reached.iter().position(|&reached| !reached)) {
        return Err(Error::mesh(format_args!("the nodes are no tree: a node is its own ancestor: {lost}")));
    }
    Ok((placements, hidden))
}

/// The parent of each node, of which it may have only one.
fn parents(document: &Document) -> Result<Vec<Option<usize>>> {
    let mut parents = vec![None; document.nodes.len()];
    for (index, node) in document.nodes.iter().enumerate() {
        for &child in &node.children {
            let child = child as usize;
            if child >= parents.len() {
                lookup(&document.nodes, child, "node", &format!("node {index}"))?;
            } else if let Some(first) = parents[child].replace(index) {
                return Err(Error::mesh(format_args!(
                    "the nodes are no tree: node {child} is a child of nodes {first} and {index}"
                )));
            }
        }
    }
    Ok(parents)
}

/// The places that `EXT_mesh_gpu_instancing` adds below a node; one without the extension.
#[derive(Debug)]
pub struct Instances<'b> {
    /// Number of instances.
    pub count: usize,
    node: usize,
    translations: Option<&'b Elements<'b>>,
    rotations: Option<&'b Elements<'b>>,
    scales: Option<&'b Elements<'b>>,
}

impl<'b> Instances<'b> {
    /// The one place of a node without instances.
    pub fn single(node: usize) -> Self {
        Self { count: 1, node, translations: None, rotations: None, scales: None }
    }

    /// Opens the accessors of a node's instances.
    pub fn open(accessors: &'b Accessors<'b>, node: usize, instancing: &Instancing) -> Result<Self> {
        let mut instances = Self::single(node);
        let mut counted: Option<(&str, usize)> = None;
        let mut has_bytes = false;
        for (name, &accessor) in &instancing.attributes {
            let whence = format!("{} of the instances of node {node}", Quoted(name));
            let elements = accessors.open(accessor as usize, &whence)?;
            has_bytes |= elements.has_bytes();
            let components = match name.as_str() {
                "TRANSLATION" | "SCALE" => 3,
                "ROTATION" => 4,
                _ => elements.components,
            };
            if elements.components != components {
                return Err(Error::mesh(format_args!(
                    "accessor {accessor} must have {components} components as {whence}: {}",
                    elements.components
                )));
            }
            match counted {
                Some((first, count)) if count != elements.count => {
                    return Err(Error::mesh(format_args!(
                        "the instances of node {node} have {count} of {}, but {} of {}",
                        Quoted(first),
                        elements.count,
                        Quoted(name)
                    )));
                }
                _ => counted = Some((name, elements.count)),
            }
            match name.as_str() {
                "TRANSLATION" => instances.translations = Some(elements),
                "ROTATION" => instances.rotations = Some(elements),
                "SCALE" => instances.scales = Some(elements),
                _ => {}
            }
        }
        let Some((_, count)) = counted else {
            return Err(Error::mesh(format_args!("the instances of node {node} have no attributes")));
        };
        if !has_bytes {
            return Err(Error::mesh(format_args!(
                "the instances of node {node} are zeros only: at least one of their accessors must have a bufferView; \
                 instances: {count}"
            )));
        }
        instances.count = count;
        Ok(instances)
    }

    /// Where instance `index` is, from the node on.
    pub fn transform(&self, index: usize) -> Result<Affine> {
        Affine::compose(
            self.translations.map_or([0.0; 3], |all| all.vector(index)),
            self.rotations.map_or([0.0, 0.0, 0.0, 1.0], |all| all.vector(index)),
            self.scales.map_or([1.0; 3], |all| all.vector(index)),
            format_args!("instance {index} of node {}", self.node),
        )
    }
}
