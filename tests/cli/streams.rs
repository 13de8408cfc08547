//! Results that go to pipes, devices, descriptors and full disks, and files with unusual names.
#![cfg(target_os = "linux")]

use std::ffi::OsStr;
use std::fs::{self, File};
use std::io::{Read, Write};
use std::os::unix::ffi::OsStrExt;
use std::os::unix::fs::{FileTypeExt, PermissionsExt, symlink};
use std::os::unix::process::CommandExt;
use std::process::{Child, Command, Stdio};
use std::time::{Duration, Instant};

use crate::command::{Done, Folder};

const CLUSTER: [&str; 4] = ["cluster", "s.obj", "-k", "10"];

/// Longer than any of these commands takes.
const PATIENCE: Duration = Duration::from_secs(120);

fn with_sphere() -> Folder {
    let folder = Folder::new();
    folder.sample("sphere", 2000, "s.obj");
    folder
}

fn make_fifo(folder: &Folder, name: &str) {
    let made = Command::new("mkfifo").arg(folder.path(name)).status().expect("mkfifo runs");
    assert!(made.success());
}

fn spawn(folder: &Folder, arguments: &[&str]) -> Child {
    folder
        .tesserae(&[&CLUSTER[..], arguments].concat())
        .stdout(Stdio::piped())
        .stderr(Stdio::piped())
        .spawn()
        .expect("the binary runs")
}

/// Waits until `condition` holds while the child runs; kills the child and panics when it never does.
fn wait_until(child: &mut Child, what: &str, mut condition: impl FnMut(&mut Child) -> bool) {
    let begin = Instant::now();
    while !condition(child) {
        if begin.elapsed() > PATIENCE {
            child.kill().expect("it runs");
            panic!("never: {what}");
        }
        std::thread::yield_now();
    }
}

fn end(mut child: Child) -> Done {
    wait_until(&mut child, "the end", |child| child.try_wait().expect("a child").is_some());
    Done::of(child.wait_with_output().expect("it ended"))
}

/// Runs a command line of the shell, in which `$0` is the program.
fn shell(folder: &Folder, line: &str) -> Done {
    let program = folder.tesserae(&[]);
    let mut shell = Command::new("sh");
    shell.args(["-c", line]).arg(program.get_program()).current_dir(folder.root()).stdin(Stdio::null());
    Done::of(shell.output().expect("sh runs"))
}

#[test]
fn a_named_pipe_is_opened_once_when_the_report_is_there() {
    let folder = with_sphere();
    make_fifo(&folder, "report");
    let mut child = spawn(&folder, &["--labels", "l.npy", "--report", "report"]);
    // labels are written first: nothing waited for a reader until then
    wait_until(&mut child, "labels", |_| folder.path("l.npy").exists());
    let mut report = String::new();
    File::open(folder.path("report")).and_then(|mut pipe| pipe.read_to_string(&mut report)).expect("a pipe");
    assert!(!end(child).expect_success().is_empty());
    let report: serde_json::Value = serde_json::from_str(&report).expect("a whole report");
    assert_eq!(report["clusters"], 10);
    assert!(fs::metadata(folder.path("report")).expect("a pipe").file_type().is_fifo());
    assert_eq!(folder.files(), ["l.npy", "report", "s.obj"]);
}

#[test]
fn every_output_may_be_a_named_pipe() {
    let folder = with_sphere();
    let command = ["cluster", "s.obj", "-k", "10", "--algorithm", "pml"];
    folder.run(&[&command[..], &["--labels", "l.npy", "--hierarchy", "h.tsr"]].concat()).expect_success();
    for (flag, name) in [("--labels", "l.npy"), ("--hierarchy", "h.tsr")] {
        let expected = folder.read(name);
        fs::remove_file(folder.path(name)).expect("a file");
        make_fifo(&folder, name);
        let path = folder.path(name);
        let reader = std::thread::spawn(move || fs::read(path).expect("a pipe"));
        folder.run(&[&command[..], &[flag, name]].concat()).expect_success();
        assert_eq!(reader.join().expect("no panic"), expected, "{name}");
    }
    // a pipe whose name says no format gets JSON
    make_fifo(&folder, "pipe");
    let path = folder.path("pipe");
    let reader = std::thread::spawn(move || fs::read(path).expect("a pipe"));
    folder.run(&[&CLUSTER[..], &["--labels", "pipe"]].concat()).expect_success();
    let labels: serde_json::Value = serde_json::from_slice(&reader.join().expect("no panic")).expect("JSON");
    assert_eq!(labels["clusters"], 10);
}

