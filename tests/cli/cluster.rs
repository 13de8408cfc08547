//! `tesserae cluster` from outside: results, and how it fails.

use std::collections::BTreeSet;
use std::process::Stdio;
use std::time::Duration;

use crate::command::Folder;
use sha2::{Digest, Sha256};

fn labels_of(bytes: &[u8]) -> Vec<u32> {
    bytes.chunks(4).map(|word| u32::from_le_bytes(word.try_into().expect("four bytes"))).collect()
}

fn sha256(bytes: &[u8]) -> String {
    Sha256::digest(bytes).iter().map(|byte| format!("{byte:02x}")).collect()
}

#[test]
fn labels_and_report_agree_in_every_format() {
    let folder = Folder::new();
    folder.sample("torus", 2000, "torus.obj");
    for extension in ["bin", "npy", "json"] {
        let labels = format!("labels.{extension}");
        let report = format!("{extension}.report");
        folder
            .run(&["cluster", "torus.obj", "--clusters", "25", "--labels", &labels, "--report", &report])
            .expect_success();
    }
    let raw = folder.read("labels.bin");
    let labels = labels_of(&raw);
    assert_eq!(folder.json("labels.json"), serde_json::json!({"clusters": 25, "labels": labels}));
    assert!(folder.read("labels.npy").ends_with(&raw));

    let report = folder.json("json.report");
    assert_eq!(report["clusters"], 25);
    assert_eq!(report["input"]["faces"], labels.len());
    assert_eq!(report["labels_sha256"], sha256(&raw));
    assert_eq!(labels.iter().collect::<BTreeSet<_>>(), (0..25).collect::<Vec<_>>().iter().collect());
    for timing in ["read", "total"] {
        assert!(report["timings_ms"][timing].as_f64().expect("a number") > 0.0, "{timing}");
    }
}

#[test]
fn success_is_one_line_on_standard_output_and_nothing_on_standard_error() {
    let folder = Folder::new();
    folder.sample("sphere", 1000, "sphere.glb");
    let stdout = folder.run(&["cluster", "sphere.glb", "-k", "12", "--labels", "l.npy"]).expect_success();
    let line = String::from_utf8(stdout).expect("text");
    assert_eq!(line.lines().count(), 1);
    for word in ["12 clusters of 1,000 faces, largest ", ", energy ", " s on "] {
        assert!(line.contains(word), "{line}");
    }
    assert_eq!(folder.files(), ["l.npy", "sphere.glb"]);
}

#[test]
fn obj_and_glb_of_a_sample_get_the_same_labels() {
    let folder = Folder::new();
    for shape in ["knot", "parts", "terrain"] {
        let hashes = ["obj", "glb"].map(|extension| {
            let mesh = format!("{shape}.{extension}");
            folder.sample(shape, 3000, &mesh);
            folder.run(&["cluster", &mesh, "-k", "60", "--report", "report.json"]).expect_success();
            folder.json("report.json")["labels_sha256"].clone()
        });
        assert_eq!(hashes[0], hashes[1], "{shape}");
    }
}

#[test]
fn cpu_and_gpu_give_the_same_labels() {
    let folder = Folder::new();
    folder.sample("parts", 4000, "parts.glb");
    let hash = |device: &str, seed: &str| {
        folder
            .run(&["cluster", "parts.glb", "-k", "300", "--device", device, "--seed", seed, "--report", "report.json"])
            .expect_success();
        let report = folder.json("report.json");
        assert_eq!(report["device"]["kind"], device);
        report["labels_sha256"].clone()
    };
    assert_eq!(hash("cpu", "3"), hash("gpu", "3"));
    assert_ne!(hash("cpu", "3"), hash("gpu", "4"));
}

#[test]
fn standard_streams_stand_in_for_files() {
    let folder = Folder::new();
    folder.sample("quads", 600, "quads.obj");
    folder.sample("knot", 600, "knot.glb");
    for mesh in ["quads.obj", "knot.glb"] {
        let named = folder.run(&["cluster", mesh, "-k", "9", "--labels", "named.json"]);
        named.expect_success();
        let piped = folder.run_with_input(&["cluster", "-", "-k", "9", "--labels", "-"], &folder.read(mesh));
        assert_eq!((piped.status, piped.stdout), (Some(0), folder.read("named.json")));
        assert!(piped.stderr.contains("9 clusters"), "the summary goes where the labels do not");
    }
    let report = folder
        .run_with_input(&["cluster", "-", "-k", "9", "--format", "obj", "--report", "-"], &folder.read("quads.obj"));
    let report: serde_json::Value = serde_json::from_slice(&report.stdout).expect("JSON");
    assert_eq!(report["clusters"], 9);
}

