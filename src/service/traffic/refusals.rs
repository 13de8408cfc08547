//! Problem documents for heads that hyper cannot read and refuses by itself, with an answer that has no body.
//!
//! No part of the service sees such a request, so the document is put in where the answer is written. Every error that
//! the service makes has a body: an error without any is hyper's.

use super::super::problem::{MEDIA_TYPE, Problem};

/// Statuses that hyper answers by itself, their reasons, and what is wrong.
const REFUSALS: [(u16, &str, &str); 3] = [
    (400, "Bad Request", "the head of the request is not valid HTTP/1.1"),
    (414, "URI Too Long", "the target of the request is longer than 65534 bytes; send parameters in a form instead"),
    (431, "Request Header Fields Too Large", "the head of the request has more than 100 headers, or is too long"),
];

/// Largest answer that is looked at, in bytes.
const MAX_BYTES: usize = 512;

/// The answer with a problem document, if `written` is a whole answer of hyper's own.
pub(super) fn with_problem(written: &[u8]) -> Option<Vec<u8>> {
    if written.len() > MAX_BYTES || !written.ends_with(b"\r\n\r\n") {
        return None;
    }
    let text = std::str::from_utf8(written).ok()?;
    let (line, headers) = text.split_once("\r\n")?;
    let (status, reason) = line.strip_prefix("HTTP/1.1 ")?.split_once(' ')?;
    let (status, _, detail) = REFUSALS.iter().find(|refusal| status.parse() == Ok(refusal.0) && refusal.1 == reason)?;
    let length = "content-length: 0\r\n";
    if !headers.contains(length) {
        return None;
    }
    let problem = Problem {
        kind: "about:blank".to_owned(),
        title: reason.to_owned(),
        status: *status,
        detail: (*detail).to_owned(),
        instance: "/".to_owned(),
        queue_depth: None,
    };
    let body = serde_json::to_string(&problem).ok()?;
    let described = format!(
        "content-type: {MEDIA_TYPE}\r\ncache-control: no-store\r\nx-content-type-options: nosniff\r\n\
         content-length: {}\r\n",
        body.len()
    );
    Some(format!("{line}\r\n{}{body}", headers.replacen(length, &described, 1)).into_bytes())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn only_whole_errors_without_a_body_get_a_document() {
        let bare = "HTTP/1.1 431 Request Header Fields Too Large\r\ncontent-length: 0\r\ndate: x\r\n\r\n";
        let whole = String::from_utf8(with_problem(bare.as_bytes()).expect("a document")).expect("text");
        let (head, body) = whole.split_once("\r\n\r\n").expect("a body");
        assert!(head.contains(&format!("content-length: {}\r\n", body.len())) && head.ends_with("date: x"), "{head}");
        assert!(body.contains("\"status\":431") && body.contains("about:blank"), "{body}");
        for other in [
            "HTTP/1.1 400 Bad Request\r\ncontent-length: 7\r\n\r\n",
            "HTTP/1.1 404 Not Found\r\ncontent-length: 0\r\n\r\n",
            "HTTP/1.1 200 OK\r\ncontent-length: 0\r\n\r\n",
            "HTTP/1.1 400 Bad Request\r\ncontent-length: 0\r\n",
            "",
        ] {
            assert_eq!(with_problem(other.as_bytes()), None, "{other}");
        }
    }
}
