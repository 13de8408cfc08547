//! The internal order of the faces: component by component, each along a Morton curve through the centroids, so that
//! faces that are close in space are close in memory. Labels go back to upload order at the end.

use rayon::prelude::*;

/// Bits of a Morton key an axis: cells of 2¹² lattice units, ~65,000 along the longest side.
const BITS: u32 = 16;

/// Upper bits of a key that faces are sorted by first: three digits.
const PREFIX_BITS: u32 = 33;
/// Bits of a digit: a counter for each value fits the first cache.
const DIGIT_BITS: u32 = 11;
/// Bits of a face's number.
const FACE_BITS: u32 = 31;

/// Upload faces sorted by Morton key, those with equal keys by number. There are at most 2³¹.
///
/// A record is 8 bytes, the first 33 bits of the key and the face: a radix sort in three passes takes them along the
/// curve to 1/2048 of the longest side. Few faces of a surface share such a cell, and those few are sorted by their
/// whole keys. (Records of key and face, 16 bytes, and four passes took three times as long.)
pub fn along_curve(faces: usize, key: impl Fn(u32) -> u64 + Sync) -> Vec<u32> {
    let mut records: Vec<u64> = (0..faces as u32)
        .into_par_iter()
        .with_min_len(4096)
        .map(|face| key(face) >> (3 * BITS - PREFIX_BITS) << FACE_BITS | u64::from(face))
        .collect();
    sort_by_prefix(&mut records);
    let mut order: Vec<u32> = records.iter().map(|&record| record as u32 & ((1 << FACE_BITS) - 1)).collect();
    let mut first = 0;
    for run in records.chunk_by(|a, b| a >> FACE_BITS == b >> FACE_BITS) {
        if run.len() > 1 {
            order[first..first + run.len()].sort_by_cached_key(|&face| (key(face), face));
        }
        first += run.len();
    }
    order
}

/// Stable radix sort by what is above the number of the face.
fn sort_by_prefix(records: &mut Vec<u64>) {
    const DIGITS: usize = (PREFIX_BITS / DIGIT_BITS) as usize;
    let digit = |record: u64, place: usize| {
        (record >> (FACE_BITS + DIGIT_BITS * place as u32)) as usize & ((1 << DIGIT_BITS) - 1)
    };
    let mut next = vec![[0u32; 1 << DIGIT_BITS]; DIGITS];
    for &record in records.iter() {
        for place in 0..DIGITS {
            next[place][digit(record, place)] += 1;
        }
    }
    let mut other = vec![0u64; records.len()];
    for (place, next) in next.iter_mut().enumerate() {
        let mut end = 0;
        for slot in next.iter_mut() {
            end += std::mem::replace(slot, end);
        }
        for &record in records.iter() {
            let slot = &mut next[digit(record, place)];
            other[*slot as usize] = record;
            *slot += 1;
        }
        std::mem::swap(records, &mut other);
    }
}

/// The upload face that each internal face is: the order along the curve, component by component.
pub fn by_component(sorted: Vec<u32>, component_of_face: &[u32], components: usize) -> Vec<u32> {
    if components <= 1 {
        return sorted;
    }
    let mut next = vec![0u32; components + 1];
    for &component in component_of_face {
        next[component as usize + 1] += 1;
    }
    for component in 0..components {
        next[component + 1] += next[component];
    }
    let mut order = vec![0u32; sorted.len()];
    for face in sorted {
        let slot = &mut next[component_of_face[face as usize] as usize];
        order[*slot as usize] = face;
        *slot += 1;
    }
    order
}

/// Interleaved upper bits of the lattice coordinates, x lowest.
pub fn morton_key(centroid: [f64; 3]) -> u64 {
    let cell = super::lattice::round_centroid(centroid).map(|g| ((g + (1 << 27)) >> (28 - BITS)) as u64);
    spread(cell[0]) | spread(cell[1]) << 1 | spread(cell[2]) << 2
}

/// Puts two zero bits between any two of the lower 21 bits.
fn spread(mut x: u64) -> u64 {
    for (shift, mask) in [
        (32, 0x001f_0000_0000_ffff),
        (16, 0x001f_0000_ff00_00ff),
        (8, 0x100f_00f0_0f00_f00f),
        (4, 0x10c3_0c30_c30c_30c3),
        (2, 0x1249_2492_4924_9249),
    ] {
        x = (x | x << shift) & mask;
    }
    x
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn keys_interleave_the_axes() {
        assert_eq!(spread(0b1011), 0b1_000_001_001);
        let key = |x: f64, y: f64, z: f64| morton_key([x, y, z]);
        let cell = 4096.0;
        assert_eq!(key(cell, 0.0, 0.0) ^ key(0.0, 0.0, 0.0), 1);
        assert_eq!(key(0.0, cell, 0.0) ^ key(0.0, 0.0, 0.0), 2);
        assert_eq!(key(0.0, 0.0, cell) ^ key(0.0, 0.0, 0.0), 4);
    }

    #[test]
    fn faces_come_by_key_and_then_by_number() {
        let mut state = 1u64;
        for shift in [16, 36, 56, 64] {
            let keys: Vec<u64> = (0..5000)
                .map(|_| {
                    state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
                    state.checked_shr(shift).unwrap_or(0)
                })
                .collect();
            let mut expected: Vec<u32> = (0..5000).collect();
            expected.sort_by_key(|&face| keys[face as usize]);
            assert_eq!(along_curve(5000, |face| keys[face as usize]), expected);
        }
    }
}
