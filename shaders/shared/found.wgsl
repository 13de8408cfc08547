// A list that the device writes, in any order. Rust: layout::Found.
struct Found {
    // The cluster, or the face.
    subject: u32,
    // The neighbour it would merge with, or the cluster that the face belonged to.
    first: u32,
    // The packed cost, or the cluster that the face belongs to.
    second: u32,
}

var<workgroup> found_here: atomic<u32>;
var<workgroup> found_before: u32;

// Where in the list a thread puts what it found; all threads of the workgroup must come here. `moves` of the turn's slot
// counts the list.
fn place_in_list(local: u32, is_found: bool) -> u32 {
    var place = 0u;
    if is_found {
        place = atomicAdd(&found_here, 1u);
    }
    workgroupBarrier();
    if local == 0u {
        found_before = atomicAdd(&ring[turn.slot].moves, atomicLoad(&found_here));
    }
    workgroupBarrier();
    return found_before + place;
}
