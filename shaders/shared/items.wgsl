// Faces and proxies in lattice units: coordinates are below 2²⁷ in magnitude.

// Rust: layout::Face.
struct Face {
    centroid: vec3<i32>,
    weight: u32,
}

// Rust: layout::Proxy.
struct Proxy {
    position: vec3<i32>,
    // The cluster's energy is shifted left by this, at most 30, to the units of the finest component.
    energy_shift: u32,
}
