//! uses: boundary_list
// Adds faces to the list, each once. A workgroup collects its new faces before it touches global memory.

// Faces that a workgroup has room for; further ones are added one by one.
const ROOM: u32 = 512u;

var<workgroup> inserted: array<u32, ROOM>;
var<workgroup> inserted_count: atomic<u32>;
var<workgroup> inserted_place: u32;

// Marks a face as listed, its label being `label`. True for one thread only, and for none if the face is listed.
fn claim(face: u32, label: u32) -> bool {
    if atomicLoad(&label_at_merge[face]) != UNLISTED {
        return false;
    }
    var holder = UNLISTED;
    while holder == UNLISTED {
        let found = atomicCompareExchangeWeak(&label_at_merge[face], UNLISTED, label);
        if found.exchanged {
            return true;
        }
        holder = found.old_value;
    }
    return false;
}

// Inserts a face that this thread has claimed.
fn insert(face: u32) {
    let place = atomicAdd(&inserted_count, 1u);
    if place < ROOM {
        inserted[place] = face;
    } else {
        boundary_list.entries[boundary_list.first + atomicAdd(&boundary_list.length, 1u)] = face;
    }
}

// Writes the inserted faces to the list. Every thread of the workgroup must call this.
fn write_inserted(local: u32) {
    workgroupBarrier();
    let count = min(atomicLoad(&inserted_count), ROOM);
    if local == 0u && count != 0u {
        inserted_place = boundary_list.first + atomicAdd(&boundary_list.length, count);
    }
    workgroupBarrier();
    for (var at = local; at < count; at += WORKGROUP) {
        boundary_list.entries[inserted_place + at] = inserted[at];
    }
}
