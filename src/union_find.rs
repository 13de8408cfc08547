//! Union-find: a forest of parents, in which a root is its own parent.

use crate::parallel;

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

/// Joins the trees of two members: the smaller root becomes the parent of the larger. Returns whether they were two
/// trees.
pub(crate) fn join(parent: &mut [u32], one: u32, other: u32) -> bool {
    let (one, other) = (root(parent, one), root(parent, other));
    parent[one.max(other) as usize] = one.min(other);
    one != other
}

/// Joins the tree of a member that has no children with those of earlier members; the member itself stands for none.
///
/// Which neighbours of a face come earlier follows no pattern. There is a branch only where two trees meet, which is
/// rare where members come in an order that keeps neighbours close.
#[inline]
pub(crate) fn attach(parent: &mut [u32], member: u32, earlier: impl Iterator<Item = u32>) {
    let mut above = member;
    for other in earlier {
        let other = parent[other as usize];
        let (low, high) = (above.min(other), above.max(other));
        if (high != member) & (low != high) {
            join(parent, low, high);
        }
        above = low;
    }
    parent[member as usize] = above;
}

/// A forest whose trees are the connected sets of members. `earlier` has the members that one is connected with and
/// that come before it; itself stands for none.
///
/// Each thread takes a run of members; trees of several runs are joined in the end.
pub(crate) fn forest<I: Iterator<Item = u32>>(members: usize, earlier: impl Fn(u32) -> I + Sync) -> Vec<u32> {
    /// Members of a run, at least.
    const LEAST: usize = 1 << 14;
    let length = members.div_ceil(rayon::current_num_threads()).max(LEAST);
    let mut parent = vec![0; members];
    let mut runs: Vec<&mut [u32]> = parent.chunks_mut(length).collect();
    let across: Vec<Vec<(u32, u32)>> = parallel::runs_mut(&mut runs, 1, &|run, runs| {
        let mut across = Vec::new();
        for (run, parent) in (run..).zip(runs) {
            let first = (run * length) as u32;
            for at in 0..parent.len() as u32 {
                parent[at as usize] = at;
                let within = earlier(first + at).map(|other| {
                    other.checked_sub(first).unwrap_or_else(|| {
                        across.push((first + at, other));
                        at
                    })
                });
                attach(parent, at, within);
            }
            parent.iter_mut().for_each(|parent| *parent += first);
        }
        across
    });
    across.into_iter().flatten().for_each(|(one, other)| _ = join(&mut parent, one, other));
    parent
}

/// A forest in which every member is a tree.
pub(crate) fn singletons(members: usize) -> Vec<u32> {
    (0..members as u32).collect()
}

/// The number of the tree of each member, in the order of their smallest members; and how many there are. Trees are
/// those that [`join`] makes: a parent is smaller than its children.
pub(crate) fn numbered(mut parent: Vec<u32>) -> (Vec<u32>, usize) {
    let mut count = 0;
    for member in 0..parent.len() {
        // a parent comes first and already has its number
        let above = parent[member] as usize;
        parent[member] = if above == member {
            count += 1;
            count - 1
        } else {
            parent[above]
        };
    }
    (parent, count as usize)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::dev::random;

    #[test]
    fn a_forest_is_the_same_for_any_number_of_threads() {
        let members = 100_000u32;
        // far and near ones, of earlier runs and of the same, some of them itself
        let earlier = |member: u32| {
            let steps = [7, 30_011, 5].into_iter();
            steps.map(move |step| if member % step.min(11) < 2 && member >= step { member - step } else { member })
        };
        let mut expected = singletons(members as usize);
        for member in 0..members {
            earlier(member).for_each(|other| _ = join(&mut expected, member, other));
        }
        let expected = numbered(expected);
        assert!(expected.1 > 1000, "{}", expected.1);
        for threads in [1, 2, 5] {
            let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().expect("threads");
            assert!(pool.install(|| numbered(forest(members as usize, earlier))) == expected, "{threads} threads");
        }
    }

    #[test]
    fn attached_members_are_in_the_trees_of_the_earlier_ones() {
        let earlier: [&[u32]; 7] = [&[], &[], &[0], &[1, 3], &[4], &[2, 3, 5], &[6, 4]];
        let (mut attached, mut joined) = (singletons(7), singletons(7));
        for (member, earlier) in (0..).zip(earlier) {
            attach(&mut attached, member, earlier.iter().copied());
            earlier.iter().for_each(|&other| _ = join(&mut joined, member, other));
        }
        assert_eq!(numbered(attached), numbered(joined));
    }

    #[test]
    fn trees_are_the_sets_that_a_walk_finds_in_the_order_of_their_smallest_members() {
        let mut states = random(1);
        for (members, edges) in [(1, 0), (40, 15), (300, 250), (300, 600), (2000, 1900)] {
            let mut next = || (states() >> 33) as usize % members;
            let mut parent = singletons(members);
            let mut beside = vec![Vec::new(); members];
            for (a, b) in (0..edges).map(|_| (next(), next())) {
                join(&mut parent, a as u32, b as u32);
                beside[a].push(b);
                beside[b].push(a);
            }
            let mut expected = vec![u32::MAX; members];
            let mut walks = 0;
            for start in 0..members {
                if expected[start] == u32::MAX {
                    let mut stack = vec![start];
                    while let Some(member) = stack.pop() {
                        if std::mem::replace(&mut expected[member], walks) == u32::MAX {
                            stack.extend(&beside[member]);
                        }
                    }
                    walks += 1;
                }
            }
            assert_eq!(numbered(parent), (expected, walks as usize));
        }
    }
}
