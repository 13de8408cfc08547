//! What is read of each element: positions, polygons, strips, or nothing.

use std::collections::HashSet;

use super::header::{Element, Header, shown};
use crate::error::{Error, Result};

/// What the rows of an element are.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Role {
    /// Vertices; which properties are x, y and z.
    Vertices([usize; 3]),
    /// Faces; which property lists the corners.
    Polygons(usize),
    /// Triangle strips; which property lists the corners.
    Strips(usize),
    /// Something that is not read.
    Skipped,
}

/// Names of the property with the corners of a face or a strip.
const CORNERS: [&[u8]; 2] = [b"vertex_indices", b"vertex_index"];

/// The role of each element of a file that has vertices and faces, and the number of vertices.
pub fn roles(header: &Header<'_>) -> Result<(Vec<Role>, u64)> {
    let roles: Vec<Role> = header.elements.iter().map(role).collect::<Result<_>>()?;
    let mut names = HashSet::new();
    for (element, role) in header.elements.iter().zip(&roles) {
        if !names.insert(element.name) && *role != Role::Skipped {
            return Err(Error::mesh(format_args!("an element is declared twice: {}", shown(element.name))));
        }
    }
    let rows = |is_one: fn(&Role) -> bool| -> u64 {
        let of_role = header.elements.iter().zip(&roles).filter(|(_, role)| is_one(role));
        of_role.map(|(element, _)| element.rows).fold(0, u64::saturating_add)
    };
    let vertices = rows(|role| matches!(role, Role::Vertices(_)));
    let lists = rows(|role| matches!(role, Role::Polygons(_) | Role::Strips(_)));
    if lists == 0 {
        return Err(Error::mesh(format_args!(
            "the mesh has no faces: the PLY file has vertices, and no rows of face or tristrips, as a point cloud \
             (make a mesh of the points first); vertices: {vertices}"
        )));
    }
    if vertices == 0 {
        return Err(Error::mesh(format_args!("the PLY file has no vertices, but rows of face or tristrips: {lists}")));
    }
    if vertices > u64::from(u32::MAX) {
        return Err(Error::too_large(format_args!(
            "the mesh has more vertices than can be numbered, {}: {vertices}",
            u32::MAX
        )));
    }
    Ok((roles, vertices))
}

fn role(element: &Element<'_>) -> Result<Role> {
    Ok(match element.name {
        _ if element.rows == 0 => Role::Skipped,
        b"vertex" => {
            Role::Vertices([coordinate(element, b"x")?, coordinate(element, b"y")?, coordinate(element, b"z")?])
        }
        b"face" => Role::Polygons(corners(element)?),
        b"tristrips" => Role::Strips(corners(element)?),
        _ => Role::Skipped,
    })
}

/// The property of this name, a single value.
fn coordinate(element: &Element<'_>, name: &[u8]) -> Result<usize> {
    let at = the_one(element, &[name])?;
    match element.properties[at].count {
        None => Ok(at),
        Some(_) => Err(Error::mesh(format_args!("a coordinate of a vertex is one number, no list: {}", shown(name)))),
    }
}

/// The property with the corners, a list of integers.
fn corners(element: &Element<'_>) -> Result<usize> {
    let at = the_one(element, &CORNERS)?;
    let property = &element.properties[at];
    match property.count.is_some() && property.value.is_integer() {
        true => Ok(at),
        false => Err(Error::mesh(format_args!(
            "the property {} of element {} is no list of integers, such as: property list uchar int vertex_indices",
            shown(property.name),
            shown(element.name)
        ))),
    }
}

/// The only property with one of these names.
fn the_one(element: &Element<'_>, names: &[&[u8]]) -> Result<usize> {
    let mut found = (0..element.properties.len()).filter(|&at| names.contains(&element.properties[at].name));
    let wrong = |what: &str| {
        let names: Vec<String> = names.iter().map(|name| shown(name)).collect();
        Err(Error::mesh(format_args!("element {} {what}: {}", shown(element.name), names.join(" or "))))
    };
    match (found.next(), found.next()) {
        (Some(at), None) => Ok(at),
        (None, _) => wrong("needs a property"),
        (Some(_), Some(_)) => wrong("has a property twice"),
    }
}
