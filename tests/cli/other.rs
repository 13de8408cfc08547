//! `tesserae sample`, `tesserae devices` and the help, from outside.

use crate::command::Folder;

#[test]
fn samples_are_written_in_the_format_of_the_name_or_as_obj_to_standard_output() {
    let folder = Folder::new();
    let said = folder.run(&["sample", "quads", "--faces", "600", "q.glb"]).expect_success();
    assert_eq!(said, b"q.glb: quads, 600 faces, written as 1,200 triangles, 602 vertices\n");
    assert!(folder.read("q.glb").starts_with(b"glTF"));
    let said = folder.run(&["sample", "quads", "--faces", "600", "q.OBJ"]).expect_success();
    assert_eq!(said, b"q.OBJ: quads, 600 faces, 602 vertices\n");
    let piped = folder.run(&["sample", "quads", "--faces", "600", "-"]).expect_success();
    assert_eq!(piped, folder.read("q.OBJ"));
}

#[test]
fn impossible_samples_are_usage_errors() {
    let folder = Folder::new();
    let cases: [(&[&str], &[&str]); 5] = [
        (&["sample", "teapot", "--faces", "9", "t.obj"], &["teapot", "knot"]),
        (&["sample", "knot", "t.obj"], &["--faces"]),
        (&["sample", "knot", "--faces", "71", "t.obj"], &["between 72 and 50000000", "71"]),
        (&["sample", "knot", "--faces", "99999999999", "t.obj"], &["99999999999"]),
        (&["sample", "knot", "--faces", "100", "t.gltf"], &[".obj", ".glb", "t.gltf"]),
    ];
    for (arguments, words) in cases {
        folder.run(arguments).expect_usage_error(words);
    }
    folder.run(&["sample", "knot", "--faces", "100", "gone/t.obj"]).expect_failure(&["cannot write", "gone/t.obj"]);
    assert!(folder.files().is_empty());
}

#[test]
fn devices_lists_the_cpu_every_adapter_and_what_auto_takes() {
    let folder = Folder::new();
    let table = folder.run(&["devices"]);
    assert_eq!(table.status, Some(0));
    let json = folder.run(&["devices", "--json"]);
    let devices: serde_json::Value = serde_json::from_slice(&json.stdout).expect("JSON");
    let lines: Vec<&str> = table.text().lines().collect();
    let adapters = devices["adapters"].as_array().expect("a list");
    assert_eq!(lines.len(), 2 + adapters.len() + 2);
    for (line, adapter) in lines[2..].iter().zip(adapters) {
        assert!(line.contains(adapter["name"].as_str().expect("a name")), "{line}");
        for kind in ["flat", "hierarchy"] {
            let largest = adapter["largest"][kind].as_u64().expect("a number of faces");
            assert!(largest > 0 && line.contains(&format!(" {largest} ")), "{line}");
        }
        let reason = adapter["reason"].as_str();
        assert_eq!(adapter["usable"], reason.is_none());
        assert!(line.ends_with(&reason.map_or("yes".into(), |reason| format!("no: {reason}"))), "{line}");
    }
    assert!(lines[1].contains(devices["cpu"]["driver"].as_str().expect("a driver")));
    let auto = devices["auto"]["adapter"].as_u64();
    let taken = auto.map_or("the cpu".into(), |index| format!("adapter {index}"));
    assert!(lines.last().is_some_and(|line| line.starts_with(&format!("--device auto takes {taken}"))));
}

#[test]
fn help_and_version_succeed_and_every_command_has_examples_or_flags() {
    let folder = Folder::new();
    let version = folder.run(&["--version"]).expect_success();
    assert_eq!(version, format!("tesserae {}\n", env!("CARGO_PKG_VERSION")).into_bytes());
    for command in ["cluster", "serve", "sample", "devices"] {
        let help = folder.run(&[command, "--help"]).expect_success();
        let help = String::from_utf8(help).expect("text");
        assert!(help.contains(&format!("Usage: tesserae {command}")), "{help}");
        for note in ["P§", "DESIGN", "Eq."] {
            assert!(!help.contains(note), "{note} says nothing to who reads this: {help}");
        }
    }
    folder.run(&[]).expect_usage_error(&["Usage: tesserae <COMMAND>"]);
}

#[test]
#[cfg(all(target_os = "linux", target_env = "gnu"))]
fn the_program_does_not_load_libstdcxx() {
    let program =
        std::process::Command::new(env!("CARGO_BIN_EXE_tesserae")).env("LD_TRACE_LOADED_OBJECTS", "1").output();
    let libraries = String::from_utf8(program.expect("the loader's list").stdout).expect("text");
    assert!(libraries.contains("libc.so"), "{libraries}");
    assert!(!libraries.contains("libstdc++"), "flags of .cargo/config.toml are not taken: {libraries}");
}

#[test]
fn ply_and_stl_are_clustered_by_name_by_content_and_by_flag() {
    let folder = Folder::new();
    let ply = "ply\nformat ascii 1.0\nelement vertex 4\nproperty float x\nproperty float y\nproperty float z\n\
               element face 2\nproperty list uchar int vertex_indices\nend_header\n\
               0 0 0\n1 0 0\n1 1 0\n0 1 0\n3 0 1 2\n3 0 2 3\n";
    let facet = |corners: &str| format!("facet normal 0 0 1\nouter loop\n{corners}endloop\nendfacet\n");
    let [one, two] = ["vertex 1 0 0\nvertex 1 1 0\n", "vertex 1 1 0\nvertex 0 1 0\n"];
    let corners = |others: &str| facet(&format!("vertex 0 0 0\n{others}"));
    let stl = format!("solid a\n{}{}endsolid a\n", corners(one), corners(two));
    for (name, text) in [("square.ply", ply), ("square.stl", &stl)] {
        folder.write(name, text);
        folder.run(&["cluster", name, "-k", "2", "--report", "r.json"]).expect_success();
        let report = folder.json("r.json");
        assert_eq!(report["input"]["format"], &name[7..]);
        assert_eq!((&report["input"]["welded_vertices"], &report["input"]["boundary_edges"]), (&4.into(), &4.into()));
        for format in [&["--format", &name[7..]][..], &[]] {
            let arguments = [&["cluster", "-", "-k", "1", "--labels", "-"], format].concat();
            let done = folder.run_with_input(&arguments, text.as_bytes());
            assert_eq!((done.status, done.text()), (Some(0), "{\"clusters\":1,\"labels\":[0,0]}\n"), "{done:?}");
        }
    }
    folder.write("cloud.ply", ply.replace("element face 2", "element face 0"));
    folder.run(&["cluster", "cloud.ply", "-k", "2"]).expect_failure(&["cloud.ply: ", "point cloud"]);
    folder.write("bad.stl", stl.replace("vertex 0 1 0\n", ""));
    folder.run(&["cluster", "bad.stl", "-k", "2"]).expect_failure(&["bad.stl: line 13: facet 1 "]);
}
