// Ends the growth: after a pass that changed nothing, the passes that are still queued get no workgroups.

@group(0) @binding(0) var<uniform> turn: Turn;
@group(0) @binding(1) var<storage, read_write> ring: array<Slot>;
@group(0) @binding(2) var<storage, read_write> next_dispatch: array<u32, 3>;

@compute @workgroup_size(1)
fn settle() {
    if atomicLoad(&ring[turn.slot].moves) == 0u {
        next_dispatch = array<u32, 3>(0u, 0u, 0u);
    }
}