#[test]
fn listed_seeds_come_from_a_file_and_number_the_clusters() {
    let folder = Folder::new();
    folder.sample("terrain", 800, "terrain.obj");
    folder.write("seeds.txt", "700\n3\n400\n");
    let arguments = "cluster terrain.obj --seeds file:seeds.txt --max-iterations 0 --labels l.bin";
    let done = folder.run(&arguments.split(' ').collect::<Vec<_>>());
    assert_eq!(done.status, Some(0));
    let labels = labels_of(&folder.read("l.bin"));
    assert_eq!([700, 3, 400].map(|face: usize| labels[face]), [0, 1, 2]);
    folder
        .write("two.obj", "v 0 0 0\nv 1 0 0\nv 0 1 0\nv 5 0 0\nv 6 0 0\nv 5 1 0\nv 1 1 0\nf 1 2 3\nf 2 7 3\nf 4 5 6\n");
    folder.write("two.txt", "0\n1\n");
    folder.run(&["cluster", "two.obj", "--seeds", "file:two.txt"]).expect_failure(&["1 of the 2 connected components"]);
    folder.run(&["cluster", "terrain.obj", "--seeds", "file:none.txt"]).expect_failure(&["cannot read", "none.txt"]);
    folder.run(&["cluster", "terrain.obj", "--seeds", "listed"]).expect_usage_error(&["listed"]);
}

#[test]
fn wrong_command_lines_are_usage_errors() {
    let folder = Folder::new();
    folder.sample("sphere", 100, "s.obj");
    let cases: [(&[&str], &[&str]); 11] = [
        (&["cluster"], &["INPUT"]),
        (&["cluster", "s.obj"], &["clusters", "Usage: tesserae cluster"]),
        (&["cluster", "s.obj", "-k", "0"], &["at least 1"]),
        (&["cluster", "s.obj", "-k", "many"], &["many"]),
        (&["cluster", "s.obj", "-k", "2", "--labels", "l.xml"], &[".json", ".npy", ".bin", "l.xml"]),
        (&["cluster", "s.obj", "-k", "2", "--labels", "l"], &[".json", ".npy", ".bin"]),
        (&["cluster", "s.obj", "-k", "2", "--labels", "-", "--report", "-"], &["the same place"]),
        (&["cluster", "s.obj", "-k", "2", "--device", "tpu"], &["auto", "cpu", "gpu"]),
        (&["cluster", "s.obj", "-k", "2", "--device", "cpu", "--adapter", "0"], &["--adapter"]),
        (&["cluster", "s.obj", "-k", "2", "--device", "gpu", "--algorithm", "acvd"], &["acvd", "--device cpu or auto"]),
        (&["cluster", "s.obj", "-k", "2", "--adapter", "0", "--algorithm", "vc"], &["vc", "--device cpu or auto"]),
    ];
    for (arguments, words) in cases {
        folder.run(arguments).expect_usage_error(words);
    }
    assert_eq!(folder.files(), ["s.obj"]);
}

#[test]
fn no_result_replaces_another_or_what_is_read() {
    let folder = Folder::new();
    folder.sample("sphere", 100, "s.obj");
    folder.write("seeds.json", "[0, 50]");
    std::fs::create_dir(folder.path("inner")).expect("a folder");
    let absolute = folder.path("s.obj").to_string_lossy().into_owned();
    let cases: [(&[&str], &[&str]); 7] = [
        (&["s.obj", "-k", "2", "--report", "s.obj"], &["--report", "the mesh", "s.obj"]),
        (&["inner/../s.obj", "-k", "2", "--report", "./s.obj"], &["--report", "the mesh", "./s.obj"]),
        (&["s.obj", "-k", "2", "--report", &absolute], &["--report", "the mesh"]),
        (&["s.obj", "--seeds", "file:seeds.json", "--labels", "./seeds.json"], &["--labels", "the list of seeds"]),
        (&["s.obj", "-k", "2", "--labels", "x.json", "--report", "x.json"], &["the same place", "x.json"]),
        (&["s.obj", "-k", "2", "--labels", "x.json", "--report", "./x.json"], &["the same place", "x.json"]),
        (&["s.obj", "-k", "2", "--labels", "inner/../x.json", "--report", "x.json"], &["the same place", "x.json"]),
    ];
    let before = folder.read("s.obj");
    for (arguments, words) in cases {
        folder.run(&[&["cluster"], arguments].concat()).expect_usage_error(words);
    }
    assert_eq!(folder.files(), ["inner", "s.obj", "seeds.json"]);
    assert_eq!((folder.read("s.obj"), folder.read("seeds.json")), (before, b"[0, 50]".to_vec()));
    // the same name in another folder is another file
    folder.run(&["cluster", "s.obj", "-k", "2", "--labels", "x.json", "--report", "inner/x.json"]).expect_success();
}

