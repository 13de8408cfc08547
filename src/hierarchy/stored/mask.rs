//! Which of the uploaded items a hierarchy is of.

use crate::device::FREE;
use crate::hierarchy::Cut;

/// Whether each uploaded item takes part. At least one does not.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Mask(Vec<bool>);

impl Mask {
    /// Whether each item takes part; none if all do.
    pub fn new(takes_part: &[bool]) -> Option<Self> {
        takes_part.contains(&false).then(|| Self(takes_part.to_vec()))
    }

    /// Number of items.
    pub(super) fn items(&self) -> u32 {
        self.0.len() as u32
    }

    /// Number of items that take part.
    pub(super) fn members(&self) -> u64 {
        self.0.iter().map(|&takes_part| u64::from(takes_part)).sum()
    }

    /// A bit an item, and zeros up to a whole byte.
    pub(super) fn bytes(&self) -> Vec<u8> {
        let byte = |items: &[bool]| (0..).zip(items).map(|(bit, &takes_part)| u8::from(takes_part) << bit).sum();
        self.0.chunks(8).map(byte).collect()
    }

    /// The mask of so many items that has these bytes.
    pub(super) fn of(bytes: &[u8], items: u32) -> Option<Self> {
        let mut takes_part: Vec<bool> =
            bytes.iter().flat_map(|&byte| (0..8).map(move |bit| byte >> bit & 1 == 1)).collect();
        let beyond = takes_part.split_off(items as usize);
        (!beyond.contains(&true)).then_some(Self(takes_part))
    }
}

/// A cut with a label for every uploaded item: [`FREE`] of those that a mask leaves out.
pub(super) fn applied(mask: Option<&Mask>, cut: Cut) -> Cut {
    let Some(Mask(takes_part)) = mask else { return cut };
    let mut of_members = cut.labels.iter().copied();
    let label = |&takes_part: &bool| if takes_part { of_members.next() } else { None };
    Cut { labels: takes_part.iter().map(label).map(|label| label.unwrap_or(FREE)).collect(), ..cut }
}
