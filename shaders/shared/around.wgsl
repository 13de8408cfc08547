// Brings the labels of a face that comes to be listed, and of those beside it, up to date where they may not be.
fn refresh_around(face: u32) {
    if lists.behind == 0u {
        return;
    }
    refresh(face);
    let end = neighbours[face + 1u];
    for (var at = neighbours[face]; at < end; at++) {
        refresh(neighbours[at]);
    }
}
