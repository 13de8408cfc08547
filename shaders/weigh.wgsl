// Pieces, third step: counts their faces, and, where all faces are searched, tells each cluster the largest number. A thread
// takes a few faces in a row, as in `gather`.

@group(0) @binding(0) var<uniform> turn: Turn;
@group(0) @binding(1) var<storage, read> labels: array<u32>;
@group(0) @binding(2) var<storage, read_write> parents: array<atomic<u32>>;
@group(0) @binding(3) var<storage, read_write> sizes: array<atomic<u32>>;
@group(0) @binding(4) var<storage, read_write> markets: array<Market>;
@group(0) @binding(5) var<storage, read_write> lists: Lists;

// Faces a thread takes.
const RUN: u32 = 8u;

// Adds faces to a piece. The last to do so finds its whole size.
fn add_to_piece(root: u32, faces: u32) {
    let before = atomicAdd(&sizes[root], faces);
    if lists.everywhere != 0u {
        atomicMax(&markets[labels[root]].best_bid, before + faces);
    }
}

@compute @workgroup_size(WORKGROUP)
fn weigh(@builtin(workgroup_id) group: vec3<u32>, @builtin(local_invocation_index) local: u32) {
    let first = thread_number(turn, group, local) * RUN;
    var root = FREE;
    var faces = 0u;
    for (var at = first; at < first + RUN; at++) {
        let face = searched_face(at);
        if face == FREE || atomicLoad(&parents[face]) == FREE {
            continue;
        }
        // `root_of` would turn other faces, too, maybe after they were turned to their roots
        let next = end_of(face);
        atomicStore(&parents[face], next);
        // that of a root is where it belongs
        if next != face && atomicLoad(&sizes[face]) == OPEN {
            atomicOr(&sizes[next], OPEN);
        }
        if next != root {
            if root != FREE {
                add_to_piece(root, faces);
            }
            root = next;
            faces = 0u;
        }
        faces += 1u;
    }
    if root != FREE {
        add_to_piece(root, faces);
    }
}
