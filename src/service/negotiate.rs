//! Content negotiation by `Accept` (RFC 9110 §12.5.1).

use axum::http::{HeaderMap, header};

use crate::artifacts::LabelFormat;
use crate::error::{Error, Kind, Result};

/// The format of labels that the client likes best.
pub(super) fn label_format(headers: &HeaderMap) -> Result<LabelFormat> {
    choose(headers, "labels", &LabelFormat::ALL.map(|format| (format, format.media_type())))
}

/// The form that the client likes best of those that `what` comes as; the earlier one when it likes several alike.
pub(super) fn choose<T: Copy>(headers: &HeaderMap, what: &str, forms: &[(T, &str)]) -> Result<T> {
    let accepted: Vec<&str> = headers.get_all(header::ACCEPT).iter().filter_map(|value| value.to_str().ok()).collect();
    let accepted = match accepted.join(",") {
        nothing if nothing.trim().is_empty() => "*/*".to_owned(),
        accepted => accepted,
    };
    let mut best = None;
    for &(form, media_type) in forms {
        let quality = quality(&accepted, media_type);
        if quality > 0 && best.is_none_or(|(_, other)| quality > other) {
            best = Some((form, quality));
        }
    }
    best.map(|(form, _)| form).ok_or_else(|| {
        let media_types: Vec<&str> = forms.iter().map(|(_, media_type)| *media_type).collect();
        Error::new(Kind::NotAcceptable, format_args!("{what} come as {}, not as {accepted:?}", media_types.join(", ")))
    })
}

/// How much a type is liked, in thousandths: by the most specific range that covers it, not by the most generous.
fn quality(accepted: &str, media_type: &str) -> u32 {
    let main_type = media_type.split('/').next().unwrap_or_default();
    accepted
        .split(',')
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

    #[test]
    fn the_best_liked_format_is_chosen() {
        use LabelFormat::{Json, Npy, Raw};
        for (accept, expected) in [
            ("*/*", Some(Json)),
            ("application/*", Some(Json)),
            ("application/x-npy", Some(Npy)),
            ("APPLICATION/Octet-Stream", Some(Raw)),
            ("application/json;q=0.5, application/x-npy;q=0.9", Some(Npy)),
            ("application/x-npy, */*;q=0.1", Some(Npy)),
            ("application/json;q=0, */*", Some(Npy)),
            ("text/html, application/*;q=0.2", Some(Json)),
            ("text/html", None),
            ("*/*;q=0", None),
            ("application/json;q=0", None),
            ("nonsense", None),
            ("", Some(Json)),
        ] {
            let mut headers = HeaderMap::new();
            headers.insert(header::ACCEPT, HeaderValue::from_static(accept));
            assert_eq!(label_format(&headers).ok(), expected, "{accept}");
        }
        assert_eq!(label_format(&HeaderMap::new()), Ok(Json));
    }
}
