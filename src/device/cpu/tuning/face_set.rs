//! A set of faces as one bit a face, gone through in the order of memory by all threads.

use std::iter;
use std::sync::atomic::{AtomicU64, Ordering::Relaxed};

use crate::parallel;

/// Words of 64 faces that a thread takes at least.
const WORDS: usize = 64;

/// Some of the faces of a graph.
#[derive(Debug)]
pub struct FaceSet(Vec<AtomicU64>);

impl FaceSet {
    /// None of `faces` faces.
    pub fn new(faces: usize) -> Self {
        Self(iter::repeat_with(AtomicU64::default).take(faces.div_ceil(64)).collect())
    }

    /// Adds a face.
    #[inline]
    pub fn insert(&mut self, face: u32) {
        *self.0[face as usize / 64].get_mut() |= 1 << (face % 64);
    }

    /// Takes a face out. Other threads may take out others at the same time.
    #[inline]
    pub fn remove(&self, face: u32) {
        self.0[face as usize / 64].fetch_and(!(1 << (face % 64)), Relaxed);
    }

    /// The faces of the set for which `is_kept` holds, ascending, and the size of the set. `is_kept` gets the face and
    /// its item; there is one item a face.
    pub fn filter<T: Sync>(&self, items: &[T], is_kept: impl Fn(u32, &T) -> bool + Sync) -> (Vec<u32>, usize) {
        let filtered = parallel::ranges(self.0.len(), WORDS, &|words| {
            let mut size = 0;
            let mut kept = Vec::with_capacity(64);
            for (word, items) in words.clone().zip(items[64 * words.start..].chunks(64)) {
                let bits = self.0[word].load(Relaxed);
                let first = (64 * word) as u32;
                size += bits.count_ones() as usize;
                for bit in ones(bits) {
                    parallel::push_if(&mut kept, first + bit, is_kept(first + bit, &items[bit as usize]));
                }
            }
            (kept, size)
        });
        let (kept, sizes): (Vec<_>, Vec<usize>) = filtered.into_iter().unzip();
        (parallel::joined(kept), sizes.iter().sum())
    }
}

/// The positions of the ones of a word, ascending.
#[inline]
fn ones(mut bits: u64) -> impl Iterator<Item = u32> {
    iter::from_fn(move || {
        let one = bits.trailing_zeros();
        bits &= bits.wrapping_sub(1);
        (one < 64).then_some(one)
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_set_has_what_was_inserted_and_not_removed() {
        let items: Vec<u32> = (0..10_000).map(|face| face % 5).collect();
        let mut set = FaceSet::new(items.len());
        (0..10_000).filter(|face| face % 3 == 0 || face % 64 == 63).for_each(|face| set.insert(face));
        set.remove(63);
        set.remove(9_999);
        let (kept, size) = set.filter(&items, |_, &item| item == 1);
        let all: Vec<u32> = (0..9_999).filter(|face| (face % 3 == 0 || face % 64 == 63) && *face != 63).collect();
        assert_eq!(size, all.len());
        assert_eq!(kept, all.into_iter().filter(|face| face % 5 == 1).collect::<Vec<_>>());
    }
}
