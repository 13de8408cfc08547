//! The most expensive inputs that are known: each is made of a number of bytes.
//!
//! Meshes are read and prepared as those of jobs are, other files are read, and requests are sent to a service.

use tesserae_mesh::dev::sample::Sample;
use tesserae_mesh::mesh::Format;

use crate::make::*;

/// Makes an input of about as many bytes.
pub type Make = fn(usize) -> Vec<u8>;

const TRIANGLE: &str = "v 0 0 0\nv 1 0 0\nv 0 1 0\n";
const FACES: &str = "property list uchar uchar vertex_indices\n";

/// Meshes.
pub const MESHES: &[(&str, Format, Make)] = &[
    ("a sound sphere", Format::Obj, |n| sample(Sample::Sphere, Format::Obj, n)),
    ("many groups", Format::Obj, |n| repeated(TRIANGLE, |i| format!("g a{i}\nf 1 2 3\n"), "", n)),
    ("two groups in turn", Format::Obj, |n| repeated(TRIANGLE, |i| format!("g {}\nf 1 2 3\n", i % 2), "", n)),
    ("many names of one group", Format::Obj, |n| {
        repeated(&format!("{TRIANGLE}g"), |i| format!(" a{i}"), "\nf 1 2 3\n", n)
    }),
    ("groups of a long object", Format::Obj, |n| {
        repeated(&format!("{TRIANGLE}o {}\n", "x".repeat(300)), |i| format!("g a{i}\nf 1 2 3\n"), "", n)
    }),
    ("many materials", Format::Obj, |n| repeated(TRIANGLE, |i| format!("usemtl a{i}\nf 1 2 3\n"), "", n)),
    ("relative indices", Format::Obj, |n| repeated(TRIANGLE, |i| format!("v {i} 0 1\nf -1 -2 -3\n"), "", n)),
    ("one long face", Format::Obj, |n| repeated(&format!("{TRIANGLE}f"), |i| format!(" {}", 1 + i % 3), "\n", n)),
    ("a face of many vertices", Format::Obj, |n| {
        halves(|i| format!("v {} {i} 0\n", i * i), "f", |i| format!(" {}", 1 + i), n)
    }),
    ("continued lines", Format::Obj, |n| repeated(&format!("{TRIANGLE}f 1"), |_| " 2 \\\n 3".to_owned(), "\n", n)),
    ("nothing but continued lines", Format::Obj, |n| repeated(TRIANGLE, |_| "\\\n".to_owned(), "\nf 1 2 3\n", n)),
    ("texture coordinates and normals", Format::Obj, |n| {
        repeated(TRIANGLE, |_| "f 1/1/1 2/2/2 3/3/3\n".to_owned(), "", n)
    }),
    ("one long number", Format::Obj, |n| repeated("v 0.", |_| "3".to_owned(), " 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n", n)),
    ("long numbers", Format::Obj, |n| {
        repeated(
            TRIANGLE,
            |_| "v 0.12345678901234567890123456789 1e-310 1.7976931348623157e308\n".to_owned(),
            "f 1 2 3\n",
            n,
        )
    }),
    ("half of a fan", Format::Obj, |n| {
        halves(|i| format!("v {i} {} 0\n", i * i), "", |i| format!("f 1 {} {}\n", i + 2, i + 3), n)
    }),
    ("one position", Format::Obj, |n| {
        halves(|_| "v 0 0 0\n".to_owned(), "", |i| format!("f {} {} {}\n", i + 1, i + 2, i + 3), n)
    }),
    ("few positions", Format::Obj, |n| {
        halves(|i| format!("v {} {} 0\n", i % 7, i % 5), "", |i| format!("f {} {} {}\n", i + 1, i + 2, i + 3), n)
    }),
    ("one face again and again", Format::Obj, |n| repeated(TRIANGLE, |_| "f 1 2 3\n".to_owned(), "", n)),
    ("one edge of all faces", Format::Obj, |n| {
        halves(|i| format!("v {i} {} 1\n", i % 9), "", |i| format!("f 1 2 {}\n", i + 3), n)
    }),
    ("empty lines", Format::Obj, |n| repeated(TRIANGLE, |_| "\n".to_owned(), "f 1 2 3\n", n)),
    ("carriage returns", Format::Obj, |n| repeated("v 0 0 0\rv 1 0 0\rv 0 1 0\r", |_| "f 1 2 3\r".to_owned(), "", n)),
    ("white space", Format::Obj, |n| repeated(TRIANGLE, |_| " ".to_owned(), "\nf 1 2 3\n", n)),
    ("unknown statements", Format::Obj, |n| repeated(TRIANGLE, |i| format!("x{i}\n"), "f 1 2 3\n", n)),
    ("comments", Format::Obj, |n| repeated(TRIANGLE, |_| "#\n".to_owned(), "f 1 2 3\n", n)),
    // V4
    ("many elements", Format::Ply, |n| ply_head("ascii", |i| format!("element e{i} 0\n"), n)),
    ("many properties", Format::Ply, |n| ply_head("ascii", |i| format!("property int p{i}\n"), n)),
    ("many comments", Format::Ply, |n| ply_head("ascii", |i| format!("comment {i}\n"), n)),
    ("no end of the header", Format::Ply, |n| repeated("ply\nformat ascii 1.0\n", |_| "comment\n".to_owned(), "", n)),
    ("faces of two bytes a corner, text", Format::Ply, |n| ply("ascii", FACES, |_| b"3 0 1 2\n".to_vec(), n)),
    ("one long face, text", Format::Ply, |n| ply_long_face(n)),
    ("skipped rows, text", Format::Ply, |n| ply_skipped("ascii", b"0\n", n)),
    ("skipped rows", Format::Ply, |n| ply_skipped("binary_little_endian", b"\0", n)),
    ("faces of four bytes", Format::Ply, |n| ply("binary_little_endian", FACES, |_| vec![3, 0, 1, 2], n)),
    ("faces without corners", Format::Ply, |n| ply("binary_little_endian", FACES, |_| vec![0], n)),
    ("faces of many lists", Format::Ply, |n| {
        let lists: String = (0..200).map(|i| format!("property list uchar uchar l{i}\n")).collect();
        ply("binary_big_endian", &(FACES.to_owned() + &lists), |_| [vec![3, 0, 1, 2], vec![0; 200]].concat(), n)
    }),
    ("one strip", Format::Ply, |n| ply_strip(n, |i| (i % 4) as u8)),
    ("one strip of restarts", Format::Ply, |n| ply_strip(n, |i| if i % 4 == 3 { 255 } else { (i % 4) as u8 })),
    ("many solids", Format::Stl, |n| repeated("", |i| format!("solid {i}\n{FACET}endsolid\n"), "", n)),
    ("empty solids", Format::Stl, |n| {
        repeated("", |_| "solid\nendsolid\n".to_owned(), &format!("solid\n{FACET}endsolid\n"), n)
    }),
    ("one long name", Format::Stl, |n| repeated("solid ", |_| "x".to_owned(), &format!("\n{FACET}endsolid\n"), n)),
    ("one facet again and again, text", Format::Stl, |n| repeated("solid\n", |_| FACET.to_owned(), "endsolid\n", n)),
    ("empty lines, text", Format::Stl, |n| repeated("solid\n", |_| "\n".to_owned(), &format!("{FACET}endsolid\n"), n)),
    ("one facet again and again", Format::Stl, |n| stl(|_| [[0.0; 3], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]], n)),
    ("one position", Format::Stl, |n| stl(|_| [[0.5; 3]; 3], n)),
    ("a fan", Format::Stl, |n| stl(|i| [[0.0; 3], [i as f32, 1.0, 0.0], [i as f32 + 1.0, 1.0, 0.0]], n)),
    ("no common vertices", Format::Stl, |n| stl(|i| [0.1, 0.2, 0.3].map(|x| [x * i as f32, i as f32, -x]), n)),
    // V1
    ("shifted positions", Format::Glb, |n| shifted(n)),
    ("a sound sphere", Format::Glb, |n| sample(Sample::Sphere, Format::Glb, n)),
    ("many parts that meet", Format::Glb, |n| sample(Sample::Parts, Format::Glb, n)),
    ("one strip", Format::Glb, |n| gltf_strip(n, 1)),
    ("placed as often as may be", Format::Glb, |n| gltf_strip(n, usize::MAX)),
    ("a fan", Format::Glb, |n| gltf_indexed(n, 6)),
    ("primitives by nodes", Format::Gltf, |n| primitives_by_nodes(n)),
    ("deep nodes", Format::Gltf, |n| {
        gltf_with(n, "nodes", |i| if i == 0 { "{\"mesh\":0}".into() } else { format!("{{\"children\":[{}]}}", i - 1) })
    }),
    ("empty nodes", Format::Gltf, |n| gltf_with(n, "nodes", |_| "{}".into())),
    ("nodes with a mesh", Format::Gltf, |n| gltf_with(n, "nodes", |_| "{\"mesh\":0}".into())),
    ("nodes with an empty mesh", Format::Gltf, |n| gltf_with(n, "nodes", |_| "{\"mesh\":1}".into())),
    ("nodes with matrices", Format::Gltf, |n| {
        gltf_with(n, "nodes", |i| format!("{{\"mesh\":0,\"matrix\":[1,0,0,0,0,1,0,0,0,0,1,0,{i},0,0,1]}}"))
    }),
    ("nodes that touch", Format::Gltf, |n| {
        gltf_with(n, "nodes", |i| format!("{{\"mesh\":0,\"translation\":[{i}e-12,0,0]}}"))
    }),
    ("nodes that touch in groups", Format::Gltf, |n| {
        // in a scene of 2,048 units, vertices lie in two groups about each place where eight cells meet
        let place = |i: usize| match i {
            0 => 2047.0,
            _ => (i / 30) as f64 + [-4.4e-4, 4.4e-4][i % 2] + (i % 30) as f64 * 1e-7,
        };
        gltf_with(n, "nodes", |i| format!("{{\"mesh\":0,\"translation\":[{:.7},0,0]}}", place(i)))
    }),
    ("names of nodes", Format::Gltf, |n| gltf_with(n, "nodes", |i| format!("{{\"mesh\":0,\"name\":\"{i}\"}}"))),
    ("many meshes", Format::Gltf, |n| {
        gltf_with(n, "meshes", |_| "{\"primitives\":[{\"attributes\":{\"POSITION\":0}}]}".into())
    }),
    ("many attributes", Format::Gltf, gltf_attributes),
    ("many accessors", Format::Gltf, |n| {
        gltf_with(n, "accessors", |_| "{\"bufferView\":0,\"componentType\":5126,\"count\":3,\"type\":\"VEC3\"}".into())
    }),
    ("many views", Format::Gltf, |n| gltf_with(n, "bufferViews", |_| "{\"buffer\":0,\"byteLength\":36}".into())),
    ("many buffers", Format::Gltf, |n| gltf_with(n, "buffers", |_| BUFFER.into())),
    ("required extensions", Format::Gltf, |n| gltf_with(n, "extensionsRequired", |i| format!("\"KHR_materials_{i}\""))),
    ("unknown members", Format::Gltf, |n| {
        repeated("{\"asset\":{\"version\":\"2.0\"}", |i| format!(",\"{i}\":0"), "}", n)
    }),
    ("deep JSON", Format::Gltf, |n| {
        repeated("{\"asset\":{\"version\":\"2.0\"},\"extras\":", |_| "[".to_owned(), "", n)
    }),
    ("deep arrays side by side", Format::Gltf, |n| {
        repeated(
            "{\"asset\":{\"version\":\"2.0\"},\"extras\":[0",
            |_| format!(",{}{}", "[".repeat(90), "]".repeat(90)),
            "]}",
            n,
        )
    }),
    ("escapes", Format::Gltf, |n| {
        repeated("{\"asset\":{\"version\":\"2.0\",\"x\":\"", |_| "\\u00e9".to_owned(), "\"}}", n)
    }),
    ("one long number", Format::Gltf, |n| {
        repeated("{\"asset\":{\"version\":\"2.0\"},\"x\":1.", |_| "3".to_owned(), "}", n)
    }),
    ("a data URI", Format::Gltf, |n| gltf_data_uri(n)),
];

