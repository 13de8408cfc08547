//! Errors of JSON in words of JSON: serde's speak of Rust's types.

use std::fmt::Write as _;

/// Names of Rust, and what they are in JSON.
const NAMES: [(&str, &str); 13] = [
    ("map", "object"),
    ("sequence", "array"),
    ("boolean `", "`"),
    ("integer `", "`"),
    ("floating point `", "`"),
    ("string \"", "\""),
    ("a sequence", "an array"),
    ("a map", "an object"),
    ("a nonzero u32", "an integer from 1 to 4294967295"),
    ("u32", "an integer from 0 to 4294967295"),
    ("u64", "an integer from 0 on"),
    ("f32", "a number"),
    ("f64", "a number"),
];

/// What is wrong, without the place: `must be an array, not an object`.
pub fn wrong_json(error: &serde_json::Error) -> String {
    let text = error.to_string();
    let place = format!(" at line {} column {}", error.line(), error.column());
    let text = text.strip_suffix(&place).unwrap_or(&text);
    let value = text.strip_prefix("invalid type: ").or_else(|| text.strip_prefix("invalid value: "));
    // from behind: what was found may be any string
    if let Some((found, expected)) = value.and_then(|value| value.rsplit_once(", expected ")) {
        return format!("must be {}, not {}", named(expected), named(found)).replace('`', "");
    }
    let quoted = text.replace('`', "\"");
    let names = [("unknown variant ", ", expected ", "must be "), ("unknown field ", ", expected ", "must have no ")];
    for (start, middle, must) in names {
        let Some((found, expected)) = quoted.strip_prefix(start).and_then(|rest| rest.rsplit_once(middle)) else {
            continue;
        };
        let expected = expected.trim_start_matches("one of ");
        return match must {
            "must be " => format!("must be one of {expected}, not {found}"),
            _ => format!("{must}member {found}, but may have {expected}"),
        };
    }
    for (start, end) in [("missing field ", "is missing"), ("duplicate field ", "is given twice")] {
        if let Some(name) = quoted.strip_prefix(start) {
            return format!("member {name} {end}");
        }
    }
    text.to_owned()
}

/// The same with line and column, where the error has them.
pub fn wrong_json_at(error: &serde_json::Error) -> String {
    let mut text = wrong_json(error);
    if error.line() > 0 {
        // writing to a string does not fail
        let _ = write!(text, ", at line {}, column {}", error.line(), error.column());
    }
    text
}

fn named(words: &str) -> String {
    for (rust, json) in NAMES {
        if let Some(rest) = words.strip_prefix(rust).filter(|rest| rest.is_empty() || rust.ends_with(['`', '"'])) {
            return format!("{json}{rest}");
        }
    }
    words.to_owned()
}

#[cfg(test)]
mod tests {
    use serde::Deserialize;

    use super::*;

    #[derive(Debug, Deserialize)]
    #[serde(rename_all = "lowercase")]
    enum Way {
        Up,
        Down,
    }

    #[derive(Debug, Deserialize)]
    #[serde(deny_unknown_fields)]
    struct Step {
        #[expect(dead_code, reason = "read only to fail")]
        way: Way,
        #[serde(default)]
        #[expect(dead_code, reason = "read only to fail")]
        lengths: Vec<u32>,
    }

    #[test]
    fn errors_are_told_in_the_words_of_json() {
        for (json, expected) in [
            (r#"{"way": "up", "lengths": {}}"#, "must be an array, not object, at line 1, column 25"),
            (
                r#"{"way": "up", "lengths": [-1]}"#,
                "must be an integer from 0 to 4294967295, not -1, at line 1, column 28",
            ),
            (r#"{"way": "left"}"#, r#"must be one of "up" or "down", not "left", at line 1, column 14"#),
            (r#"{"wey": 1}"#, r#"must have no member "wey", but may have "way" or "lengths", at line 1, column 6"#),
            ("{}", r#"member "way" is missing, at line 1, column 2"#),
            (r#"{"way": "up", "way": "up"}"#, r#"member "way" is given twice, at line 1, column 19"#),
        ] {
            let error = serde_json::from_str::<Step>(json).expect_err(json);
            assert_eq!(wrong_json_at(&error), expected);
        }
        let error = serde_json::from_str::<f64>("[]").expect_err("no number");
        assert_eq!(wrong_json(&error), "must be a number, not array");
        let error = serde_json::from_str::<Way>("3").expect_err("no name");
        assert!(!wrong_json(&error).contains('`'), "{error}");
    }
}
