//! `tesserae export`, and the outputs of `cluster` that are made of the mesh.

use crate::command::Folder;
use tesserae_mesh::artifacts::{self, Artifact, Form, LABELS_PNG, MEANS, Need, REPORT, SHAPES, npy_header};

fn made_of_mesh() -> impl Iterator<Item = &'static Artifact> {
    artifacts::ALL.into_iter().filter(|artifact| artifact.needs.contains(&Need::Mesh))
}

/// Every flag with every form, as arguments that write `PREFIX-FILE`.
fn every_output(prefix: &str) -> Vec<(String, String)> {
    let forms = |artifact: &'static Artifact| {
        let flag = &artifact.flags[0];
        flag.forms(artifact).map(move |form| (flag.name.to_owned(), form.file))
    };
    made_of_mesh().flat_map(forms).map(|(flag, file)| (flag, format!("{prefix}-{file}"))).collect()
}

fn npy(labels: &[u32]) -> Vec<u8> {
    let mut bytes = npy_header("<u4", &format!("({},)", labels.len()));
    bytes.extend(labels.iter().flat_map(|label| label.to_le_bytes()));
    bytes
}

#[test]
fn exports_are_what_cluster_writes_for_any_number_of_threads() {
    let folder = Folder::new();
    folder.sample("quads", 3000, "q.obj");
    for (flag, file) in every_output("one") {
        let arguments =
            ["cluster", "q.obj", "-k", "30", "--device", "cpu", "--labels", "l.npy", flag.as_str(), file.as_str()];
        folder.run(&arguments).expect_success();
    }
    for threads in ["1", "3"] {
        for (flag, file) in every_output("two") {
            let mut command = folder.tesserae(&["export", "q.obj", "--labels", "l.npy", &flag, &file]);
            let done = command.env("RAYON_NUM_THREADS", threads).output().expect("the binary runs");
            let said = String::from_utf8_lossy(&done.stdout).into_owned();
            assert!(said.starts_with("30 clusters of "), "{said}");
            let one = file.replacen("two", "one", 1);
            assert!(folder.read(&file) == folder.read(&one), "{file} differs with {threads} threads");
        }
    }
}

/// The report is left out: it has times. Shapes are those of other energies.
#[test]
fn every_output_of_cluster_has_the_same_bytes_for_any_number_of_threads() {
    let folder = Folder::new();
    folder.sample("quads", 1000, "q.obj");
    let all = || {
        artifacts::ALL.into_iter().filter(|artifact| ![REPORT.name, MEANS.name, SHAPES.name].contains(&artifact.name))
    };
    // of images
    let is_of_mesh = |form: &&Form| form.file != LABELS_PNG.file;
    let mut written = 0;
    for (is_tree, parameters) in [(false, ["-k", "20", "--algorithm", "bb"]), (true, ["-k", "1", "--algorithm", "hr"])]
    {
        let files: Vec<_> = all()
            .filter(|artifact| artifact.needs(Need::Hierarchy) == is_tree)
            .flat_map(|artifact| artifact.flags.iter().map(move |flag| (flag, artifact)))
            .flat_map(|(flag, artifact)| flag.forms(artifact).filter(is_of_mesh).map(|form| (flag.name, form.file)))
            .collect();
        // a flag is given once, so that forms of one flag take a run each
        for &(flag, file) in &files {
            let with = |threads: &str| {
                let mut command =
                    folder.tesserae(&[&["cluster", "q.obj", "--device", "cpu", flag, file], &parameters[..]].concat());
                let done = command.env("RAYON_NUM_THREADS", threads).output().expect("the binary runs");
                assert!(done.status.success(), "{file}: {done:?}");
                folder.read(file)
            };
            assert!(with("1") == with("4"), "{file} differs");
        }
        written += files.len();
    }
    let with_flags = all().filter(|artifact| !artifact.flags.is_empty());
    let forms = with_flags.flat_map(|artifact| artifact.forms).filter(is_of_mesh).count();
    assert_eq!(written, forms);
}

#[test]
fn a_hierarchy_is_exported_at_any_number_of_clusters() {
    let folder = Folder::new();
    folder.sample("quads", 1000, "q.obj");
    let made = ["cluster", "q.obj", "--algorithm", "pml", "--device", "cpu", "--hierarchy", "q.tsr"];
    folder.run(&made).expect_success();
    folder.run(&["cut", "q.tsr", "-k", "17", "--labels", "cut.npy"]).expect_success();
    folder.run(&["export", "q.obj", "--labels", "cut.npy", "--mesh", "of-labels.glb"]).expect_success();
    folder.run(&["export", "q.obj", "--hierarchy", "q.tsr", "-k", "17", "--mesh", "of-tree.glb"]).expect_success();
    assert!(folder.read("of-labels.glb") == folder.read("of-tree.glb"));
    folder.sample("quads", 2000, "other.obj");
    let other = ["export", "other.obj", "--hierarchy", "q.tsr", "-k", "17", "--mesh", "x.glb"];
    folder.run(&other).expect_failure(&["q.tsr", "of another"]);
}

