//! A tree that is small enough to be followed by hand.

use serde_json::{Value, json};

use super::json::Limits;
use super::stored::{Header, Stored};
use super::*;

fn merge(into: u32, from: u32, cost: f64, faces: u32) -> Merge {
    let made =
        Merged { cost, energy: 2.0 * cost, faces, weight: f64::from(faces), proxy: [0.0, 0.5, 1.0], shape: None };
    Merge { into, from, made }
}

fn round(clusters: u32, merges_end: u32, moves_end: u64, energy: f64) -> Round {
    Round { clusters, energy, merges_end, moves_end }
}

/// Seven faces. Round 1 merges 0+1, 2+3 and 4+5; face 5 goes to cluster 2. Round 2 merges 2+6 and 0+4. Round 3 the
/// rest.
pub(super) fn small() -> Stored {
    let tree = Tree {
        faces: 7,
        merges: vec![
            merge(0, 1, 1.0, 2),
            merge(2, 3, 2.0, 2),
            merge(4, 5, 3.0, 2),
            merge(2, 6, 2.5, 4),
            merge(0, 4, 4.0, 3),
            merge(2, 0, 3.5, 7),
        ],
        moves: vec![FaceMove { face: 5, to: 2 }],
        rounds: vec![round(4, 3, 1, 5.5), round(2, 5, 1, 12.0), round(1, 6, 1, 15.5)],
    };
    let header = Header {
        version: "0.1.0".into(),
        algorithm: "pml".into(),
        parameters: Default::default(),
        input: json!({"format": "obj", "vertices": 9, "faces": 7, "components": 1}),
    };
    Stored { header, mask: None, tree }
}

/// The same without the move.
fn nested() -> Stored {
    let mut stored = small();
    stored.tree.moves.clear();
    stored.tree.rounds.iter_mut().for_each(|round| round.moves_end = 0);
    stored
}

fn json_of(stored: &Stored, limits: Limits) -> Value {
    let mut out = Vec::new();
    stored.write_json(&mut out, limits).expect("a vector takes everything");
    serde_json::from_slice(&out).expect("JSON")
}

#[test]
fn cuts_are_states_of_the_run_or_the_cheapest_merges_on_top() {
    let tree = small().tree;
    for (clusters, labels, kind, energy) in [
        (7, [0, 1, 2, 3, 4, 5, 6], "exact", 0.0),
        (6, [0, 0, 1, 2, 3, 4, 5], "merged", 1.0),
        (5, [0, 0, 1, 1, 2, 3, 4], "merged", 3.0),
        (4, [0, 0, 1, 1, 2, 1, 3], "exact", 5.5),
        (3, [0, 0, 1, 1, 2, 1, 1], "merged", 8.0),
        (2, [0, 0, 1, 1, 0, 1, 1], "exact", 12.0),
        (1, [0; 7], "exact", 15.5),
    ] {
        let cut = tree.labels_at(clusters).expect("within the tree");
        assert_eq!((cut.labels.as_slice(), cut.kind(), cut.energy), (&labels[..], kind, energy), "{clusters}");
        assert_eq!(cut.clusters(), clusters);
    }
    for clusters in [0, 8, u64::MAX] {
        let error = tree.labels_at(clusters).expect_err("outside");
        assert!(error.message.contains("between the 1 ") && error.message.contains("the 7 "), "{error}");
    }
}

#[test]
fn json_lists_what_was_asked_for() {
    let whole = json_of(&small(), Limits::default());
    assert_eq!(whole["faces"], 7);
    assert_eq!(whole["levels"][1], json!({"round": 2, "clusters": 2, "energy": 12.0, "merges": 2, "moves": 0}));
    let ids: Vec<u64> =
        whole["nodes"].as_array().expect("a list").iter().filter_map(|node| node["id"].as_u64()).collect();
    assert_eq!(ids, [7, 8, 9, 10, 11, 12]);
    assert_eq!(
        whole["nodes"][3],
        json!({"id": 10, "children": [8, 6], "round": 2, "clusters_left": 3, "cost": 2.5, "energy": 5.0, "faces": 4,
               "weight": 4.0, "proxy": [0.0, 0.5, 1.0]})
    );
    assert_eq!(whole["nodes"][5]["children"], json!([10, 11]));
    assert_eq!(whole["roots"], json!([12]));

    let part = json_of(&small(), Limits { min_clusters: Some(2), max_clusters: Some(4), ..Limits::default() });
    let left: Vec<u64> =
        part["nodes"].as_array().expect("a list").iter().filter_map(|node| node["clusters_left"].as_u64()).collect();
    assert_eq!(left, [4, 3, 2]);
    assert_eq!(part["levels"].as_array().map(Vec::len), Some(2));
    assert_eq!(part["roots"], json!([10, 11]));
    let none = json_of(&small(), Limits { min_clusters: Some(100), ..Limits::default() });
    assert_eq!(
        (&none["nodes"], &none["levels"], &none["roots"]),
        (&json!([]), &json!([]), &json!([0, 1, 2, 3, 4, 5, 6]))
    );
}

