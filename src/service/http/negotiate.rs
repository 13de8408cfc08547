//! Content negotiation by `Accept` (RFC 9110 §12.5.1).

use axum::http::{HeaderMap, header};
use mime::{Mime, Name};
use tesserae_mesh::artifacts::{Artifact, Form};
use tesserae_mesh::error::{Error, Kind, Result};

/// The form of an output that the query names, or else the one that the client prefers.
pub(crate) fn form(headers: &HeaderMap, format: Option<&str>, artifact: &'static Artifact) -> Result<&'static Form> {
    let Some(name) = format else { return choose(headers, artifact, artifact.forms.iter()) };
    artifact.form(name).ok_or_else(|| {
        let known: Vec<&str> = artifact.forms.iter().map(Form::extension).collect();
        Error::parameter(format_args!("the formats of {} are {}, not {name:?}", artifact.name, known.join(", ")))
    })
}

/// The form that the client prefers among some of an output; the earlier one if it likes several alike.
pub(crate) fn choose(
    headers: &HeaderMap,
    artifact: &'static Artifact,
    forms: impl Iterator<Item = &'static Form>,
) -> Result<&'static Form> {
    let accepted: Vec<&str> = headers.get_all(header::ACCEPT).iter().filter_map(|value| value.to_str().ok()).collect();
    let accepted = accepted.join(",");
    // browsers send a dozen
    let ranges = accepted.split(',').take(64);
    let mut ranges: Vec<Mime> = ranges.filter_map(|range| range.trim().parse().ok()).collect();
    if accepted.trim().is_empty() {
        ranges.push(mime::STAR_STAR);
    }
    let weighed = forms.map(|form| (form, weight(&ranges, form.media_type))).filter(|(_, weight)| *weight > 0.0);
    let best = weighed.reduce(|best, other| if other.1 > best.1 { other } else { best });
    best.map(|(form, _)| form).ok_or_else(|| {
        let media_types: Vec<&str> = artifact.forms.iter().map(|form| form.media_type).collect();
        let (name, known) = (artifact.name, media_types.join(", "));
        Error::new(Kind::NotAcceptable, format_args!("the media types of {name} are {known}, not {accepted:?}"))
    })
}

/// How much a type is liked: by the most specific range that covers it, not by the most generous.
fn weight(ranges: &[Mime], media_type: &str) -> f32 {
    let is_star = |name: Name<'_>| name == mime::STAR;
    let covers = |range: &&Mime| match (is_star(range.type_()), is_star(range.subtype())) {
        (true, _) => true,
        (false, true) => media_type.split('/').next() == Some(range.type_().as_str()),
        (false, false) => media_type == range.essence_str(),
    };
    let stars = |range: &&Mime| u8::from(is_star(range.type_())) + u8::from(is_star(range.subtype()));
    let weight = |range: &Mime| range.get_param("q").map_or(Ok(1.0), |weight| weight.as_str().parse::<f32>());
    ranges.iter().filter(covers).min_by_key(stars).and_then(|range| weight(range).ok()).unwrap_or(0.0)
}

#[cfg(test)]
mod tests {
    use axum::http::HeaderValue;
    use tesserae_mesh::artifacts::LABELS;

    use super::*;

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
            let headers = HeaderMap::from_iter([(header::ACCEPT, HeaderValue::from_str(accept).expect("a value"))]);
            let chosen = form(&headers, None, &LABELS).ok();
            assert_eq!(chosen.map(|form| form.file), expected.map(|form| form.file), "{accept}");
        }
        assert_eq!(form(&HeaderMap::new(), None, &LABELS).map(|form| form.file), Ok(json.file));
    }
}
