//! Query strings: every name known, none given twice.

use std::collections::HashSet;

use axum::extract::Query;
use axum::http::Uri;
use percent_encoding::percent_decode_str;
use serde::de::DeserializeOwned;
use tesserae_mesh::error::{Error, Quoted, Result, what_it_must_be};

/// Reads the query into `T`, which denies unknown fields. What is wrong is named.
pub(crate) fn read<T: DeserializeOwned>(uri: &Uri) -> Result<T> {
    names(uri.query().unwrap_or_default())?;
    Query::<T>::try_from_uri(uri).map(|Query(value)| value).map_err(|rejection| {
        let text = rejection.body_text();
        let text = text.strip_prefix("Failed to deserialize query string: ").unwrap_or(&text);
        Error::parameter(format_args!("the query string is not valid: {}", in_words(text, uri)))
    })
}

/// The error about one parameter with its value, in words of HTTP; others as they are.
fn in_words(text: &str, uri: &Uri) -> String {
    let found = text.split_once(": ").and_then(|(name, what)| {
        let must = what_it_must_be(what)?;
        let (value, _) = take(uri.query()?, name);
        Some(format!("{name} {must}, not {}", Quoted(&value?)))
    });
    found.unwrap_or_else(|| text.to_owned())
}

/// The names in a query string, in order. One that is there twice is refused.
pub(crate) fn names(query: &str) -> Result<Vec<String>> {
    let names: Vec<String> = pairs(query).map(|pair| decoded(pair.split('=').next().unwrap_or_default())).collect();
    let mut seen = HashSet::new();
    match names.iter().find(|name| !seen.insert(name.as_str())) {
        Some(name) => {
            Err(Error::parameter(format_args!("a parameter is given twice in the query string: {}", Quoted(name))))
        }
        None => Ok(names),
    }
}

/// The parameters of a query string, as they are written.
pub(crate) fn pairs(query: &str) -> impl Iterator<Item = &str> {
    query.split('&').filter(|pair| !pair.is_empty())
}

/// Takes the parameter `name` out of a query string: its value, and the rest.
pub(crate) fn take(query: &str, name: &str) -> (Option<String>, String) {
    let mut value = None;
    let mut rest = Vec::new();
    for pair in pairs(query) {
        let (key, text) = pair.split_once('=').unwrap_or((pair, ""));
        if decoded(key) == name {
            value = Some(decoded(text));
        } else {
            rest.push(pair);
        }
    }
    (value, rest.join("&"))
}

fn decoded(text: &str) -> String {
    percent_decode_str(&text.replace('+', " ")).decode_utf8_lossy().into_owned()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_name_given_twice_is_refused_however_it_is_written() {
        assert!(names("clusters=1&seed=2").is_ok());
        let error = names("clusters=1&%63lusters=2").expect_err("twice");
        assert!(error.message.contains("clusters"), "{error}");
    }

    #[test]
    fn a_value_of_the_wrong_kind_is_named_in_words_of_http() {
        #[derive(Debug, serde::Deserialize)]
        #[expect(dead_code, reason = "read only to fail")]
        struct Wanted {
            clusters: Option<u32>,
            density: Option<f64>,
            fast: Option<bool>,
        }
        for (query, expected) in [
            ("clusters=1e3", r#"clusters must be a whole number, not "1e3""#),
            ("clusters=", r#"clusters must be a whole number, not """#),
            ("fast=true&clusters=-7%0a", r#"clusters must be a whole number, not "-7\n""#),
            ("clusters=5000000000", r#"clusters must be a smaller number, not "5000000000""#),
            ("density=x", r#"density must be a number, not "x""#),
            ("fast=yes", r#"fast must be true or false, not "yes""#),
        ] {
            let error = read::<Wanted>(&format!("/?{query}").parse().expect("a URI")).expect_err(query);
            assert_eq!(error.message, format!("the query string is not valid: {expected}"));
        }
    }

    #[test]
    fn taking_one_leaves_the_others_as_they_were() {
        assert_eq!(take("a=%20&form%61t=ob+j&b", "format"), (Some("ob j".into()), "a=%20&b".into()));
        assert_eq!(take("", "format"), (None, String::new()));
    }
}
