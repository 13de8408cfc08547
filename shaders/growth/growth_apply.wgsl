//! uses: boundary_list
//! reads: wanted_clusters
//! writes: labels, boundary_list
// Second step of a pass of the growth (P§5.3), a thread a listed face or a freed one: the labels follow.
// Rust: device::plain::grow.

fn growth_apply(face: u32) {
    if labels[face] == FREE {
        labels[face] = wanted_clusters[face];
    }
}
