// Labels of clusters that became part of others. A merge tells only the listed faces and those beside them; a face deeper in
// keeps its label until somebody needs it. Whoever then brings it up to date writes the same as all others who do.

// What became of a cluster.
fn now_part_of(label: u32) -> u32 {
    var cluster = label;
    if cluster == FREE {
        return cluster;
    }
    var into = lists.entries[3u * turn.faces + cluster];
    while into != 0u {
        cluster = into - 1u;
        into = lists.entries[3u * turn.faces + cluster];
    }
    return cluster;
}

// Brings the label of a face up to date, and returns it.
fn refresh(face: u32) -> u32 {
    let label = atomicLoad(&labels[face]);
    let cluster = now_part_of(label);
    if cluster != label {
        atomicStore(&labels[face], cluster);
    }
    return cluster;
}