/// What is read in a file that is not a mesh.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Kind {
    Hierarchy,
    Labels,
    Seeds,
    Weights,
}

/// Files that are no meshes.
pub const FILES: &[(&str, Kind, Make)] = &[
    ("one chain", Kind::Hierarchy, |n| hierarchy(n, usize::MAX, |i| (i + 1, i))),
    ("one chain, a merge a round", Kind::Hierarchy, |n| hierarchy(n, 1, |i| (i + 1, i))),
    ("one star, a merge a round", Kind::Hierarchy, |n| hierarchy(n, 1, |i| (0, i + 1))),
    ("labels of eight bytes", Kind::Labels, |n| npy("<i8", &[0; 8], n)),
    ("labels of four bytes", Kind::Labels, |n| npy("<u4", &[0; 4], n)),
    ("a list in text", Kind::Seeds, |n| repeated("", |_| "0 ".to_owned(), "", n)),
    ("a list in JSON", Kind::Seeds, |n| repeated("[0", |_| ",0".to_owned(), "]", n)),
    ("a list of numbers", Kind::Seeds, |n| npy("<u4", &[0; 4], n)),
    ("a list of white space", Kind::Seeds, |n| repeated("", |_| " ".to_owned(), "0", n)),
    ("one long word", Kind::Seeds, |n| repeated("", |_| "1".to_owned(), "", n)),
    ("weights", Kind::Weights, |n| npy("<f4", &1.0f32.to_le_bytes(), n)),
];

