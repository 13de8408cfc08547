//! Content negotiation by `Accept` (RFC 9110 §12.5.1).

use axum::http::{HeaderMap, header};

use crate::artifacts::{Artifact, Form};
use crate::error::{Error, Kind, Result};

/// Most media ranges of a request that are read; browsers send a dozen.
const MAX_RANGES: usize = 64;

/// The form of an output that the query names, or else the one that the client prefers.
pub(super) fn form(headers: &HeaderMap, format: Option<&str>, artifact: &'static Artifact) -> Result<&'static Form> {
    match format {
        None => choose(headers, artifact),
        Some(name) => artifact.form(name).ok_or_else(|| {
            let known: Vec<&str> = artifact.forms.iter().map(Form::extension).collect();
            Error::parameter(format_args!("the formats of {} are {}, not {name:?}", artifact.name, known.join(", ")))
        }),
    }
}

/// The form of an output that the client prefers; the earlier one if it likes several alike.
pub(super) fn choose(headers: &HeaderMap, artifact: &'static Artifact) -> Result<&'static Form> {
    choose_among(headers, artifact, artifact.forms.iter())
}

/// The same among some of its forms.
pub(super) fn choose_among(
    headers: &HeaderMap,
    artifact: &'static Artifact,
    forms: impl Iterator<Item = &'static Form>,
) -> Result<&'static Form> {
    let accepted: Vec<&str> = headers.get_all(header::ACCEPT).iter().filter_map(|value| value.to_str().ok()).collect();
    let accepted = match accepted.join(",") {
        nothing if nothing.trim().is_empty() => "*/*".to_owned(),
        accepted => accepted,
    };
    let mut best = None;
    for form in forms {
        let quality = quality(&accepted, form.media_type);
        if quality > 0 && best.is_none_or(|(_, other)| quality > other) {
            best = Some((form, quality));
        }
    }
    best.map(|(form, _)| form).ok_or_else(|| {
        let media_types: Vec<&str> = artifact.forms.iter().map(|form| form.media_type).collect();
        Error::new(
            Kind::NotAcceptable,
            format_args!("the media types of {} are {}, not {accepted:?}", artifact.name, media_types.join(", ")),
        )
    })
}

/// How much a type is liked, in thousandths: by the most specific range that covers it, not by the most generous.
fn quality(accepted: &str, media_type: &str) -> u32 {
    let main_type = media_type.split('/').next().unwrap_or_default();
    accepted
        .split(',')
        .take(MAX_RANGES)
        .filter_map(|range| {
            let mut fields = range.split(';').map(str::trim);
            let range = fields.next()?;
            let specificity = if range.eq_ignore_ascii_case(media_type) {
                2
            } else if range == "*/*" {
                0
            } else if range.strip_suffix("/*").is_some_and(|main| main.eq_ignore_ascii_case(main_type)) {
                1
            } else {
                return None;
            };
            let weight = fields
                .filter_map(|field| field.split_once('='))
                .find(|(name, _)| name.trim().eq_ignore_ascii_case("q"))
                .map_or(Some(1.0), |(_, value)| value.trim().parse::<f64>().ok())?;
            Some((specificity, (weight.clamp(0.0, 1.0) * 1000.0) as u32))
        })
        .max()
        .map_or(0, |(_, weight)| weight)
}

#[cfg(test)]
mod tests {
    use axum::http::HeaderValue;

    use super::*;
    use crate::artifacts::LABELS;

    #[test]
    fn the_best_liked_format_is_chosen() {
        let [json, npy, raw, ..] = LABELS.forms else { panic!("three forms") };
        for (accept, expected) in [
            ("*/*", Some(json)),
            ("application/*", Some(json)),
            ("application/x-npy", Some(npy)),
            ("APPLICATION/Octet-Stream", Some(raw)),
            ("application/json;q=0.5, application/x-npy;q=0.9", Some(npy)),
            ("application/x-npy, */*;q=0.1", Some(npy)),
            ("application/json;q=0, */*", Some(npy)),
            ("text/html, application/*;q=0.2", Some(json)),
            ("text/html", None),
            ("*/*;q=0", None),
            ("application/json;q=0", None),
            ("nonsense", None),
            ("", Some(json)),
            (&format!("{}application/x-npy", "a/b,".repeat(63)), Some(npy)),
            (&format!("{}application/x-npy", "a/b,".repeat(64)), None),
        ] {
            let mut headers = HeaderMap::new();
            headers.insert(header::ACCEPT, HeaderValue::from_str(accept).expect("a value"));
            let chosen = choose(&headers, &LABELS).ok();
            assert_eq!(chosen.map(|form| form.file), expected.map(|form| form.file), "{accept}");
        }
        assert_eq!(choose(&HeaderMap::new(), &LABELS).map(|form| form.file), Ok(json.file));
    }
}
