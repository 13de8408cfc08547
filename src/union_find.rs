//! Trees of what was found to be one: a forest of parents, in which a root is its own.

/// The root of a member's tree; halves the path on the way.
pub(crate) fn root(parent: &mut [u32], mut member: u32) -> u32 {
    loop {
        let up = parent[member as usize];
        if up == member {
            return member;
        }
        let above = parent[up as usize];
        parent[member as usize] = above;
        member = above;
    }
}
