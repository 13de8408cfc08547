//! Bodies that would take work out of proportion to their content are refused.

use crate::limits::{gzipped, zstandard};
use crate::support::*;

#[tokio::test]
async fn uploads_have_one_gzip_member_and_at_most_64_zstd_frames() {
    let service = Service::start().await;
    let mesh = sphere(300);
    let send = |encoding: &str, body: Vec<u8>| {
        let request = service.post("/v1/jobs?clusters=5").header("content-type", "model/obj");
        request.header("content-encoding", encoding).body(body)
    };
    let whole = gzipped(&mesh);
    let (first, second) = mesh.split_at(1000);
    for body in [
        [gzipped(first), gzipped(second)].concat(),
        [gzipped(b"").repeat(200_000), whole.clone()].concat(),
        [&whole[..], b"\0"].concat(),
        [&whole[..], &mesh].concat(),
    ] {
        let detail = refused(send("gzip", body), 400, "bad-request").await;
        assert!(detail.contains("more than one member") && detail.contains("as a whole"), "{detail}");
    }
    let frames = |count: usize| [zstandard(b"").repeat(count - 1), zstandard(&mesh)].concat();
    let job = json(send("zstd", frames(64))).await;
    assert_eq!(job["mesh"]["bytes"], mesh.len(), "{job}");
    for body in [frames(65), frames(400_000)] {
        let detail = refused(send("zstd", body), 400, "bad-request").await;
        assert!(detail.contains("limit of 64"), "{detail}");
    }
    // one member of a million empty blocks
    let empty = [&[0x1f, 0x8b, 8, 0, 0, 0, 0, 0, 0, 0xff][..], &[0, 0, 0, 0xff, 0xff].repeat(1_000_000)].concat();
    let detail = refused(send("gzip", empty), 400, "bad-request").await;
    assert!(detail.contains("2 times as large as its content"), "{detail}");
}

#[tokio::test]
async fn a_body_of_very_many_very_small_chunks_is_refused() {
    let service = Service::start().await;
    let mesh = sphere(20_000);
    for (bytes, is_taken) in [(1, false), (70, true)] {
        let chunks: Vec<_> = mesh.chunks(bytes).map(|chunk| std::io::Result::Ok(chunk.to_vec())).collect();
        assert!(chunks.len() > 5000);
        let body = reqwest::Body::wrap_stream(futures_util::stream::iter(chunks));
        let request = service.post("/v1/jobs?clusters=5").header("content-type", "model/obj").body(body);
        if is_taken {
            assert_eq!(json(request).await["mesh"]["bytes"], mesh.len());
            continue;
        }
        let detail = refused(request, 400, "bad-request").await;
        assert!(detail.contains("fewer than 64 bytes") && detail.contains("larger chunks"), "{detail}");
    }
}
