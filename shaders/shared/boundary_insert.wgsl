//! uses: append
// Adds faces to the boundary list, each once.

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
    append(face, iteration.half, iteration.half);
}

// Writes the inserted faces to the list. Every thread of the workgroup must call this, once.
fn write_inserted(local: u32) {
    write_appended(local, iteration.half, iteration.half);
}