/// What follows the path in the target of a request, and its headers.
pub type Head = fn(usize) -> [String; 2];

fn target(text: Vec<u8>) -> [String; 2] {
    [String::from_utf8(text).expect("text"), String::new()]
}

fn header(name: &str, unit: &str, bytes: usize) -> [String; 2] {
    [String::new(), format!("{name}: {}\r\n", unit.repeat(bytes / unit.len()))]
}

/// Targets of requests, for every route.
pub const TARGETS: &[(&str, Head)] = &[
    // V2
    ("many parameters", |n| target(repeated("?a", |i| format!("&b{i:x}"), "", n))),
    ("one parameter again and again", |n| target(repeated("?a=1", |_| "&a=1".to_owned(), "", n))),
    ("empty parameters", |n| target(repeated("?", |_| "&".to_owned(), "", n))),
    ("one long value", |n| target(repeated("?clusters=", |_| "9".to_owned(), "", n))),
    ("a list", |n| target(repeated("?levels=1", |_| ",1".to_owned(), "", n))),
    ("percent signs", |n| target(repeated("?", |_| "%63".to_owned(), "=1", n))),
    ("a long path", |n| target(repeated("/", |_| "%2e/".to_owned(), "", n))),
];

/// Headers of requests, for every route.
pub const HEADERS: &[(&str, Head)] = &[
    ("media types", |n| header("Accept", "a/b;q=0.1;c=d, ", n)),
    ("commas", |n| header("Accept", ",", n)),
    ("codings", |n| header("Accept-Encoding", "gzip;q=0.1, ", n)),
    ("tags", |n| header("If-None-Match", "\"x\", ", n)),
    ("ranges", |n| header("Range", "bytes=0-1,", n)),
    ("addresses of proxies", |n| header("X-Forwarded-For", "127.0.0.1, ", n)),
    ("preferences", |n| header("Prefer", "wait=x;y=z, ", n)),
    ("digits of an event", |n| header("Last-Event-ID", "9", n)),
    ("a long key", |n| header("Idempotency-Key", "\\\"", n)),
    ("a long token", |n| header("Authorization", "Bearer ", n)),
    ("cookies", |n| header("Cookie", "a=b; ", n)),
    ("parts of a trace", |n| header("Traceparent", "00-", n)),
    ("parameters of a media type", |n| header("Content-Type", "multipart/form-data; boundary=b;", n)),
    ("many content codings", |n| header("Content-Encoding", "gzip,", n)),
    ("requested headers", |n| header("Access-Control-Request-Headers", "a,", n)),
    ("options of a connection", |n| header("Connection", "a,", n)),
    ("one hundred headers", |n| {
        let value = "x".repeat(n / 95 - 5);
        [String::new(), (0..95).map(|i| format!("X-{i}: {value}\r\n")).collect()]
    }),
];

