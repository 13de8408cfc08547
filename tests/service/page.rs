//! The page at `/`: files of the binary with their headers, or an answer that says why there are none.

use tesserae_mesh::device::cpu::CpuDevice;

use crate::support::*;

const HAS_PAGE: bool = cfg!(feature = "page");

/// Paths and media types of the files.
const FILES: [(&str, &str); 9] = [
    ("/", "text/html"),
    ("/page.js", "text/javascript"),
    ("/scene.js", "text/javascript"),
    ("/page.css", "text/css"),
    ("/mark.svg", "image/svg+xml"),
    ("/share.jpg", "image/jpeg"),
    ("/licences.txt", "text/plain"),
    ("/knot.glb", "application/octet-stream"),
    ("/knot.tsr", "application/octet-stream"),
];

#[tokio::test]
async fn the_page_has_a_strict_policy_and_is_validated_before_each_use() {
    let service = Service::start().await;
    if !HAS_PAGE {
        let detail = refused(service.get("/"), 404, "not-found").await;
        assert!(detail.contains("this build has no page"), "{detail}");
        return;
    }
    for (path, media_type) in FILES {
        let response = service.get(path).send().await.expect("answered");
        assert_eq!(response.status(), 200, "{path}");
        let headers = response.headers().clone();
        let header = |name: &str| headers[name].to_str().expect("text").to_owned();
        assert!(header("content-type").starts_with(media_type), "{path}");
        assert_eq!(
            header("content-security-policy"),
            "default-src 'none'; script-src 'self'; style-src 'self'; img-src 'self' data: blob:; \
             connect-src 'self' blob:; base-uri 'none'; form-action 'none'; frame-ancestors 'none'"
        );
        assert_eq!(header("cross-origin-opener-policy"), "same-origin");
        assert_eq!(header("referrer-policy"), "no-referrer");
        assert!(header("cache-control").contains("no-cache"));
        assert!(!response.bytes().await.expect("bytes").is_empty());
        let again = service.get(path).header("if-none-match", header("etag")).send().await.expect("answered");
        assert_eq!(again.status(), 304, "{path}");
    }
}

#[tokio::test]
async fn the_page_needs_no_token_and_gives_no_data() {
    let folder = tempfile::tempdir().expect("a folder");
    let path = folder.path().join("tokens.json");
    tesserae_service::TokenFile::change(&path, |file| Ok(file.add("mine")?.reveal())).expect("made");
    let with_tokens = |settings: &mut tesserae_service::Settings| settings.access.tokens = Some(path);
    let service = Service::with(with_tokens, Box::new(CpuDevice::new())).await;
    let expected = if HAS_PAGE { 200 } else { 404 };
    for (path, _) in FILES {
        assert_eq!(service.get(path).send().await.expect("answered").status(), expected, "{path}");
    }
    refused(service.get("/v1/jobs"), 401, "unauthorized").await;
}
