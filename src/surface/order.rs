//! The internal order of the faces: component by component, each along a Morton curve through the centroids, so that
//! faces that are close in space are close in memory. Labels go back to upload order at the end.

use glam::DVec3;
use rayon::prelude::*;

use super::components::Components;
use super::lattice::round_centroid;
use super::rows::Rows;
use crate::parallel;

/// Bits of a Morton key an axis: cells of 2¹² lattice units, ~65,000 along the longest side.
const BITS: u32 = 16;

/// Bits of a digit: a counter for each value fits the first cache.
const DIGIT_BITS: u32 = 11;
/// Bits of a record for the number of a face or vertex. The rest are three digits.
pub const NUMBER_BITS: u32 = 31;

/// With more faces than this, records have no more bits for their numbers than they need, and a fourth digit: by three,
/// half of 4 million faces share their cell with others and are sorted twice
/// (`benches/results/2026-11-28-two-cores/curve.md`).
const MANY_FACES: usize = 1 << 21;

/// Calls a function with each place in a list of faces and the centroid of the face there.
type Centroids<'a> = dyn Fn(&[u32], &mut dyn FnMut(usize, DVec3)) + Sync + 'a;

/// Upload faces in the order of the Morton keys of their centroids, those with equal keys by number. There are at most
/// 2³¹.
///
/// A record is 8 bytes, the first bits of the key and the face: with 33 bits of the key, a radix sort in three passes
/// takes them along the curve to 1/2048 of the longest side. Few faces of a surface share such a cell, and those few
/// are sorted by their whole keys.
pub fn along_curve(faces: usize, centroids: &Centroids<'_>) -> Vec<u32> {
    let number_bits = if faces > MANY_FACES { usize::BITS - (faces - 1).leading_zeros() } else { NUMBER_BITS };
    along_curve_by(faces, number_bits, centroids)
}

/// The same with so many bits of a record for the face; the rest are no more than a key has.
fn along_curve_by(faces: usize, number_bits: u32, centroids: &Centroids<'_>) -> Vec<u32> {
    const PIECE: usize = 256;
    let mut records = vec![0u64; faces];
    parallel::runs_mut(&mut records, parallel::LEAST, &|first, records| {
        for (first, records) in (first..).step_by(PIECE).zip(records.chunks_mut(PIECE)) {
            let faces: [u32; PIECE] = std::array::from_fn(|at| (first + at) as u32);
            centroids(&faces[..records.len()], &mut |at, centroid| {
                let prefix = key(round_centroid(centroid)) >> (3 * BITS + number_bits - u64::BITS);
                records[at] = prefix << number_bits | u64::from(faces[at]);
            });
        }
    });
    sort_by_prefix(&mut records, number_bits);
    let face = |record: u64| record as u32 & ((1 << number_bits) - 1);
    let is_same = |a: &u64, b: &u64| a >> number_bits == b >> number_bits;
    // pieces that end between cells
    let (mut pieces, mut rest) = (Vec::new(), &mut records[..]);
    while !rest.is_empty() {
        let mut end = parallel::LEAST.min(rest.len());
        while end < rest.len() && is_same(&rest[end - 1], &rest[end]) {
            end += 1;
        }
        let (piece, others) = rest.split_at_mut(end);
        pieces.push(piece);
        rest = others;
    }
    parallel::runs_mut(&mut pieces, 1, &|_, pieces| {
        let (mut faces, mut keyed) = (Vec::new(), Vec::new());
        let cells = pieces.iter_mut().flat_map(|piece| piece.chunk_by_mut(is_same));
        for run in cells.filter(|run| run.len() > 1) {
            faces.clear();
            faces.extend(run.iter().map(|&record| face(record)));
            keyed.clear();
            centroids(&faces, &mut |at, centroid| keyed.push((key(round_centroid(centroid)), faces[at])));
            keyed.sort_unstable();
            run.iter_mut().zip(&keyed).for_each(|(record, &(_, face))| *record = u64::from(face));
        }
    });
    drop(pieces);
    let mut sorted = vec![0; faces];
    parallel::runs_mut(&mut sorted, parallel::LEAST, &|first, run| {
        run.iter_mut().zip(&records[first..]).for_each(|(number, &record)| *number = face(record));
    });
    sorted
}

