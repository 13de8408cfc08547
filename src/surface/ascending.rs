//! Short lists in ascending order, each number once.
//!
//! The neighbours of a group of faces are about six numbers in no order. Which of two is smaller follows no pattern: a
//! sort's branches are a fifth of those that are mispredicted in a clustering of the bunny at quality fast. [`append`]
//! has none.

use std::array::from_fn;

/// Longest list that is sorted without branches.
const FEW: usize = 8;

/// Above all numbers.
const NONE: i32 = i32::MAX;

/// Appends the numbers to `to`, ascending and each once, all but `without`. They are below 2³¹ − 1. The list is empty
/// afterwards.
pub fn append(to: &mut Vec<u32>, numbers: &mut Vec<u32>, without: u32) {
    let mut count = 0;
    for at in 0..numbers.len() {
        numbers[count] = numbers[at];
        count += usize::from(numbers[at] != without);
    }
    if count <= FEW {
        numbers.resize(numbers.len().max(FEW), 0);
        append_few(to, &from_fn(|at| if at < count { numbers[at] as i32 } else { NONE }));
    } else {
        numbers.truncate(count);
        numbers.sort_unstable();
        numbers.dedup();
        to.extend_from_slice(numbers);
    }
    numbers.clear();
}

/// Puts each number where as many are smaller: equal ones at one place, which leaves the next ones empty.
#[inline]
fn append_few(to: &mut Vec<u32>, numbers: &[i32; FEW]) {
    let mut sorted = [NONE; FEW];
    for (&smaller, &number) in smaller_in(numbers).iter().zip(numbers) {
        sorted[smaller as usize % FEW] = number;
    }
    let (mut kept, mut count) = ([0; FEW], 0);
    for number in sorted {
        kept[count % FEW] = number as u32;
        count += usize::from(number != NONE);
    }
    let first = to.len();
    to.extend_from_slice(&kept);
    to.truncate(first + count);
}

/// How many numbers are smaller than each. By itself, this becomes vector instructions.
#[inline(never)]
fn smaller_in(numbers: &[i32; FEW]) -> [i32; FEW] {
    let mut smaller = [0; FEW];
    for one in numbers {
        smaller = from_fn(|at| smaller[at] + i32::from(*one < numbers[at]));
    }
    smaller
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn lists_of_any_length_are_sorted() {
        let mut state = 1u64;
        for length in (0..40).cycle().take(2000) {
            let mut random = |below: u64| {
                state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
                ((state >> 33) % below) as u32
            };
            let without = random(12);
            let mut numbers: Vec<u32> = (0..length).map(|_| random(12)).collect();
            let mut expected: Vec<u32> = numbers.iter().copied().filter(|&number| number != without).collect();
            expected.sort_unstable();
            expected.dedup();
            let mut all = vec![7];
            append(&mut all, &mut numbers, without);
            assert_eq!(all, [&[7], &expected[..]].concat());
            assert!(numbers.is_empty());
        }
    }
}
