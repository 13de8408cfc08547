//! Text of messages: one line, bounded, and without characters that a terminal or a log would obey.
//!
//! Names in a mesh are under the control of its author. A line feed in one would forge a line of the log, an escape
//! sequence would reach the terminal, and a direction override would show the line in another order.

use std::fmt::{self, Display, Write};

/// Characters of a string of the input that a message shows.
const LONGEST_QUOTE: usize = 200;

/// A string of the input in a message: in quotes, escaped, and cut after 200 characters.
///
/// What is cut is replaced by an ellipsis, and the length in bytes follows: `"abc…" (1000000 bytes)`.
#[derive(Debug, Clone, Copy)]
pub struct Quoted<'a>(pub &'a str);

impl Display for Quoted<'_> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_char('"')?;
        let mut is_cut = false;
        for (shown, char) in self.0.chars().enumerate() {
            is_cut = shown == LONGEST_QUOTE;
            if is_cut {
                f.write_char('…')?;
                break;
            }
            match char {
                '"' | '\\' => write!(f, "\\{char}")?,
                '\n' => f.write_str("\\n")?,
                '\r' => f.write_str("\\r")?,
                '\t' => f.write_str("\\t")?,
                _ if is_obeyed(char) => write!(f, "{}", char.escape_unicode())?,
                _ => f.write_char(char)?,
            }
        }
        f.write_char('"')?;
        if is_cut { write!(f, " ({} bytes)", self.0.len()) } else { Ok(()) }
    }
}

/// The message of another library, which may quote the input: on one line, and cut after 200 characters.
#[derive(Debug, Clone, Copy)]
pub struct Brief<T>(pub T);

impl<T: Display> Display for Brief<T> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(&one_line(&self.0, LONGEST_QUOTE))
    }
}

/// The text on one line, of at most `most` characters and the ellipsis that stands for the others.
pub(super) fn one_line(text: &dyn Display, most: usize) -> String {
    let mut line = Line { text: String::new(), left: most, bytes: 0, is_cut: false };
    // a `Display` that fails has no more text
    let _ = write!(line, "{text}");
    if line.is_cut {
        let _ = write!(line.text, "… ({} bytes)", line.bytes);
    }
    line.text
}

/// A line as it is written. What is cut is counted and not kept, so a long text takes no memory.
struct Line {
    text: String,
    /// Characters that may still be added.
    left: usize,
    /// Bytes written so far.
    bytes: usize,
    is_cut: bool,
}

impl Write for Line {
    fn write_str(&mut self, text: &str) -> fmt::Result {
        self.bytes += text.len();
        for char in text.chars() {
            if self.left == 0 {
                self.is_cut = true;
                break;
            }
            self.left -= 1;
            match char {
                '\n' | '\r' | '\t' => self.text.push(' '),
                _ if is_obeyed(char) => self.text.extend(char.escape_unicode()),
                _ => self.text.push(char),
            }
        }
        Ok(())
    }
}

/// Whether a terminal or a viewer of logs acts on the character instead of showing it: control characters, separators
/// of lines and paragraphs, direction overrides, and characters without width.
fn is_obeyed(char: char) -> bool {
    char.is_control()
        || matches!(
            char,
            '\u{61c}' | '\u{200b}'..='\u{200f}' | '\u{2028}'..='\u{202e}' | '\u{2060}'..='\u{206f}' | '\u{feff}'
                | '\u{fff9}'..='\u{fffb}' | '\u{e0000}'..='\u{e007f}'
        )
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::error::{Error, Kind, LONGEST_MESSAGE};

    /// Everything that a message must not hold.
    const HOSTILE: &str =
        "a\n\r\t\0\u{1b}[31m\u{7f}\u{85}\u{9b}\u{2028}\u{2029}\u{202e}\u{2066}\u{200e}\u{61c}\u{feff}b";

    fn is_plain(text: &str) -> bool {
        !text.chars().any(is_obeyed)
    }

    #[test]
    fn quoted_strings_are_escaped_and_cut() {
        assert_eq!(Quoted("a \"b\" \\ ü").to_string(), r#""a \"b\" \\ ü""#);
        let hostile = Quoted(HOSTILE).to_string();
        assert!(is_plain(&hostile) && hostile.starts_with(r#""a\n\r\t\u{0}\u{1b}[31m"#), "{hostile}");
        assert_eq!(Quoted(&"x".repeat(200)).to_string(), format!("\"{}\"", "x".repeat(200)));
        assert_eq!(Quoted(&"ü".repeat(201)).to_string(), format!("\"{}…\" (402 bytes)", "ü".repeat(200)));
    }

    #[test]
    fn no_error_has_control_characters_or_a_long_message() {
        for message in [HOSTILE.to_owned(), HOSTILE.repeat(100_000), "x".repeat(1 << 20)] {
            let error = Error::new(Kind::InvalidMesh, &message);
            assert!(is_plain(&error.message), "{error}");
            let wrapped = Error::new(Kind::InvalidMesh, format_args!("buffer 0: {error}"));
            assert!(is_plain(&wrapped.message) && wrapped.message.chars().count() < 9 * LONGEST_MESSAGE, "{wrapped}");
        }
        assert_eq!(Error::mesh("a\nb\u{1b}c").message, "a b\\u{1b}c");
        let exact = "ü".repeat(LONGEST_MESSAGE);
        assert_eq!(Error::mesh(&exact).message, exact);
        assert_eq!(Error::mesh(format!("{exact}x")).message, format!("{exact}… ({} bytes)", exact.len() + 1));
    }

    #[test]
    fn messages_of_libraries_are_brief() {
        assert_eq!(Brief("a\nb").to_string(), "a b");
        assert_eq!(Brief("x".repeat(201)).to_string(), format!("{}… (201 bytes)", "x".repeat(200)));
    }
}
