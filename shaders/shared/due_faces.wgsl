//! uses: append
// A listed face is due if its own cluster or one beside it changed in the iteration before: gained or lost a face, or
// got another proxy as a flood ended. No other face can decide otherwise than then. The thread of a face evaluates it
// if its own cluster changed. Otherwise the thread of its first neighbour in a cluster that changed does, which is
// listed, too.

var<workgroup> due_count: atomic<u32>;
// Of the thread's own face, the first and the last place in `neighbours` of a face in another cluster that has not
// changed; the last is 0 without any.
var<private> first_unchanged: u32;
var<private> last_unchanged: u32;
// Whether the face that is evaluated had a neighbour in a cluster that changed.
var<private> saw_changed: bool;

fn has_changed(cluster: u32) -> bool {
    return iteration.in_phase == 1u || atomicLoad(&clusters[cluster].active_in) == 2u * iteration.number - 1u;
}

// Notes a neighbour in another cluster of the face that is evaluated, by its own thread (`visitor` is FREE) or by that
// of its neighbour `visitor`. False if another thread evaluates the face.
fn is_own_task(at: u32, label: u32, visitor: u32) -> bool {
    if visitor == FREE {
        if !has_changed(label) {
            first_unchanged = select(first_unchanged, at, last_unchanged == 0u);
            last_unchanged = at;
        }
    } else if !saw_changed && has_changed(label) {
        saw_changed = true;
        return neighbours[at] == visitor;
    }
    return true;
}

// Whether the neighbour of a face at a place in `neighbours` may be due because the face's cluster has changed; a face
// may be a neighbour twice.
fn may_be_due(own: u32, at: u32) -> bool {
    let near = neighbours[at];
    let label = labels[near];
    if label == own || label == FREE || has_changed(label) {
        return false;
    }
    var before = first_unchanged;
    while neighbours[before] != near {
        before++;
    }
    return before == at;
}

// Calls `evaluate(face, own, visitor)` of the kernel for a face whose cluster has changed, and for those of its
// neighbours that may be due because of that. There is one call, since a software gpu takes the time of each for all
// threads.
fn evaluate_due(face: u32, own: u32) {
    first_unchanged = 1u;
    last_unchanged = 0u;
    var next = face;
    var visitor = FREE;
    var at = 0u;
    loop {
        saw_changed = false;
        evaluate(next, labels[next], visitor);
        at = select(at + 1u, first_unchanged, visitor == FREE);
        visitor = face;
        while at <= last_unchanged && !may_be_due(own, at) {
            at++;
        }
        if at > last_unchanged {
            break;
        }
        next = neighbours[at];
    }
}

// Counts the due faces and appends the movers. Every thread of the workgroup must call this, once.
fn write_due(local: u32) {
    write_movers(local);
    if local == 0u {
        atomicAdd(&boundary_list.due, atomicLoad(&due_count));
    }
}