#[test]
fn the_clusters_of_a_cut_are_nodes_in_the_order_of_their_labels() {
    for (clusters, nodes, parents) in [
        (7, json!([0, 1, 2, 3, 4, 5, 6]), json!([7, 7, 8, 8, 9, 9, 10])),
        // face 5 moves to the cluster of 2 and 3 at the end of round 1
        (5, json!([7, 8, 4, 5, 6]), json!([11, 10, 9, 9, 10])),
        (4, json!([7, 8, 9, 6]), json!([11, 10, 11, 10])),
        (2, json!([11, 10]), json!([12, 12])),
        (1, json!([12]), json!([null])),
    ] {
        let limits = Limits { max_clusters: Some(0), clusters: Some(clusters), ..Limits::default() };
        let json = json_of(&small(), limits);
        assert_eq!(json["cut"], json!({"nodes": nodes, "parents": parents}), "{clusters}");
        assert_eq!(json["nodes"], json!([]));
    }
    assert_eq!(json_of(&small(), Limits::default()).get("cut"), None);
}

#[test]
fn numbers_that_json_has_not_become_null() {
    let mut stored = small();
    stored.tree.merges[0].made.cost = f64::INFINITY;
    stored.tree.rounds[0].energy = f64::NAN;
    let json = json_of(&stored, Limits::default());
    assert_eq!((&json["nodes"][0]["cost"], &json["levels"][0]["energy"]), (&Value::Null, &Value::Null));
}

/// Counts bytes and the largest piece.
#[derive(Default)]
struct Counting {
    bytes: usize,
    largest: usize,
}

impl std::io::Write for Counting {
    fn write(&mut self, bytes: &[u8]) -> std::io::Result<usize> {
        self.bytes += bytes.len();
        self.largest = self.largest.max(bytes.len());
        Ok(bytes.len())
    }

    fn flush(&mut self) -> std::io::Result<()> {
        Ok(())
    }
}

#[test]
fn large_hierarchies_are_written_piece_by_piece() {
    let faces = 200_000;
    let merges: Vec<Merge> = (1..faces).map(|face| merge(0, face, f64::from(face), face + 1)).collect();
    let rounds = (1..faces).map(|end| round(faces - end, end, 0, f64::from(end))).collect();
    let stored = Stored { tree: Tree { faces, merges, moves: Vec::new(), rounds }, ..small() };
    let mut json = Counting::default();
    stored.write_json(&mut json, Limits::default()).expect("it takes everything");
    assert!(json.bytes > 20_000_000 && json.largest < 100, "{} bytes, {} at once", json.bytes, json.largest);
    let mut file = Counting::default();
    stored.write(&mut file).expect("it takes everything");
    assert!(file.bytes > 10_000_000 && file.largest < 200_000, "{} bytes, {} at once", file.bytes, file.largest);
}

#[test]
fn rows_of_the_linkage_matrix_rise_with_children_before_parents() {
    let rows: Vec<[f64; 4]> = nested().linkage().expect("nested").rows().collect();
    let root = |cost: f64| (2.0 * cost).sqrt();
    assert_eq!(
        rows,
        [
            [0.0, 1.0, root(1.0), 2.0],
            [2.0, 3.0, root(2.0), 2.0],
            [6.0, 8.0, root(2.5), 3.0],
            [4.0, 5.0, root(3.0), 2.0],
            [7.0, 10.0, root(4.0), 4.0],
            // inverts: 3.5 above 4
            [9.0, 11.0, root(4.0), 7.0],
        ]
    );
}

#[test]
fn trees_without_a_linkage_matrix_say_what_to_ask_for() {
    let message = |stored: &Stored| stored.linkage().expect_err("none").message;
    assert!(message(&small()).contains("optimize=none"));
    let mut early = nested();
    early.tree.merges.pop();
    early.tree.rounds.pop();
    assert!(message(&early).contains("leave clusters out"));
    early.header.input["components"] = json!(2);
    assert!(message(&early).contains("bridge_components"));
    early.header.parameters.insert("features".into(), json!("30"));
    assert!(message(&early).contains("regions") && message(&early).contains("leave features out"));
    let single = Stored { tree: Tree { faces: 1, ..Tree::default() }, ..small() };
    assert!(message(&single).contains("two faces"));
}
