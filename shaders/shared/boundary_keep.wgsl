//! uses: boundary_list
// Chooses the faces of the new list, which goes into the half that is not in use.

var<workgroup> kept_here: atomic<u32>;
var<workgroup> kept_before: u32;

// Whether a face is free or has a neighbour of another cluster.
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

// Lists the thread's face if it is kept. Every thread of the workgroup must call this.
fn keep(local: u32, face: u32, is_kept: bool) {
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
