//! The internal order of the faces: component by component, each along a Morton curve through the centroids, so that
//! faces that are close in space are close in memory. Labels go back to upload order at the end.

use rayon::prelude::*;

use super::lattice::FaceGeometry;

/// Bits of a Morton key an axis: cells of 2¹² lattice units, ~65,000 along the longest side.
const BITS: u32 = 16;

/// The upload face that each internal face is: sorted by component, Morton key, upload face.
pub fn internal_order(geometry: &[FaceGeometry], component_of_face: &[u32], components: usize) -> Vec<u32> {
    let mut keyed: Vec<(u64, u32)> =
        geometry.par_iter().enumerate().map(|(face, geometry)| (morton_key(geometry.centroid), face as u32)).collect();
    sort_by_key(&mut keyed);
    let sorted = keyed.into_iter().map(|(_, face)| face);
    if components <= 1 {
        return sorted.collect();
    }
    let mut next = vec![0u32; components + 1];
    for &component in component_of_face {
        next[component as usize + 1] += 1;
    }
    for component in 0..components {
        next[component + 1] += next[component];
    }
    let mut order = vec![0u32; geometry.len()];
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

/// Stable radix sort by the lower 3·[`BITS`] bits of the key.
pub fn sort_by_key(items: &mut Vec<(u64, u32)>) {
    const DIGIT: u32 = 12;
    let mut other = vec![(0u64, 0u32); items.len()];
    for pass in 0..(3 * BITS).div_ceil(DIGIT) {
        let digit = |key: u64| (key >> (pass * DIGIT)) as usize & ((1 << DIGIT) - 1);
        let mut next = vec![0usize; 1 << DIGIT];
        for &(key, _) in items.iter() {
            next[digit(key)] += 1;
        }
        let mut start = 0;
        for slot in &mut next {
            start += std::mem::replace(slot, start);
        }
        for &item in items.iter() {
            let slot = &mut next[digit(item.0)];
            other[*slot] = item;
            *slot += 1;
        }
        std::mem::swap(items, &mut other);
    }
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
    fn radix_sort_is_the_stable_sort() {
        let mut state = 1u64;
        let mut items: Vec<(u64, u32)> = (0..5000)
            .map(|i| {
                state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
                (state >> (16 + 20 * (i % 3)), i)
            })
            .collect();
        let mut expected = items.clone();
        expected.sort_by_key(|item| item.0);
        sort_by_key(&mut items);
        assert_eq!(items, expected);
    }
}
