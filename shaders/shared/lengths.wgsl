//! uses: boundary_list
// Stores the lengths of the lists that an iteration went over, for the host. One thread calls it.
fn write_lengths(movers: u32) {
    atomicStore(&stats[iteration.slot].listed, listed());
    atomicStore(&stats[iteration.slot].due, atomicExchange(&boundary_list.due, 0u));
    atomicStore(&stats[iteration.slot].movers, movers);
}