#[cfg(unix)]
#[test]
fn links_and_redirections_to_a_file_are_that_file() {
    use std::fs::{File, hard_link};
    use std::os::unix::fs::symlink;
    let folder = Folder::new();
    folder.sample("sphere", 100, "s.obj");
    symlink("s.obj", folder.path("link")).expect("a link");
    symlink(".", folder.path("here")).expect("a link");
    hard_link(folder.path("s.obj"), folder.path("hard")).expect("a link");
    for report in ["link", "hard", "here/s.obj"] {
        folder.run(&["cluster", "s.obj", "-k", "2", "--report", report]).expect_usage_error(&["the mesh", report]);
    }
    folder
        .run(&["cluster", "s.obj", "-k", "2", "--labels", "here/x.json", "--report", "x.json"])
        .expect_usage_error(&["the same place"]);
    let redirected = |input: &str, output: &str| {
        let mut command = folder.tesserae(&["cluster", "-", "-k", "2", "--labels", "-", "--report", "r.json"]);
        command.stdin(File::open(folder.path(input)).expect("a file"));
        command.stdout(File::create(folder.path(output)).expect("a file"));
        command.output().expect("the binary runs")
    };
    let refused = redirected("s.obj", "r.json");
    let stderr = String::from_utf8(refused.stderr).expect("text");
    assert_eq!(refused.status.code(), Some(2), "{stderr}");
    assert!(stderr.contains("the same place"), "{stderr}");
    std::fs::copy(folder.path("s.obj"), folder.path("r.json")).expect("a copy");
    let refused = redirected("r.json", "l.json");
    let stderr = String::from_utf8(refused.stderr).expect("text");
    assert_eq!(refused.status.code(), Some(2), "{stderr}");
    assert!(stderr.contains("the mesh"), "{stderr}");
    assert_eq!(folder.read("r.json"), folder.read("s.obj"));
    std::fs::remove_file(folder.path("r.json")).expect("it is there");
    assert_eq!(redirected("s.obj", "l.json").status.code(), Some(0));
}

#[test]
fn an_adapter_is_what_auto_takes_or_nothing() {
    let folder = Folder::new();
    folder.sample("sphere", 100, "s.obj");
    let wrong = ["cluster", "s.obj", "-k", "2", "--adapter", "no such card"];
    folder.run(&wrong).expect_failure(&["no adapter", "no such card"]);
    let devices = folder.run(&["devices", "--json"]);
    let devices: serde_json::Value = serde_json::from_slice(&devices.stdout).expect("JSON");
    let usable = devices["adapters"].as_array().expect("a list").iter().find(|adapter| adapter["usable"] == true);
    let Some(adapter) = usable else {
        println!("no adapter can be used here: not tested");
        return;
    };
    let index = adapter["index"].to_string();
    folder.run(&["cluster", "s.obj", "-k", "2", "--adapter", &index, "--report", "r.json"]).expect_success();
    assert_eq!(folder.json("r.json")["device"]["name"], adapter["name"]);
}

