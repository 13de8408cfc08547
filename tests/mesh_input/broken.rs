//! Broken files by the hundred: whatever the bytes, there is a sound mesh or an error, at once.

use proptest::prelude::*;
use serde_json::json;
use tesserae_mesh::Kind;
use tesserae_mesh::mesh::{self, Beside, Format, Limits, NoResources};

use crate::make::{check, data_uri, floats, glb, square};
use crate::ply_make::{self, ENCODINGS};
use crate::{off, stl_forms};

/// Reads the bytes as what they are not, too, and checks whatever comes of it.
fn survive(bytes: &[u8], format: Format) {
    let limits = Limits { max_bytes: 64 << 20, max_faces: 100_000, ..Limits::default() };
    for format in [format, Format::ALL[bytes.len() % Format::ALL.len()]] {
        let head = &bytes[..bytes.len().min(mesh::HEAD_BYTES)];
        let checked = format.check_head(head, Some(bytes.len() as u64));
        match mesh::read(bytes, format, &NoResources, &limits) {
            Ok(mesh) => {
                check(&mesh);
                // what is read must not have been refused before
                assert_eq!(checked, Ok(()));
            }
            Err(error) => {
                let kinds = [Kind::InvalidMesh, Kind::UnsupportedMesh, Kind::TooLarge];
                assert!(kinds.contains(&error.kind), "{error:?}");
                assert!(!error.message.is_empty() && !error.message.ends_with('.'), "{error}");
            }
        }
    }
    let _ = Format::recognise(None, bytes, Some(bytes.len() as u64));
}

/// Files of every kind, each a few hundred bytes.
fn sound() -> Vec<(Format, Vec<u8>)> {
    let text = "# mesh\no a\nv 0 0 0\nv 1.5e-1 0 0 1\r\nv 1 1 0 .5 .5 .5\nv -1 .25 0\ng b c\nvt 0 0\nvn 0 0 1\n\
                f 1/1/1 2/1/1 3//1\n\
                f -1 -2 \\\n-3\nl 1 2\ns off\nf 1 2 3 4 # quad\n";
    let (plain, binary) = square();
    let mut inline = plain.clone();
    inline["buffers"][0]["uri"] = json!(data_uri(&binary));

    let (mut rich, mut bytes) = square();
    let positions =
        meshopt::encode_vertex_buffer(&[[0f32, 1., 2.], [3., 4., 5.], [6., 7., 9.], [1., 0., 2.]]).expect("encoded");
    let indices = meshopt::encode_index_buffer(&[0, 1, 2, 0, 2, 3], 4).expect("encoded");
    bytes.extend(floats(&[1., 2., 3., 4., 5., 6.]));
    let first = bytes.len();
    bytes.extend(&positions);
    let second = bytes.len();
    bytes.extend(&indices);
    rich["buffers"] = json!([{"byteLength": bytes.len()}, {"byteLength": 60}]);
    rich["bufferViews"] = json!([
        {"buffer": 1, "byteLength": 48, "extensions": {"EXT_meshopt_compression": {
            "buffer": 0, "byteOffset": first, "byteLength": positions.len(), "byteStride": 12, "count": 4,
            "mode": "ATTRIBUTES"}}},
        {"buffer": 1, "byteLength": 12, "extensions": {"EXT_meshopt_compression": {
            "buffer": 0, "byteOffset": second, "byteLength": indices.len(), "byteStride": 2, "count": 6,
            "mode": "TRIANGLES"}}},
        {"buffer": 0, "byteOffset": 60, "byteLength": 24},
        {"buffer": 0, "byteOffset": 48, "byteLength": 12},
    ]);
    rich["accessors"].as_array_mut().expect("accessors").extend([
        json!({"bufferView": 2, "componentType": 5126, "count": 2, "type": "VEC3"}),
        json!({"count": 5, "componentType": 5126, "type": "VEC3", "sparse": {
            "count": 1, "indices": {"bufferView": 3, "componentType": 5123}, "values": {"bufferView": 2}}}),
    ]);
    rich["nodes"] = json!([
        {"mesh": 0, "children": [1], "extensions": {"EXT_mesh_gpu_instancing": {"attributes": {"TRANSLATION": 2}}}},
        {"mesh": 1, "scale": [1, 2, -3], "rotation": [0, 0.6, 0, 0.8]},
    ]);
    rich["meshes"]
        .as_array_mut()
        .expect("meshes")
        .push(json!({"primitives": [{"attributes": {"POSITION": 3}, "mode": 5}]}));
    rich["extensionsRequired"] = json!(["EXT_meshopt_compression", "EXT_mesh_gpu_instancing"]);
    let elements: Vec<ply_make::Element> = vec![
        ("edge", ply_make::properties(&["list int short ends"]), vec![vec![vec![0.0, 1.0]]]),
        ply_make::vertices(&crate::make::SQUARE),
        ply_make::faces(&[&[0, 1, 2], &[0, 1, 2, 3], &[2]]),
        ("tristrips", ply_make::properties(&["list uint int vertex_index"]), vec![vec![vec![0., 1., 2., -1., 3.]]]),
    ];
    let triangles = [[[0.0, 1.5, 2.0], [1.0, 0.0, -3.0], [0.0, 0.0, 1e-3]]; 2];
    let mut sound = vec![
        (Format::Obj, text.as_bytes().to_vec()),
        (Format::Glb, glb(&plain, &binary)),
        (Format::Gltf, inline.to_string().into_bytes()),
        (Format::Glb, glb(&rich, &bytes)),
        (Format::Stl, stl_forms::binary(b"made by a test", &triangles)),
        (Format::Stl, stl_forms::text("a", &triangles).into_bytes()),
        (Format::Off, off::TEXT.as_bytes().to_vec()),
    ];
    sound.extend(ENCODINGS.map(|encoding| (Format::Ply, ply_make::write(encoding, &elements, "\n"))));
    sound
}

