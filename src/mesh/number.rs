//! Numbers in text, each rounded to the nearest f64 as if computed exactly.
//!
//! Nearly every coordinate in the wild has few enough digits that its digits and its power of ten are both exact f64;
//! one multiplication or division then rounds once, which is correct. The others go to the standard library.

use crate::error::Quoted;

/// 10⁰ … 10²², the powers of ten that are exact f64.
const POWERS: [f64; 23] = [
    1e0, 1e1, 1e2, 1e3, 1e4, 1e5, 1e6, 1e7, 1e8, 1e9, 1e10, 1e11, 1e12, 1e13, 1e14, 1e15, 1e16, 1e17, 1e18, 1e19, 1e20,
    1e21, 1e22,
];

/// Decimal digits that always fit a u64.
const DIGITS: usize = 19;

/// The decimal number that `text` begins with, and its length in bytes; none where there is no number.
///
/// Magnitudes beyond f64 give infinity.
#[inline]
pub fn float(text: &[u8]) -> Option<(f64, usize)> {
    let negative = text.first() == Some(&b'-');
    let mut at = usize::from(negative || text.first() == Some(&b'+'));
    let mut mantissa = 0u64;
    let first = at;
    at = digits(text, at, &mut mantissa);
    let mut count = at - first;
    let mut exponent = 0i64;
    if text.get(at) == Some(&b'.') {
        let first = at + 1;
        at = digits(text, first, &mut mantissa);
        count += at - first;
        exponent = -((at - first) as i64);
    }
    if count == 0 {
        return None;
    }
    if let Some(b'e' | b'E') = text.get(at) {
        let (power, end) = power(text, at + 1)?;
        exponent += power;
        at = end;
    }
    let value = if count <= DIGITS && mantissa <= 1 << 53 && exponent.abs() < POWERS.len() as i64 {
        let power = POWERS[exponent.unsigned_abs() as usize];
        let magnitude = if exponent < 0 { mantissa as f64 / power } else { mantissa as f64 * power };
        if negative { -magnitude } else { magnitude }
    } else {
        std::str::from_utf8(&text[..at]).ok()?.parse().ok()?
    };
    Some((value, at))
}

/// Appends the digits at `at` to `mantissa`, which wraps around after [`DIGITS`] of them, and returns where they end.
#[inline]
fn digits(text: &[u8], mut at: usize, mantissa: &mut u64) -> usize {
    while let Some(eight) = text.get(at..).and_then(|rest| rest.first_chunk()) {
        let (value, count) = leading_digits(*eight);
        *mantissa = mantissa.wrapping_mul(SCALES[count]).wrapping_add(value);
        at += count;
        if count < 8 {
            return at;
        }
    }
    while let Some(digit) = text.get(at).map(|byte| byte.wrapping_sub(b'0')).filter(|&digit| digit <= 9) {
        *mantissa = mantissa.wrapping_mul(10).wrapping_add(u64::from(digit));
        at += 1;
    }
    at
}

/// 10⁰ … 10⁸.
const SCALES: [u64; 9] = [1, 10, 100, 1000, 10_000, 100_000, 1_000_000, 10_000_000, 100_000_000];

/// The number that the digits at the beginning of `text` make, and how many they are. All eight bytes at once: first
/// the bytes that are no digits are marked, then pairs are added up, then pairs of pairs.
#[inline]
fn leading_digits(text: [u8; 8]) -> (u64, usize) {
    const EACH: u64 = 0x0101_0101_0101_0101;
    let values = u64::from_le_bytes(text) ^ (EACH * u64::from(b'0'));
    // a carry can only spoil bytes behind the first that is no digit
    let others = (values.wrapping_add(EACH * 0x76) | values) & (EACH * 0x80);
    let count = others.trailing_zeros() as usize / 8;
    // the digits move to the end, and zeros come before them
    let values = values.checked_shl(64 - 8 * count as u32).unwrap_or(0);
    let pairs = values.wrapping_mul(10).wrapping_add(values >> 8);
    let even = (pairs & 0x0000_00ff_0000_00ff).wrapping_mul(100 + (1_000_000 << 32));
    let odd = (pairs >> 16 & 0x0000_00ff_0000_00ff).wrapping_mul(1 + (10_000 << 32));
    (even.wrapping_add(odd) >> 32, count)
}

/// The power of ten at `at`, behind the `e`, and where it ends. Beyond a million it is not exact, nor need it be.
fn power(text: &[u8], at: usize) -> Option<(i64, usize)> {
    let negative = text.get(at) == Some(&b'-');
    let first = at + usize::from(negative || text.get(at) == Some(&b'+'));
    let mut value = 0i64;
    let mut end = first;
    while let Some(digit) = text.get(end).filter(|byte| byte.is_ascii_digit()) {
        value = (10 * value + i64::from(digit - b'0')).min(1_000_000);
        end += 1;
    }
    (end > first).then_some((if negative { -value } else { value }, end))
}

/// The integer that `text` begins with, and its length in bytes; none where there is none. Saturates at ±2⁴⁰.
#[inline]
pub fn integer(text: &[u8]) -> Option<(i64, usize)> {
    let negative = text.first() == Some(&b'-');
    let first = usize::from(negative || text.first() == Some(&b'+'));
    if let Some(eight) = text.get(first..).and_then(|rest| rest.first_chunk()) {
        let (value, count) = leading_digits(*eight);
        if (1..8).contains(&count) {
            let value = value as i64;
            return Some((if negative { -value } else { value }, first + count));
        }
    }
    let mut value = 0i64;
    let mut at = first;
    while let Some(byte) = text.get(at) {
        let digit = byte.wrapping_sub(b'0');
        if digit > 9 {
            break;
        }
        value = 10 * value + i64::from(digit);
        if value > 1 << 40 {
            value = 1 << 40;
        }
        at += 1;
    }
    (at > first).then_some((if negative { -value } else { value }, at))
}

