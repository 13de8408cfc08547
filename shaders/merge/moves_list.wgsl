//! uses: boundary_list
//! reads: labels, label_at_merge
//! writes: moves, stats, boundary_list
// Lists the faces that belong to another cluster than after the last merge, in any order, for the host, a thread a
// listed face; `stats` counts the entries. A face that moved is listed. Rust: device::moves_since_merge.

fn moves_list(face: u32) {
    if label_at_merge[face] != labels[face] {
        let place = atomicAdd(&stats[iteration.slot].entries, 1u);
        moves[place] = Move(face, label_at_merge[face], labels[face]);
    }
}
