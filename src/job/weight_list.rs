//! Weights as files: NumPy's `.npy` with floats of 4 or 8 bytes.

use crate::data::npy;
use crate::error::{Error, Result};

/// The weights in a file, in its order; any floats, whether they make sense or not.
pub fn parse(bytes: &[u8]) -> Result<Vec<f64>> {
    check_head(bytes)?;
    let floats = "little-endian floats of 4 or 8 bytes";
    Ok(npy::parse_flat(bytes, "file of weights", &["<f4", "<f8"], floats)?.floats())
}

/// Refuses what does not begin as such a file does.
pub fn check_head(head: &[u8]) -> Result<()> {
    if !head.starts_with(npy::MAGIC) {
        return Err(Error::parameter("the weights must be a .npy file, as numpy.save writes it"));
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::artifacts::npy_header;

    #[test]
    fn floats_of_both_widths_are_read_and_nothing_else_is() {
        let file = |kind: &str, shape: &str, data: &[u8]| [&npy_header(kind, shape), data].concat();
        let narrow: Vec<u8> = [0.5f32, -1.0].iter().flat_map(|x| x.to_le_bytes()).collect();
        let wide: Vec<u8> = [0.5f64, f64::NAN].iter().flat_map(|x| x.to_le_bytes()).collect();
        assert_eq!(parse(&file("<f4", "(2,)", &narrow)), Ok(vec![0.5, -1.0]));
        assert_eq!(parse(&file("<f8", "(2,)", &wide)).map(|all| (all[0], all[1].is_nan())), Ok((0.5, true)));
        assert_eq!(parse(&file("<f8", "(0,)", &[])), Ok(vec![]));
        for (bytes, word) in [
            (b"1.0 2.0".to_vec(), ".npy"),
            (npy::MAGIC.to_vec(), "ends early"),
            (file("<i4", "(2,)", &narrow), "<i4"),
            (file(">f4", "(2,)", &narrow), ">f4"),
            (file("<f4", "(1, 2)", &narrow), "one dimension"),
            (file("<f4", "(3,)", &narrow), "should hold 3"),
        ] {
            let error = parse(&bytes).expect_err(word);
            assert!(error.message.contains(word), "{error}");
        }
    }
}
