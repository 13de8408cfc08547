//! Query strings: every name known, none given twice.

use std::collections::HashSet;

use axum::extract::Query;
use axum::http::Uri;
use form_urlencoded::Serializer;
use serde::de::DeserializeOwned;
use tesserae_mesh::error::{Error, Quoted, Result, what_it_must_be};

/// Reads the query into `T`, which denies unknown fields. What is wrong is named.
pub(crate) fn read<T: DeserializeOwned>(uri: &Uri) -> Result<T> {
    parse(&pairs(uri)?)
}

/// The same of parameters that were read before.
pub(crate) fn parse<T: DeserializeOwned>(pairs: &[(String, String)]) -> Result<T> {
    let wrong = |text: &str| Error::parameter(format_args!("the query string is not valid: {text}"));
    let query = Serializer::for_suffix("/?".to_owned(), 2).extend_pairs(pairs).finish();
    let uri = query.parse().map_err(|error| wrong(&format!("{error}")))?;
    Query::try_from_uri(&uri).map(|Query(value)| value).map_err(|rejection| {
        let text = rejection.body_text();
        let text = text.strip_prefix("Failed to deserialize query string: ").unwrap_or(&text);
        // about one parameter with its value, in words of HTTP; others as they are
        let found = text.split_once(": ").and_then(|(name, what)| {
            let (_, value) = pairs.iter().find(|(known, _)| known == name)?;
            Some(format!("{name} {}, not {}", what_it_must_be(what)?, Quoted(value)))
        });
        wrong(&found.unwrap_or_else(|| text.to_owned()))
    })
}

/// The names and values in a query string, in order. A name that is there twice is refused.
pub(crate) fn pairs(uri: &Uri) -> Result<Vec<(String, String)>> {
    let pairs: Vec<_> = form_urlencoded::parse(uri.query().unwrap_or_default().as_bytes()).into_owned().collect();
    let mut seen = HashSet::new();
    match pairs.iter().find(|(name, _)| !seen.insert(name)) {
        Some((name, _)) => {
            Err(Error::parameter(format_args!("a parameter is given twice in the query string: {}", Quoted(name))))
        }
        None => Ok(pairs),
    }
}

/// Takes the value of a parameter out of those of a query string.
pub(crate) fn take(pairs: &mut Vec<(String, String)>, name: &str) -> Option<String> {
    let place = pairs.iter().position(|(known, _)| known == name)?;
    Some(pairs.remove(place).1)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn uri(query: &str) -> Uri {
        format!("/?{query}").parse().expect("a URI")
    }

    #[test]
    fn a_name_given_twice_is_refused_however_it_is_written() {
        assert!(pairs(&uri("clusters=1&seed=2")).is_ok());
        let error = pairs(&uri("clusters=1&%63lusters=2")).expect_err("twice");
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
            let error = read::<Wanted>(&uri(query)).expect_err(query);
            assert_eq!(error.message, format!("the query string is not valid: {expected}"));
        }
    }

    #[test]
    fn taking_one_leaves_the_others_as_they_were() {
        let mut rest = pairs(&uri("a=%20&form%61t=ob+j&b")).expect("pairs");
        assert_eq!(take(&mut rest, "format").as_deref(), Some("ob j"));
        assert_eq!(rest, [("a", " "), ("b", "")].map(|(name, value)| (name.to_owned(), value.to_owned())));
        assert_eq!(take(&mut Vec::new(), "format"), None);
    }
}
