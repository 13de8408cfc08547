//! Labels from a file: `.npy` with whole numbers, one a face.

use crate::data::npy;
use crate::error::{Error, Result};

/// The labels in a file, one for each of `faces` faces, and the number of clusters: one more than the largest label.
///
/// Labels are below the number of faces, as those of clusters without a gap are, so that no table of clusters is out of
/// proportion to the mesh.
pub fn parse(bytes: &[u8], faces: usize) -> Result<(Vec<u32>, u64)> {
    if !bytes.starts_with(npy::MAGIC) {
        return Err(Error::parameter("the labels must be a .npy file, as --labels OUT.npy and numpy.save write it"));
    }
    let kinds = ["<u4", "<i4", "<u8", "<i8"];
    let array = npy::parse_flat(bytes, "file of labels", &kinds, "little-endian whole numbers of 4 or 8 bytes")?;
    let numbers: Vec<i64> = array.whole_numbers().collect();
    if numbers.len() != faces {
        return Err(Error::parameter(format_args!(
            "the mesh has {faces} faces, so there must be as many labels: {}",
            numbers.len()
        )));
    }
    let wrong = numbers.iter().position(|number| !(0..faces as i64).contains(number));
    if let Some(face) = wrong {
        return Err(Error::parameter(format_args!(
            "labels must be from 0 to {}, one less than the number of faces; that of face {face} is {}",
            faces - 1,
            numbers[face]
        )));
    }
    let labels: Vec<u32> = numbers.into_iter().map(|number| number as u32).collect();
    let clusters = labels.iter().max().map_or(0, |&label| u64::from(label) + 1);
    Ok((labels, clusters))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::artifacts::npy_header;

    #[test]
    fn labels_of_every_width_are_read_and_counted() {
        let file = |kind: &str, data: &[u8], count| [&npy_header(kind, &format!("({count},)")), data].concat();
        let narrow: Vec<u8> = [2u32, 0, 2].iter().flat_map(|x| x.to_le_bytes()).collect();
        let wide: Vec<u8> = [2i64, 0, 2].iter().flat_map(|x| x.to_le_bytes()).collect();
        for (kind, data) in [("<u4", &narrow), ("<i4", &narrow), ("<u8", &wide), ("<i8", &wide)] {
            assert_eq!(parse(&file(kind, data, 3), 3), Ok((vec![2, 0, 2], 3)), "{kind}");
        }
        let negative: Vec<u8> = [0i64, -1].iter().flat_map(|x| x.to_le_bytes()).collect();
        for (bytes, faces, words) in [
            (file("<u4", &narrow, 3), 4, "4 faces"),
            (file("<u4", &narrow, 3), 2, "2 faces"),
            (file("<i8", &negative, 2), 2, "face 1 is -1"),
            (file("<u4", &[9, 0, 0, 0], 1), 1, "face 0 is 9"),
            (file("<f4", &[0; 4], 1), 1, "whole numbers"),
            (b"[0, 1]".to_vec(), 2, ".npy"),
        ] {
            let error = parse(&bytes, faces).expect_err(words);
            assert!(error.message.contains(words), "{error}");
        }
    }
}
