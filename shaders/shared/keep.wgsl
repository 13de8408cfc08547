// Which faces belong on the list; those that do go to the half that is not in use.

var<workgroup> kept_here: atomic<u32>;
var<workgroup> kept_before: u32;

// Whether a face is free, or has a neighbour of another cluster.
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

// Lists the face of each thread that keeps one; all threads of the workgroup must come here.
fn keep(local: u32, face: u32, is_kept: bool) {
    var place = 0u;
    if is_kept {
        place = atomicAdd(&kept_here, 1u);
    }
    workgroupBarrier();
    if local == 0u {
        kept_before = turn.faces - lists.first + atomicAdd(&lists.kept, atomicLoad(&kept_here));
    }
    workgroupBarrier();
    if is_kept {
        lists.entries[kept_before + place] = face;
    }
}
