//! Groups of faces of an OBJ: those under one object, group and material.

use std::collections::HashMap;

use super::chunk::Name;
use crate::mesh::groups;

/// The groups of the faces so far.
pub struct Groups<'a> {
    /// Numbers of names from 1 on: names are compared once a statement, however long they are.
    numbers: HashMap<&'a [u8], u32>,
    /// The names in force: one of each [`Kind`](super::chunk::Kind), 0 for none.
    current: [u32; 3],
    of_face: groups::Groups<[u32; 3]>,
}

impl<'a> Groups<'a> {
    /// No faces yet, with room for so many.
    pub fn with_capacity(faces: usize) -> Self {
        let of_face = groups::Groups::with_capacity(faces);
        Self { numbers: HashMap::new(), current: [0; 3], of_face }
    }

    /// From face `face` on, a name is in force.
    pub fn rename(&mut self, face: usize, name: &Name<'a>) {
        self.of_face.add_to(face, self.current);
        let text = name.text.trim_ascii();
        let next = self.numbers.len() as u32 + 1;
        self.current[name.kind as usize] = if text.is_empty() { 0 } else { *self.numbers.entry(text).or_insert(next) };
    }

    /// The group of each of all faces.
    pub fn finish(mut self, faces: usize) -> Vec<u32> {
        self.of_face.add_to(faces, self.current);
        self.of_face.finish()
    }
}