#[test]
fn other_failures_are_one_line() {
    let folder = Folder::new();
    folder.sample("sphere", 100, "s.obj");
    folder.sample("parts", 500, "parts.obj");
    folder.write("text.obj", "v 0 0 0\nf 1 2 3\n");
    folder.write("unknown.mesh", "\x00\x01");
    let cases: [(&[&str], &[&str]); 9] = [
        (&["cluster", "none.obj", "-k", "2"], &["cannot read", "none.obj"]),
        (&["cluster", ".", "-k", "2"], &["cannot read"]),
        (&["cluster", "text.obj", "-k", "2"], &["2"]),
        (&["cluster", "unknown.mesh", "-k", "2"], &["mesh format", "obj, glb, gltf"]),
        (&["cluster", "s.obj", "-k", "101"], &["faces", "101"]),
        (&["cluster", "parts.obj", "-k", "2"], &["12", "2"]),
        (&["cluster", "s.obj", "-k", "2", "--max-faces", "99"], &["--max-faces", "100"]),
        (&["cluster", "s.obj", "-k", "2", "--max-upload-bytes", "50"], &["--max-upload-bytes", "50"]),
        (&["cluster", "s.obj", "-k", "2", "--labels", "gone/l.npy"], &["gone/l.npy: cannot write: the folder gone "]),
    ];
    let before = folder.files();
    for (arguments, words) in cases {
        folder.run(arguments).expect_failure(words);
    }
    assert_eq!(folder.files(), before);
}

#[test]
fn outputs_that_cannot_be_written_are_refused_before_the_work() {
    let folder = Folder::new();
    // There is no mesh to read: the message is about what is tried first.
    let arguments = ["cluster", "none.obj", "-k", "2", "--report", "gone/r.json"];
    folder.run(&arguments).expect_failure(&["gone/r.json"]);
}

#[test]
fn a_failed_run_leaves_earlier_results_alone() {
    let folder = Folder::new();
    folder.sample("sphere", 100, "s.obj");
    folder.write("l.npy", "earlier");
    folder.run(&["cluster", "s.obj", "-k", "101", "--labels", "l.npy"]).expect_failure(&["101"]);
    assert_eq!(folder.read("l.npy"), b"earlier");
    folder.run(&["cluster", "s.obj", "-k", "10", "--labels", "l.npy"]).expect_success();
    assert!(folder.read("l.npy").starts_with(b"\x93NUMPY"));
    assert_eq!(folder.files(), ["l.npy", "s.obj"]);
}

#[test]
fn buffers_beside_the_mesh_are_read_and_others_are_not() {
    let folder = Folder::new();
    folder.sample("knot", 900, "knot.glb");
    let glb = folder.read("knot.glb");
    let length = u32::from_le_bytes(glb[12..16].try_into().expect("four bytes")) as usize;
    let mut document: serde_json::Value = serde_json::from_slice(&glb[20..20 + length]).expect("JSON");
    std::fs::create_dir(folder.path("inner")).expect("a folder");
    folder.write("inner/knot.bin", &glb[20 + length + 8..]);
    folder.write("outer.bin", &glb[20 + length + 8..]);
    let mut with = |uri: &str| {
        document["buffers"][0]["uri"] = uri.into();
        folder.write("inner/knot.gltf", document.to_string());
        folder.run(&["cluster", "inner/knot.gltf", "-k", "20", "--report", "gltf.json"])
    };
    with("knot.bin").expect_success();
    with("../outer.bin").expect_failure(&["../outer.bin"]);
    with(&folder.path("outer.bin").to_string_lossy()).expect_failure(&["outer.bin"]);
    with("knot.bin").expect_success();
    folder
        .run(&["cluster", "inner/knot.gltf", "-k", "20", "--labels", "inner/knot.bin"])
        .expect_failure(&["--labels", "a buffer", "knot.bin"]);
    assert_eq!(folder.read("inner/knot.bin"), folder.read("outer.bin"));
    folder.run(&["cluster", "knot.glb", "-k", "20", "--report", "glb.json"]).expect_success();
    assert_eq!(folder.json("gltf.json")["labels_sha256"], folder.json("glb.json")["labels_sha256"]);
}

#[cfg(unix)]
#[test]
fn devices_and_links_stay_what_they_are() {
    use std::os::unix::fs::{FileTypeExt, PermissionsExt, symlink};
    let folder = Folder::new();
    folder.sample("sphere", 100, "s.obj");
    folder.write("real.bin", "earlier");
    std::fs::set_permissions(folder.path("real.bin"), PermissionsExt::from_mode(0o640)).expect("permissions");
    symlink("real.bin", folder.path("link.bin")).expect("a link");
    folder.run(&["cluster", "s.obj", "-k", "10", "--labels", "link.bin", "--report", "/dev/null"]).expect_success();
    assert!(folder.path("link.bin").is_symlink());
    assert_eq!(folder.read("real.bin").len(), 400);
    let mode = std::fs::metadata(folder.path("real.bin")).expect("a file").permissions().mode();
    assert_eq!(mode & 0o777, 0o640);
    let null = std::fs::metadata("/dev/null").expect("a device");
    assert!(null.file_type().is_char_device());
}

