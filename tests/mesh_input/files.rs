//! Buffers outside the mesh: what may be named, and that nothing else is opened.

use std::cell::RefCell;
use std::path::Path;

use serde_json::{Value, json};
use tesserae_mesh::mesh::{self, Beside, Format, Limits, NoResources, Resources, Source};
use tesserae_mesh::{Kind, Result};

use crate::make::{SQUARE, square};

/// Notes every request and gives the same bytes every time.
#[derive(Default)]
struct Noting {
    bytes: Vec<u8>,
    asked: RefCell<Vec<(String, u64)>>,
}

impl Resources for Noting {
    fn load(&self, uri: &str, max_bytes: u64) -> Result<Vec<u8>> {
        self.asked.borrow_mut().push((uri.to_owned(), max_bytes));
        Ok(self.bytes.clone())
    }
}

fn document(uri: &str) -> Vec<u8> {
    let (mut document, _) = square();
    document["buffers"][0]["uri"] = Value::String(uri.to_owned());
    document.to_string().into_bytes()
}

const REFUSED: [&str; 27] = [
    "",
    "/etc/passwd",
    "//host/share",
    "..",
    "../buffer.bin",
    "a/../buffer.bin",
    "a/..",
    "%2e%2e/buffer.bin",
    "..%2fbuffer.bin",
    "%2fetc%2fpasswd",
    "a%2F..%2Fb",
    "file:///etc/passwd",
    "file:buffer.bin",
    "http://localhost/buffer.bin",
    "HTTPS://localhost/buffer.bin",
    "ftp://host/x",
    "C:buffer.bin",
    "c:/buffer.bin",
    "C%3A/buffer.bin",
    "..\\buffer.bin",
    "a\\b",
    "a%5c..%5cb",
    "buffer\0.bin",
    "buffer%00.bin",
    "buffer%0a.bin",
    "javascript:x",
    "%ff%fe.bin",
];

#[test]
fn only_paths_downwards_are_asked_for() {
    let noting = Noting::default();
    for uri in REFUSED {
        let error = mesh::read(&document(uri), Format::Gltf, &noting, &Limits::default()).expect_err("refused");
        assert_eq!(error.kind, Kind::InvalidMesh, "{uri:?}: {error}");
        assert!(error.message.contains("buffer 0"), "{error}");
    }
    assert!(noting.asked.borrow().is_empty(), "{:?}", noting.asked);
}

#[test]
fn names_are_percent_decoded_and_limited() {
    let (_, binary) = square();
    for (uri, path) in [
        ("buffer.bin", "buffer.bin"),
        ("a/b/c.bin", "a/b/c.bin"),
        ("./my%20buffer%25.bin", "./my buffer%.bin"),
        ("my buffer.bin", "my buffer.bin"),
        ("%C3%BC.bin", "\u{fc}.bin"),
        ("\u{fc}.bin", "\u{fc}.bin"),
        ("..a/b..c/...", "..a/b..c/..."),
        ("a/b:c.bin", "a/b:c.bin"),
    ] {
        let noting = Noting { bytes: binary.clone(), ..Noting::default() };
        let document = document(uri);
        let max_bytes = document.len() as u64 + 60;
        let limits = Limits { max_bytes, ..Limits::default() };
        let mesh = mesh::read(&document, Format::Gltf, &noting, &limits).expect("a mesh");
        assert_eq!(mesh.positions, SQUARE);
        assert_eq!(noting.asked.take(), [(path.to_owned(), 60)]);
        // the limit is for all bytes together, even where the resources do not keep it
        let limits = Limits { max_bytes: max_bytes - 1, ..limits };
        let error = mesh::read(&document, Format::Gltf, &noting, &limits).expect_err("too large");
        assert_eq!(error.kind, Kind::TooLarge);
    }
}

#[test]
fn an_opened_mesh_has_its_faces_counted_and_is_read_on_another_thread_without_loading_anything_again() {
    let (_, bytes) = square();
    let noting = Noting { bytes, ..Noting::default() };
    let document = document("a.bin");
    let limits = Limits::default();
    let source = |bytes| Source::new(bytes, Format::Gltf, &noting, &limits);
    let mesh = mesh::open(source(&document), |opened| {
        assert_eq!((opened.faces(), noting.asked.take().len()), (2, 1));
        std::thread::scope(|scope| scope.spawn(|| opened.read()).join().expect("a thread"))
    })
    .flatten()
    .expect("a mesh")
    .mesh;
    assert_eq!((mesh.positions, mesh.faces.len()), (SQUARE.to_vec(), 2));
    assert!(noting.asked.take().is_empty());
    let cut = &document[..document.len() / 2];
    assert!(mesh::open(source(cut), |_| panic!("what cannot be opened is not given to the caller")).is_err());
}

