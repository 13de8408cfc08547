// Pieces in a hierarchy, before the search among listed faces: lists the faces around each one that left its cluster since the
// last merge, those of that cluster. A piece that was cut off is so often listed whole, and one that was not hangs together
// among them; where it is otherwise, `doubt` finds out.

@group(0) @binding(0) var<uniform> turn: Turn;
@group(0) @binding(1) var<storage, read> neighbours: array<u32>;
@group(0) @binding(2) var<storage, read_write> labels: array<atomic<u32>>;
@group(0) @binding(3) var<storage, read_write> clusters: array<Cluster>;
@group(0) @binding(4) var<storage, read_write> origins: array<atomic<u32>>;
@group(0) @binding(5) var<storage, read_write> lists: Lists;

// Faces that a thread lists. With 16, one in some thousand faces that move on the bunny leaves a doubt, with 64 next to none.
const AROUND: u32 = 64u;

var<private> found: array<u32, AROUND>;
var<private> found_count: u32;

// Lists the faces of a cluster beside a face that is listed, of those that are not. Labels beside it are up to date.
fn list_beside(face: u32, cluster: u32) {
    let end = neighbours[face + 1u];
    for (var at = neighbours[face]; at < end && found_count < AROUND; at++) {
        let near = neighbours[at];
        if atomicLoad(&labels[near]) == cluster && claim(near, cluster) {
            refresh_around(near);
            add_newcomer(near);
            found[found_count] = near;
            found_count++;
        }
    }
}

fn explore_around(face: u32) {
    let left = atomicLoad(&origins[face]);
    // a cluster has lost the face, and nobody has looked for its pieces since
    if left >= UNLISTED || left == atomicLoad(&labels[face]) || atomicLoad(&clusters[left].whole) != 0u {
        return;
    }
    found_count = 0u;
    let end = neighbours[face + 1u];
    for (var at = neighbours[face]; at < end; at++) {
        // they are listed, being beside another cluster now
        if atomicLoad(&labels[neighbours[at]]) == left {
            list_beside(neighbours[at], left);
        }
    }
    for (var next = 0u; next < found_count; next++) {
        list_beside(found[next], left);
    }
}

@compute @workgroup_size(WORKGROUP)
fn explore(@builtin(workgroup_id) group: vec3<u32>, @builtin(local_invocation_index) local: u32) {
    let face = listed_face(thread_number(turn, group, local));
    if face != FREE {
        explore_around(face);
    }
    list_newcomers(local);
}