/// Number of [`sound`] files.
const SOUND: usize = 10;

#[test]
fn the_sound_files_are_sound() {
    assert_eq!(sound().len(), SOUND);
    for (format, bytes) in sound() {
        let mesh = mesh::read(&bytes, format, &NoResources, &Limits::default()).expect("a mesh");
        check(&mesh);
    }
}

#[test]
fn cut_at_every_length() {
    for (format, bytes) in sound() {
        // a text may end at any line, and lose digits of its last number
        let is_text = format == Format::Obj || format != Format::Gltf && !bytes.contains(&0);
        for length in 0..bytes.len() {
            survive(&bytes[..length], format);
            if !is_text {
                let cut = mesh::read(&bytes[..length], format, &NoResources, &Limits::default());
                assert!(cut.is_err(), "{format:?} cut at {length}");
            }
        }
    }
}

#[test]
fn every_byte_flipped() {
    for (format, bytes) in sound() {
        for at in 0..bytes.len() {
            for flip in [0x01, 0x80, 0xff, 0x20] {
                let mut bytes = bytes.clone();
                bytes[at] ^= flip;
                survive(&bytes, format);
            }
        }
    }
}

/// Every number in the text replaced by others that are large, small, negative or none.
#[test]
fn every_number_replaced() {
    let numbers = [
        "0",
        "1",
        "-1",
        "3",
        "255",
        "65535",
        "65536",
        "4294967295",
        "4294967296",
        "2147483648",
        "-2147483649",
        "9223372036854775807",
        "18446744073709551615",
        "99999999999999999999999",
        "1e308",
        "1e999",
        "-0.0",
        "0.5",
        "null",
        "\"x\"",
        "[]",
        "",
    ];
    for (format, bytes) in sound() {
        let mut at = 0;
        while at < bytes.len() {
            if !bytes[at].is_ascii_digit() {
                at += 1;
                continue;
            }
            let end = at + bytes[at..].iter().take_while(|b| b.is_ascii_digit()).count();
            for number in numbers {
                let spliced = [&bytes[..at], number.as_bytes(), &bytes[end..]].concat();
                survive(&with_lengths(spliced, format), format);
            }
            at = end;
        }
    }
}

