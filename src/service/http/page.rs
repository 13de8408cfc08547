//! The page at `/`: a client of this interface for people, in one document, one style sheet, two scripts and two
//! pictures. The first script is small, so that the page is there at once; it loads the second, which draws.
//!
//! Its sources are in `web/`. `make bundle` makes seven files of them, and the feature `page` compiles these in; the
//! mesh of the first visit is made here ([`KNOT`]). Without the feature, the paths are a 404 that says so.
//!
//! The page needs no token and holds no data. The content security policy admits what comes from here only: no inline
//! script or style, no `eval`, no frame. Files have an `ETag` and are validated before each use.

use std::sync::{Arc, LazyLock};

use axum::body::Bytes;
use axum::http::header;
use axum::response::{IntoResponse, Response};
use axum::routing::get;
use axum::{Extension, Router};
use sha2::{Digest, Sha256};
use tesserae_mesh::dev::sample::{Sample, generate, write_glb};
use tesserae_mesh::device::Cancel;
use tesserae_mesh::device::cpu::CpuDevice;
use tesserae_mesh::error::{Error, Result};
use tesserae_mesh::job;
use tesserae_mesh::mesh::Format;
use tesserae_mesh::parameters::{Algorithm, Parameters};

use crate::guard::problem::{Answer, Failure};
use crate::http::conditional::Content;
use crate::ops::blocking;

/// What the page may load. Textures and downloads are `blob:`.
const POLICY: &str = "default-src 'none'; script-src 'self'; style-src 'self'; img-src 'self' data: blob:; \
                      connect-src 'self' blob:; base-uri 'none'; form-action 'none'; frame-ancestors 'none'";

/// Path, media type and bytes of each file.
#[cfg(feature = "page")]
const FILES: [(&str, &str, &[u8]); 7] = [
    ("/", "text/html; charset=utf-8", include_bytes!(concat!(env!("PAGE_BUNDLE"), "/index.html"))),
    ("/page.js", "text/javascript; charset=utf-8", include_bytes!(concat!(env!("PAGE_BUNDLE"), "/page.js"))),
    ("/scene.js", "text/javascript; charset=utf-8", include_bytes!(concat!(env!("PAGE_BUNDLE"), "/scene.js"))),
    ("/page.css", "text/css; charset=utf-8", include_bytes!(concat!(env!("PAGE_BUNDLE"), "/page.css"))),
    ("/mark.svg", "image/svg+xml", include_bytes!(concat!(env!("PAGE_BUNDLE"), "/mark.svg"))),
    ("/share.jpg", "image/jpeg", include_bytes!(concat!(env!("PAGE_BUNDLE"), "/share.jpg"))),
    ("/licences.txt", "text/plain; charset=utf-8", include_bytes!(concat!(env!("PAGE_BUNDLE"), "/licences.txt"))),
];

#[cfg(not(feature = "page"))]
const FILES: [(&str, &str, &[u8]); 0] = [];

/// The knot and its hierarchy, each with its digest; made once, when a page first loads them.
static KNOT: LazyLock<Result<[(Content, Bytes); 2]>> = LazyLock::new(make_knot);

pub(crate) fn routes<S: Clone + Send + Sync + 'static>() -> Router<S> {
    if FILES.is_empty() {
        let missing = "this build has no page: build it with `make run`, or use the interface in /openapi.yaml";
        let refusal = move || async move { Failure::from(Error::not_found(missing)).into_response() };
        return Router::new().route("/", get(refusal));
    }
    let knot = Router::new().route("/knot.glb", get(|| knot(0))).route("/knot.tsr", get(|| knot(1)));
    FILES.into_iter().fold(knot, |routes, (path, media_type, bytes)| {
        // the same in every answer of this process, so it is made once, and not before it is needed
        let content = Arc::new(LazyLock::new(|| digest(bytes)));
        routes.route(path, get(async move || serve(media_type, bytes, Content::clone(&content))))
    })
}

/// A file of the page with the headers that all of them have.
fn serve(media_type: &'static str, bytes: impl IntoResponse, content: Content) -> Response {
    let headers = [
        (header::CONTENT_TYPE.as_str(), media_type),
        (header::CONTENT_SECURITY_POLICY.as_str(), POLICY),
        ("cross-origin-opener-policy", "same-origin"),
    ];
    (headers, Extension(content), bytes).into_response()
}

/// SHA-256 of a file, in hexadecimal.
fn digest(bytes: &[u8]) -> Content {
    Content(Sha256::digest(bytes).iter().map(|byte| format!("{byte:02x}")).collect())
}

async fn knot(file: usize) -> Answer {
    let made = blocking(move || KNOT.as_ref().map(|files| files[file].clone()).map_err(Error::clone));
    let (content, bytes) = made.await??;
    Ok(serve("application/octet-stream", bytes, content))
}

fn make_knot() -> Result<[(Content, Bytes); 2]> {
    let failed = |error| Error::internal(format_args!("the knot of the page: {error}"));
    let (mut glb, mut tsr) = (Vec::new(), Vec::new());
    write_glb(&mut glb, &generate(Sample::Knot, 20_000)?).map_err(failed)?;
    let parameters = Parameters { algorithm: Algorithm::Pml, ..Parameters::default() };
    let prepared = job::prepare(&job::Request::new(&glb, Format::Glb, &parameters))?;
    let outcome = job::run(&prepared, &mut CpuDevice::new(), &Cancel::default(), &mut |_| {})?;
    if let Some(hierarchy) = outcome.hierarchy {
        hierarchy.write(&mut tsr).map_err(failed)?;
    }
    Ok([glb, tsr].map(|bytes| (digest(&bytes), Bytes::from(bytes))))
}
