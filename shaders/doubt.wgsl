// Pieces in a hierarchy: whether what is known of listed faces tells them all. A piece that goes on among other faces is open.
//
// Let two open pieces of a cluster not hang together. What hangs together with an open piece has faces that are not listed; those
// never moved, and were of the cluster after the last merge, when it was in one piece. So a way led through it from the one
// to the other. It leaves what hangs together with the first by a face beside one that left the cluster, or that a
// closed piece has: beside a gap. That face is listed, as its neighbour left (beside a closed piece it would be part of it). Through
// gaps the way comes to a listed face of another open piece. So where every gap has one open piece beside it, all open pieces of
// a cluster are one. The others are whole, and if none of them has as many faces as are left for that one, it is the largest.

@group(0) @binding(0) var<uniform> turn: Turn;
@group(0) @binding(1) var<storage, read> neighbours: array<u32>;
@group(0) @binding(2) var<storage, read> labels: array<u32>;
@group(0) @binding(3) var<storage, read> origins: array<u32>;
@group(0) @binding(4) var<storage, read> pieces: array<u32>;
@group(0) @binding(5) var<storage, read_write> sizes: array<atomic<u32>>;
// The trees of gaps.
@group(0) @binding(6) var<storage, read_write> parents: array<atomic<u32>>;
@group(0) @binding(7) var<storage, read_write> clusters: array<Cluster>;
@group(0) @binding(8) var<storage, read_write> lists: Lists;

// Whether a gap beside an open face has another open piece beside it, too, as the later of both to come here finds.
fn is_between_pieces(face: u32, cluster: u32, piece: u32) -> bool {
    let end = neighbours[face + 1u];
    for (var at = neighbours[face]; at < end; at++) {
        let near = neighbours[at];
        if origins[near] == cluster && atomicLoad(&parents[near]) != FREE {
            let other = atomicMin(&sizes[turn.faces + root_of(near)], piece);
            if other != FREE && other != piece {
                return true;
            }
        }
    }
    return false;
}

@compute @workgroup_size(WORKGROUP)
fn doubt(@builtin(workgroup_id) group: vec3<u32>, @builtin(local_invocation_index) local: u32) {
    let face = listed_face(thread_number(turn, group, local));
    if face == FREE || pieces[face] == FREE {
        return;
    }
    let own = labels[face];
    let size = atomicLoad(&sizes[pieces[face]]);
    var is_in_doubt = false;
    if size >= OPEN {
        is_in_doubt = origins[face] == own && is_between_pieces(face, own, pieces[face]);
    } else {
        let outside = atomicLoad(&clusters[own].staying);
        is_in_doubt = outside != 0u && size >= outside;
    }
    if is_in_doubt {
        atomicStore(&lists.doubts, 1u);
    }
}
