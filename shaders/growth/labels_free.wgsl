//! writes: labels, label_at_merge
// All faces become free, a thread a face.

fn labels_free(face: u32) {
    labels[face] = FREE;
    atomicStore(&label_at_merge[face], FREE);
}
