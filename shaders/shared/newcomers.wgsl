// Faces that come to be on a boundary join the list, each once. A workgroup collects its newcomers before it touches memory
// that all share.

// Newcomers that a workgroup has room for; more than that go to the list one by one.
const ROOM: u32 = 512u;

var<workgroup> newcomers: array<u32, ROOM>;
var<workgroup> newcomer_count: atomic<u32>;
var<workgroup> newcomer_place: u32;

// Whether a face that was not listed is now, by this thread.
fn claim(face: u32, label: u32) -> bool {
    if atomicLoad(&origins[face]) != UNLISTED {
        return false;
    }
    var holder = UNLISTED;
    while holder == UNLISTED {
        let found = atomicCompareExchangeWeak(&origins[face], UNLISTED, label);
        if found.exchanged {
            return true;
        }
        holder = found.old_value;
    }
    return false;
}

fn add_newcomer(face: u32) {
    let place = atomicAdd(&newcomer_count, 1u);
    if place < ROOM {
        newcomers[place] = face;
    } else {
        lists.entries[lists.first + atomicAdd(&lists.length, 1u)] = face;
    }
}

// Brings them to the list; all threads of the workgroup must come here.
fn list_newcomers(local: u32) {
    workgroupBarrier();
    let count = min(atomicLoad(&newcomer_count), ROOM);
    if local == 0u && count != 0u {
        newcomer_place = lists.first + atomicAdd(&lists.length, count);
    }
    workgroupBarrier();
    for (var at = local; at < count; at += WORKGROUP) {
        lists.entries[newcomer_place + at] = newcomers[at];
    }
}