#[test]
fn a_coarse_mesh_is_divided_for_its_remesh() {
    let folder = Folder::new();
    folder.sample("quads", 600, "q.obj");
    let outputs = ["--remesh", "r.ply", "--remesh-source", "s.npz", "--report", "r.json"];
    let cluster = |more: &[&'static str]| [&["cluster", "q.obj", "-k", "150", "--device", "cpu"], more].concat();
    folder.run(&cluster(&[&["--subdivide", "auto"], &outputs[..]].concat())).expect_success();
    let report = folder.json("r.json");
    let auto = folder.read("r.ply");
    assert_eq!((&report["parameters"]["subdivide"], &report["remesh"]["checked"]), (&1.into(), &true.into()));
    assert_eq!(report["remesh"]["vertices"]["clusters"], 150);
    assert!(report["input"]["faces"].as_u64() >= Some(150 * 30), "{report}");
    folder.run(&cluster(&[&["--subdivide", "1"], &outputs[..]].concat())).expect_success();
    assert!(folder.read("r.ply") == auto && folder.read("s.npz").starts_with(b"PK"));
    for (more, words) in [
        (&["--subdivide", "1", "--labels", "l.npy"][..], &["--labels", "--subdivide"][..]),
        (&["--subdivide", "11", "--remesh", "r.ply"], &["--subdivide", "auto", "11"]),
        (&["--subdivide", "1", "--algorithm", "pml", "--remesh", "r.ply"], &["--subdivide", "pml"]),
        (
            &["--subdivide", "1", "--weight-attribute", "_W", "--remesh", "r.ply"],
            &["--subdivide", "--weight-attribute"],
        ),
        (&["--subdivide", "1", "--weights", "w.npy", "--remesh", "r.ply"], &["--subdivide", "--weights"]),
    ] {
        folder.run(&cluster(more)).expect_usage_error(words);
    }
    folder.run(&cluster(&["--subdivide", "10", "--remesh", "r.ply"])).expect_failure(&["--max-faces"]);
}

#[test]
fn labels_from_anywhere_may_have_gaps() {
    let folder = Folder::new();
    folder.write("m.obj", "v 0 0 0\nv 1 0 0\nv 0 1 0\nv 1 1 0\nf 1 2 3\nf 2 4 3\nf 1 2 4\nf 1 4 3\n");
    folder.write("l.npy", npy(&[3, 0, 3, 3]));
    for (flag, file) in every_output("gap") {
        folder.run(&["export", "m.obj", "--labels", "l.npy", &flag, &file]).expect_success();
    }
    let obj = String::from_utf8(folder.read("gap-mesh.obj")).expect("text");
    let groups: Vec<&str> = obj.lines().filter(|line| line.starts_with('g')).collect();
    assert_eq!(groups, ["g cluster-0", "g cluster-3"]);
}

#[test]
fn written_meshes_are_read_back() {
    let folder = Folder::new();
    folder.sample("knot", 2000, "k.glb");
    folder.run(&["cluster", "k.glb", "-k", "20", "--device", "cpu", "--labels", "l.npy"]).expect_success();
    for file in ["out.glb", "out.obj"] {
        folder.run(&["export", "k.glb", "--labels", "l.npy", "--mesh", file]).expect_success();
        folder.run(&["cluster", file, "-k", "20", "--device", "cpu", "--report", "r.json"]).expect_success();
        let report = folder.json("r.json");
        assert_eq!(report["input"]["boundary_edges"], 0, "{file}");
        assert_eq!(report["input"]["non_manifold_edges"], 0, "{file}");
        assert!(report["input"]["faces"].as_u64() > Some(1900), "{file}");
    }
}

#[test]
fn wrong_command_lines_are_refused() {
    let folder = Folder::new();
    folder.sample("quads", 600, "q.obj");
    folder.write("short.npy", npy(&[0; 5]));
    let cases: [(&[&str], &[&str]); 7] = [
        (&["export", "q.obj", "--mesh", "x.glb"], &["--labels"]),
        (&["export", "q.obj", "--labels", "short.npy"], &["--mesh"]),
        (&["export", "q.obj", "--hierarchy", "q.tsr", "--mesh", "x.glb"], &["--clusters"]),
        (&["export", "q.obj", "--labels", "short.npy", "--mesh", "x.stl"], &[".glb", ".ply"]),
        (&["export", "q.obj", "--labels", "short.npy", "--mesh", "q.obj"], &["would replace"]),
        (&["export", "q.obj", "--labels", "short.npy", "--mesh", "x.glb", "--force"], &["--submeshes"]),
        (&["export", "-", "--labels", "-", "--mesh", "x.glb"], &["standard input"]),
    ];
    for (arguments, words) in cases {
        folder.run(arguments).expect_usage_error(words);
    }
    let short = ["export", "q.obj", "--labels", "short.npy", "--mesh", "x.glb"];
    folder.run(&short).expect_failure(&["short.npy", "600", "5"]);
    folder.run(&["cut", "q.tsr", "-k", "3", "--mesh", "x.glb"]).expect_usage_error(&["--mesh"]);
    let whole = ["cluster", "q.obj", "--algorithm", "pml", "--mesh", "x.glb"];
    folder.run(&whole).expect_usage_error(&["--clusters"]);
    folder.run(&["cluster", "q.obj", "-k", "3", "--submeshes", "x.stl.zip"]).expect_success();
    assert!(folder.read("x.stl.zip").starts_with(b"PK"));
}