#[test]
fn without_resources_nothing_is_found() {
    let error = mesh::read(&document("a.bin"), Format::Gltf, &NoResources, &Limits::default()).expect_err("refused");
    assert!(error.message.contains("\"a.bin\""), "{error}");
}

#[test]
fn a_buffer_that_is_shorter_than_declared_is_refused() {
    let (_, mut binary) = square();
    binary.pop();
    let noting = Noting { bytes: binary, ..Noting::default() };
    let error = mesh::read(&document("a.bin"), Format::Gltf, &noting, &Limits::default()).expect_err("truncated");
    assert_eq!(error.message, "buffer 0 is truncated: it declares 60 bytes, it has 59");
}

#[test]
fn a_buffer_is_read_once() {
    let (mut document, binary) = square();
    document["buffers"][0]["uri"] = json!("a.bin");
    document["nodes"] = json!([{"mesh": 0, "children": [1]}, {"mesh": 0}]);
    let noting = Noting { bytes: binary, ..Noting::default() };
    mesh::read(document.to_string().as_bytes(), Format::Gltf, &noting, &Limits::default()).expect("a mesh");
    assert_eq!(noting.asked.borrow().len(), 1);
}

fn beside(folder: &Path, uri: &str, max_bytes: u64) -> Result<Vec<u8>> {
    let folder = folder.to_owned();
    Beside { folder }.load(uri, max_bytes)
}

#[test]
fn files_beside_the_mesh_and_nowhere_else() {
    let root = tempfile::tempdir().expect("a folder");
    let folder = root.path().join("mesh");
    std::fs::create_dir_all(folder.join("below")).expect("a folder");
    std::fs::write(folder.join("a.bin"), [1, 2, 3]).expect("a file");
    std::fs::write(folder.join("below/b.bin"), [4]).expect("a file");
    std::fs::write(root.path().join("secret.bin"), [9]).expect("a file");

    assert_eq!(beside(&folder, "a.bin", 3), Ok(vec![1, 2, 3]));
    assert_eq!(beside(&folder, "below/b.bin", 9), Ok(vec![4]));
    assert_eq!(beside(&folder, "a.bin", 2).expect_err("too large").kind, Kind::TooLarge);
    for uri in REFUSED.iter().filter(|uri| !uri.contains('%')).chain(&["missing.bin", "below", ".", "a.bin/x"]) {
        let error = beside(&folder, uri, 100).expect_err("refused");
        assert_eq!(error.kind, Kind::InvalidMesh, "{uri:?}: {error}");
        assert!(!error.message.contains(&*root.path().to_string_lossy()), "{error}");
    }
    let secret = root.path().join("secret.bin");
    assert!(beside(&folder, &secret.to_string_lossy(), 100).is_err());
}

#[cfg(unix)]
#[test]
fn links_and_pipes_lead_nowhere() {
    use std::os::unix::fs::symlink;

    let root = tempfile::tempdir().expect("a folder");
    let folder = root.path().join("mesh");
    std::fs::create_dir(&folder).expect("a folder");
    std::fs::write(folder.join("a.bin"), [1]).expect("a file");
    std::fs::write(root.path().join("secret.bin"), [9]).expect("a file");
    std::fs::create_dir(root.path().join("mesh-2")).expect("a folder");
    std::fs::write(root.path().join("mesh-2/c.bin"), [8]).expect("a file");
    symlink(root.path().join("secret.bin"), folder.join("out.bin")).expect("a link");
    symlink(root.path().join("mesh-2"), folder.join("next")).expect("a link");
    symlink("/dev/zero", folder.join("endless.bin")).expect("a link");
    symlink("a.bin", folder.join("in.bin")).expect("a link");
    symlink("loop.bin", folder.join("loop.bin")).expect("a link");
    let pipe = folder.join("pipe.bin");
    let made = std::process::Command::new("mkfifo").arg(&pipe).status();
    assert!(made.is_ok_and(|status| status.success()));

    assert_eq!(beside(&folder, "in.bin", 9), Ok(vec![1]));
    for uri in ["out.bin", "next/c.bin", "endless.bin", "pipe.bin"] {
        let error = beside(&folder, uri, 100).expect_err("refused");
        assert_eq!(error.kind, Kind::InvalidMesh, "{uri}: {error}");
    }
    assert!(beside(&folder, "loop.bin", 100).is_err());
    // a folder that is itself reached by a link is as good as any
    symlink(&folder, root.path().join("link")).expect("a link");
    assert_eq!(beside(&root.path().join("link"), "a.bin", 9), Ok(vec![1]));
}
