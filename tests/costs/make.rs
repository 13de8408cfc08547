//! Builders of inputs.

use std::io::{Read as _, Write as _};

use tesserae_mesh::dev::sample::{self, Sample};
use tesserae_mesh::energy::Merged;
use tesserae_mesh::hierarchy::stored::{Header, Stored};
use tesserae_mesh::hierarchy::{Merge, Round, Tree};
use tesserae_mesh::mesh::{self, Format, Limits, NoResources};

/// A facet of an STL text.
pub const FACET: &str = "facet normal 0 0 1\nouter loop\nvertex 0 0 0\nvertex 1 0 0\nvertex 0 1 0\nendloop\nendfacet\n";

/// What is not the head of an input, which has the rest: in proportion to the bytes, as times are to be.
fn payload(bytes: usize) -> usize {
    bytes / 6 * 5
}

/// A head, as many units as there is room for, and a tail.
pub fn repeated(head: &str, unit: impl Fn(usize) -> String, tail: &str, bytes: usize) -> Vec<u8> {
    let mut text = head.to_owned();
    let room = bytes.saturating_sub(tail.len());
    let mut next = unit(0);
    for number in 1.. {
        if text.len() + next.len() > room {
            break;
        }
        text += &next;
        next = unit(number);
    }
    (text + tail).into_bytes()
}

/// Units that fill half of the bytes, and as many others behind a word.
pub fn halves(
    first: impl Fn(usize) -> String,
    between: &str,
    second: impl Fn(usize) -> String,
    bytes: usize,
) -> Vec<u8> {
    let mut text = String::new();
    let mut count = 0;
    while text.len() < bytes / 2 {
        text += &first(count);
        count += 1;
    }
    text += between;
    (0..count.saturating_sub(3)).for_each(|number| text += &second(number));
    text.into_bytes()
}

/// The largest sample that fits.
pub fn sample(kind: Sample, format: Format, bytes: usize) -> Vec<u8> {
    let made = |faces: u64| {
        let mesh = sample::generate(kind, faces).expect("a sample");
        let mut file = Vec::new();
        match format {
            Format::Glb => sample::write_glb(&mut file, &mesh),
            _ => sample::write_obj(&mut file, &mesh),
        }
        .expect("a vector takes everything");
        file
    };
    let few = 2000;
    made(few * bytes as u64 / made(few).len() as u64)
}

/// A sphere as GLB with four bytes too much in its positions, as a wrong stride makes.
pub fn shifted(bytes: usize) -> Vec<u8> {
    let mut file = sample(Sample::Sphere, Format::Glb, bytes);
    let json = u32::from_le_bytes([file[12], file[13], file[14], file[15]]) as usize;
    let mesh = mesh::read(&file, Format::Glb, &NoResources, &Limits::default()).expect("a sphere");
    let positions = 28 + json;
    let end = positions + 12 * mesh.positions.len();
    file.copy_within(positions..end - 4, positions + 4);
    file[positions..positions + 4].fill(0);
    file
}

/// A header of a PLY whose elements and properties take the bytes.
pub fn ply_head(format: &str, unit: impl Fn(usize) -> String, bytes: usize) -> Vec<u8> {
    let head = format!(
        "ply\nformat {format} 1.0\nelement vertex 3\nproperty float x\nproperty float y\nproperty float z\n\
         element face 1\nproperty list uchar int vertex_indices\n"
    );
    repeated(&head, unit, "end_header\n0 0 0\n1 0 0\n0 1 0\n3 0 1 2\n", bytes.min(1 << 20))
}

/// A PLY with three vertices whose faces take the bytes.
pub fn ply(format: &str, properties: &str, face: impl Fn(usize) -> Vec<u8>, bytes: usize) -> Vec<u8> {
    ply_rows(format, ["face", properties, ""], 4, &face, bytes)
}

/// A PLY whose rows of one element take the bytes, with some vertices before them and something behind them.
fn ply_rows(
    format: &str,
    [element, properties, more]: [&str; 3],
    vertices: usize,
    row: &dyn Fn(usize) -> Vec<u8>,
    bytes: usize,
) -> Vec<u8> {
    let mut rows = Vec::new();
    let mut count = 0;
    while rows.len() < payload(bytes) {
        rows.extend(row(count));
        count += 1;
    }
    let head = format!(
        "ply\nformat {format} 1.0\nelement vertex {vertices}\nproperty float x\nproperty float y\nproperty float z\n\
         element {element} {count}\n{properties}{more}end_header\n"
    );
    let mut file = head.into_bytes();
    for vertex in 0..vertices {
        let place = [(vertex % 2) as f32, (vertex / 2) as f32, (vertex * vertex) as f32];
        match format {
            "ascii" => writeln!(file, "{} {} {}", place[0], place[1], place[2]).expect("a vector takes everything"),
            "binary_big_endian" => file.extend(place.iter().flat_map(|x| x.to_be_bytes())),
            _ => file.extend(place.iter().flat_map(|x| x.to_le_bytes())),
        }
    }
    file.extend(rows);
    file
}

