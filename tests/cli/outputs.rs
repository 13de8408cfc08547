//! `-o`, several meshes and several numbers of clusters, compressed meshes, and what is said about results.

use std::io::Write;

use flate2::Compression;
use flate2::write::GzEncoder;

use crate::command::Folder;

/// Runs a command line whose words have no blanks.
fn run(folder: &Folder, command: &str) -> String {
    let stdout = folder.run(&command.split(' ').collect::<Vec<_>>()).expect_success();
    String::from_utf8(stdout).expect("text")
}

fn packed(bytes: &[u8]) -> Vec<u8> {
    let mut encoder = GzEncoder::new(Vec::new(), Compression::default());
    encoder.write_all(bytes).expect("a vector takes everything");
    encoder.finish().expect("a vector takes everything")
}

#[test]
fn the_extension_says_what_is_written() {
    let folder = Folder::new();
    folder.sample("quads", 400, "q.obj");
    run(&folder, "cluster q.obj -k 7 --labels f.npy --mesh f.glb --submeshes f.stl.zip --clusters-graph f.graphml");
    run(&folder, "cluster q.obj -k 7 -o o.npy -o o.glb -o o.stl.zip -o o.graphml -o o.json -o o.txt -o o.csv");
    for extension in ["npy", "glb", "stl.zip", "graphml"] {
        assert_eq!(folder.read(&format!("f.{extension}")), folder.read(&format!("o.{extension}")), "{extension}");
    }
    let report = folder.json("o.json");
    assert_eq!((&report["clusters"], report["algorithm"].as_str()), (&7.into(), Some("bb")));
    let text = String::from_utf8(folder.read("o.txt")).expect("text");
    let numbers: Vec<u32> = text.lines().map(|line| line.parse().expect("a number")).collect();
    let npy = folder.read("o.npy");
    let of_npy = npy[npy.len() - 4 * numbers.len()..].as_chunks::<4>().0;
    assert_eq!(numbers, of_npy.iter().map(|word| u32::from_le_bytes(*word)).collect::<Vec<_>>());
    let csv = String::from_utf8(folder.read("o.csv")).expect("text");
    let rows = numbers.iter().enumerate().map(|(face, cluster)| format!("{face},{cluster}\n"));
    assert_eq!(csv, format!("face,cluster\n{}", rows.collect::<String>()));

    run(&folder, "cluster q.obj --algorithm pml -o h.tsr");
    run(&folder, "cut h.tsr -k 7 -o cut.npy -o cut.json");
    assert_eq!(folder.json("cut.json")["clusters"], 7);
    run(&folder, "export q.obj --labels cut.npy -o cut.ply -o table.csv");
    assert!(folder.read("cut.ply").starts_with(b"ply\n") && folder.read("table.csv").starts_with(b"cluster,"));
}

#[test]
fn outputs_that_may_be_several_things_are_refused_with_a_list() {
    let folder = Folder::new();
    // there is no mesh to read
    for (output, words) in [
        ("x.stl", ["--submeshes OUT.stl.zip", "--remesh OUT.stl"]),
        ("x.npz", ["--clusters-graph OUT.npz", "--remesh-source OUT.npz"]),
        ("x.gif", ["no output has the extension .gif", ".npy, "]),
        ("x", ["the extension says what is written", ".npy, "]),
        ("x.tsr", ["-o x.tsr goes with hierarchies", "bb"]),
    ] {
        folder.run(&["cluster", "none.obj", "-k", "2", "-o", output]).expect_usage_error(&words);
    }
    folder
        .run(&["cluster", "none.obj", "-k", "2", "--mesh", "."])
        .expect_usage_error(&["it is a folder", "{name}.glb"]);
    folder.run(&["cut", "none.tsr", "-k", "2", "-o", "."]).expect_usage_error(&["it is a folder"]);
}

