//! Text of mesh files: lines, and the words and numbers in them.
//!
//! A line ends at a line feed; carriage returns that end lines by themselves are replaced first ([`with_line_feeds`]).
//! A word ends at white space.

use std::borrow::Cow;

use super::number;

/// The text with a line feed for every carriage return that ends a line by itself, be it in a file that has no line
/// feeds or in one put together from several.
pub fn with_line_feeds(text: &[u8]) -> Cow<'_, [u8]> {
    let after = || text.iter().skip(1).chain([&b'\n']);
    let is_alone = |(&byte, &after): (&u8, &u8)| byte == b'\r' && after != b'\n';
    if !text.contains(&b'\r') || !text.iter().zip(after()).any(is_alone) {
        return Cow::Borrowed(text);
    }
    let feed = |(byte, after)| if is_alone((byte, after)) { b'\n' } else { *byte };
    Cow::Owned(text.iter().zip(after()).map(feed).collect())
}

/// Offset of the first line end at or after `from`, or the length of the text.
#[inline]
pub fn line_end(text: &[u8], from: usize) -> usize {
    let rest = text.get(from..).unwrap_or_default();
    memchr::memchr(b'\n', rest).map_or(text.len(), |at| from + at)
}

/// The number of the line, from 1, that holds the byte at `offset`.
pub fn line_number(text: &[u8], offset: usize) -> u64 {
    let before = &text[..offset.min(text.len())];
    1 + before.iter().filter(|&&byte| byte == b'\n').count() as u64
}

/// Cuts the text into pieces of at least `size` bytes (the last may be shorter). Each but the first begins with a line
/// that `may_begin` allows.
pub fn pieces(text: &[u8], size: usize, may_begin: impl Fn(&[u8]) -> bool) -> Vec<&[u8]> {
    let mut pieces = Vec::with_capacity(text.len() / size + 1);
    let mut first = 0;
    while first < text.len() {
        let mut end = (first + size - 1).min(text.len());
        loop {
            end = text.len().min(line_end(text, end) + 1);
            if end == text.len() || may_begin(&text[end..]) {
                break;
            }
        }
        pieces.push(&text[first..end]);
        first = end;
    }
    pieces
}

/// Whether a byte separates words.
#[inline]
pub fn is_space(byte: u8) -> bool {
    matches!(byte, b' ' | b'\t'..=b'\r')
}

/// A place in a text that is read word by word.
#[derive(Debug, Clone, Copy)]
pub struct Words<'a> {
    /// The text.
    pub text: &'a [u8],
    /// Offset of the next byte.
    pub at: usize,
}

impl<'a> Words<'a> {
    /// The next byte; a line feed at the end of the text.
    #[inline]
    fn peek(&self) -> u8 {
        self.text.get(self.at).copied().unwrap_or(b'\n')
    }

    #[inline]
    fn rest(&self) -> &'a [u8] {
        self.text.get(self.at..).unwrap_or_default()
    }

    /// Moves to the next word of the line, or to the end of the line.
    #[inline]
    pub fn skip_blanks(&mut self) {
        while self.peek() != b'\n' && is_space(self.peek()) {
            self.at += 1;
        }
    }

    /// Moves to the next word, on this line or a later one, or to the end of the text.
    #[inline]
    pub fn skip_space(&mut self) {
        while self.at < self.text.len() && is_space(self.peek()) {
            self.at += 1;
        }
    }

    /// Whether no word follows on the line; blanks must have been skipped.
    #[inline]
    pub fn is_at_line_end(&self) -> bool {
        self.peek() == b'\n'
    }

    /// Whether nothing follows; white space must have been skipped.
    #[inline]
    pub fn is_at_end(&self) -> bool {
        self.at >= self.text.len()
    }

    /// Takes the word that begins here; empty at the end of a line.
    #[inline]
    pub fn word(&mut self) -> &'a [u8] {
        let first = self.at;
        while !is_space(self.peek()) {
            self.at += 1;
        }
        &self.text[first..self.at]
    }

    /// Takes what is left of the line.
    #[inline]
    pub fn line(&mut self) -> &'a [u8] {
        let end = line_end(self.text, self.at);
        let line = self.text.get(self.at..end).unwrap_or_default();
        self.at = self.text.len().min(end + 1);
        line
    }

    /// Takes the word that begins here if it is an integer, which saturates at ±2⁴⁰.
    #[inline]
    pub fn integer(&mut self) -> Option<i64> {
        let (value, length) = number::integer(self.rest())?;
        self.take(length).then_some(value)
    }

    /// Takes the word that begins here, a finite number.
    ///
    /// # Errors
    /// What is wrong with the word, which is not taken.
    #[inline]
    pub fn coordinate(&mut self) -> Result<f64, String> {
        if let Some((value, length)) = number::float(self.rest())
            && value.is_finite()
            && self.take(length)
        {
            return Ok(value);
        }
        Err(format!("a coordinate {}", number::complaint({ *self }.word())))
    }

    /// Takes a word of this length, if it ends there.
    #[inline]
    fn take(&mut self, length: usize) -> bool {
        let end = self.at + length;
        let is_whole = self.text.get(end).is_none_or(|&byte| is_space(byte));
        if is_whole {
            self.at = end;
        }
        is_whole
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn pieces_cover_the_text_and_begin_where_they_may() {
        let text = b"a 1\nb\n\na 2\n\n b\na";
        for size in 1..text.len() + 2 {
            let pieces = pieces(text, size, |line| line.starts_with(b"a"));
            assert_eq!(pieces.concat(), text);
            assert!(pieces[1..].iter().all(|piece| piece.starts_with(b"a")), "{pieces:?}");
            let (_, others) = pieces.split_last().expect("a piece");
            assert!(others.iter().all(|piece| piece.len() >= size));
        }
        assert!(pieces(b"", 10, |_| true).is_empty());
    }

    #[test]
    fn words_and_numbers_end_at_white_space() {
        let mut words = Words { text: b" 12\t-1.5e1 7x nan\r\nlast", at: 0 };
        words.skip_blanks();
        assert_eq!(words.integer(), Some(12));
        words.skip_blanks();
        assert_eq!(words.integer(), None);
        assert_eq!(words.coordinate(), Ok(-15.0));
        words.skip_blanks();
        assert_eq!(words.coordinate(), Err("a coordinate is not a number: \"7x\"".into()));
        assert_eq!(words.word(), b"7x");
        words.skip_blanks();
        assert_eq!(words.coordinate(), Err("a coordinate is not finite: \"nan\"".into()));
        assert_eq!(words.line(), b"nan\r");
        assert_eq!((words.word(), words.is_at_line_end(), words.is_at_end()), (&b"last"[..], true, true));
    }
}
