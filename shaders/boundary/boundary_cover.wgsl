//! uses: cover
//! writes: next_dispatch, boundary_list
// The indirect dispatches that follow go over all faces that are listed now.

fn boundary_cover() {
    cover(true);
}