/// A GLB file whose chunk lengths fit its JSON again, as far as that can be told.
fn with_lengths(mut bytes: Vec<u8>, format: Format) -> Vec<u8> {
    if format != Format::Glb || bytes.len() < 24 {
        return bytes;
    }
    let json = bytes[20..].windows(8).position(|w| &w[4..] == b"BIN\0").unwrap_or(bytes.len() - 20);
    let total = (bytes.len() as u32).to_le_bytes();
    bytes[8..12].copy_from_slice(&total);
    bytes[12..16].copy_from_slice(&(json as u32).to_le_bytes());
    bytes
}

#[test]
fn files_of_other_kinds() {
    for bytes in [
        &b""[..],
        b"\0",
        b"glTF",
        b"glTF\x02\0\0\0\x0c\0\0\0",
        b"{}",
        b"[]",
        b"null",
        b"{\"asset\":{\"version\":\"2.0\"}}",
        b"\xff\xfe{\0",
        b"ply\nformat ascii 1.0\n",
        b"ply\r",
        b"ply\nformat ascii 1.0\nend_header",
        b"ply\nformat ascii 1.0\nelement face 1\nproperty list int int vertex_index\nend_header\n0\n",
        b"solid x\n",
        b"solid\nfacet\n",
        b"solid\nfacet\nouter",
        b"solid\nendsolid\nvertex",
        b"\x1f\x8b\x08\0",
        b"PK\x03\x04",
        b"<html>",
        b"%PDF-1.4",
        b"\x89PNG\r\n\x1a\n",
        b"f",
        b"v",
        b"f 1",
        b"\\",
        b"\\\n",
        b"v 1 2 3\\",
        b"f 1 2 3\\\r",
        b"g \\\n\\\n",
        b"\r",
        b"#",
        b"o\\",
        b"f \\\n\\\n\\",
        b"\xef\xbb\xbf",
    ] {
        for format in Format::ALL {
            survive(bytes, format);
            assert!(mesh::read(bytes, format, &NoResources, &Limits::default()).is_err());
        }
    }
}

