// A merge, second step, while clusters are small: all faces follow their clusters. From here on moves count.

@group(0) @binding(0) var<uniform> turn: Turn;
@group(0) @binding(1) var<storage, read_write> labels: array<atomic<u32>>;
@group(0) @binding(2) var<storage, read_write> origins: array<u32>;
@group(0) @binding(3) var<storage, read_write> lists: Lists;

@compute @workgroup_size(WORKGROUP)
fn relabel(@builtin(workgroup_id) group: vec3<u32>, @builtin(local_invocation_index) local: u32) {
    let face = thread_number(turn, group, local);
    if face >= turn.faces {
        return;
    }
    let label = refresh(face);
    if label != FREE && origins[face] != UNLISTED {
        origins[face] = label;
    }
}
