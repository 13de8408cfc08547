//! The parsers of the service, for fuzzers. Tests compile them too, so that `make lint` reads them.

use std::sync::{Arc, OnceLock};

use axum::body::Body;
use axum::extract::Request;
use axum::http::{HeaderMap, HeaderValue};
use tesserae_mesh::job::InputFormat;
use tokio::runtime::Runtime;

use crate::files::Files;
use crate::guard::access::tokens::{TokenFile, Tokens};
use crate::http::api::create;
use crate::http::{conditional, negotiate};
use crate::ingest::intake::Rules;
use crate::ingest::request::WantedJob;
use crate::ingest::upload;
use crate::ops::faults::Faults;
use crate::ops::trace::TraceParent;
use crate::settings::TrafficConstants;
use crate::work::webhooks;

/// A query string and a JSON part.
pub fn request(query: &[u8], json: &[u8]) {
    let Ok(uri) = format!("/v1/jobs?{}", String::from_utf8_lossy(query)).parse() else { return };
    let Ok(mut wanted) = WantedJob::from_query(&uri) else { return };
    let _ = wanted.add_json(json);
    let _ = wanted.check_early(true);
    for format in InputFormat::all() {
        let _ = wanted.clone().finish(format, |_| false);
    }
}

/// A form with the boundary `b`, as an upload.
pub fn form(bytes: &[u8]) {
    static PLACE: OnceLock<(Runtime, Arc<Files>)> = OnceLock::new();
    let (runtime, files) = PLACE.get_or_init(|| {
        let runtime = tokio::runtime::Builder::new_current_thread().enable_all().build().expect("a runtime");
        let files = Files::open(None, None, 0, Faults::default()).expect("a folder");
        (runtime, Arc::new(files))
    });
    let rules = Rules { limit: 1 << 20, patience: TrafficConstants::default().body_timeout };
    let request = Request::post("/v1/jobs?clusters=3")
        .header("content-type", "multipart/form-data; boundary=b")
        .body(Body::from(bytes.to_vec()))
        .expect("a request");
    let _ = runtime.block_on(upload::receive(request, files, "fuzz", true, rules));
}

/// A file of tokens; its content as a token.
pub fn tokens(bytes: &[u8]) {
    let _ = TokenFile::parse(bytes);
    let mut file = TokenFile::default();
    let token = file.add("a").expect("a token").reveal();
    let tokens = Tokens::of(&file).expect("valid");
    let text = String::from_utf8_lossy(bytes);
    assert!(tokens.tenant(&text).is_none() || text == token);
}

/// The value of headers.
pub fn headers(bytes: &[u8]) {
    let Ok(value) = HeaderValue::from_bytes(bytes) else { return };
    let mut headers = HeaderMap::new();
    for name in ["traceparent", "prefer", "accept", "if-none-match", "range"] {
        headers.insert(name, value.clone());
    }
    let parent = TraceParent::of_request(&headers);
    assert_eq!(TraceParent::parse(&parent.to_string()), Some(parent));
    let _ = create::wait(&headers);
    let _ = negotiate::form(&headers, None, &tesserae_mesh::artifacts::LABELS);
    conditional::for_fuzzing(&headers, 100);
    if let Ok(text) = value.to_str() {
        webhooks::for_fuzzing(text);
    }
}
