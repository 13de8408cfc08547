//! The internal order of the faces: component by component, each along a Morton curve through the centroids, so that
//! faces that are close in space are close in memory. Labels go back to upload order at the end.

use glam::DVec3;
use rayon::prelude::*;

use super::components::Components;
use super::lattice::round_centroid;

/// Bits of a Morton key an axis: cells of 2¹² lattice units, ~65,000 along the longest side.
const BITS: u32 = 16;

/// Upload faces in the order of the Morton keys of their centroids, those with equal keys by number.
pub fn along_curve(faces: usize, centroid: impl Fn(usize) -> DVec3 + Sync) -> Vec<u32> {
    let keyed = |face: usize| (key(round_centroid(centroid(face))), face as u32);
    let mut keyed: Vec<(u64, u32)> = (0..faces).into_par_iter().map(keyed).collect();
    keyed.par_sort_unstable();
    keyed.into_iter().map(|(_, face)| face).collect()
}

/// The upload face that each internal face is: the order along the curve, component by component.
pub fn by_component(mut sorted: Vec<u32>, components: &Components) -> Vec<u32> {
    if components.count > 1 {
        sorted.par_sort_by_key(|&face| components.of_face[face as usize]);
    }
    sorted
}

/// The internal face that each upload face is, from the upload face that each internal face is.
pub fn inverse(upload_face: &[u32]) -> Vec<u32> {
    let mut internal = vec![0; upload_face.len()];
    for (face, &upload) in upload_face.iter().enumerate() {
        internal[upload as usize] = face as u32;
    }
    internal
}

/// Interleaved upper bits of the lattice coordinates, x lowest.
fn key(centroid: [i32; 3]) -> u64 {
    let [x, y, z] = centroid.map(|g| spread(((g + (1 << 27)) >> (28 - BITS)) as u64));
    x | y << 1 | z << 2
}

/// Puts two zero bits between any two of the lower 21 bits.
fn spread(x: u64) -> u64 {
    const STEPS: [(u32, u64); 5] = [
        (32, 0x001f_0000_0000_ffff),
        (16, 0x001f_0000_ff00_00ff),
        (8, 0x100f_00f0_0f00_f00f),
        (4, 0x10c3_0c30_c30c_30c3),
        (2, 0x1249_2492_4924_9249),
    ];
    STEPS.into_iter().fold(x, |x, (shift, mask)| (x | x << shift) & mask)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn keys_interleave_the_axes() {
        assert_eq!(spread(0b1011), 0b1_000_001_001);
        let cell = 4096;
        assert_eq!(key([cell, 0, 0]) ^ key([0; 3]), 1);
        assert_eq!(key([0, cell, 0]) ^ key([0; 3]), 2);
        assert_eq!(key([0, 0, cell]) ^ key([0; 3]), 4);
    }

    #[test]
    fn faces_come_by_key_and_then_by_number() {
        let mut state = 1u64;
        for shift in [37, 45, 53, 63] {
            let mut coordinate = || {
                state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
                f64::from((state >> 32) as i32 >> (shift - 32))
            };
            let centroids: Vec<DVec3> =
                (0..5000).map(|_| DVec3::new(coordinate(), coordinate(), coordinate())).collect();
            let mut expected: Vec<u32> = (0..5000).collect();
            expected.sort_by_key(|&face| key(round_centroid(centroids[face as usize])));
            assert_eq!(along_curve(5000, |face| centroids[face]), expected);
        }
    }
}
