// What every dispatch knows, and how its threads find their item.

// A free face's label, and the wish of a face that stays where it is.
const FREE: u32 = 0xffffffffu;

// The origin of a face that is not listed. That of a listed one is the label that it had when it was, or after the last merge.
const UNLISTED: u32 = 0xfffffffeu;

// Threads in a workgroup.
const WORKGROUP: u32 = 256u;

// One turn: an iteration, or a pass of the growth. Rust: layout::Turn.
struct Turn {
    // Where in the ring the turn's numbers go.
    slot: u32,
    // 1: between batches. Fit and measure even though nothing moved, and let the dispatches that follow run.
    forced: u32,
    // Number of faces.
    faces: u32,
    // Number of clusters that are left.
    clusters: u32,
    // Workgroups in a full row of a dispatch; a dispatch of fewer is one row.
    row: u32,
    // Number of the turn in its phase, from 1.
    number: u32,
    // Number of entries in a list that the host wrote.
    entries: u32,
    // Which of equally cheap dual edges is the best: TIES_BY_HASH or TIES_BY_LARGEST_ID.
    ties: u32,
}

// Number of the thread in a dispatch of one or two dimensions. The rows' length comes from the host, because the built-in
// num_workgroups is 0 in an indirect dispatch on DX12 unless wgpu's own checks of those are on.
fn thread_number(turn: Turn, group: vec3<u32>, local: u32) -> u32 {
    return (group.y * turn.row + group.x) * WORKGROUP + local;
}