#[test]
fn several_meshes_and_numbers_of_clusters_give_what_single_runs_do() {
    let folder = Folder::new();
    folder.sample("sphere", 900, "a.obj");
    folder.sample("torus", 700, "b.glb");
    std::fs::create_dir(folder.path("out")).expect("a folder");
    let said = run(&folder, "cluster a.obj b.glb -k 30,7,12 -o out/ --mesh {name}_{k}.ply");
    let mut expected = Vec::new();
    for (mesh, name) in [("a.obj", "a"), ("b.glb", "b")] {
        for clusters in [30, 7, 12] {
            run(&folder, &format!("cluster {mesh} -k {clusters} -o one.npy -o one.ply"));
            assert_eq!(folder.read("one.npy"), folder.read(&format!("out/{name}-{clusters}.npy")));
            assert_eq!(folder.read("one.ply"), folder.read(&format!("{name}_{clusters}.ply")));
            let report = folder.json(&format!("out/{name}-{clusters}.json"));
            assert_eq!((&report["clusters"], &report["parameters"]["clusters"]), (&clusters.into(), &clusters.into()));
            expected.extend([format!("{name}-{clusters}.json"), format!("{name}-{clusters}.npy")]);
        }
    }
    expected.sort();
    let mut written: Vec<String> = std::fs::read_dir(folder.path("out"))
        .expect("a folder")
        .map(|entry| entry.expect("an entry").file_name().into_string().expect("text"))
        .collect();
    written.sort();
    assert_eq!(written, expected);
    let lines: Vec<Vec<&str>> = said.lines().map(|line| line.split_whitespace().collect()).collect();
    assert_eq!(lines.len(), 7, "{said}");
    assert_eq!(lines[0][..3], ["mesh", "faces", "clusters"]);
    for (row, (mesh, clusters)) in lines[1..].iter().zip([
        ("a.obj", "30"),
        ("a.obj", "7"),
        ("a.obj", "12"),
        ("b.glb", "30"),
        ("b.glb", "7"),
        ("b.glb", "12"),
    ]) {
        assert_eq!((row[0], row[2]), (mesh, clusters), "{said}");
    }
}

#[test]
fn a_hierarchy_is_made_once_and_cut_at_each_number() {
    let folder = Folder::new();
    folder.sample("knot", 1500, "k.obj");
    std::fs::create_dir(folder.path("out")).expect("a folder");
    run(&folder, "cluster k.obj --algorithm pml -k 20,200,60 -o out/ -o {k}.glb");
    let report = folder.json("out/k.json");
    assert_eq!((&report["clusters"], &report["parameters"]["levels"]), (&20.into(), &serde_json::json!([200, 60])));
    for clusters in ["20", "60", "200"] {
        let levels = if clusters == "20" { " --levels 200,60" } else { "" };
        run(&folder, &format!("cluster k.obj --algorithm pml -k {clusters}{levels} -o one.npy -o one.glb"));
        // the run that ends there stops at no level below
        if clusters != "60" {
            assert_eq!(folder.read("one.npy"), folder.read(&format!("out/k-{clusters}.npy")), "{clusters}");
            assert_eq!(folder.read("one.glb"), folder.read(&format!("{clusters}.glb")), "{clusters}");
        }
        run(&folder, &format!("cut out/k.tsr -k {clusters} -o cut.npy"));
        assert_eq!(folder.read("cut.npy"), folder.read(&format!("out/k-{clusters}.npy")), "{clusters}");
    }
    folder
        .run(&["cluster", "k.obj", "--algorithm", "pml", "-k", "9,5", "--report", "{k}.json"])
        .expect_usage_error(&["--report", "leave {k} out"]);
}

#[test]
fn files_that_would_be_overwritten_are_refused_before_anything_is_read() {
    let folder = Folder::new();
    std::fs::create_dir(folder.path("x")).expect("a folder");
    // there are no meshes to read
    for (command, words) in [
        ("a.obj b.obj -k 5 -o x.npy", ["-o x.npy would be written once for each mesh", "as {name}.npy"]),
        ("a.obj b.obj -k 5,6 -o {k}.npy", ["-o {k}.npy would be written once for each mesh", "as {name}-{k}.npy"]),
        ("a.obj -k 5,6 --mesh x.glb", ["--mesh would be written once for each number of clusters", "as {k}.glb"]),
        ("a.obj b.obj -k 5 --labels -", ["--labels would be written once for each mesh", "{name}"]),
        ("a.obj x/a.ply -k 5 -o {name}.npy", ["two outputs of -o cannot both go to the same place", "a.npy"]),
        ("a.obj --algorithm pml -o {k}.tsr", ["-o {k}.tsr has {k} in its name", "--clusters"]),
        ("a.obj -k 5,6,5 -o {k}.npy", ["--clusters has a number twice", "5"]),
        ("a.obj -k 5,0 -o {k}.npy", ["--clusters must be at least 1", "0"]),
        ("a.obj -k 5,6 --seeds file:s.txt", ["a list of seeds has one number of clusters", "--clusters"]),
        ("a.obj -k 5,6 --subdivide auto", ["--subdivide auto", "--subdivide 1"]),
    ] {
        let command: Vec<&str> = command.split(' ').collect();
        folder.run(&[&["cluster"], &command[..]].concat()).expect_usage_error(&words);
    }
}

