//! How much work a thread takes at a time, at least. Results do not depend on it.

/// Faces, nodes or pairs, where each costs some hundred instructions.
pub const ITEMS: usize = 1024;

/// Faces, where each costs some ten instructions.
pub const FACES: usize = 1 << 13;

/// Clusters, where each costs as much as its boundary has faces.
pub const CLUSTERS: usize = 64;