const FORM: &str = "Content-Type: multipart/form-data; boundary=b\r\n";
const OBJ: &str = "Content-Type: model/obj\r\n";
const GZIP: &str = "Content-Type: model/obj\r\nContent-Encoding: gzip\r\n";
const ZSTD: &str = "Content-Type: model/obj\r\nContent-Encoding: zstd\r\n";
const CHUNKED: &str = "Content-Type: model/obj\r\nTransfer-Encoding: chunked\r\n";
const CHUNKED_FORM: &str = "Content-Type: multipart/form-data; boundary=b\r\nTransfer-Encoding: chunked\r\n";

fn parameters(json: Vec<u8>) -> Vec<u8> {
    part("parameters", "", &json)
}

fn carriage_returns(bytes: usize) -> Vec<u8> {
    part("mesh", "; filename=\"a.obj\"", &vec![b'\r'; bytes])
}

/// Bodies of requests for jobs, with their headers.
pub const BODIES: &[(&str, &str, Make)] = &[
    ("many buffers", FORM, |n| buffers(n, usize::MAX)),
    ("buffers of long names", FORM, |n| buffers(n, 1024)),
    ("a part again and again", FORM, |n| part("seeds", "", b"0").repeat(n / 100)),
    ("unknown parts", FORM, |n| part("x", "", b"0").repeat(n / 100)),
    ("a long name of a part", FORM, |n| part(&"x".repeat(n), "", b"")),
    ("headers of a part", FORM, |n| repeated("--b\r\n", |i| format!("x{i}: y\r\n"), "\r\n", n)),
    ("no boundary", FORM, |n| repeated("", |_| "--a\r\n".to_owned(), "", n)),
    ("nearly boundaries", FORM, |n| part("mesh", "; filename=\"a.obj\"", "\r\n--a".repeat(n / 5).as_bytes())),
    ("carriage returns", FORM, carriage_returns),
    ("members of JSON", FORM, |n| parameters(repeated("{\"a\":0", |i| format!(",\"{i}\":0"), "}", n.min(65_536)))),
    ("a member again and again", FORM, |n| {
        parameters(repeated("{\"a\":0", |_| ",\"a\":0".to_owned(), "}", n.min(65_536)))
    }),
    ("deep JSON", FORM, |n| parameters(repeated("{\"a\":", |_| "[".to_owned(), "", n.min(65_536)))),
    ("a list in JSON", FORM, |n| parameters(repeated("{\"levels\":[1", |_| ",1".to_owned(), "]}", n.min(65_536)))),
    ("outputs in JSON", FORM, |n| {
        parameters(repeated("{\"outputs\":[\"mesh\"", |_| ",\"mesh.glb\"".to_owned(), "]}", n.min(65_536)))
    }),
    ("too much JSON", FORM, |n| parameters(repeated("{\"a\":0", |i| format!(",\"{i}\":0"), "}", n))),
    ("white space", OBJ, |n| vec![b' '; n]),
    // V3
    ("gzip members", GZIP, |n| gzip(&[3, 0], 1).repeat(n / 20)),
    ("empty blocks of gzip", GZIP, |n| gzip(&[0, 0, 0, 0xff, 0xff], n / 5)),
    ("tables of gzip", GZIP, |n| gzip(&deflate_tables(), n / 47)),
    ("a long name in gzip", GZIP, |n| {
        [&[0x1f, 0x8b, 8, 8, 0, 0, 0, 0, 0, 0xff][..], &vec![b'x'; n], &[0, 3, 0, 0, 0, 0, 0, 0, 0, 0, 0]].concat()
    }),
    ("zeros by gzip", GZIP, |n| zeros_by_gzip(n)),
    ("frames of zstd", ZSTD, |n| zstd(&[], 0).repeat(n / 9)),
    ("skipped frames of zstd", ZSTD, |n| [0x50, 0x2a, 0x4d, 0x18, 0, 0, 0, 0].repeat(n / 8)),
    ("empty blocks of zstd", ZSTD, |n| zstd(&[0, 0, 0], n / 3)),
    ("repeated bytes of zstd", ZSTD, |n| zstd(&[0x0a, 0x40, 0, b' '], n / 4)),
    ("chunks of a byte", CHUNKED, |n| chunked(&vec![b' '; n / 6], 1)),
    ("chunks of seventy bytes", CHUNKED, |n| chunked(&vec![b' '; n / 76 * 70], 70)),
    ("chunks of a byte of a part's head", CHUNKED_FORM, |n| {
        chunked(format!("--b\r\nx: {}", "y".repeat(n / 6)).as_bytes(), 1)
    }),
    ("chunks of a byte before a part", CHUNKED_FORM, |n| chunked(&vec![b'y'; n / 6], 1)),
    ("chunks of a byte of a part", CHUNKED_FORM, |n| chunked(&carriage_returns(n / 6), 1)),
    ("chunks of seventy bytes of a part", CHUNKED_FORM, |n| chunked(&carriage_returns(n / 76 * 70), 70)),
];
