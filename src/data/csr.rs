//! Edges as compressed rows.

use super::members::Members;
use crate::error::{Error, Result};
use crate::surface::{Rows, rows};

/// Edges as compressed rows, as scipy and METIS have them: those of item i lead to
/// `indices[offsets[i]..offsets[i + 1]]`. Any of them may be there in one direction or both, twice, or lead to the item
/// itself.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Csr {
    offsets: Vec<u32>,
    indices: Vec<u32>,
}

impl Csr {
    /// Checks compressed rows: `indptr` begins with 0, never falls and ends with the number of indices; indices are
    /// below the number of rows.
    pub fn new(
        indptr: impl ExactSizeIterator<Item = i64>,
        indices: impl ExactSizeIterator<Item = i64>,
    ) -> Result<Self> {
        let (rows, entries) = (indptr.len().saturating_sub(1), indices.len());
        check_entries(entries)?;
        if indptr.len() == 0 {
            return Err(Error::parameter("indptr must have one entry more than there are items: 0"));
        }
        let mut offsets: Vec<u32> = Vec::with_capacity(rows + 1);
        for (at, offset) in indptr.enumerate() {
            let before = offsets.last().map_or(0, |&before| i64::from(before));
            let fits = if at == 0 { offset == 0 } else { (before..=entries as i64).contains(&offset) };
            if !fits {
                return Err(Error::parameter(format_args!(
                    "indptr must begin with 0 and rise to the number of indices, {entries}; entry {at}, after \
                     {before}, is {offset}"
                )));
            }
            offsets.push(offset as u32);
        }
        if offsets[rows] as usize != entries {
            return Err(Error::parameter(format_args!(
                "indptr must end with the number of indices, {entries}: {}",
                offsets[rows]
            )));
        }
        let mut checked = Vec::with_capacity(entries);
        for (at, index) in indices.enumerate() {
            if !(0..rows as i64).contains(&index) {
                let row = offsets.partition_point(|&offset| offset as usize <= at) - 1;
                return Err(Error::parameter(format_args!(
                    "indices must be from 0 to {}, one less than the number of rows; entry {at}, in row {row}, is \
                     {index}",
                    rows as i64 - 1
                )));
            }
            checked.push(index as u32);
        }
        Ok(Self { offsets, indices: checked })
    }

    /// The same rows without some entries; `is_kept` has one flag an entry.
    pub fn filtered(self, mut is_kept: impl Iterator<Item = bool>) -> Self {
        let mut kept = Self { offsets: vec![0], indices: Vec::with_capacity(self.indices.len()) };
        for row in self.offsets.windows(2) {
            let of_row = &self.indices[row[0] as usize..row[1] as usize];
            kept.indices.extend(of_row.iter().filter(|_| is_kept.next() == Some(true)));
            kept.offsets.push(kept.indices.len() as u32);
        }
        kept
    }

    /// Number of rows.
    pub fn items(&self) -> usize {
        self.offsets.len() - 1
    }

    /// Number of entries.
    pub fn entries(&self) -> usize {
        self.indices.len()
    }

    /// Every edge in both directions and once, between members, none to itself; rows ascend.
    pub(super) fn rows(&self, members: &Members) -> Result<Rows> {
        let edges = || {
            self.offsets.windows(2).enumerate().flat_map(|(item, row)| {
                let from = members.member(item as u32);
                let of_row = &self.indices[row[0] as usize..row[1] as usize];
                of_row.iter().filter_map(move |&other| Some((from?, members.member(other)?))).filter(|(a, b)| a != b)
            })
        };
        let rows = rows::symmetric(members.len(), edges);
        check_neighbours(rows.items.len() as u64)?;
        Ok(rows)
    }
}

/// Refuses more directed edges than [`rows::symmetric`] can count in both directions.
pub fn check_entries(entries: usize) -> Result<()> {
    match entries >= 1 << 31 {
        true => Err(Error::too_large(format_args!("a graph may have at most {} entries: {entries}", (1u32 << 31) - 1))),
        false => Ok(()),
    }
}

/// Refuses more neighbours than rows can have.
pub fn check_neighbours(neighbours: u64) -> Result<()> {
    match neighbours > 1 << 31 {
        true => Err(Error::too_large(format_args!(
            "a graph may have at most {} edges in both directions together: {neighbours}",
            1u32 << 31
        ))),
        false => Ok(()),
    }
}
