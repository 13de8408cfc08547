//! Bodies that would take work out of proportion to their content are refused.

use crate::limits::{gzipped, zstandard};
use crate::support::*;

#[tokio::test]
async fn compressed_uploads_have_one_member_or_frame() {
    let service = Service::start().await;
    let mesh = sphere(300);
    let send = |encoding: &str, body: Vec<u8>| service.obj("clusters=5", body).header("content-encoding", encoding);
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
    for frames in [1, 400_000] {
        let body = [zstandard(b"").repeat(frames), zstandard(&mesh)].concat();
        let detail = refused(send("zstd", body), 400, "bad-request").await;
        assert!(detail.contains("more than one member or frame"), "{detail}");
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
        let request = service.obj("clusters=5", body);
        if is_taken {
            assert_eq!(json(request).await["mesh"]["bytes"], mesh.len());
            continue;
        }
        let detail = refused(request, 400, "bad-request").await;
        assert!(detail.contains("fewer than 64 bytes") && detail.contains("larger chunks"), "{detail}");
    }
}