#[test]
fn a_mesh_that_fails_does_not_stop_the_others() {
    let folder = Folder::new();
    folder.sample("sphere", 300, "a.obj");
    folder.write("bad.obj", "v 0 0 0\nf 1 2 3\n");
    folder.sample("torus", 300, "z.obj");
    let done = folder.run(&["cluster", "a.obj", "bad.obj", "none.obj", "z.obj", "-k", "5", "-o", "{name}.npy"]);
    assert_eq!(done.status, Some(1), "{done:?}");
    let complaints: Vec<&str> = done.stderr.lines().collect();
    assert!(complaints[0].starts_with("tesserae: bad.obj: line 2: "), "{done:?}");
    assert!(complaints[1].starts_with("tesserae: none.obj: cannot read: "), "{done:?}");
    assert_eq!((complaints.len(), done.text().lines().count()), (2, 3), "{done:?}");
    assert_eq!(folder.files(), ["a.npy", "a.obj", "bad.obj", "z.npy", "z.obj"]);
}

#[test]
fn a_run_that_writes_nothing_says_so_and_how_to_write() {
    let folder = Folder::new();
    folder.sample("sphere", 300, "s.obj");
    let second = |command: &str| run(&folder, command).lines().nth(1).expect("a second line").to_owned();
    let advice = second("cluster s.obj -k 5");
    assert_eq!(advice, "nothing was written: add -o s.npy (labels) or -o s.glb (to look at)");
    assert!(second("cluster s.obj --algorithm pml").ends_with("-o s.tsr (the hierarchy)"));
    assert_eq!(folder.files(), ["s.obj"]);
    assert_eq!(run(&folder, "cluster s.obj -k 5 -o s.npy").lines().count(), 1);
    let advice = run(&folder, "cluster s.obj -k 5,6");
    assert!(advice.ends_with("add -o s-{k}.npy (labels) or -o s-{k}.glb (to look at)\n"), "{advice}");
}

#[test]
fn quiet_commands_say_nothing_but_errors() {
    let folder = Folder::new();
    for command in [
        "sample sphere --faces 300 p.obj -q",
        "cluster p.obj -k 9 --seeds morton --max-iterations 1 -q -o p.npy",
        "cluster p.obj --algorithm pml --quiet -o p.tsr",
        "cut p.tsr -k 5 -o c.npy -q",
        "export p.obj --labels p.npy -o p.ply -q",
    ] {
        assert_eq!(run(&folder, command), "", "{command}");
    }
    let done =
        folder.run(&["cluster", "p.obj", "-k", "9", "--seeds", "morton", "--max-iterations", "1", "-o", "p.npy"]);
    assert!(
        done.stderr.contains("warning: ") && done.text().contains("9 clusters"),
        "without -q it says both: {done:?}"
    );
    folder.run(&["cluster", "p.obj", "-k", "9999", "-q"]).expect_failure(&["9999"]);
}

