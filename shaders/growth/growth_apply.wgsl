//! uses: boundary_list
//! reads: wanted_clusters
//! writes: labels, boundary_list
// Second step of a pass of the growth (P§5.3), a thread a listed face: the labels follow. Rust: device::plain::grow.

fn growth_apply(thread: u32, local: u32) {
    let face = listed_face(thread);
    if face != FREE && wanted_clusters[thread] != FREE {
        labels[face] = wanted_clusters[thread];
    }
}
