//! `tesserae bench` from outside, small.

use crate::command::Folder;
use serde_json::Value;

#[test]
fn a_gpu_is_timed_by_its_own_clock_and_its_labels_are_compared() {
    let folder = Folder::new();
    folder.sample("sphere", 600, "ball.obj");
    let command = "bench --device gpu --repeats 1 --faces 500 --mesh ball.obj:20 --json b.json --markdown b.md";
    folder.run(&command.split(' ').collect::<Vec<_>>()).expect_success();
    let bench: Value = serde_json::from_slice(&folder.read("b.json")).expect("JSON");
    assert!(bench["copy_bytes_a_second"].as_f64().is_some_and(|speed| speed > 1e6), "{bench}");
    let rows = bench["rows"].as_array().expect("rows");
    let told: Vec<(&str, u64, u64)> = rows
        .iter()
        .map(|row| {
            let number = |member: &str| row[member].as_u64().expect("a number");
            (row["algorithm"].as_str().expect("text"), number("faces"), number("clusters"))
        })
        .collect();
    assert_eq!(
        told,
        [
            ("bb", 600, 20),
            ("pml, not optimised", 600, 1),
            ("pml", 600, 1),
            ("bb, 100 faces a cluster", 500, 5),
            ("bb, 1000 faces a cluster", 500, 1),
            ("pml, not optimised", 500, 1),
            ("pml", 500, 1),
        ]
    );
    for row in rows {
        assert_eq!(row["same_as_cpu"], true, "{row}");
        let stages = row["stages"].as_array().expect("stages");
        let sum: f64 = stages.iter().filter_map(|stage| stage["milliseconds"].as_f64()).sum();
        let device = row["device"].as_f64().expect("timestamps");
        // the device's clock runs within the host's; both measure the same work
        assert!(sum > 0.0 && (sum - device).abs() < 1e-6, "{row}");
        assert!(device < 1.1 * row["cluster"].as_f64().expect("ms") + row["upload"].as_f64().expect("ms"), "{row}");
        let is_flat = row["algorithm"].as_str().is_some_and(|algorithm| algorithm.starts_with("bb"));
        assert_eq!(is_flat, row["sweep"]["share_of_copy"].as_f64().is_some_and(|share| share > 0.0), "{row}");
    }
    let dispatches = |row: usize, kernel: &str| rows[row]["kernels"][kernel]["dispatches"].as_u64().unwrap_or(0);
    let applied = dispatches(0, "BOUNDARY_APPLY") + dispatches(0, "BOUNDARY_CHAIN");
    assert!(applied > 0 && dispatches(0, "BOUNDARY_PROPOSE") == applied, "{bench}");
    assert!(dispatches(1, "MERGE_APPLY") > 0 && dispatches(1, "BOUNDARY_PROPOSE") == 0, "{bench}");

    let markdown = String::from_utf8(folder.read("b.md")).expect("text");
    assert!(markdown.contains("| ball.obj | 600 | 20 | bb |") && markdown.contains("## On the device"), "{markdown}");
    let mut cells = 0;
    for line in markdown.lines() {
        let count = line.matches('|').count();
        assert!(cells == 0 || count == 0 || count == cells, "{line}");
        cells = count;
    }
}

#[test]
fn the_cpu_is_measured_and_what_does_not_fit_is_told() {
    let folder = Folder::new();
    let said = folder.run(&["bench", "--device", "cpu", "--repeats", "1", "--faces", "500"]).expect_success();
    let said = String::from_utf8(said).expect("text");
    assert!(said.contains("| knot | 500 | 5 |") && !said.contains("On the device"), "{said}");
    let figures = ["bench", "--device", "cpu", "--repeats", "1", "--faces", "500", "--json", "-"];
    let figures: Value = serde_json::from_slice(&folder.run(&figures).expect_success()).expect("only JSON");
    assert_eq!(figures["rows"][0]["faces"], 500, "{figures}");
    folder.write("bad.obj", "f 1 2 3");
    let cases: [(&[&str], &[&str]); 5] = [
        (&["bench", "--mesh", "ball.obj"], &["FILE:K"]),
        (&["bench", "--mesh", "ball.obj:0"], &["FILE:K"]),
        (&["bench", "--faces", "7"], &["7"]),
        (&["bench", "--device", "cpu", "--adapter", "0"], &["--adapter"]),
        (&["bench", "--device", "cpu", "--json", "-", "--markdown", "-"], &["same place"]),
    ];
    for (arguments, words) in cases {
        folder.run(arguments).expect_usage_error(words);
    }
    folder.run(&["bench", "--device", "cpu", "--mesh", "no.obj:5"]).expect_failure(&["no.obj"]);
    folder.run(&["bench", "--device", "cpu", "--mesh", "bad.obj:5"]).expect_failure(&["bad.obj", "line 1"]);
}
