//! uses: boundary_list, bids
//! reads: neighbours, labels
//! writes: label_at_merge, face_bids, boundary_list
// Makes the new boundary list, in the half that is not in use: from all faces, or from the listed ones, a thread each.
// It keeps the faces that are free or have a neighbour of another cluster; between batches also those that moved since
// the last merge, which the host may read.

// Whether all faces are candidates; the host has set `label_at_merge` of all then.
override FROM_ALL: bool = false;

var<workgroup> kept_here: atomic<u32>;
var<workgroup> kept_before: u32;

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

fn boundary_keep(thread: u32, local: u32) {
    var face = FREE;
    if !FROM_ALL {
        face = listed_face(thread);
    } else if thread < iteration.faces {
        face = thread;
    }
    var is_kept = false;
    if face != FREE {
        let has_moved = atomicLoad(&label_at_merge[face]) != labels[face];
        is_kept = is_on_boundary(face) || (iteration.between != 0u && has_moved);
        if !is_kept {
            atomicStore(&label_at_merge[face], UNLISTED);
            face_bids[face] = NO_BID;
        }
    }
    var place = 0u;
    if is_kept {
        place = atomicAdd(&kept_here, 1u);
    }
    workgroupBarrier();
    if local == 0u {
        let before = atomicAdd(&boundary_list.kept, atomicLoad(&kept_here));
        kept_before = iteration.faces - boundary_list.first + before;
    }
    workgroupBarrier();
    if is_kept {
        boundary_list.entries[kept_before + place] = face;
    }
}
