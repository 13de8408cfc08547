//! Lists of seeds as files: NumPy's `.npy` with integers, a JSON array, or text with numbers between white space or
//! commas.

use crate::data::npy;
use crate::error::{Error, Result, wrong_json_at};

/// The face numbers in a file, in its order.
pub fn parse(bytes: &[u8]) -> Result<Vec<u32>> {
    let listed = if bytes.starts_with(npy::MAGIC) {
        parse_npy(bytes)?
    } else {
        let text = std::str::from_utf8(bytes)
            .map_err(|_| Error::parameter("the list of seeds is neither .npy, JSON nor text"))?;
        match text.trim_start().starts_with('[') {
            true => serde_json::from_str(text).map_err(|error| {
                Error::parameter(format_args!(
                    "the list of seeds is no JSON array of numbers: {}",
                    wrong_json_at(&error)
                ))
            })?,
            false => parse_text(text)?,
        }
    };
    if listed.is_empty() {
        return Err(Error::parameter("the list of seeds is empty"));
    }
    Ok(listed)
}

fn parse_text(text: &str) -> Result<Vec<u32>> {
    text.split(|c: char| c.is_whitespace() || c == ',')
        .filter(|word| !word.is_empty())
        .enumerate()
        .map(|(seed, word)| {
            word.parse().map_err(|_| Error::parameter(format_args!("seed {seed} is no face number: {word:?}")))
        })
        .collect()
}

/// A one-dimensional array of little-endian integers of 4 or 8 bytes.
fn parse_npy(bytes: &[u8]) -> Result<Vec<u32>> {
    const KINDS: [&str; 4] = ["<i4", "<u4", "<i8", "<u8"];
    let array = npy::parse_flat(bytes, "list of seeds", &KINDS, "little-endian integers of 4 or 8 bytes")?;
    let wrong = |seed| Error::parameter(format_args!("seed {seed} is no face number, in the .npy list"));
    let numbers = array.whole_numbers().enumerate();
    numbers.map(|(seed, number)| u32::try_from(number).map_err(|_| wrong(seed))).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn npy(kind: &str, shape: &str, data: &[u8]) -> Vec<u8> {
        let header = format!("{{'descr': '{kind}', 'fortran_order': False, 'shape': {shape}, }}\n");
        let mut bytes = b"\x93NUMPY\x01\x00".to_vec();
        bytes.extend((header.len() as u16).to_le_bytes());
        bytes.extend(header.as_bytes());
        bytes.extend(data);
        bytes
    }

    #[test]
    fn the_three_forms_say_the_same() {
        assert_eq!(parse(b"5, 7\n9\n"), Ok(vec![5, 7, 9]));
        assert_eq!(parse(b" [5,7,9]"), Ok(vec![5, 7, 9]));
        assert_eq!(parse(&npy("<u4", "(3,)", &[5, 0, 0, 0, 7, 0, 0, 0, 9, 0, 0, 0])), Ok(vec![5, 7, 9]));
        assert_eq!(parse(&npy("<i8", "(1,)", &[5, 1, 0, 0, 0, 0, 0, 0])), Ok(vec![261]));
    }

    #[test]
    fn what_is_no_list_of_faces_is_refused() {
        for bytes in [
            &b""[..],
            b"[]",
            b"[1.5]",
            b"[-1]",
            b"1 two",
            b"\xff\xfe",
            b"\x93NUMPY",
            b"\x93NUMPY\x01\x00\xff\xff{}",
            &npy("<f8", "(1,)", &[0; 8]),
            &npy("<i4", "(1,)", &[255; 4]),
            &npy("<u8", "(1,)", &[255; 8]),
            &npy("<u4", "(2, 2)", &[0; 16]),
            &npy("<u4", "(1000000000000000000,)", &[0; 16]),
            &npy("<u4", "(3,)", &[0; 13]),
        ] {
            assert!(parse(bytes).is_err(), "{}", String::from_utf8_lossy(bytes));
        }
    }
}
