//! uses: boundary_list
// Appends faces to a half of the boundary list. A workgroup collects its faces before it touches global memory.

// Faces that a workgroup has room for; further ones are added one by one.
const ROOM: u32 = 512u;

var<workgroup> appended: array<u32, ROOM>;
var<workgroup> appended_count: atomic<u32>;
var<workgroup> appended_place: u32;

// `length` is the index of the number of faces in the half.
fn append(face: u32, length: u32, half: u32) {
    let place = atomicAdd(&appended_count, 1u);
    if place < ROOM {
        appended[place] = face;
    } else {
        let next = atomicAdd(&boundary_list.lengths[length], 1u);
        boundary_list.entries[half * iteration.faces + next] = face;
    }
}

// Writes what `append` has collected. Every thread of the workgroup must call this, once.
fn write_appended(local: u32, length: u32, half: u32) {
    workgroupBarrier();
    let count = min(atomicLoad(&appended_count), ROOM);
    if local == 0u && count != 0u {
        appended_place = half * iteration.faces + atomicAdd(&boundary_list.lengths[length], count);
    }
    workgroupBarrier();
    for (var at = local; at < count; at += WORKGROUP) {
        boundary_list.entries[appended_place + at] = appended[at];
    }
}

// The same for movers.
fn append_mover(face: u32) {
    append(face, movers_at(), 1u - iteration.half);
}

fn write_movers(local: u32) {
    write_appended(local, movers_at(), 1u - iteration.half);
}
