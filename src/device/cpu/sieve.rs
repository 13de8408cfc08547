//! Keeping some of many items where which ones follows no pattern: without a branch that depends on it, as mispredicted ones cost
//! more than all else that is done to an item.

/// The items that were kept, in the order in which they were offered.
#[derive(Debug, Default)]
pub struct Sieve {
    /// Those, and room for more.
    places: Vec<u32>,
    kept: usize,
}

impl Sieve {
    /// Keeps nothing; what comes next takes the same memory.
    pub fn clear(&mut self) {
        self.kept = 0;
    }

    /// Adds those of at most `most` items that `is_kept`.
    #[inline]
    pub fn add(&mut self, most: usize, items: impl Iterator<Item = u32>, mut is_kept: impl FnMut(u32) -> bool) {
        let room = self.kept + most;
        if self.places.len() < room {
            self.places.resize(room.max(2 * self.places.len()), 0);
        }
        let mut kept = 0;
        let places = &mut self.places[self.kept..][..most];
        for item in items.take(most) {
            places[kept] = item;
            kept += usize::from(is_kept(item));
        }
        self.kept += kept;
    }

    /// Adds all of some items.
    pub fn extend(&mut self, items: &[u32]) {
        self.add(items.len(), items.iter().copied(), |_| true);
    }

    /// Keeps of those that were kept the ones that `is_kept`.
    #[inline]
    pub fn retain(&mut self, mut is_kept: impl FnMut(u32) -> bool) {
        let places = &mut self.places[..self.kept];
        let mut kept = 0;
        for at in 0..places.len() {
            let item = places[at];
            places[kept] = item;
            kept += usize::from(is_kept(item));
        }
        self.kept = kept;
    }

    /// What was kept.
    pub fn kept(&self) -> &[u32] {
        &self.places[..self.kept]
    }

    /// The same, to be changed.
    pub fn kept_mut(&mut self) -> &mut [u32] {
        &mut self.places[..self.kept]
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_kept_stays_in_order() {
        let mut sieve = Sieve::default();
        for _ in 0..2 {
            sieve.clear();
            sieve.add(10, 0..10, |item| item % 2 == 0);
            sieve.add(3, 10..100, |_| true);
            sieve.add(0, 0..0, |_| true);
            sieve.extend(&[7, 7]);
            assert_eq!(sieve.kept(), [0, 2, 4, 6, 8, 10, 11, 12, 7, 7]);
            sieve.retain(|item| item > 6);
            assert_eq!(sieve.kept(), [8, 10, 11, 12, 7, 7]);
            sieve.retain(|_| false);
            assert!(sieve.kept().is_empty());
        }
    }
}
