//! A filter without a branch that depends on the items: where which ones are kept follows no pattern, mispredicted
//! branches cost more than all else (`benches/results/2026-11-22-two-cores/branches.md`).

/// The items that passed, in the order in which they came. Its memory is used again after [`clear`](Self::clear).
#[derive(Debug, Default)]
pub struct Filter {
    /// The kept items, then unused slots.
    slots: Vec<u32>,
    kept: usize,
}

impl Filter {
    /// Drops all items.
    pub fn clear(&mut self) {
        self.kept = 0;
    }

    /// Adds those of at most `most` items for which `is_kept` holds.
    #[inline]
    pub fn add(&mut self, most: usize, items: impl Iterator<Item = u32>, mut is_kept: impl FnMut(u32) -> bool) {
        let room = self.kept + most;
        if self.slots.len() < room {
            self.slots.resize(room.max(2 * self.slots.len()), 0);
        }
        let mut kept = 0;
        let slots = &mut self.slots[self.kept..][..most];
        for item in items.take(most) {
            slots[kept] = item;
            kept += usize::from(is_kept(item));
        }
        self.kept += kept;
    }

    /// Adds all of some items.
    pub fn extend(&mut self, items: &[u32]) {
        self.add(items.len(), items.iter().copied(), |_| true);
    }

    /// Keeps those items for which `is_kept` holds.
    #[inline]
    pub fn retain(&mut self, mut is_kept: impl FnMut(u32) -> bool) {
        let slots = &mut self.slots[..self.kept];
        let mut kept = 0;
        for at in 0..slots.len() {
            let item = slots[at];
            slots[kept] = item;
            kept += usize::from(is_kept(item));
        }
        self.kept = kept;
    }

    /// The kept items.
    pub fn kept(&self) -> &[u32] {
        &self.slots[..self.kept]
    }

    /// The kept items, to be reordered.
    pub fn kept_mut(&mut self) -> &mut [u32] {
        &mut self.slots[..self.kept]
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_kept_stays_in_order() {
        let mut filter = Filter::default();
        for _ in 0..2 {
            filter.clear();
            filter.add(10, 0..10, |item| item % 2 == 0);
            filter.add(3, 10..100, |_| true);
            filter.add(0, 0..0, |_| true);
            filter.extend(&[7, 7]);
            assert_eq!(filter.kept(), [0, 2, 4, 6, 8, 10, 11, 12, 7, 7]);
            filter.retain(|item| item > 6);
            assert_eq!(filter.kept(), [8, 10, 11, 12, 7, 7]);
            filter.retain(|_| false);
            assert!(filter.kept().is_empty());
        }
    }
}
