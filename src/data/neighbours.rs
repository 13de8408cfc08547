//! Neighbours of members, whatever makes them neighbours: components, and rows in internal order.

use std::ops::Range;

use super::csr::check_neighbours;
use super::grid::Grid;
use crate::error::Result;
use crate::parallel;
use crate::surface::Rows;
use crate::surface::components::Components;
use crate::union_find;

/// Members that a thread takes at once, at least.
const PIECE: usize = 1 << 12;

/// Which members are neighbours: symmetric, none of itself.
#[derive(Debug)]
pub enum Neighbours<'a> {
    /// By their places.
    Grid(Grid<'a>),
    /// By lists.
    Rows(Rows),
}

impl Neighbours<'_> {
    /// Puts the neighbours of a member in place of what is in a list, in ascending order.
    fn list(&self, member: u32, into: &mut Vec<u32>) {
        into.clear();
        match self {
            Self::Grid(grid) => grid.list(member, into),
            Self::Rows(rows) => into.extend_from_slice(rows.of(member)),
        }
    }

    /// The components that neighbours connect.
    pub fn components(&self, members: usize) -> Components {
        let mut sets = union_find::singletons(members);
        let mut beside = Vec::new();
        for member in 0..members as u32 {
            self.list(member, &mut beside);
            union_find::attach(&mut sets, member, beside.iter().copied().take_while(|&other| other < member));
        }
        let (of_face, count) = union_find::numbered(sets);
        Components { of_face, count }
    }

    /// The rows of the internal order, which is given in both directions, and of bridges between members. Rows ascend.
    pub fn compressed(&self, member_of: &[u32], internal: &[u32], bridges: &[(u32, u32)]) -> Result<Rows> {
        check_neighbours(self.count(internal.len()) + 2 * bridges.len() as u64)?;
        let mut bridges: Vec<(u32, u32)> = bridges.iter().flat_map(|&(a, b)| [(a, b), (b, a)]).collect();
        bridges.sort_unstable();
        let piece = |members: Range<usize>| {
            let mut rows = Rows::default();
            let mut row = Vec::new();
            for &member in &member_of[members] {
                self.list(member, &mut row);
                let first = bridges.partition_point(|&(other, _)| other < member);
                row.extend(bridges[first..].iter().take_while(|bridge| bridge.0 == member).map(|bridge| bridge.1));
                row.iter_mut().for_each(|other| *other = internal[*other as usize]);
                row.sort_unstable();
                rows.offsets.push(rows.items.len() as u32);
                rows.items.extend_from_slice(&row);
            }
            rows
        };
        Ok(Rows::joined(parallel::pieces(member_of.len(), PIECE, &piece)))
    }

    /// How many neighbours all members have together.
    fn count(&self, members: usize) -> u64 {
        match self {
            Self::Rows(rows) => rows.items.len() as u64,
            Self::Grid(grid) => {
                let of_members = |members: Range<usize>| {
                    let mut beside = Vec::new();
                    let of_member = |member: usize| {
                        beside.clear();
                        grid.list(member as u32, &mut beside);
                        beside.len() as u64
                    };
                    members.map(of_member).sum::<u64>()
                };
                parallel::ranges(members, PIECE, &of_members).into_iter().sum()
            }
        }
    }
}
