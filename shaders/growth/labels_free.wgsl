//! writes: labels, label_at_merge
// All faces become free, a thread a face.

fn labels_free(face: u32, local: u32) {
    if face < iteration.faces {
        labels[face] = FREE;
        atomicStore(&label_at_merge[face], FREE);
    }
}
