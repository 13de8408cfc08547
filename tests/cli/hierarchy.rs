//! Hierarchies on the command line: made, cut, written, drawn, refused.

use crate::command::Folder;
use serde_json::Value;

/// A folder with a knot and a hierarchy of it.
fn with_hierarchy(arguments: &[&str]) -> Folder {
    let folder = Folder::new();
    folder.sample("knot", 2000, "knot.obj");
    let command = ["cluster", "knot.obj", "--hierarchy", "knot.tsr", "--report", "knot.json"];
    folder.run(&[&command[..], arguments].concat()).expect_success();
    folder
}

/// What `tesserae cut` says of a cut in its report.
fn cut(folder: &Folder, clusters: u64) -> Value {
    let clusters = clusters.to_string();
    let command = ["cut", "knot.tsr", "--clusters", &clusters, "--labels", "cut.bin", "--report", "cut.json"];
    folder.run(&command).expect_success();
    folder.json("cut.json")
}

fn number(value: &Value) -> u64 {
    value.as_u64().unwrap_or_else(|| panic!("no number: {value}"))
}

fn rows(value: &Value) -> &Vec<Value> {
    value.as_array().unwrap_or_else(|| panic!("no list: {value}"))
}

fn labels(bytes: &[u8]) -> Vec<u32> {
    bytes.chunks(4).map(|word| u32::from_le_bytes(word.try_into().expect("four bytes"))).collect()
}

#[test]
fn cuts_are_the_levels_of_the_run_or_exactly_as_many_clusters_as_asked_for() {
    let folder = with_hierarchy(&["--algorithm", "pml", "--levels", "300,100"]);
    let report = folder.json("knot.json");
    let levels = rows(&report["levels"]);
    assert!(levels.iter().filter(|row| [300, 100].contains(&number(&row["clusters"]))).count() == 2, "{levels:?}");
    assert_eq!((&report["clusters"], &report["labels_sha256"]), (&1.into(), &Value::Null));
    for row in levels {
        let cut = cut(&folder, number(&row["clusters"]));
        assert_eq!((&cut["cut"], &cut["round"], &cut["energy"]), (&"exact".into(), &row["round"], &row["energy"]));
    }
    let faces = number(&report["input"]["faces"]);
    for clusters in (1..=faces).step_by(171) {
        let cut = cut(&folder, clusters);
        let labels = labels(&folder.read("cut.bin"));
        assert_eq!(labels.len() as u64, faces);
        assert_eq!(u64::from(labels.iter().max().expect("faces") + 1), clusters, "{cut}");
        assert_eq!(cut["cut"] == "exact", number(&cut["merges_on_top"]) == 0);
    }
    // the state that a run which ends there has
    for clusters in ["300", "100"] {
        let command = ["cluster", "knot.obj", "--algorithm", "pml", "--levels", "300,100", "--report", "end.json"];
        let rest = ["--clusters", clusters, "--labels", "end.bin"];
        let levels = if clusters == "300" { [&command[..4], &command[6..]].concat() } else { command.to_vec() };
        folder.run(&[&levels[..], &rest[..]].concat()).expect_success();
        let cut = cut(&folder, clusters.parse().expect("a number"));
        assert_eq!(folder.read("cut.bin"), folder.read("end.bin"), "{clusters}");
        assert_eq!(cut["labels_sha256"], folder.json("end.json")["labels_sha256"]);
    }
}

#[test]
fn what_a_cut_is_is_said_in_one_line() {
    let folder = with_hierarchy(&["--algorithm", "pml", "--clusters", "50", "--labels", "run.npy"]);
    let line = |clusters: &str| {
        let stdout = folder.run(&["cut", "knot.tsr", "-k", clusters, "--labels", "cut.npy"]).expect_success();
        String::from_utf8(stdout).expect("text")
    };
    let exact = line("50");
    assert!(
        exact.starts_with("50 clusters of ")
            && exact.contains(" × the mean), energy ")
            && exact.contains("exact: the state after round "),
        "{exact}"
    );
    assert_eq!(folder.read("cut.npy"), folder.read("run.npy"));
    let merged = line("51");
    assert!(merged.contains("merged: ") && merged.contains("cheapest merges"), "{merged}");
    assert_eq!(merged.lines().count(), 1);
    let done = folder.run(&["cut", "knot.tsr", "-k", "50", "--labels", "-"]);
    let json: Value = serde_json::from_slice(&done.stdout).expect("JSON");
    assert_eq!((&json["clusters"], &json["cut"]), (&50.into(), &"exact".into()));
    assert!(done.stderr.contains("50 clusters"), "{}", done.stderr);
    for clusters in ["49", "0", "100000"] {
        folder
            .run(&["cut", "knot.tsr", "-k", clusters, "--labels", "cut.npy"])
            .expect_failure(&["--clusters must be between the 50", clusters]);
    }
}