#[cfg(target_os = "linux")]
/// The system clears every page that a process comes to: 250 bytes a face, where what is given back goes to the system.
#[cfg(all(target_os = "linux", target_env = "gnu"))]
#[test]
fn memory_that_is_given_back_is_used_again() {
    let folder = Folder::new();
    let faces = 300_000;
    folder.sample("sphere", faces, "sphere.glb");
    let command =
        ["cluster", "sphere.glb", "-k", "3000", "--quality", "fast", "--device", "cpu", "--labels", "sphere.npy"];
    let mut child = folder.tesserae(&command).stdout(Stdio::null()).spawn().expect("the binary runs");
    // state, and the page faults that needed no disk; both are there until somebody waits for the process
    let stat = || {
        let stat = std::fs::read_to_string(format!("/proc/{}/stat", child.id())).expect("it is not waited for");
        let (_, fields) = stat.rsplit_once(") ").expect("a name in parentheses");
        let fields: Vec<String> = fields.split(' ').map(str::to_owned).collect();
        (fields[0].clone(), fields[7].parse::<u64>().expect("a number"))
    };
    let faults = loop {
        let (state, faults) = stat();
        if state == "Z" {
            break faults;
        }
        std::thread::sleep(Duration::from_millis(2));
    };
    assert!(child.wait().expect("it ended").success());
    let bytes_a_face = faults * 4096 / faces;
    assert!(bytes_a_face < 200, "{bytes_a_face}");
}

#[test]
fn a_reader_that_leaves_gets_no_message_and_a_full_disk_does() {
    let folder = Folder::new();
    folder.sample("sphere", 20_000, "s.obj");
    let mut child = folder
        .tesserae(&["cluster", "s.obj", "-k", "10", "--labels", "-"])
        .stdout(Stdio::piped())
        .stderr(Stdio::piped())
        .spawn()
        .expect("the binary runs");
    drop(child.stdout.take());
    let ended = child.wait_with_output().expect("the binary ends");
    assert_eq!((ended.status.code(), ended.stderr.as_slice()), (Some(1), &b""[..]));

    let full = || Stdio::from(std::fs::File::options().write(true).open("/dev/full").expect("a device"));
    for arguments in [&["cluster", "s.obj", "-k", "10", "--labels", "-"][..], &["cluster", "s.obj", "-k", "10"]] {
        let ended = folder.tesserae(arguments).stdout(full()).output().expect("the binary runs");
        let stderr = String::from_utf8(ended.stderr).expect("text");
        assert_eq!((ended.status.code(), stderr.lines().count()), (Some(1), 1), "{stderr}");
        assert!(stderr.contains("standard output"), "{stderr}");
    }
}

#[cfg(target_os = "linux")]
#[test]
fn an_interrupt_ends_the_work_with_one_line_and_no_files() {
    use std::process::Command;
    const SIGINT: u64 = 1 << (2 - 1);
    let folder = Folder::new();
    folder.sample("plane", 1_000_000, "plane.glb");
    let mut child = folder
        .tesserae(&["cluster", "plane.glb", "-k", "10", "--seeds", "random", "--labels", "l.npy"])
        .stdout(Stdio::piped())
        .stderr(Stdio::piped())
        .spawn()
        .expect("the binary runs");
    // The kernel tells when the interrupt is handled by the program, which is when the work begins.
    loop {
        let status = std::fs::read_to_string(format!("/proc/{}/status", child.id())).expect("a process");
        let caught = status.lines().find_map(|line| line.strip_prefix("SigCgt:\t")).expect("a mask");
        if u64::from_str_radix(caught, 16).expect("hexadecimal") & SIGINT != 0 {
            break;
        }
        assert!(child.try_wait().expect("a child").is_none(), "it ended before it could be interrupted");
        std::thread::yield_now();
    }
    let killed = Command::new("kill").args(["-INT", &child.id().to_string()]).status().expect("kill runs");
    assert!(killed.success());
    let ended = child.wait_with_output().expect("the binary ends");
    let stderr = String::from_utf8(ended.stderr).expect("text");
    assert_eq!((ended.status.code(), stderr.as_str()), (Some(1), "tesserae: stopped by SIGINT before the end\n"));
    assert_eq!(folder.files(), ["plane.glb"]);
}
