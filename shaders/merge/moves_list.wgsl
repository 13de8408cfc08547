// Lists the faces that belong to another cluster than after the last merge, for the host. Whoever moved was on a boundary.

@group(0) @binding(0) var<uniform> turn: Turn;
@group(0) @binding(1) var<storage, read> labels: array<u32>;
@group(0) @binding(2) var<storage, read> origins: array<u32>;
@group(0) @binding(3) var<storage, read_write> found: array<Found>;
@group(0) @binding(4) var<storage, read_write> ring: array<Slot>;
@group(0) @binding(5) var<storage, read_write> lists: Lists;

@compute @workgroup_size(WORKGROUP)
fn moves_list(@builtin(workgroup_id) group: vec3<u32>, @builtin(local_invocation_index) local: u32) {
    let face = listed_face(thread_number(turn, group, local));
    var before = 0u;
    var after = 0u;
    if face != FREE {
        before = origins[face];
        after = labels[face];
    }
    let place = place_in_list(local, before != after);
    if before != after {
        found[place] = Found(face, before, after);
    }
}