#[test]
fn the_first_signal_ends_a_command_that_waits_for_the_reader_of_a_pipe() {
    // ten times each: two threads that handled signals took one for two in one run of six
    for (signal, name) in [("-TERM", "SIGTERM"), ("-INT", "SIGINT")].repeat(10) {
        let folder = with_sphere();
        make_fifo(&folder, "report");
        let mut child = spawn(&folder, &["--labels", "l.npy", "--report", "report"]);
        wait_until(&mut child, "labels", |_| folder.path("l.npy").exists());
        let sent = Command::new("kill").args([signal, &child.id().to_string()]).status().expect("kill runs");
        assert!(sent.success());
        end(child).expect_failure(&[&format!("stopped by {name}")]);
        assert_eq!(folder.files(), ["l.npy", "report", "s.obj"]);
    }
}

#[test]
fn a_reader_that_leaves_a_named_pipe_is_an_error() {
    let folder = Folder::new();
    folder.sample("sphere", 100_000, "s.obj"); // more labels than a pipe holds
    make_fifo(&folder, "l.json");
    let child = spawn(&folder, &["--labels", "l.json"]);
    let mut begin = [0; 10];
    File::open(folder.path("l.json")).and_then(|mut pipe| pipe.read_exact(&mut begin)).expect("a pipe");
    assert_eq!(&begin, b"{\"clusters");
    end(child).expect_failure(&["tesserae: l.json: cannot write", "Broken pipe"]);
}

#[test]
fn descriptors_are_written_where_they_stand() {
    let folder = with_sphere();
    folder.write("log", "earlier\n");
    shell(&folder, "\"$0\" cluster s.obj -k 10 --report /dev/fd/3 3>>log").expect_success();
    let log = folder.read("log");
    assert!(log.starts_with(b"earlier\n{"), "{}", String::from_utf8_lossy(&log));
    assert!(serde_json::from_slice::<serde_json::Value>(&log[8..]).is_ok());

    for name in ["/dev/stdout", "/dev/fd/1", "/proc/self/fd/1", "-"] {
        folder.write("out", "earlier\n");
        let done = shell(&folder, &format!("{{ \"$0\" cluster s.obj -k 10 --labels {name}; echo later; }} >>out"));
        assert!(done.stderr.contains("10 clusters"), "the summary goes where the labels do not: {done:?}");
        let out = String::from_utf8(folder.read("out")).expect("text");
        assert!(out.starts_with("earlier\n{\"clusters\":10") && out.ends_with("]}\nlater\n"), "{name}: {out}");
    }

    let piped = shell(&folder, "\"$0\" cluster s.obj -k 10 --labels /dev/fd/3 3>&1 >/dev/null | cat");
    assert!(serde_json::from_slice::<serde_json::Value>(&piped.expect_success()).is_ok());
}

#[test]
fn standard_output_may_be_closed_or_the_null_device() {
    let folder = with_sphere();
    for command in [
        "--version",
        "cluster --help",
        "sample sphere --faces 100 -",
        "cluster s.obj -qk 10 -o labels.npy",
        "cluster s.obj -qk 10 --labels -",
    ] {
        for discarded in [">&-", ">/dev/null", "1<>/dev/null"] {
            shell(&folder, &format!("\"$0\" {command} {discarded}")).expect_success();
        }
    }
    for discarded in [">&-", ">/dev/null"] {
        let done = shell(&folder, &format!("\"$0\" token new acme --tokens tokens.json {discarded}"));
        done.expect_failure(&["a token is shown once"]);
    }
    assert!(!folder.path("tokens.json").exists());
}

#[test]
fn a_full_disk_is_an_error_at_every_output() {
    let folder = with_sphere();
    folder
        .run(&["cluster", "s.obj", "--algorithm", "hr", "--hierarchy", "h.tsr", "--report", "r.json"])
        .expect_success();
    for extension in ["npy", "json", "bin", "tsr", "obj", "glb", "svg", "md"] {
        symlink("/dev/full", folder.path(&format!("full.{extension}"))).expect("a link");
    }
    let before = folder.files();
    for command in [
        "cluster s.obj -k 10 --labels full.npy",
        "cluster s.obj -k 10 --labels full.json",
        "cluster s.obj -k 10 --labels full.bin",
        "cluster s.obj -k 10 --report full.json",
        "cluster s.obj -k 10 --report /dev/full",
        "cluster s.obj --algorithm pml --hierarchy full.tsr",
        "cluster s.obj --algorithm pml --hierarchy full.json",
        "cluster s.obj --algorithm hr --linkage full.npy",
        "cut h.tsr -k 10 --labels full.npy",
        "cut h.tsr -k 10 --report full.json",
        "cut h.tsr --hierarchy full.json",
        "sample sphere --faces 100 full.obj",
        "sample sphere --faces 100 full.glb",
        "plot r.json full.svg",
    ] {
        let done = folder.run(&command.split(' ').collect::<Vec<_>>());
        done.expect_failure(&["full", "cannot write", "No space left"]);
    }
    assert_eq!(folder.files(), before);
}