#[test]
fn one_step_without_optimisation_gives_nested_cuts_and_a_linkage_matrix() {
    let folder = with_hierarchy(&["--algorithm", "hr", "--linkage", "knot.npy"]);
    let report = folder.json("knot.json");
    let faces = number(&report["input"]["faces"]);
    assert_eq!(report["parameters"]["optimize"], "none");
    assert_eq!(rows(&report["levels"]).len() as u64, faces - 1);
    assert!(rows(&report["levels"]).iter().all(|row| row["moves"] == 0 && row["merges"] == 1));
    let matrix = folder.read("knot.npy");
    assert_eq!(matrix.len() as u64, 128 + 32 * (faces - 1));
    folder.run(&["cut", "knot.tsr", "--linkage", "again.npy"]).expect_success();
    assert_eq!(folder.read("again.npy"), matrix);
    cut(&folder, 40);
    let fine = labels(&folder.read("cut.bin"));
    cut(&folder, 39);
    let coarse = labels(&folder.read("cut.bin"));
    let mut pairs: Vec<(u32, u32)> = fine.into_iter().zip(coarse).collect();
    pairs.sort_unstable();
    pairs.dedup();
    assert_eq!(pairs.len(), 40, "a cluster is torn");
}

#[test]
fn json_hierarchies_are_the_same_from_the_run_and_from_the_file() {
    let folder = with_hierarchy(&["--algorithm", "pml", "--optimize", "none"]);
    let command = ["cluster", "knot.obj", "--algorithm", "pml", "--optimize", "none", "--hierarchy", "run.json"];
    let limits = ["--min-clusters", "5", "--max-clusters", "50"];
    folder.run(&command).expect_success();
    folder.run(&["cut", "knot.tsr", "--hierarchy", "cut.json"]).expect_success();
    assert_eq!(folder.read("run.json"), folder.read("cut.json"));
    let whole = folder.json("run.json");
    let faces = number(&whole["faces"]);
    assert_eq!((&whole["algorithm"], &whole["parameters"]["optimize"]), (&"pml".into(), &"none".into()));
    let nodes = rows(&whole["nodes"]);
    assert_eq!(nodes.len() as u64, faces - 1);
    assert_eq!(whole["roots"], serde_json::json!([2 * faces - 2]));
    for (nth, node) in nodes.iter().enumerate() {
        assert_eq!(number(&node["id"]), faces + nth as u64);
        let below = |child: &Value| {
            let child = number(child);
            assert!(child < number(&node["id"]));
            child.checked_sub(faces).map_or(1, |row| number(&nodes[row as usize]["faces"]))
        };
        assert_eq!(rows(&node["children"]).iter().map(below).sum::<u64>(), number(&node["faces"]), "nested");
    }
    assert_eq!(whole["levels"], folder.json("knot.json")["levels"]);

    folder.run(&[&command[..], &limits[..]].concat()).expect_success();
    let part = folder.json("run.json");
    let left: Vec<u64> = rows(&part["nodes"]).iter().map(|node| number(&node["clusters_left"])).collect();
    assert_eq!(left, (5..=50).rev().collect::<Vec<_>>());
    assert_eq!(rows(&part["roots"]).len(), 5);
}

#[test]
fn the_same_run_writes_the_same_file() {
    let files = [1, 2].map(|_| with_hierarchy(&["--algorithm", "ml", "--collapse-fraction", "10"]).read("knot.tsr"));
    assert_eq!(files[0], files[1]);
}

#[test]
fn several_pieces_make_a_forest_without_a_linkage_matrix() {
    let folder = Folder::new();
    folder.sample("parts", 600, "parts.obj");
    let command = ["cluster", "parts.obj", "--algorithm", "hr", "--hierarchy", "parts.tsr", "--report", "r.json"];
    folder.run(&command).expect_success();
    let components = number(&folder.json("r.json")["input"]["components"]);
    assert!(components > 1);
    assert_eq!(number(&folder.json("r.json")["clusters"]), components);
    for command in [
        &["cut", "parts.tsr", "--linkage", "x.npy"][..],
        &["cluster", "parts.obj", "--algorithm", "hr", "--linkage", "x.npy"],
    ] {
        folder.run(command).expect_failure(&["--bridge-components", &components.to_string()]);
    }
    assert!(!folder.files().contains(&"x.npy".to_owned()));
}

