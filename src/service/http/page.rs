//! The page at `/`: a client of this interface for people, in one document, one style sheet, two scripts and two
//! pictures. The first script is small, so that the page is there at once; it loads the second, which draws.
//!
//! Its sources are in `web/`. `make bundle` makes seven files of them, and the feature `page` compiles these in; the
//! mesh of the first visit is made here ([`knot`]). Without the feature, the paths are a 404 that says so.
//!
//! The page needs no token to be read, and holds no data; a token that it is given stays in the browser's session. The
//! content security policy admits what comes from here and nothing else: no inline script or style, no `eval`, no other
//! host, no frame. Files have an `ETag` and are validated before each use, so that a new release is a new page.

use axum::Router;
use axum::http::header;
use axum::response::{IntoResponse, Response};
use axum::routing::get;
use tesserae_mesh::error::{Error, Kind};

use crate::guard::problem::Failure;
use crate::http::conditional::Content;

mod knot;

#[derive(Debug, Clone, Copy)]
struct File {
    path: &'static str,
    media_type: &'static str,
    bytes: &'static [u8],
}

/// What the page may load. Textures and downloads are `blob:`.
const POLICY: &str = "default-src 'none'; script-src 'self'; style-src 'self'; img-src 'self' data: blob:; \
                      connect-src 'self' blob:; base-uri 'none'; form-action 'none'; frame-ancestors 'none'";

#[cfg(feature = "page")]
macro_rules! bundled {
    ($name:literal) => {
        include_bytes!(concat!(env!("PAGE_BUNDLE"), "/", $name))
    };
}

#[cfg(feature = "page")]
const FILES: [File; 7] = [
    File { path: "/", media_type: "text/html; charset=utf-8", bytes: bundled!("index.html") },
    File { path: "/page.js", media_type: "text/javascript; charset=utf-8", bytes: bundled!("page.js") },
    File { path: "/scene.js", media_type: "text/javascript; charset=utf-8", bytes: bundled!("scene.js") },
    File { path: "/page.css", media_type: "text/css; charset=utf-8", bytes: bundled!("page.css") },
    File { path: "/mark.svg", media_type: "image/svg+xml", bytes: bundled!("mark.svg") },
    File { path: "/share.jpg", media_type: "image/jpeg", bytes: bundled!("share.jpg") },
    File { path: "/licences.txt", media_type: "text/plain; charset=utf-8", bytes: bundled!("licences.txt") },
];

/// None: the page was not compiled in.
#[cfg(not(feature = "page"))]
const FILES: [File; 0] = [];

pub(crate) fn routes<S: Clone + Send + Sync + 'static>() -> Router<S> {
    if FILES.is_empty() {
        let missing = "this build has no page: build it with `make run`, or use the interface in /openapi.yaml";
        let refusal = move || async move { Failure::from(Error::new(Kind::NotFound, missing)).into_response() };
        return Router::new().route("/", get(refusal));
    }
    FILES.into_iter().fold(knot::routes(), |routes, file| {
        // the same in every answer of this process, so it is made once
        let content = Content(digest(file.bytes));
        routes.route(file.path, get(async move || serve(file.media_type, file.bytes, content)))
    })
}

/// Makes what the page shows first, in the background.
pub(crate) fn start() {
    if !FILES.is_empty() {
        knot::start();
    }
}

/// A file of the page with the headers that all of them have.
fn serve(media_type: &'static str, bytes: impl IntoResponse, content: Content) -> Response {
    let headers = [
        (header::CONTENT_TYPE.as_str(), media_type),
        (header::CONTENT_SECURITY_POLICY.as_str(), POLICY),
        ("cross-origin-opener-policy", "same-origin"),
    ];
    let mut response = (headers, bytes).into_response();
    response.extensions_mut().insert(content);
    response
}

/// SHA-256 of a file, in hexadecimal.
fn digest(bytes: &[u8]) -> String {
    use sha2::{Digest, Sha256};
    Sha256::digest(bytes).iter().map(|byte| format!("{byte:02x}")).collect()
}
