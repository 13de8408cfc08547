//! Shapes of clusters, and the part with known patches.

use serde_json::Value;

use crate::command::Folder;

fn run(folder: &Folder, command: &str) -> String {
    String::from_utf8(folder.run(&command.split(' ').collect::<Vec<_>>()).expect_success()).expect("text")
}

#[test]
fn shapes_of_a_part_are_written_alone_and_in_the_report() {
    let folder = Folder::new();
    run(&folder, "sample part --faces 1500 --truth t.npy p.obj");
    let said = run(
        &folder,
        "cluster p.obj -k 13 --energy shapes --resolution 0.001u --labels l.npy --shapes-out s.json --report r.json",
    );
    assert!(said.starts_with("13 clusters of 1,"), "{said}");
    let (shapes, report) = (folder.json("s.json"), folder.json("r.json"));
    assert_eq!(shapes, report["shapes"]);
    assert_eq!(report["parameters"]["shapes"], "plane,sphere,cylinder");
    assert_eq!(report["parameters"]["resolution"], "0.001u");
    let rows = shapes.as_array().expect("rows");
    let of = |kind: &str| rows.iter().filter(|row| row["type"] == kind && row[kind].is_object()).count();
    assert_eq!([of("plane"), of("sphere"), of("cylinder")], [7, 1, 5]);
    let faces: u64 = rows.iter().map(|row| row["faces"].as_u64().expect("a number")).sum();
    assert_eq!(faces, report["input"]["faces"].as_u64().expect("a number"));
    // a patch of the truth is a label
    let numbers = |name: &str| {
        let bytes = folder.read(name);
        let start = bytes.len() - 4 * faces as usize;
        bytes[start..].as_chunks::<4>().0.iter().map(|word| u32::from_le_bytes(*word)).collect::<Vec<_>>()
    };
    let pairs: std::collections::BTreeSet<_> = numbers("l.npy").into_iter().zip(numbers("t.npy")).collect();
    assert_eq!(pairs.len(), 13);
    // other energies have no shapes
    run(&folder, "cluster p.obj -k 13 --report c.json");
    assert_eq!(folder.json("c.json")["shapes"], Value::Null);
}

#[test]
fn a_tolerance_decides_how_many_clusters_there_are() {
    let folder = Folder::new();
    run(&folder, "sample part --faces 1500 p.obj");
    let said = run(&folder, "cluster p.obj --energy shapes --tolerance 0.01 --labels l.npy --report r.json");
    assert!(said.starts_with("13 clusters of 1,"), "{said}");
    let report = folder.json("r.json");
    assert_eq!((&report["tolerance"]["asked"], &report["parameters"]["resolution"]), (&0.01.into(), &0.001.into()));
    assert!(report["tolerance"]["largest"].as_f64() <= report["tolerance"]["length"].as_f64());
}

#[test]
fn hierarchies_have_types_cuts_and_a_linkage_matrix() {
    let folder = Folder::new();
    run(&folder, "sample part --faces 600 p.obj");
    let command = "cluster p.obj --algorithm pml --optimize none --energy shapes --hierarchy h.tsr --linkage z.npy";
    assert!(run(&folder, command).starts_with("a hierarchy of "));
    assert!(run(&folder, "cut h.tsr -k 13 --hierarchy h.json -o l.npy").starts_with("13 clusters of "));
    let nodes = folder.json("h.json")["nodes"].as_array().cloned().expect("nodes");
    for kind in ["plane", "cylinder"] {
        assert!(nodes.iter().any(|node| node["type"] == kind), "{kind}");
    }
    let said = run(&folder, "cluster p.obj --algorithm ml -k 13 --levels 40 --energy shapes --shapes-out s.json");
    assert!(said.starts_with("13 clusters of "), "{said}");
    assert_eq!(folder.json("s.json").as_array().map(Vec::len), Some(13));
}

#[test]
fn shapes_are_evaluated_beside_labels() {
    let folder = Folder::new();
    run(&folder, "sample part --faces 600 --truth t.npy p.obj");
    let done = folder.run(&["evaluate", "shapes", "p.obj", "--truth", "t.npy", "--labels", "again=t.npy"]);
    assert!(done.status == Some(0) && done.stderr.contains("CGAL is absent"), "{done:?}");
    let table = done.text();
    let rows: Vec<&str> = table.lines().filter(|row| row.contains("| 13 | 0 | 7 | 1 | 5 |")).collect();
    assert_eq!(rows.len(), 3, "{table}");
    assert!(rows.iter().any(|row| row.contains("again")), "{table}");
    folder.run(&["evaluate", "shapes", "p.obj"]).expect_usage_error(&["--truth"]);
}

#[test]
fn noise_moves_the_corners_of_the_part_alone() {
    let folder = Folder::new();
    run(&folder, "sample part --faces 1500 a.obj");
    run(&folder, "sample part --faces 1500 --noise 0.1 b.obj");
    let lines = |name: &str, start: &str| {
        let text = String::from_utf8(folder.read(name)).expect("text");
        text.lines().filter(|line| line.starts_with(start)).map(str::to_owned).collect::<Vec<_>>()
    };
    assert_eq!(lines("a.obj", "f "), lines("b.obj", "f "));
    assert_ne!(lines("a.obj", "v "), lines("b.obj", "v "));
}
