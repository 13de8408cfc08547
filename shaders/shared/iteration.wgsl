// What every dispatch knows, and which item a thread works on.

// The label of a free face, and "none" wherever a face or a cluster is meant.
const FREE: u32 = 0xffffffffu;

// `label_at_merge` of a face that is not on the boundary list.
const UNLISTED: u32 = 0xfffffffeu;

// Threads in a workgroup of every kernel with a thread an item.
const WORKGROUP: u32 = 256u;

// An iteration of a phase, or a pass of the growth. Rust: layout::Iteration.
struct Iteration {
    // Index of its entry in `stats`.
    slot: u32,
    // 1: outside a batch of iterations. Kernels then do their work even though nothing moved.
    between: u32,
    // Number of faces.
    faces: u32,
    // Number of clusters that are left.
    clusters: u32,
    // Workgroups in a full row of a dispatch; a smaller dispatch is one row.
    row: u32,
    // Number of the iteration in its phase, from 1.
    number: u32,
    // Number of entries of `host_list`.
    entries: u32,
    // Order of equally cheap dual edges: TIES_BY_HASH or TIES_BY_LARGEST_ID.
    ties: u32,
}

// Number of the thread in a dispatch of one or two dimensions. The row length comes from the host, because the built-in
// num_workgroups is 0 in an indirect dispatch on DX12 unless wgpu validates those.
fn thread_number(iteration: Iteration, group: vec3<u32>, local: u32) -> u32 {
    return (group.y * iteration.row + group.x) * WORKGROUP + local;
}
