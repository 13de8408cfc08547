//! Names that hold control characters or a megabyte: no message, log line or problem repeats them raw or whole.

use serde_json::{Value, json};
use tesserae_mesh::mesh::{self, Format, Limits, NoResources, Source};
use tesserae_mesh::{Error, Result};

use crate::make::{glb, obj, square};

/// Forges a line of the log, reaches the terminal, turns the direction of the text.
const CONTROLS: &str = "x\n2026 ERROR forged\r\u{1b}[31m\u{7f}\u{9b}31m\u{2028}\u{2029}\u{202e}\u{2066}\u{0}";

fn names() -> [String; 3] {
    [CONTROLS.to_owned(), "n".repeat(1 << 20), CONTROLS.repeat(30_000)]
}

/// What must hold of every message.
#[track_caller]
fn check_message(message: &str, most: usize) {
    let is_obeyed = |c: char| c.is_control() || ('\u{2028}'..='\u{202e}').contains(&c) || c == '\u{2066}';
    assert!(!message.contains(is_obeyed), "{message:?}");
    assert!(message.chars().count() <= most, "{} characters: {message}", message.len());
}

/// Puts a name at a JSON pointer of a document, as a value or as a key.
fn with_name(pointer: &str, value: Value) -> Result<mesh::PolygonMesh> {
    let (mut document, binary) = square();
    let (parent, key) = pointer.rsplit_once('/').expect("a pointer");
    document.pointer_mut(parent).expect("a parent")[key] = value;
    mesh::read(&glb(&document, &binary), Format::Glb, &NoResources, &Limits::default())
}

#[test]
fn no_name_of_a_gltf_reaches_a_message_raw_or_whole() {
    for name in names() {
        let mut key = serde_json::Map::new();
        key.insert(name.clone(), json!(99));
        let key = Value::Object(key);
        let mut errors: Vec<Error> = Vec::new();
        let mut meshes = 0;
        for (pointer, value) in [
            ("/extensionsRequired", json!([name])),
            ("/extensionsUsed", json!([name])),
            ("/asset/version", json!(name)),
            ("/asset/minVersion", json!(name)),
            ("/asset/generator", json!(name)),
            ("/asset", json!(name)),
            ("/nodes/0/name", json!(name)),
            ("/nodes/0/mesh", json!(name)),
            ("/meshes/0/name", json!(name)),
            ("/meshes/0/primitives/0/mode", json!(name)),
            ("/meshes/0/primitives/0/attributes", key.clone()),
            ("/nodes/0/extensions", json!({"EXT_mesh_gpu_instancing": {"attributes": key.clone()}})),
            ("/nodes/0/extensions", json!({"EXT_mesh_gpu_instancing": {"attributes": name}})),
            ("/bufferViews/0/extensions", json!({"EXT_meshopt_compression": {"mode": name}})),
            ("/bufferViews/0/name", json!(name)),
            ("/accessors/0/type", json!(name)),
            ("/accessors/0/name", json!(name)),
            ("/materials", json!([{"name": name}])),
            ("/buffers/0/name", json!(name)),
            ("/buffers/0/uri", json!(name)),
            ("/buffers/0/uri", json!(format!("data:{name}"))),
            ("/scenes/0/nodes", json!(name)),
        ] {
            match with_name(pointer, value) {
                Ok(mesh) => {
                    meshes += 1;
                    assert!(mesh.parts.iter().all(|part| part.group.as_ref().is_none_or(|group| group.len() < 300)));
                    mesh.warnings.iter().for_each(|warning| check_message(warning, 300));
                }
                Err(error) => errors.push(error),
            }
        }
        assert!(errors.len() >= 12 && meshes >= 7, "{} {meshes}", errors.len());
        for error in &errors {
            check_message(&error.message, 2500);
        }
        // and the attribute that the caller names
        let (document, binary) = square();
        let read = |format, bytes: &[u8]| {
            let limits = Limits::default();
            let source = Source { attribute: Some(&name), ..Source::new(bytes, format, &NoResources, &limits) };
            mesh::open(source, |opened| opened.read()).flatten()
        };
        check_message(&read(Format::Glb, &glb(&document, &binary)).expect_err("no attribute").message, 2500);
        check_message(&read(Format::Obj, b"v 0 0 0\nf 1 1 1\n").expect_err("no attribute").message, 2500);
    }
}

#[test]
fn no_word_of_an_obj_reaches_a_message_raw_or_whole() {
    // line feeds end a statement and blanks a word
    let word: String = CONTROLS.replace(['\n', '\r', ' '], "_");
    for name in [word.clone(), "n".repeat(1 << 20), word.repeat(30_000)] {
        for text in [
            format!("v 0 0 {name}\n"),
            format!("v 0 0 0\nf 1 1 {name}\n"),
            format!("v 0 0 0\nf 1 1 1/{name}\n"),
            format!("v 0 0 0\nf 1 1 {}\n", "1".repeat(1 << 20)),
            format!("v 0 0 1e{}\n", "9".repeat(1 << 20)),
            format!("o {name}\ng {name}\nusemtl {name}\n{name}\nv 0 0 0\n"),
        ] {
            let text = if text.contains('\0') { text.replace('\0', "\u{1}") } else { text };
            check_message(&obj(&text).expect_err("refused").message, 2500);
        }
        let mesh = obj(format!("o {name}\ng {name}\nv 0 0 0\nf 1 1 1\n").replace('\0', "\u{1}")).expect("a mesh");
        assert!(mesh.parts[0].group.as_ref().is_some_and(|group| group.len() < 600));
    }
}
