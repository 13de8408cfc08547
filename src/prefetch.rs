//! Prefetching: loops that visit memory in an order that the processor cannot predict request what a later item needs.
//!
//! It pays where a list of faces or nodes is scattered over a mesh that is larger than the caches. It changes no
//! result.

/// Items between one stage of prefetching and the next. Half and twice as many differ by less than 4 % of a clustering
/// (`benches/results/2026-11-22-two-cores/ahead.md`).
const LOOKAHEAD: usize = 4;

/// The items of a slice, each with a view of those to come.
pub(crate) fn with_lookahead<T>(items: &[T]) -> impl Iterator<Item = (&T, Ahead<'_, T>)> {
    items.iter().enumerate().map(|(at, item)| (item, Ahead(&items[at..])))
}

/// The current item of a slice and those after it.
pub(crate) struct Ahead<'a, T>(&'a [T]);

impl<'a, T> Ahead<'a, T> {
    /// The item so many stages ahead, if there is one. A chain of reads is prefetched in stages: first what is found
    /// directly, one stage later what that points to.
    #[inline(always)]
    pub fn stage(&self, stages: usize) -> Option<&'a T> {
        self.0.get(stages * LOOKAHEAD)
    }
}

/// Requests the cache line of the item at an index, if there is one.
#[inline(always)]
#[cfg_attr(target_arch = "x86_64", expect(unsafe_code, reason = "the standard library has no safe way to say so"))]
pub(crate) fn prefetch<T>(items: &[T], at: usize) {
    #[cfg(target_arch = "x86_64")]
    if let Some(item) = items.get(at) {
        use std::arch::x86_64::{_MM_HINT_T0, _mm_prefetch};
        // SAFETY: x86-64 processors have the instruction, the address is that of an item, and a hint changes nothing.
        unsafe { _mm_prefetch::<_MM_HINT_T0>(std::ptr::from_ref(item).cast()) };
    }
    #[cfg(not(target_arch = "x86_64"))]
    let _ = (items, at);
}
