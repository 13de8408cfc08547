//! Groups of faces as one number a face, from runs of faces. Names are not kept.

use std::collections::HashMap;
use std::hash::Hash;

/// The groups of the faces so far.
#[derive(Debug)]
pub struct Groups<K> {
    numbers: HashMap<K, u32>,
    of_face: Vec<u32>,
}

impl<K: Hash + Eq> Groups<K> {
    /// No faces yet, with room for so many.
    pub fn with_capacity(faces: usize) -> Self {
        Self { numbers: HashMap::new(), of_face: Vec::with_capacity(faces) }
    }

    /// Adds the faces before `end` that are not there yet. Runs of the same key are one group.
    pub fn add_to(&mut self, end: usize, key: K) {
        if end > self.of_face.len() {
            let next = self.numbers.len() as u32;
            let number = *self.numbers.entry(key).or_insert(next);
            self.of_face.resize(end, number);
        }
    }

    /// The group of each face.
    pub fn finish(self) -> Vec<u32> {
        self.of_face
    }
}