#[test]
fn a_full_or_closed_standard_output_ends_every_command_that_prints() {
    let folder = with_sphere();
    folder.run(&["cluster", "s.obj", "-k", "10", "--report", "r.json"]).expect_success();
    folder.run(&["token", "new", "known", "--tokens", "known.json"]).expect_success();
    let before = folder.read("known.json");
    for command in [
        "--help",
        "--version",
        "help cluster",
        "cluster --help",
        "token new --help",
        "devices",
        "devices --json",
        "token list --tokens known.json",
        "token new acme --tokens known.json",
        "token new acme --tokens new.json",
        "cluster s.obj -k 10",
        "cluster s.obj -k 10 --labels -",
        "sample sphere --faces 100 -",
        "plot r.json -",
    ] {
        let done = shell(&folder, &format!("\"$0\" {command} >/dev/full"));
        done.expect_failure(&["tesserae: cannot write to standard output: No space left"]);
        let (reader, writer) = std::io::pipe().expect("a pipe");
        drop(reader);
        let mut command = folder.tesserae(&command.split(' ').collect::<Vec<_>>());
        let done = Done::of(command.stdout(writer).output().expect("the binary runs"));
        assert_eq!((done.status, done.stderr.as_str()), (Some(1), ""), "it ends quietly: {command:?}");
    }
    assert!(folder.read("known.json") == before && !folder.path("new.json").exists(), "no token was shown");
}

#[test]
fn samples_and_pictures_go_to_pipes_too() {
    let folder = with_sphere();
    folder.run(&["cluster", "s.obj", "-k", "10", "--report", "r.json"]).expect_success();
    folder.sample("sphere", 2000, "s.glb");
    folder.run(&["plot", "r.json", "r.svg"]).expect_success();
    for (command, expected, names) in [
        ("sample sphere --faces 2000", "s.obj", &["pipe", "pipe.obj"][..]),
        ("sample sphere --faces 2000", "s.glb", &["pipe.glb"]),
        ("plot r.json", "r.svg", &["pipe", "pipe.svg"]),
    ] {
        let expected = folder.read(expected);
        for name in names {
            make_fifo(&folder, name);
            let path = folder.path(name);
            let reader = std::thread::spawn(move || fs::read(path).expect("a pipe"));
            folder.run(&command.split(' ').chain([*name]).collect::<Vec<_>>()).expect_success();
            assert_eq!(reader.join().expect("no panic"), expected, "{command} {name}");
            fs::remove_file(folder.path(name)).expect("a pipe");
        }
    }
    for command in ["sample sphere --faces 2000", "plot r.json"] {
        for out in ["/dev/stdout | cat", "/dev/fd/3 3>&1 >/dev/null | cat"] {
            let expected = folder.read(if command.starts_with("plot") { "r.svg" } else { "s.obj" });
            let done = shell(&folder, &format!("\"$0\" {command} {out}"));
            assert_eq!(done.expect_success(), expected, "{command} {out}");
        }
    }
    folder.run(&["sample", "sphere", "--faces", "2000", "s.stl"]).expect_usage_error(&[".obj or .glb", "s.stl"]);
    folder.run(&["plot", "r.json", "picture"]).expect_usage_error(&[".svg", "picture"]);
}