/// A PLY text with one face, whose corners take the bytes.
pub fn ply_long_face(bytes: usize) -> Vec<u8> {
    let corners = payload(bytes) / 2;
    let face = format!("{corners}{}\n", " 0 1 2".repeat(corners / 3 + 1).split_at(2 * corners).0);
    ply_rows("ascii", ["face", "property list uint uchar vertex_indices\n", ""], 4, &|_| face.clone().into_bytes(), 601)
}

/// A PLY whose rows are of an element that is not read, and a face.
pub fn ply_skipped(format: &str, row: &[u8], bytes: usize) -> Vec<u8> {
    let face: &[u8] = if format == "ascii" { b"3 0 1 2\n" } else { &[3, 0, 1, 2] };
    let more = "element face 1\nproperty list uchar uchar vertex_indices\n";
    let mut file = ply_rows(format, ["other", "property uchar a\n", more], 4, &|_| row.to_vec(), bytes);
    file.extend(face);
    file
}

/// A PLY with one strip of one byte a corner.
pub fn ply_strip(bytes: usize, corner: impl Fn(usize) -> u8) -> Vec<u8> {
    let corners = payload(bytes);
    let strip = [&(corners as u32).to_le_bytes()[..], &(0..corners).map(corner).collect::<Vec<_>>()].concat();
    let properties = "property list uint char vertex_indices\n";
    ply_rows("binary_little_endian", ["tristrips", properties, ""], 4, &|_| strip.clone(), 601)
}

/// A binary STL.
pub fn stl(facet: impl Fn(usize) -> [[f32; 3]; 3], bytes: usize) -> Vec<u8> {
    let count = bytes.saturating_sub(84) / 50;
    let mut file = vec![0; 80];
    file.extend((count as u32).to_le_bytes());
    for number in 0..count {
        file.extend([0; 12]);
        file.extend(facet(number).as_flattened().iter().flat_map(|x| x.to_le_bytes()));
        file.extend([0; 2]);
    }
    file
}

/// A GLB of a JSON and a binary chunk.
fn glb(json: &str, binary: &[u8]) -> Vec<u8> {
    let padded = |bytes: &[u8], with: u8| {
        let mut bytes = bytes.to_vec();
        bytes.resize(bytes.len().next_multiple_of(4), with);
        bytes
    };
    let (json, binary) = (padded(json.as_bytes(), b' '), padded(binary, 0));
    let mut file = b"glTF\x02\0\0\0".to_vec();
    file.extend(((28 + json.len() + binary.len()) as u32).to_le_bytes());
    for (kind, chunk) in [(b"JSON", &json), (b"BIN\0", &binary)] {
        file.extend((chunk.len() as u32).to_le_bytes());
        file.extend(kind);
        file.extend(chunk);
    }
    file
}

/// The JSON of a glTF with a primitive of some vertices and indices, which a buffer without a URI has.
fn document(vertices: usize, width: usize, indices: usize, mode: u32, nodes: usize) -> String {
    let (positions, component) = (12 * vertices, [0, 5121, 5123, 0, 5125][width]);
    let length = positions + width * indices;
    let nodes = vec!["{\"mesh\":0}"; nodes].join(",");
    format!(
        "{{\"asset\":{{\"version\":\"2.0\"}},\"nodes\":[{nodes}],\"meshes\":[{{\"primitives\":[{{\"attributes\":\
         {{\"POSITION\":0}},\"indices\":1,\"mode\":{mode}}}]}}],\"accessors\":[{{\"bufferView\":0,\
         \"componentType\":5126,\
         \"count\":{vertices},\"type\":\"VEC3\"}},{{\"bufferView\":1,\"componentType\":{component},\"count\":{indices},\
         \"type\":\"SCALAR\"}}],\"bufferViews\":[{{\"buffer\":0,\"byteLength\":{positions}}},{{\"buffer\":0,\
         \"byteOffset\":{positions},\"byteLength\":{}}}],\"buffers\":[{{\"byteLength\":{length}}}]}}",
        width * indices
    )
}

fn positions(vertices: usize) -> impl Iterator<Item = u8> {
    (0..vertices).flat_map(|i| [i as f32, (i * i) as f32, (i % 3) as f32]).flat_map(f32::to_le_bytes)
}