#[test]
fn compressed_meshes_of_every_format_are_read() {
    let folder = Folder::new();
    folder.sample("sphere", 500, "s.obj");
    folder.sample("sphere", 500, "s.glb");
    run(&folder, "cluster s.obj -k 500 --remesh r.ply --remesh-source r.npz");
    run(&folder, "cluster s.obj -k 40 --mesh m.ply");
    for name in ["s.obj", "s.glb", "m.ply"] {
        run(&folder, &format!("cluster {name} -k 9 -o plain.npy"));
        let compressed = packed(&folder.read(name));
        let without_name = folder.run_with_input(&["cluster", "-", "-k", "9", "-o", "stdin.npy"], &compressed);
        without_name.expect_success();
        let (one, other) = compressed.split_at(compressed.len() / 2);
        folder.write(&format!("{name}.gz"), &compressed);
        run(&folder, &format!("cluster {name}.gz -k 9 -o {{name}}.packed.npy"));
        let stem = name.split('.').next().expect("a name");
        for written in ["stdin.npy".to_owned(), format!("{stem}.packed.npy")] {
            assert_eq!(folder.read("plain.npy"), folder.read(&written), "{name}");
        }
        folder.write("cut.gz", one);
        folder
            .run(&["cluster", "cut.gz", "-k", "9"])
            .expect_failure(&["cut.gz: the gzip file is damaged or truncated"]);
        assert!(!other.is_empty());
    }
    folder.write("zeros.obj.gz", packed(&vec![b'\n'; 64 << 20]));
    folder.run(&["cluster", "zeros.obj.gz", "-k", "9"]).expect_failure(&["more than 100 times as large", "gunzip"]);
    let few = ["cluster", "s.obj.gz", "-k", "9", "--max-upload-bytes", "20000"];
    folder.run(&few).expect_failure(&["--max-upload-bytes", "20001"]);
    // meshes of other commands
    folder.run(&["export", "s.obj.gz", "--labels", "s.packed.npy", "-o", "e.ply"]).expect_success();
}

#[test]
fn off_files_are_read() {
    let folder = Folder::new();
    folder.write("square.off", "COFF\n4 2 0\n0 0 0 1 0 0\n1 0 0 1 0 0\n1 1 0 1 0 0\n0 1 0 1 0 0\n3 0 1 2\n3 0 2 3\n");
    run(&folder, "cluster square.off -k 2 -o l.txt -o r.json");
    assert_eq!(folder.read("l.txt"), b"0\n1\n");
    assert_eq!(folder.json("r.json")["input"]["format"], "off");
}

#[test]
fn the_summary_says_clusters_faces_balance_and_time() {
    let folder = Folder::new();
    folder.sample("torus", 2000, "t.obj");
    let line = run(&folder, "cluster t.obj -k 100 -o t.csv");
    let csv = String::from_utf8(folder.read("t.csv")).expect("text");
    let mut faces = [0; 100];
    csv.lines()
        .skip(1)
        .for_each(|row| faces[row.split(',').nth(1).expect("a column").parse::<usize>().expect("a number")] += 1);
    let (largest, all) = (faces.iter().max().expect("clusters"), faces.iter().sum::<i32>());
    let balance = f64::from(*largest) * 100.0 / f64::from(all);
    assert!(line.starts_with("100 clusters of "), "{line}");
    assert!(line.contains(&format!(", largest {largest} ({balance:.2} × the mean), energy ")), "{line}");
    assert!(line.contains(", energy ") && line.contains(" s on ") && !line.contains("e0"), "{line}");
    let tree = run(&folder, "cluster t.obj --algorithm pml -o t.tsr");
    assert!(tree.starts_with("a hierarchy of ") && tree.contains(" rounds, ") && !tree.contains("energy"), "{tree}");
    let remesh = run(&folder, "cluster t.obj -k 100 --remesh r.ply");
    let second = remesh.lines().nth(1).expect("a second line");
    assert!(
        second.starts_with("remesh: ") && second.contains(" vertices, ") && second.ends_with("triangles"),
        "{remesh}"
    );
    let coarse = run(&folder, "cluster t.obj -k 3 --remesh r.ply");
    assert!(coarse.contains(" more than clusters: 1 handle"), "{coarse}");
}

#[test]
fn a_missing_folder_is_named() {
    let folder = Folder::new();
    folder.sample("sphere", 100, "s.obj");
    for output in ["gone/l.npy", "gone/"] {
        let words = ["cannot write: the folder gone does not exist"];
        folder.run(&["cluster", "s.obj", "-k", "2", "-o", output]).expect_failure(&words);
    }
}