/// Sorts records, which are all different and come in the order of their numbers, by what is above the lower
/// `number_bits`, which hold the number.
///
/// Up to two threads do best with a stable radix sort by one; more sort the whole numbers, in the same order.
pub fn sort_by_prefix(records: &mut Vec<u64>, number_bits: u32) {
    if rayon::current_num_threads() > 2 {
        return records.par_sort_unstable();
    }
    let digits = (u64::BITS - number_bits).div_ceil(DIGIT_BITS);
    let digit = |record: u64, place: usize| {
        (record >> (number_bits + DIGIT_BITS * place as u32)) as usize & ((1 << DIGIT_BITS) - 1)
    };
    let mut next = vec![[0u32; 1 << DIGIT_BITS]; digits as usize];
    for &record in records.iter() {
        for (place, next) in next.iter_mut().enumerate() {
            next[digit(record, place)] += 1;
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

/// The upload face that each internal face is: the order along the curve, component by component. `sorted` has no
/// loose face.
pub fn by_component(sorted: Vec<u32>, components: &Components) -> Vec<u32> {
    if components.count <= 1 {
        return sorted;
    }
    let component_of: Vec<u32> = sorted.iter().map(|&face| components.of_face[face as usize]).collect();
    let mut faces = Rows::grouped(&component_of, components.count).items;
    faces.iter_mut().for_each(|face| *face = sorted[*face as usize]);
    faces
}

/// No internal face: of an upload face that takes no part in the clustering.
pub const NO_FACE: u32 = u32::MAX;

/// The internal face that each of `faces` upload faces is, or [`NO_FACE`], from the upload face that each internal face
/// is.
pub fn inverse(upload_face: &[u32], faces: usize) -> Vec<u32> {
    let mut internal = vec![NO_FACE; faces];
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
    STEPS.iter().fold(x, |x, &(shift, mask)| (x | x << shift) & mask)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::dev::random;

    #[test]
    fn keys_interleave_the_axes() {
        assert_eq!(spread(0b1011), 0b1_000_001_001);
        let cell = 4096;
        assert_eq!(key([cell, 0, 0]) ^ key([0; 3]), 1);
        assert_eq!(key([0, cell, 0]) ^ key([0; 3]), 2);
        assert_eq!(key([0, 0, cell]) ^ key([0; 3]), 4);
    }

    #[test]
    fn components_come_one_after_the_other_and_keep_the_order_of_their_faces() {
        let mut states = random(2);
        for count in [1, 2, 40] {
            let mut of_face: Vec<u32> = (0..500).map(|_| (states() >> 33) as u32 % count).collect();
            // one of a single face
            of_face.extend((count > 1).then_some(count));
            let sorted: Vec<u32> = (0..of_face.len() as u32).rev().collect();
            let mut expected = sorted.clone();
            expected.sort_by_key(|&face| of_face[face as usize]);
            let components = Components { count: of_face.iter().max().map_or(0, |&last| last as usize + 1), of_face };
            assert_eq!(by_component(sorted, &components), expected);
        }
    }

    #[test]
    fn faces_come_by_key_and_then_by_number() {
        let mut states = random(1);
        for shift in [37, 45, 53, 63] {
            let mut coordinate = || f64::from((states() >> 32) as i32 >> (shift - 32));
            let centroids: Vec<DVec3> =
                (0..5000).map(|_| DVec3::new(coordinate(), coordinate(), coordinate())).collect();
            let key = |face: u32| key(round_centroid(centroids[face as usize]));
            let mut expected: Vec<u32> = (0..5000).collect();
            expected.sort_by_key(|&face| key(face));
            let each = |faces: &[u32], visit: &mut dyn FnMut(usize, DVec3)| {
                faces.iter().enumerate().for_each(|(at, &face)| visit(at, centroids[face as usize]));
            };
            // there is a sort for few threads and one for many
            for (threads, bits) in [(1, NUMBER_BITS), (1, 22), (1, 16), (4, NUMBER_BITS), (4, 22)] {
                let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().expect("threads");
                let sorted = pool.install(|| along_curve_by(5000, bits, &each));
                assert_eq!(sorted, expected, "{threads} threads, {bits} bits");
            }
        }
    }
}