#[test]
fn deep_and_long_inputs_take_linear_time() {
    let start = std::time::Instant::now();
    for (unit, end) in [
        ("v 0 0 0\\\n", ""),
        ("f 1 ", ""),
        ("\\\n", ""),
        ("g a\n", ""),
        ("o a\ng b\n", "v 0 0 0\nf 1 1 1"),
        ("# \\\n", ""),
        ("g #\\\n", ""),
        ("v 0 0 0\n", "f 1 1 1"),
        ("f 1 1 1\n", "v 0 0 0"),
        ("\r", ""),
        ("g a\\\n", ""),
        ("l 1 2\n", ""),
        ("v 1e", ""),
        ("1", ""),
        ("v 0 0 0\nf -1 -1 -1\n", ""),
        ("f 1 1 1\nf 1 1 1 1\n", "v 0 0 0"),
        (" ", ""),
        ("v 1 2 3 4 \\\n5", ""),
    ] {
        let text = unit.repeat(4_000_000 / unit.len()) + end;
        if let Ok(mesh) = mesh::read(text.as_bytes(), Format::Obj, &NoResources, &Limits::default()) {
            check(&mesh);
        }
        let text = format!("v {}", text);
        let _ = mesh::read(text.as_bytes(), Format::Obj, &NoResources, &Limits::default());
    }
    let list = "ply\nformat ascii 1.0\nelement face 1\nproperty list uint int vertex_index\n";
    for (format, start, unit) in [
        (Format::Ply, "ply\nformat ascii 1.0\n", "element a 1\n"),
        (Format::Ply, "ply\nformat ascii 1.0\nelement a 9\n", "property int a\n"),
        (Format::Ply, &format!("{list}element vertex 1\nproperty int x\nend_header\n"), "\n"),
        (Format::Ply, &format!("{list}end_header\n"), " \t"),
        (Format::Ply, &format!("{list}end_header\n900000000"), " 0"),
        (Format::Ply, &format!("{list}end_header\n"), "1"),
        (Format::Ply, "ply\r", "\r"),
        (Format::Stl, "solid a\n", "\n"),
        (Format::Stl, "solid a\nfacet", " "),
        (Format::Stl, "", "solid a\nfacet\n"),
        (Format::Stl, "", "solid a\nendsolid\n"),
        (Format::Stl, "solid ", "x"),
        (Format::Stl, "solid\n facet\nouter loop vertex 0 0 ", "0"),
        (Format::Stl, "solid\n", "\r"),
        (Format::Off, "", "#\n"),
        (Format::Off, "OFF", "1"),
        (Format::Off, "OFF\n", "C"),
        (Format::Off, "OFF 1 1 0\n0 0 0\n900000000", " 0"),
        (Format::Off, "OFF 1 1 0\n", "0 "),
        (Format::Off, "OFF 900000000 1 0\n", "0 0 0\n"),
    ] {
        let text = start.to_owned() + &unit.repeat(4_000_000 / unit.len());
        assert!(mesh::read(text.as_bytes(), format, &NoResources, &Limits::default()).is_err());
    }
    assert!(start.elapsed() < std::time::Duration::from_secs(60), "{:?}", start.elapsed());
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(600))]

    #[test]
    fn several_bytes_changed(
        which in 0..SOUND, changes in prop::collection::vec((any::<prop::sample::Index>(), any::<u8>()), 1..12),
    ) {
        let (format, mut bytes) = sound().swap_remove(which);
        for (at, byte) in changes {
            let at = at.index(bytes.len());
            bytes[at] = byte;
        }
        survive(&bytes, format);
    }

    #[test]
    fn pieces_moved_and_repeated(
        which in 0..SOUND, from: prop::sample::Index, length in 0usize..80, to: prop::sample::Index, is_copy: bool,
    ) {
        let (format, mut bytes) = sound().swap_remove(which);
        let from = from.index(bytes.len());
        let piece = bytes[from..(from + length).min(bytes.len())].to_vec();
        if !is_copy {
            bytes.drain(from..from + piece.len());
        }
        let to = to.index(bytes.len() + 1);
        bytes.splice(to..to, piece);
        survive(&with_lengths(bytes, format), format);
    }

    #[test]
    fn lines_of_words(lines in prop::collection::vec(
        prop::collection::vec(prop::sample::select(vec![
            "v", "f", "vn", "g", "o", "l", "curv", "#", "\\\n", "\\", "1", "-1", "2", "0", "1/2/3", "1//", "/", "1e5",
            "nan", ".", "-", "x", "\r",
        ]), 0..7), 0..12,
    )) {
        let text: Vec<String> = lines.iter().map(|words| words.join(" ")).collect();
        survive(text.join("\n").as_bytes(), Format::Obj);
        survive(format!("v 0 0 0\nv 1 0 0\nv 0 1 0\n{}", text.join("\n")).as_bytes(), Format::Obj);
    }

    #[test]
    fn any_bytes_behind_a_magic(
        magic in prop::sample::select(vec![
            &b"glTF\x02\0\0\0"[..], b"{", b"v ", b"", b"ply\n", b"solid\n", b"solid\nfacet\n",
            b"ply\nformat binary_big_endian 1.0\nelement vertex 1\nproperty char x\nproperty char y\nproperty char z\n\
              element tristrips 1\nproperty list uchar char vertex_index\nend_header\n",
            b"ply\nformat ascii 1.0\nelement vertex 1\nproperty char x\nproperty char y\nproperty char z\n\
              element face 1\nproperty list uchar char vertex_index\nend_header\n0 0 0\n",
        ]),
        bytes: Vec<u8>,
    ) {
        let bytes = [magic, &bytes].concat();
        for format in Format::ALL {
            survive(&bytes, format);
        }
    }

    #[test]
    fn no_uri_leaves_the_folder(uri in "[a-z./%\\\\:2efF0 ]{0,12}") {
        let root = tempfile::tempdir().expect("a folder");
        let folder = root.path().join("mesh");
        std::fs::create_dir(&folder).expect("a folder");
        let (mut document, _) = square();
        document["buffers"][0]["uri"] = json!(uri);
        let beside = Beside { folder };
        let read = mesh::read(document.to_string().as_bytes(), Format::Gltf, &beside, &Limits::default());
        prop_assert_eq!(read.expect_err("there is nothing to read").kind, Kind::InvalidMesh);
    }
}