/// A GLB with one strip of one byte an index, at some places or as many as may be.
pub fn gltf_strip(bytes: usize, places: usize) -> Vec<u8> {
    let indices = payload(bytes);
    let places = places.min((2 * bytes + (1 << 19)) / indices);
    let binary: Vec<u8> = positions(4).chain((0..indices).map(|i| (i % 4) as u8)).collect();
    glb(&document(4, 1, indices, 5, places), &binary)
}

/// A GLB with one fan.
pub fn gltf_indexed(bytes: usize, mode: u32) -> Vec<u8> {
    let count = payload(bytes) / 16;
    let binary: Vec<u8> = positions(count).chain((0..count as u32).flat_map(u32::to_le_bytes)).collect();
    glb(&document(count, 4, count, mode, 1), &binary)
}

/// A buffer that has the vertices of a triangle.
pub const BUFFER: &str =
    "{\"byteLength\":36,\"uri\":\"data:;base64,AAAAAAAAAAAAAAAAAACAPwAAAAAAAAAAAAAAAAAAgD8AAAAA\"}";

/// A glTF with a triangle, up to the value of one of its members, which comes last.
fn gltf_up_to(member: &str) -> String {
    let meshes = "[{\"primitives\":[{\"attributes\":{\"POSITION\":0}}]},{\"primitives\":[]}]";
    let accessors = "[{\"bufferView\":0,\"componentType\":5126,\"count\":3,\"type\":\"VEC3\"}]";
    let mut text = "{\"asset\":{\"version\":\"2.0\"}".to_owned();
    for (name, value) in [
        ("nodes", "[{\"mesh\":0}]"),
        ("meshes", meshes),
        ("accessors", accessors),
        ("bufferViews", "[{\"buffer\":0,\"byteLength\":36}]"),
        ("buffers", &format!("[{BUFFER}]")),
    ] {
        if name != member {
            text += &format!(",\"{name}\":{value}");
        }
    }
    text + &format!(",\"{member}\":")
}

/// A glTF with a triangle, one of whose members, an array, takes the bytes.
pub fn gltf_with(bytes: usize, member: &str, item: impl Fn(usize) -> String) -> Vec<u8> {
    let head = gltf_up_to(member) + "[" + &item(0);
    repeated(&head, |number| format!(",{}", item(number + 1)), "]}", bytes)
}

/// A glTF with a primitive of very many attributes.
pub fn gltf_attributes(bytes: usize) -> Vec<u8> {
    let head = gltf_up_to("meshes") + "[{\"primitives\":[{\"attributes\":{\"POSITION\":0";
    repeated(&head, |number| format!(",\"_{number}\":0"), "}}]}]}", bytes)
}

/// A glTF with very many primitives of one mesh, which very many nodes place.
pub fn primitives_by_nodes(bytes: usize) -> Vec<u8> {
    let primitive = "{\"attributes\":{\"POSITION\":0}}";
    let primitives = vec![primitive; bytes / 2 / (primitive.len() + 1)].join(",");
    let nodes = vec!["{\"mesh\":0}"; bytes / 2 / 11].join(",");
    let head = gltf_up_to("meshes").replace("[{\"mesh\":0}]", &format!("[{nodes}]"));
    format!("{head}[{{\"primitives\":[{primitives}]}}]}}").into_bytes()
}

/// A glTF whose buffer is a data URI.
pub fn gltf_data_uri(bytes: usize) -> Vec<u8> {
    let vertices = payload(bytes) / 16 / 3 * 3;
    let head = gltf_up_to("buffers")
        .replace("\"count\":3", &format!("\"count\":{vertices}"))
        .replace("\"byteLength\":36", &format!("\"byteLength\":{}", 12 * vertices));
    let data = "AACAPwAAAEAAAEBA".repeat(vertices);
    format!("{head}[{{\"byteLength\":{},\"uri\":\"data:;base64,{data}\"}}]}}", 12 * vertices).into_bytes()
}

/// A NumPy file of one dimension.
pub fn npy(kind: &str, value: &[u8], bytes: usize) -> Vec<u8> {
    let count = bytes.saturating_sub(200) / value.len();
    let header = format!("{{'descr': '{kind}', 'fortran_order': False, 'shape': ({count},), }}\n");
    let mut file = b"\x93NUMPY\x01\0".to_vec();
    file.extend((header.len() as u16).to_le_bytes());
    file.extend(header.as_bytes());
    (0..count).for_each(|_| file.extend(value));
    file
}

