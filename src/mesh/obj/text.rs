//! Lines, continuations and comments: where statements begin and end, and where a file may be cut.
//!
//! A statement is a line; a backslash right before the end of the line joins the next one to it. A comment goes from
//! `#` to the end of its line and is never joined, so that a path in a comment cannot swallow the next vertex.

use crate::mesh::text::line_end;

/// A place in the text.
#[derive(Debug, Clone, Copy)]
pub struct Cursor<'a> {
    /// The text.
    pub text: &'a [u8],
    /// Offset of the next byte.
    pub at: usize,
}

/// Kinds of statements.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Keyword {
    /// `v`
    Vertex,
    /// `f`, or `fo` of older files.
    Face,
    /// `g`
    Group,
    /// `o`
    Object,
    /// `p` or `l`: points and lines.
    Element,
    /// `usemtl`
    Material,
    /// `curv`, `curv2` or `surf`
    FreeForm,
    /// Anything else, a comment or an empty line included.
    Other,
}

impl<'a> Cursor<'a> {
    /// The next byte; a line end at the end of the text.
    #[inline]
    pub fn peek(&self) -> u8 {
        self.text.get(self.at).copied().unwrap_or(b'\n')
    }

    /// The text that is left.
    #[inline]
    pub fn rest(&self) -> &'a [u8] {
        self.text.get(self.at..).unwrap_or_default()
    }

    /// Skips blanks and joined line ends.
    #[inline]
    pub fn skip_blanks(&mut self) {
        loop {
            match self.peek() {
                b' ' | b'\t' | b'\r' | 0x0b | 0x0c => self.at += 1,
                b'\\' => match joint(self.rest()) {
                    0 => return,
                    length => self.at += length,
                },
                _ => return,
            }
        }
    }

    /// Whether a token ends here.
    #[inline]
    pub fn at_boundary(&self) -> bool {
        match self.peek() {
            b' ' | b'\n' | b'\t' | b'\r' | 0x0b | 0x0c | b'#' => true,
            b'\\' => joint(self.rest()) > 0,
            _ => false,
        }
    }

    /// Whether the statement has no more tokens; blanks must have been skipped.
    #[inline]
    pub fn at_statement_end(&self) -> bool {
        matches!(self.peek(), b'\n' | b'#')
    }

    /// Reads the keyword that a statement begins with; blanks must have been skipped.
    #[inline]
    pub fn keyword(&mut self) -> Keyword {
        let (keyword, length) = match (self.peek(), self.text.get(self.at + 1)) {
            (b'v', Some(b' ')) => (Keyword::Vertex, 1),
            (b'f', Some(b' ')) => (Keyword::Face, 1),
            (b'v', Some(b'n' | b't')) => (Keyword::Other, 0),
            (b'v' | b'f' | b'g' | b'o' | b'p' | b'l' | b'c' | b's' | b'u', _) => self.rare_keyword(),
            _ => (Keyword::Other, 0),
        };
        self.at += length;
        keyword
    }

    fn rare_keyword(&self) -> (Keyword, usize) {
        let rest = self.rest();
        let known: [(&[u8], Keyword); 11] = [
            (b"v", Keyword::Vertex),
            (b"f", Keyword::Face),
            (b"fo", Keyword::Face),
            (b"g", Keyword::Group),
            (b"o", Keyword::Object),
            (b"p", Keyword::Element),
            (b"l", Keyword::Element),
            (b"usemtl", Keyword::Material),
            (b"curv", Keyword::FreeForm),
            (b"curv2", Keyword::FreeForm),
            (b"surf", Keyword::FreeForm),
        ];
        for (word, keyword) in known {
            let after = Cursor { at: self.at + word.len(), ..*self };
            if rest.starts_with(word) && after.at_boundary() {
                return (keyword, word.len());
            }
        }
        (Keyword::Other, 0)
    }

    /// Moves to the line after this one, joined or not.
    #[inline]
    pub fn skip_line(&mut self) {
        self.at = line_end(self.text, self.at) + 1;
    }

    /// Moves to the line after this one, joined or not, and returns what was left of this.
    pub fn line(&mut self) -> &'a [u8] {
        let first = self.at;
        self.skip_line();
        self.text.get(first..self.at - 1).unwrap_or_default()
    }

    /// Moves behind the statement and returns what was left of it, comment and line end excluded.
    #[inline]
    pub fn skip_statement(&mut self) -> &'a [u8] {
        let first = self.at;
        loop {
            let line = self.at;
            let end = line_end(self.text, line);
            self.at = end + 1;
            if let Some(comment) = comment(self.text, first, line..end) {
                return &self.text[first..comment];
            }
            if end == self.text.len() || !is_joined(&self.text[line..end]) {
                return self.text.get(first..end).unwrap_or_default();
            }
        }
    }

    /// The token that begins here.
    pub fn token(&self) -> &'a [u8] {
        let mut end = *self;
        while !end.at_boundary() {
            end.at += 1;
        }
        &self.text[self.at.min(end.at)..end.at]
    }
}

/// Where a comment begins in the line: at a `#` that follows a blank or begins the statement's rest.
fn comment(text: &[u8], first: usize, line: std::ops::Range<usize>) -> Option<usize> {
    line.into_iter().find(|&at| text[at] == b'#' && (at == first || text[at - 1].is_ascii_whitespace()))
}

/// Length of the joined line end that `text` begins with, 0 when it does not.
fn joint(text: &[u8]) -> usize {
    match text {
        [b'\\', b'\n', ..] => 2,
        [b'\\', b'\r', b'\n', ..] => 3,
        // at the end of the file there is nothing left to join
        [b'\\'] | [b'\\', b'\r'] => text.len(),
        _ => 0,
    }
}

/// Whether a line, given without its line end, is joined to the next.
fn is_joined(line: &[u8]) -> bool {
    line.ends_with(b"\\") || line.ends_with(b"\\\r")
}

/// Cuts the text into pieces of at least `size` bytes (the last may be shorter) that end where a statement ends.
pub fn split(text: &[u8], size: usize) -> Vec<&[u8]> {
    let mut pieces = Vec::with_capacity(text.len() / size + 1);
    let mut first = 0;
    while first < text.len() {
        let mut end = first + size;
        while end < text.len() {
            let line = line_end(text, end);
            end = line + 1;
            if !is_joined(&text[first..line]) {
                break;
            }
        }
        let end = end.min(text.len());
        pieces.push(&text[first..end]);
        first = end;
    }
    pieces
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn pieces_cover_the_text_and_keep_joined_lines_together() {
        let text = b"v 1 2 3\nf 1 \\\n2 \\\r\n3\r\n# c \\\nv 4 5 6\nv 7";
        for size in 1..text.len() + 2 {
            let pieces = split(text, size);
            assert_eq!(pieces.concat(), text);
            for piece in &pieces[..pieces.len() - 1] {
                assert!(piece.ends_with(b"\n") && !is_joined(&piece[..piece.len() - 1]));
            }
        }
    }

    #[test]
    fn statements_end_at_comments_and_unjoined_lines() {
        let mut cursor = Cursor { text: b" a b # c \\\nnext \\\nmore\nlast\\", at: 0 };
        assert_eq!(cursor.skip_statement(), b" a b ");
        assert_eq!(cursor.skip_statement(), b"next \\\nmore");
        assert_eq!(cursor.skip_statement(), b"last\\");
        assert_eq!(cursor.skip_statement(), b"");
    }
}
