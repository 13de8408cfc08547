// Ends the growth: after a pass that changed nothing, the passes that are still queued get no workgroups. Forced, it lets
// dispatches go over the listed faces.

@group(0) @binding(0) var<uniform> turn: Turn;
@group(0) @binding(1) var<storage, read_write> ring: array<Slot>;
@group(0) @binding(2) var<storage, read_write> lists: Lists;
@group(0) @binding(3) var<storage, read_write> next_dispatch: array<u32, 3>;

@compute @workgroup_size(1)
fn growth_check_done() {
    if turn.forced != 0u {
        cover_list();
    } else if atomicLoad(&ring[turn.slot].moves) == 0u {
        cover_nothing();
    }
}