/// A hierarchy that takes the bytes: of each merge `(into, from)`, with so many merges a round.
pub fn hierarchy(bytes: usize, a_round: usize, merge: impl Fn(u32) -> (u32, u32)) -> Vec<u8> {
    let faces = (bytes / (60 + 8 + 32 / a_round)) as u32;
    let merges: Vec<Merge> = (0..faces - 1)
        .map(|number| {
            let (into, from) = merge(number);
            let made = Merged { cost: 1.0, energy: 1.0, faces: 2, weight: 1.0, proxy: [0.0; 3], shape: None };
            Merge { into, from, made }
        })
        .collect();
    let rounds = (1..=merges.len().div_ceil(a_round))
        .map(|round| {
            let merges_end = (round * a_round).min(merges.len()) as u32;
            Round { clusters: faces - merges_end, energy: 1.0, merges_end, moves_end: 0 }
        })
        .collect();
    let header = Header {
        version: "0.1.0".to_owned(),
        algorithm: "hr".to_owned(),
        parameters: serde_json::Map::new(),
        input: serde_json::Value::Null,
    };
    let mut file = Vec::new();
    let stored = Stored { header, mask: None, tree: Tree { faces, merges, moves: Vec::new(), rounds } };
    stored.write(&mut file).expect("a vector takes everything");
    file
}

/// A part of a form with the boundary `b`.
pub fn part(name: &str, more: &str, content: &[u8]) -> Vec<u8> {
    let head = format!("--b\r\nContent-Disposition: form-data; name=\"{name}\"{more}\r\n\r\n");
    [head.as_bytes(), content, b"\r\n"].concat()
}

/// Parts with buffers, as many as fit or at most so many, whose names take the bytes and differ at their ends.
pub fn buffers(bytes: usize, most: usize) -> Vec<u8> {
    let count = most.min(bytes / 90);
    let long = "x".repeat((bytes / count).saturating_sub(90));
    (0..count).flat_map(|number| part("buffer", &format!("; filename=\"{long}{number}\""), b"")).collect()
}

/// A gzip member of nothing, of these blocks some times over.
pub fn gzip(blocks: &[u8], times: usize) -> Vec<u8> {
    let head = [0x1f, 0x8b, 8, 0, 0, 0, 0, 0, 0, 0xff];
    let end: &[u8] = if blocks == [3, 0] { &[] } else { &[3, 0] };
    [&head[..], &blocks.repeat(times), end, &[0; 8]].concat()
}

/// Four blocks of deflate, which take whole bytes, with nothing in them but their own codes (RFC 1951 §3.2.7).
pub fn deflate_tables() -> Vec<u8> {
    let mut bits = Vec::new();
    let mut put = |value: u32, count: u32| bits.extend((0..count).map(|bit| value >> bit & 1 == 1));
    for _ in 0..4 {
        // not the last, with codes of its own: for 257 literals and lengths, 1 distance, of 18 lengths
        [(0, 1), (2, 2), (0, 5), (0, 5), (14, 4)].into_iter().for_each(|(value, count)| put(value, count));
        // lengths of the codes for 16, 17, 18, 0, …, 1: one bit for 18, two for 0 and 1
        for at in 0..18 {
            put(
                match at {
                    2 => 1,
                    3 | 17 => 2,
                    _ => 0,
                },
                3,
            );
        }
        // codes: 18 is 0, 0 is 10, 1 is 11; the first literal and the end of the block have one bit each
        [(3, 2), (0, 1), (127, 7), (0, 1), (106, 7), (3, 2), (1, 2)]
            .into_iter()
            .for_each(|(value, count)| put(value, count));
        // the end of the block
        put(1, 1);
    }
    assert_eq!(bits.len() % 8, 0);
    bits.chunks(8).map(|byte| byte.iter().rev().fold(0, |value, &bit| value << 1 | u8::from(bit))).collect()
}

/// A gzip member of zeros, which are a thousand times as many.
pub fn zeros_by_gzip(bytes: usize) -> Vec<u8> {
    let mut encoder = flate2::write::GzEncoder::new(Vec::new(), flate2::Compression::best());
    std::io::copy(&mut std::io::repeat(0).take(1000 * bytes as u64), &mut encoder).expect("a vector takes everything");
    encoder.finish().expect("a vector takes everything")
}

/// A zstd frame of these blocks some times over (RFC 8878 §3.1.1).
pub fn zstd(blocks: &[u8], times: usize) -> Vec<u8> {
    [&[0x28, 0xb5, 0x2f, 0xfd, 0, 0x58][..], &blocks.repeat(times), &[1, 0, 0]].concat()
}

/// A content in chunks of some bytes each.
pub fn chunked(content: &[u8], bytes: usize) -> Vec<u8> {
    let chunk = |chunk: &[u8]| [format!("{:x}\r\n", chunk.len()).as_bytes(), chunk, b"\r\n"].concat();
    content.chunks(bytes).flat_map(chunk).chain(*b"0\r\n\r\n").collect()
}
