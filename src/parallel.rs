//! Work divided among the threads of rayon's pool: the one that it is called in, else the global one.
//!
//! Most of these functions are compiled once for each type of result. An iterator of rayon is compiled for each
//! closure, into some thirty functions: 1.9 of 8.6 MB of the engine in a debug build
//! (`benches/results/2026-11-30-two-cores/test-times.md`).

use std::ops::Range;
use std::sync::atomic::{AtomicBool, Ordering::Relaxed};
use std::sync::{Mutex, MutexGuard, PoisonError};

/// Numbers of the shortest range, where each takes few instructions.
pub const LEAST: usize = 1 << 12;

/// Ranges for each thread: threads that are done take those of others.
const RANGES_A_THREAD: usize = 8;

/// What `of` gives for ranges that make up `0..count`, in their order. Each but the last has at least `least` numbers,
/// and below two times that there is one. Where they end depends on the number of threads.
pub fn ranges<T: Send>(count: usize, least: usize, of: &(dyn Fn(Range<usize>) -> T + Sync)) -> Vec<T> {
    pieces(count, length(count, least), of)
}

/// The same for ranges of `length` numbers, whatever the number of threads; the last has what is left.
pub fn pieces<T: Send>(count: usize, length: usize, of: &(dyn Fn(Range<usize>) -> T + Sync)) -> Vec<T> {
    let range = |nth: usize| nth * length..count.min((nth + 1) * length);
    match count.div_ceil(length) {
        1 => vec![of(0..count)],
        ranges => {
            let results: Vec<Mutex<Option<T>>> = (0..ranges).map(|_| Mutex::default()).collect();
            each(0..ranges, &|nth| *lock(&results[nth]) = Some(of(range(nth))));
            results.iter().filter_map(|result| lock(result).take()).collect()
        }
    }
}

/// What `add` adds to lists for such ranges, as one list.
pub fn list<T: Send>(count: usize, least: usize, add: &(dyn Fn(Range<usize>, &mut Vec<T>) + Sync)) -> Vec<T> {
    let of = |range| {
        let mut list = Vec::new();
        add(range, &mut list);
        list
    };
    // the most frequent case by far is one of few numbers
    if length(count, least) >= count { of(0..count) } else { joined(ranges(count, least, &of)) }
}

/// What `of` gives for each number of `0..count`.
pub fn map<T: Send>(count: usize, least: usize, of: impl Fn(usize) -> T + Sync) -> Vec<T> {
    list(count, least, &|range, list| list.extend(range.map(&of)))
}

/// The numbers of `0..count` for which `is_wanted` holds.
pub fn filter(count: usize, least: usize, is_wanted: impl Fn(&u32) -> bool + Sync) -> Vec<u32> {
    list(count, least, &|range, list| {
        for number in range.start as u32..range.end as u32 {
            push_if(list, number, is_wanted(&number));
        }
    })
}

/// Appends an item if it is wanted. Where that follows no pattern, a branch would be mispredicted: the item is appended
/// and taken back.
#[inline]
pub fn push_if<T>(list: &mut Vec<T>, item: T, is_wanted: bool) {
    list.push(item);
    list.truncate(list.len() - usize::from(!is_wanted));
}

/// The first number of `0..count` for which `is_wanted` holds.
pub fn first(count: usize, least: usize, is_wanted: impl Fn(usize) -> bool + Sync) -> Option<usize> {
    ranges(count, least, &|mut range| range.find(|&number| is_wanted(number))).into_iter().flatten().next()
}

/// Whether `holds` says so of one of such ranges; others may be left out then.
pub fn any(count: usize, least: usize, holds: &(dyn Fn(Range<usize>) -> bool + Sync)) -> bool {
    let any = AtomicBool::new(false);
    ranges(count, least, &|range| {
        if !any.load(Relaxed) && holds(range) {
            any.store(true, Relaxed);
        }
    });
    any.into_inner()
}

/// The lists as one.
pub fn joined<T>(mut lists: Vec<Vec<T>>) -> Vec<T> {
    if lists.len() == 1 {
        return lists.swap_remove(0);
    }
    let mut all = Vec::with_capacity(lists.iter().map(Vec::len).sum());
    lists.into_iter().for_each(|list| all.extend(list));
    all
}

/// What `of` gives for runs that make up `items`, in their order, given the number of the first item of each, too. Each
/// but the last has at least `least` items.
pub fn runs_mut<I: Send, T: Send>(items: &mut [I], least: usize, of: &(dyn Fn(usize, &mut [I]) -> T + Sync)) -> Vec<T> {
    let length = length(items.len(), least);
    let runs: Vec<Mutex<&mut [I]>> = items.chunks_mut(length).map(Mutex::new).collect();
    pieces(runs.len(), 1, &|nth| of(nth.start * length, &mut lock(&runs[nth.start])))
}

/// Calls `of` with each number.
fn each(numbers: Range<usize>, of: &(dyn Fn(usize) + Sync)) {
    let middle = numbers.start.midpoint(numbers.end);
    match numbers.len() {
        0 => {}
        1 => of(numbers.start),
        _ => _ = rayon::join(|| each(numbers.start..middle, of), || each(middle..numbers.end, of)),
    }
}

/// What a panic leaves is not read.
fn lock<T>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}

fn length(count: usize, least: usize) -> usize {
    match rayon::current_num_threads() {
        threads if threads == 1 || count < 2 * least => count.max(1),
        threads => count.div_ceil(RANGES_A_THREAD * threads).max(least),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn all_numbers_are_there_in_their_order() {
        for threads in [1, 2, 5] {
            let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().expect("threads");
            for (count, least) in [(0, 1), (1, 1), (7, 10), (10, 10), (11, 10), (1000, 1), (1000, 300)] {
                let numbers: Vec<usize> = (0..count).collect();
                let ranges = pool.install(|| ranges(count, least, &|range| range));
                assert!(ranges.len() < 2 || ranges[..ranges.len() - 1].iter().all(|range| range.len() >= least));
                assert_eq!(ranges.into_iter().flatten().collect::<Vec<_>>(), numbers, "{threads} {least}");
                assert_eq!(pool.install(|| map(count, least, |number| number)), numbers);
                let even: Vec<u32> = (0..count as u32).filter(|number| number % 2 == 0).collect();
                assert_eq!(
                    pool.install(|| first(count, least, |number| number >= count / 2)),
                    (count > 0).then_some(count / 2)
                );
                assert_eq!(pool.install(|| filter(count, least, |number| number % 2 == 0)), even);
                for wanted in [0, count / 2, count] {
                    let found = pool.install(|| any(count, least, &|mut range| range.any(|number| number == wanted)));
                    assert_eq!(found, wanted < count);
                }
                let pieces: Vec<usize> = pool.install(|| pieces(count, least, &|range| range.len()));
                assert_eq!(pieces.len(), count.div_ceil(least));
                assert!(pieces.iter().rev().skip(1).all(|&piece| piece == least));
                let mut items = vec![0; count];
                pool.install(|| {
                    runs_mut(&mut items, least, &|first, run| {
                        (first..).zip(run).for_each(|(number, item)| *item += number);
                    });
                });
                assert_eq!(items, numbers);
            }
        }
    }
}
