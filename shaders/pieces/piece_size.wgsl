//! uses: piece_tree, largest_piece
// Third step: sets every face to its root, counts the faces of each piece, and finds the size of each cluster's largest
// piece. A thread takes a few faces in a row, as in `sums_gather`.

@group(0) @binding(0) var<uniform> iteration: Iteration;
@group(0) @binding(1) var<storage, read> labels: array<u32>;
@group(0) @binding(2) var<storage, read_write> parents: array<atomic<u32>>;
@group(0) @binding(3) var<storage, read_write> piece_sizes: array<atomic<u32>>;
@group(0) @binding(4) var<storage, read_write> largest_pieces: array<LargestPiece>;

// Faces a thread takes.
const RUN: u32 = 8u;

// The last addition to a piece finds its whole size.
fn add_to_piece(root: u32, faces: u32) {
    let before = atomicAdd(&piece_sizes[root], faces);
    atomicMax(&largest_pieces[labels[root]].size, before + faces);
}

@compute @workgroup_size(WORKGROUP)
fn piece_size(@builtin(workgroup_id) group: vec3<u32>, @builtin(local_invocation_index) local: u32) {
    let first = thread_number(iteration, group, local) * RUN;
    let end = min(first + RUN, iteration.faces);
    var root = FREE;
    var faces = 0u;
    for (var face = first; face < end; face++) {
        if atomicLoad(&parents[face]) == FREE {
            continue;
        }
        let next = end_of(face);
        atomicStore(&parents[face], next);
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
