//! uses: append
//! reads: neighbours, labels
//! writes: label_at_merge, boundary_list
// Makes the new boundary list, in the half that is not in use: from all faces, or from the listed ones, a thread each.
// It keeps the faces that are free or have a neighbour of another cluster; after merges also those that moved since the
// last one, which the host may read.

fn is_on_boundary(face: u32) -> bool {
    let own = labels[face];
    if own == FREE {
        return true;
    }
    let end = neighbours[face + 1u];
    for (var at = neighbours[face]; at < end; at++) {
        if labels[neighbours[at]] != own {
            return true;
        }
    }
    return false;
}

fn boundary_keep(face: u32) {
    let has_moved = iteration.keeps_moved != 0u && atomicLoad(&label_at_merge[face]) != labels[face];
    if has_moved || is_on_boundary(face) {
        append(face, 1u - iteration.half, 1u - iteration.half);
    } else {
        atomicStore(&label_at_merge[face], UNLISTED);
    }
}

fn boundary_keep_end(local: u32, group: u32) {
    write_appended(local, 1u - iteration.half, 1u - iteration.half);
}
