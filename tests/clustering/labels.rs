//! The labels of many jobs against a table of them, `labels.tsv`: a change of labels that was not meant shows.
//!
//! A row is a mesh (`sample:NAME:FACES`, or a file of the folder with real meshes), arguments of `tesserae cluster`,
//! the sha256 of the labels and the energy. Of a hierarchy without `-k`, the digest is that of all labels of the cuts
//! in [`CUTS`]. Rows of real meshes are passed over where the meshes are absent.
//!
//! `UPDATE_LABELS=1 cargo test --test clustering labels` computes the digests and energies anew, with the real meshes
//! present, and prints the energies that changed. A new row is a mesh and arguments, with or without the rest.

use std::fmt::Write;
use std::path::PathBuf;

use crate::command::Folder;
use crate::common::root;
use crate::common::zoo::shared_meshes;
use tesserae_mesh::job::labels_sha256;

/// Numbers of clusters at which whole hierarchies are cut.
const CUTS: [u64; 3] = [300, 100, 20];

/// What a row gives.
#[derive(Debug, PartialEq)]
struct Result {
    digest: String,
    energy: String,
}

fn table() -> PathBuf {
    root().join("tests/clustering/labels.tsv")
}

/// The mesh of a row; none where it is absent.
fn mesh(folder: &Folder, name: &str) -> Option<String> {
    let Some(sample) = name.strip_prefix("sample:") else {
        return shared_meshes()
            .map(|meshes| meshes.join(name))
            .filter(|path| path.is_file())
            .map(|path| path.to_str().expect("a path in UTF-8").to_owned());
    };
    let (sample, faces) = sample.split_once(':').expect("sample:NAME:FACES");
    folder.sample(sample, faces.parse().expect("a number"), "sample.glb");
    Some("sample.glb".to_owned())
}

/// Runs a row.
fn result(folder: &Folder, mesh: &str, arguments: &str) -> Result {
    let mut all = vec!["cluster", mesh, "--device", "cpu", "--report", "report.json"];
    all.extend(arguments.split(' '));
    let is_whole = arguments.contains("--algorithm") && !arguments.contains("-k ");
    if is_whole {
        all.extend(["--hierarchy", "tree.tsr"]);
    }
    folder.run(&all).expect_success();
    let report = folder.json("report.json");
    let energy = format!("{:.9e}", report["energy"]["final"].as_f64().expect("an energy"));
    let digest = if is_whole {
        let mut labels = Vec::new();
        for clusters in CUTS {
            folder.run(&["cut", "tree.tsr", "-k", &clusters.to_string(), "--labels", "labels.bin"]).expect_success();
            let bytes = folder.read("labels.bin");
            labels.extend(bytes.as_chunks().0.iter().map(|&label| u32::from_le_bytes(label)));
        }
        labels_sha256(&labels)
    } else {
        report["labels_sha256"].as_str().expect("a digest").to_owned()
    };
    Result { digest, energy }
}

#[test]
fn labels_are_those_of_the_table() {
    let is_update = std::env::var_os("UPDATE_LABELS").is_some();
    let rows = std::fs::read_to_string(table()).expect("a table");
    let folder = Folder::new();
    let (mut written, mut other, mut compared) = (String::new(), Vec::new(), 0);
    for row in rows.lines() {
        let fields: Vec<&str> = row.split('\t').collect();
        let (name, arguments) = (fields[0], fields[1]);
        let Some(mesh) = mesh(&folder, name) else {
            writeln!(written, "{row}").expect("a string");
            continue;
        };
        let now = result(&folder, &mesh, arguments);
        compared += 1;
        let known = fields.get(2..4).map(|known| Result { digest: known[0].to_owned(), energy: known[1].to_owned() });
        if known.as_ref() != Some(&now) {
            let was = known.map_or("new".to_owned(), |known| known.energy);
            other.push(format!("{name} {arguments}: energy {was} → {}", now.energy));
        }
        writeln!(written, "{name}\t{arguments}\t{}\t{}", now.digest, now.energy).expect("a string");
    }
    if is_update {
        std::fs::write(table(), written).expect("the table can be written");
        println!("{}", other.join("\n"));
        return;
    }
    assert!(
        other.is_empty(),
        "other labels (meant? UPDATE_LABELS=1 cargo test --test clustering labels):\n{}",
        other.join("\n")
    );
    assert!(compared > 10, "{compared} rows");
}

#[test]
fn one_other_label_is_another_row() {
    let folder = Folder::new();
    let mesh = mesh(&folder, "sample:knot:700").expect("a sample");
    let first = result(&folder, &mesh, "-k 20");
    assert_eq!(result(&folder, &mesh, "-k 20"), first);
    assert_ne!(result(&folder, &mesh, "-k 20 --seeds morton"), first);
}