/// What is wrong with a word that is no finite number, for a message: `is not a number: "1e"`.
#[cold]
pub fn complaint(word: &[u8]) -> String {
    let text = String::from_utf8_lossy(word);
    let quoted = Quoted(&text);
    let plain = text.trim_matches(['+', '-']).to_ascii_lowercase();
    let is_number = float(plain.as_bytes()).is_some_and(|(_, length)| length == plain.len());
    if is_number || plain.starts_with("nan") || plain.starts_with("inf") {
        format!("is not finite: {quoted}")
    } else if plain.contains(',') {
        format!("is not a number, in which a point stands before the decimals: {quoted}")
    } else {
        format!("is not a number: {quoted}")
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    /// What the standard library, which rounds correctly, makes of the same text.
    fn check(text: &str) {
        let (value, length) = float(text.as_bytes()).unwrap_or_else(|| panic!("{text:?} is a number"));
        let expected: f64 = text.parse().expect("a number");
        assert_eq!(value.to_bits(), expected.to_bits(), "{text}");
        assert_eq!(length, text.len(), "{text}");
    }

    #[test]
    fn hard_numbers_are_correctly_rounded() {
        for text in [
            "0",
            "-0",
            "+0.0",
            "1",
            "-1.",
            ".5",
            "+.5",
            "-0.03782970",
            "1e5",
            "1E-5",
            "1.5e+3",
            "007",
            "1e22",
            "1e23",
            "9007199254740992",
            "9007199254740993",
            "9007199254740991e22",
            "9007199254740993e-22",
            "0.1234567890123456789",
            "12345678901234567890",
            "99999999999999999999999999999999999999",
            "1.7976931348623157e308",
            "1.7976931348623159e308",
            "1e309",
            "-1e999999999999999999999",
            "2.2250738585072014e-308",
            "2.2250738585072011e-308",
            "5e-324",
            "2.4703282292062327e-324",
            "2.4703282292062328e-324",
            "1e-400",
            "0e999999999",
            "0.000000000000000000000000000000000001",
            // halfway between two doubles, and just beside
            "1.00000000000000011102230246251565404236316680908203125",
            "1.00000000000000011102230246251565404236316680908203124",
            "1.00000000000000011102230246251565404236316680908203126",
            "9007199254740992.5",
            "9007199254740993.0",
            "18014398509481986",
            "36028797018963972",
            "18446744073709551615",
            "18446744073709551616",
            "9999999999999999999",
            "10000000000000000000",
        ] {
            check(text);
        }
    }

    #[test]
    fn what_is_no_number_is_refused() {
        for text in ["", "-", "+", ".", "-.", "e5", "1e", "1e+", "nan", "inf", "x", "--1", "/"] {
            assert_eq!(float(text.as_bytes()), None, "{text:?}");
        }
        for text in ["", "-", "+", "x", ".", "/1"] {
            assert_eq!(integer(text.as_bytes()), None, "{text:?}");
        }
    }

    #[test]
    fn digits_are_counted_up_to_the_first_other_byte() {
        for count in 0..=8 {
            for other in [b' ', b'\n', b'/', b':', b'.', 0, 0x80, 0xff, b'0' ^ 0x80] {
                let mut text = *b"98765432";
                text[count..].fill(other);
                let value = text[..count].iter().fold(0, |value, digit| 10 * value + u64::from(digit - b'0'));
                assert_eq!(leading_digits(text), (value, count), "{text:?}");
            }
        }
    }

    #[test]
    fn numbers_end_where_they_end() {
        assert_eq!(float(b"1.5 2"), Some((1.5, 3)));
        assert_eq!(float(b"1,5"), Some((1.0, 1)));
        assert_eq!(float(b"1.2.3"), Some((1.2, 3)));
        assert_eq!(integer(b"12/3"), Some((12, 2)));
        assert_eq!(integer(b"-7\n"), Some((-7, 2)));
        assert_eq!(integer(b"99999999999999999999"), Some((1 << 40, 20)));
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(20_000))]

        #[test]
        fn decimals_are_correctly_rounded(
            negative: bool,
            whole in "[0-9]{0,22}",
            fraction in "[0-9]{1,22}",
            exponent in prop::option::of(-340i32..320),
        ) {
            let sign = if negative { "-" } else { "" };
            let power = exponent.map(|e| format!("e{e}")).unwrap_or_default();
            check(&format!("{sign}{whole}.{fraction}{power}"));
        }

        #[test]
        fn doubles_survive_printing(bits: u64) {
            let value = f64::from_bits(bits);
            if value.is_finite() {
                check(&format!("{value:e}"));
                check(&format!("{value}"));
            }
        }

        /// The exact midpoint of two neighbouring doubles, where a wrong rounding shows.
        #[test]
        fn halfway_cases_go_to_even(mantissa in (1u64 << 52)..(1u64 << 53), shift in 1u32..10) {
            let midpoint = (u128::from(mantissa) * 2 + 1) << shift;
            for text in [format!("{midpoint}"), format!("{}", midpoint - 1), format!("{}", midpoint + 1)] {
                check(&text);
            }
        }

        #[test]
        fn any_bytes_are_safe(text: Vec<u8>) {
            if let Some((_, length)) = float(&text) {
                prop_assert!(length <= text.len());
            }
            if let Some((_, length)) = integer(&text) {
                prop_assert!(length <= text.len());
            }
        }
    }
}