#[test]
fn wrong_flags_are_usage_errors_that_say_what_to_do() {
    let folder = Folder::new();
    let cluster = ["cluster", "none.obj"];
    for (flags, words) in [
        (&["--algorithm", "pml", "--labels", "x.npy"][..], &["tesserae cut"][..]),
        (&["-k", "5", "--hierarchy", "x.tsr"], &["--hierarchy", "bb"]),
        (&["-k", "5", "--linkage", "x.npy"], &["--linkage", "bb"]),
        (&["-k", "5", "--levels", "9"], &["levels", "bb"]),
        (&["--algorithm", "pml", "--levels", "9,x"], &["levels", "9,x"]),
        (&["--algorithm", "pml", "-k", "5", "--levels", "4"], &["levels", "4"]),
        (&["--algorithm", "pml", "--seeds", "random"], &["seeds", "pml"]),
        (&["--algorithm", "ml", "--collapse-fraction", "51"], &["--collapse-fraction", "51"]),
        (&["--algorithm", "pml", "--linkage", "x.npy"], &["--optimize none"]),
        (&["--algorithm", "hr", "-k", "5", "--linkage", "x.npy"], &["leave --clusters out"]),
        (&["--algorithm", "hr", "--linkage", "x.json"], &[".npy"]),
        (&["--algorithm", "hr", "--hierarchy", "x.npy"], &[".tsr"]),
        (&["--algorithm", "hr", "--hierarchy", "x.tsr", "--max-clusters", "5"], &["OUT.json"]),
        (
            &["--algorithm", "hr", "--hierarchy", "x.json", "--max-clusters", "5", "--min-clusters", "6"],
            &["--min-clusters", "6 and 5"],
        ),
        (&["--algorithm", "hr", "--hierarchy", "x.json", "--report", "x.json"], &["same place"]),
    ] {
        folder.run(&[&cluster[..], flags].concat()).expect_usage_error(words);
    }
    for (flags, words) in [
        (&["cut", "x.tsr", "-k", "12x"][..], &["12x", "--clusters", "must be a whole number"][..]),
        (&["cut", "x.tsr", "-k", "99999999999999999999"], &["must be a smaller number"]),
        (&["cut", "x.tsr"], &["no output is named"]),
        (&["cut", "x.tsr", "--labels", "x.npy"], &["--clusters is missing"]),
        (&["cut", "x.tsr", "-k", "3", "--labels", "-", "--report", "-"], &["same place"]),
        (&["plot", "x.svg"], &["OUT.svg"]),
        (&["plot", "r.json", "x.png"], &[".svg"]),
    ] {
        folder.run(flags).expect_usage_error(words);
    }
    assert!(folder.files().is_empty());
}

#[test]
fn files_that_are_no_hierarchies_are_refused_in_one_line() {
    let folder = with_hierarchy(&["--algorithm", "pml", "-k", "100"]);
    let good = folder.read("knot.tsr");
    let damaged_at = |at: usize| {
        let mut damaged = good.clone();
        damaged[at] ^= 1;
        damaged
    };
    let damaged = damaged_at(100);
    for (bytes, word) in [
        (&good[..good.len() - 1], "bytes"),
        (&good[..20], "ends early"),
        (b"solid knot", "no hierarchy file"),
        (&damaged, "checksum"),
    ] {
        folder.write("bad.tsr", bytes);
        folder.run(&["cut", "bad.tsr", "-k", "200", "--labels", "x.npy"]).expect_failure(&[word]);
    }
    // what no cut needs is looked at by who reads all of it
    folder.write("bad.tsr", damaged_at(good.len() - 40));
    folder.run(&["cut", "bad.tsr", "--hierarchy", "x.json"]).expect_failure(&["checksum"]);
    folder.run(&["cut", "knot.tsr", "-k", "200", "--max-faces", "99"]).expect_failure(&["limit of 99"]);
    folder.run(&["cut", "no.tsr", "-k", "200"]).expect_failure(&["no.tsr"]);
    let done = folder.run_with_input(&["cut", "-", "-k", "200", "--labels", "x.npy"], &good);
    done.expect_success();
}

#[test]
fn plots_hold_every_report() {
    let folder = with_hierarchy(&["--algorithm", "pml"]);
    folder.run(&["cluster", "knot.obj", "-k", "50", "--report", "flat.json"]).expect_success();
    folder.run(&["plot", "knot.json", "flat.json", "both.svg"]).expect_success();
    let svg = String::from_utf8(folder.read("both.svg")).expect("text");
    for word in ["knot.json (pml)", "flat.json (bb)", "clusters", "iteration", "<polyline"] {
        assert!(svg.contains(word), "{word}");
    }
    folder.run(&["plot", "knot.json", "knot.obj", "both.svg"]).expect_failure(&["knot.obj", "no report"]);
}
