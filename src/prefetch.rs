//! Asking for memory before it is needed, where the program knows what it will look at next and the processor cannot guess: lists of
//! faces all over a mesh that is larger than its caches.

/// Asks for the item at a place; there may be none. Changes nothing but how long it takes.
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