#[test]
fn names_may_have_any_bytes() {
    let folder = Folder::new();
    let name = |bytes: &'static [u8]| OsStr::from_bytes(bytes).to_owned();
    let [mesh, labels, report, seeds] =
        [name(b"m\xff.obj"), name(b"l\xff.npy"), name(b"r\xff.json"), name(b"s\xff.txt")];
    let run = |arguments: &[&OsStr]| Done::of(folder.tesserae(&[]).args(arguments).output().expect("the binary runs"));
    let word = OsStr::new;
    run(&[word("sample"), word("sphere"), word("--faces"), word("200"), &mesh]).expect_success();
    fs::write(folder.root().join(&seeds), "3 70").expect("a file");
    let listed = name(b"file:s\xff.txt");
    run(&[word("cluster"), &mesh, word("--seeds"), &listed, word("--labels"), &labels, word("--report"), &report])
        .expect_success();
    assert!(fs::read(folder.root().join(&labels)).expect("labels").starts_with(b"\x93NUMPY"));
    let hierarchy = name(b"h\xff.tsr");
    run(&[word("cluster"), &mesh, word("--algorithm"), word("pml"), word("--hierarchy"), &hierarchy]).expect_success();
    run(&[word("cut"), &hierarchy, word("-k"), word("5"), word("--labels"), &labels]).expect_success();
    let missing = name(b"n\xff.obj");
    run(&[word("cluster"), &missing, word("-k"), word("2")]).expect_failure(&["tesserae: n\u{fffd}.obj: cannot read"]);
}

#[test]
fn links_to_files_that_are_not_there_stay_links() {
    let folder = with_sphere();
    fs::create_dir(folder.path("inner")).expect("a folder");
    symlink("inner/l.npy", folder.path("link.npy")).expect("a link");
    folder.run(&[&CLUSTER[..], &["--labels", "link.npy"]].concat()).expect_success();
    assert!(folder.path("link.npy").is_symlink());
    assert!(folder.read("inner/l.npy").starts_with(b"\x93NUMPY"));
}

#[test]
fn a_file_in_a_folder_that_takes_no_new_files_is_written_in_place() {
    const NOBODY: u32 = 65_534;
    let folder = with_sphere();
    fs::create_dir(folder.path("fixed")).expect("a folder");
    folder.write("fixed/l.npy", "earlier".repeat(10_000));
    let set =
        |name: &str, mode| fs::set_permissions(folder.path(name), PermissionsExt::from_mode(mode)).expect("a mode");
    set(".", 0o755);
    set("fixed/l.npy", 0o666);
    set("fixed", 0o555);
    let mut command = folder.tesserae(&[&CLUSTER[..], &["--labels", "fixed/l.npy"]].concat());
    if fs::metadata("/proc/self").is_ok_and(|process| std::os::unix::fs::MetadataExt::uid(&process) == 0) {
        command.uid(NOBODY).gid(NOBODY); // no folder refuses root
    }
    let done = command.output();
    set("fixed", 0o755);
    match done {
        Ok(done) => drop(Done::of(done).expect_success()),
        Err(error) => return println!("another user may not run the program here: not tested: {error}"),
    }
    assert!(folder.read("fixed/l.npy").starts_with(b"\x93NUMPY"));
    assert_eq!(folder.read("fixed/l.npy").len(), 128 + 4 * 2000);
}

#[test]
fn several_results_may_be_thrown_away() {
    let folder = with_sphere();
    let discard = ["--algorithm", "pml", "--report", "/dev/null", "--hierarchy", "/dev/null", "--labels", "-"];
    let mut command = folder.tesserae(&[&CLUSTER[..], &discard].concat());
    let done = Done::of(command.stdout(Stdio::null()).output().expect("the binary runs"));
    assert_eq!(done.status, Some(0), "{done:?}");
    assert!(fs::metadata("/dev/null").expect("a device").file_type().is_char_device());
}

#[test]
fn an_input_may_be_a_pipe() {
    let folder = with_sphere();
    make_fifo(&folder, "mesh.obj");
    let (path, bytes) = (folder.path("mesh.obj"), folder.read("s.obj"));
    let writer = std::thread::spawn(move || {
        File::options().write(true).open(path).and_then(|mut pipe| pipe.write_all(&bytes)).expect("a pipe");
    });
    folder.run(&["cluster", "mesh.obj", "-k", "10"]).expect_success();
    writer.join().expect("no panic");
}

#[test]
fn two_links_to_one_file_that_is_not_there_are_one_output() {
    let folder = with_sphere();
    for link in ["l1.npy", "l2.json"] {
        symlink("z.npy", folder.path(link)).expect("a link");
    }
    let done = folder.run(&[&CLUSTER[..], &["--labels", "l1.npy", "--report", "l2.json"]].concat());
    assert_eq!(done.status, Some(2), "{done:?}");
    assert!(!folder.path("z.npy").exists());
}

#[test]
fn a_command_works_where_addresses_are_limited() {
    let folder = Folder::new();
    // less than a heap that tries large pages takes
    shell(&folder, "ulimit -v 900000; \"$0\" sample knot --faces 20000 knot.obj").expect_success();
    assert!(folder.path("knot.obj").exists());
}
