//! uses: cover
//! writes: next_dispatch, boundary_list
// The faces that `boundary_keep` kept become the list. After the end of a phase, the `boundary_keep` of a batch that is
// still queued has no workgroups, and the list stays.

fn boundary_publish() {
    if iteration.between != 0u || next_dispatch[0] != 0u {
        atomicStore(&boundary_list.length, atomicExchange(&boundary_list.kept, 0u));
        boundary_list.first = iteration.faces - boundary_list.first;
        cover(true);
    }
}
