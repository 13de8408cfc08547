//! Errors of the standard library about numbers in text, in words for the person who wrote the text.

/// What a value must be, for such an error.
const WORDS: [(&str, &str); 8] = [
    ("invalid digit found in string", "must be a whole number"),
    ("cannot parse integer from empty string", "must be a whole number"),
    ("number too large to fit in target type", "must be a smaller number"),
    ("number too small to fit in target type", "must be a larger number"),
    ("number would be zero for non-zero type", "must be 1 or more"),
    ("invalid float literal", "must be a number"),
    ("cannot parse float from empty string", "must be a number"),
    ("provided string was not `true` or `false`", "must be true or false"),
];

/// What a value must be that the standard library refused with this error; None for other errors.
pub fn what_it_must_be(error: &str) -> Option<&'static str> {
    WORDS.iter().find(|(rust, _)| *rust == error).map(|&(_, must)| must)
}
