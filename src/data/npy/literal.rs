//! Literals of Python, as far as headers of arrays have them.

/// Levels of brackets in brackets.
const DEEPEST: u32 = 8;
/// Values between two brackets. Arrays of NumPy have at most 64 dimensions.
const MOST_VALUES: usize = 64;

/// A value in a header.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Literal<'a> {
    /// A string without escapes.
    Text(&'a str),
    /// A whole number from 0 on.
    Number(u64),
    /// `True` or `False`.
    Truth(bool),
    /// Values in parentheses.
    Tuple(Vec<Literal<'a>>),
    /// Values in square brackets: the fields of a structure.
    List(Vec<Literal<'a>>),
    /// Pairs of a string and a value, in braces.
    Dictionary(Vec<(&'a str, Literal<'a>)>),
}

impl<'a> Literal<'a> {
    /// The literal that a text is; none where it is anything else.
    pub fn read(text: &'a str) -> Option<Self> {
        let mut rest = text;
        let literal = value(&mut rest, 0)?;
        rest.trim().is_empty().then_some(literal)
    }

    /// The value of a key, if this is a dictionary with it. The last one counts, as in Python.
    pub fn get(&self, key: &str) -> Option<&Self> {
        let Self::Dictionary(pairs) = self else { return None };
        pairs.iter().rev().find(|(name, _)| *name == key).map(|(_, value)| value)
    }
}

/// Takes a value from the front of a text.
fn value<'a>(rest: &mut &'a str, depth: u32) -> Option<Literal<'a>> {
    if depth > DEEPEST {
        return None;
    }
    *rest = rest.trim_start();
    let first = rest.chars().next()?;
    match first {
        '\'' | '"' => text(rest).map(Literal::Text),
        '0'..='9' => {
            let (digits, after) = rest.split_at(rest.bytes().take_while(u8::is_ascii_digit).count());
            *rest = after;
            digits.parse().ok().map(Literal::Number)
        }
        '(' => {
            let (values, has_comma) = values(rest, ')', |rest| value(rest, depth + 1))?;
            // parentheses around one value without a comma are no tuple
            (has_comma || values.len() != 1).then_some(Literal::Tuple(values))
        }
        '[' => values(rest, ']', |rest| value(rest, depth + 1)).map(|(values, _)| Literal::List(values)),
        '{' => {
            let pair = |rest: &mut &'a str| {
                *rest = rest.trim_start();
                let key = text(rest)?;
                *rest = rest.trim_start().strip_prefix(':')?;
                Some((key, value(rest, depth + 1)?))
            };
            values(rest, '}', pair).map(|(pairs, _)| Literal::Dictionary(pairs))
        }
        _ => [("True", true), ("False", false)].into_iter().find_map(|(word, truth)| {
            *rest = rest.strip_prefix(word)?;
            Some(Literal::Truth(truth))
        }),
    }
}

/// Takes a string from the front of a text.
fn text<'a>(rest: &mut &'a str) -> Option<&'a str> {
    let quote = rest.chars().next().filter(|first| "'\"".contains(*first))?;
    let (inside, after) = rest[1..].split_once(quote)?;
    *rest = after;
    (!inside.contains(['\\', '\n'])).then_some(inside)
}

/// Takes values between brackets from the front of a text, and whether a comma follows the last.
fn values<'a, T>(
    rest: &mut &'a str,
    close: char,
    mut one: impl FnMut(&mut &'a str) -> Option<T>,
) -> Option<(Vec<T>, bool)> {
    *rest = &rest[1..];
    let mut values = Vec::new();
    let mut ends_in_comma = false;
    loop {
        *rest = rest.trim_start();
        if let Some(after) = rest.strip_prefix(close) {
            *rest = after;
            return Some((values, ends_in_comma));
        }
        if values.len() == MOST_VALUES || (!values.is_empty() && !ends_in_comma) {
            return None;
        }
        values.push(one(rest)?);
        *rest = rest.trim_start();
        let after = rest.strip_prefix(',');
        ends_in_comma = after.is_some();
        *rest = after.unwrap_or(rest);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn literals_are_read_as_python_reads_them() {
        use Literal::{Dictionary, List, Number, Text, Truth, Tuple};
        for (text, expected) in [
            ("3", Number(3)),
            (" 'a' ", Text("a")),
            ("\"a'b\"", Text("a'b")),
            ("True", Truth(true)),
            ("()", Tuple(vec![])),
            ("( 3 ,)", Tuple(vec![Number(3)])),
            ("(3,4)", Tuple(vec![Number(3), Number(4)])),
            ("[('x', '<f4')]", List(vec![Tuple(vec![Text("x"), Text("<f4")])])),
            ("{'a': 1, 'b': False,}", Dictionary(vec![("a", Number(1)), ("b", Truth(false))])),
        ] {
            assert_eq!(Literal::read(text), Some(expected), "{text}");
        }
        let repeated = Literal::read("{'a': 1, 'a': 2}").expect("a dictionary");
        assert_eq!((repeated.get("a"), repeated.get("b")), (Some(&Number(2)), None));
        let deep = "(".repeat(60_000);
        let long = format!("({}", "1,".repeat(65));
        for text in [
            "",
            "(3)",
            "(,)",
            "(3 4)",
            "(3,,4)",
            "(3",
            "3)",
            "-1",
            "'a",
            "'a\\n'",
            "{1: 2}",
            "{'a' 1}",
            "None",
            "Trues",
            "18446744073709551616",
            "(3];",
            &deep,
            &long,
        ] {
            assert_eq!(Literal::read(text), None, "{text}");
        }
    }
}
