//! What messages of the command line name: the input that is wrong, and flags as they are typed.

use crate::command::Folder;
use tesserae_mesh::parameters::Name;

/// Exit status 1 and one line that begins with `begin`.
#[track_caller]
fn expect_beginning(folder: &Folder, command: &str, begin: &str) {
    let done = folder.run(&command.split(' ').collect::<Vec<_>>());
    assert!(done.stderr.starts_with(begin), "{begin:?}: {done:?}");
    done.expect_failure(&[]);
}

#[test]
fn messages_about_an_input_begin_with_its_name() {
    let folder = Folder::new();
    folder.sample("sphere", 100, "s.obj");
    folder.sample("parts", 500, "parts.obj");
    folder.write("bad.obj", "v 0 0 0\nf 1 2 3\n");
    folder.write("bad.mesh", "\x00\x01");
    folder.write("bad.tsr", "no tree");
    folder.write("bad.json", "no report");
    folder.write("words.txt", "1 two");
    folder.write("far.txt", "1 100");
    folder.write("bad.npy", "no array");
    folder.write("two.npy", npy(&[1.0, 2.0]));
    folder.write(
        "away.gltf",
        r#"{"asset":{"version":"2.0"},"buffers":[{"uri":"gone.bin","byteLength":36}],
        "bufferViews":[{"buffer":0,"byteLength":36}],"accessors":[{"bufferView":0,"componentType":5126,"count":3,
        "type":"VEC3"}],"meshes":[{"primitives":[{"attributes":{"POSITION":0}}]}],"nodes":[{"mesh":0}],
        "scenes":[{"nodes":[0]}]}"#,
    );
    for (command, begin) in [
        ("cluster bad.obj -k 2", "tesserae: bad.obj: line 2: "),
        ("cluster bad.mesh -k 2", "tesserae: bad.mesh: "),
        ("cluster away.gltf -k 2", "tesserae: away.gltf: "),
        ("cluster none.obj -k 2", "tesserae: none.obj: cannot read: "),
        ("cluster . -k 2", "tesserae: .: cannot read: "),
        ("cluster - -k 2", "tesserae: standard input: "),
        ("cluster s.obj -k 101", "tesserae: s.obj: --clusters must not be more than"),
        ("cluster s.obj -k 2 --max-upload-bytes 50", "tesserae: s.obj: "),
        ("cluster s.obj -k 2 --max-faces 99", "tesserae: s.obj: "),
        ("cluster s.obj --seeds file:none.txt", "tesserae: none.txt: cannot read: "),
        ("cluster s.obj --seeds file:words.txt", "tesserae: words.txt: "),
        ("cluster s.obj --seeds file:far.txt", "tesserae: far.txt: "),
        ("cluster s.obj -k 3 --seeds file:far.txt", "tesserae: far.txt: --clusters and the number of listed seeds"),
        ("cluster s.obj -k 2 --weights bad.npy", "tesserae: bad.npy: "),
        ("cluster s.obj -k 2 --weights two.npy", "tesserae: two.npy: "),
        ("cut bad.tsr -k 2 --labels l.npy", "tesserae: bad.tsr: "),
        ("cut none.tsr -k 2 --labels l.npy", "tesserae: none.tsr: cannot read: "),
        ("plot bad.json x.svg", "tesserae: bad.json: "),
        ("bench --device cpu --mesh bad.obj:2 --faces 100", "tesserae: bad.obj: line 2: "),
    ] {
        expect_beginning(&folder, command, begin);
    }
    let done = folder.run(&["cluster", "s.obj", "--seeds", "morton", "-k", "9", "--max-iterations", "1"]);
    assert_eq!(done.status, Some(0));
    let warning = "tesserae: s.obj: warning: stopped by --max-iterations, maybe before it had converged: 1";
    assert!(done.stderr.starts_with(warning), "{done:?}");
}

#[cfg(unix)]
#[test]
fn control_characters_of_a_name_do_not_reach_the_terminal() {
    let folder = Folder::new();
    folder.write("a\nb\x1b[31m.obj", "no mesh");
    let done = folder.run(&["cluster", "a\nb\x1b[31m.obj", "-k", "2"]);
    done.expect_failure(&["tesserae: a\\nb\\u{1b}[31m.obj: "]);
}

#[test]
fn parameters_are_spelled_as_flags() {
    let folder = Folder::new();
    folder.sample("parts", 500, "parts.obj");
    folder.sample("sphere", 100, "s.obj");
    folder.run(&["cluster", "s.obj", "--algorithm", "pml", "--hierarchy", "h.tsr"]).expect_success();
    for (command, words) in [
        ("cluster parts.obj -k 3", "(--bridge-components joins them): 3"),
        ("cluster parts.obj --algorithm pml -k 3", "(--bridge-components joins them): 3"),
        ("cluster parts.obj --algorithm hr --linkage x.npy", "--bridge-components joins them"),
        ("cluster s.obj -k 3 --features 1", "into which --features divides the mesh"),
        ("cluster s.obj -k 3 --features sharp", "--features must be an angle from 0 to 180 degrees (40 is safe)"),
        ("cluster s.obj -k 3 --features 30 --bridge-components", "joins what --features keeps apart"),
        ("cluster s.obj -k 3 --shapes sphere", "--shapes goes with --energy shapes"),
        ("cluster s.obj -k 3 --energy planes --resolution 1e-3", "--resolution goes with --energy shapes"),
        ("cluster s.obj -k 3 --energy shapes --shapes torus", "--shapes must be some of plane,sphere,cylinder,cone"),
        (
            "cluster s.obj -k 3 --energy shapes --resolution -1",
            "--resolution and --tolerance must be a share of the diagonal",
        ),
        ("cluster s.obj -k 3 --energy planes --tolerance 1e-3", "--clusters does not go with --tolerance"),
        ("cluster s.obj --tolerance 1e-3", "--tolerance goes with --energy planes or shapes"),
        ("cluster s.obj --energy planes --tolerance 0u", "--tolerance must be a share of the diagonal"),
        (
            "cluster s.obj -k 3 --algorithm vc --energy planes",
            "the energy planes goes with the algorithms bb, pml, ml and hr",
        ),
        ("cluster s.obj --algorithm pml --energy planes --pairs all", "--pairs does not go with the energy planes"),
        ("cluster s.obj --algorithm pml --energy planes --tolerance 1", "--tolerance goes with flat clusterings (bb)"),
        ("cluster s.obj -k 3 --energy planes --quality best", "--quality does not go with the energy planes"),
        ("cluster s.obj -k 3 --shapes-out x.json", "--shapes-out goes with --energy planes or shapes"),
        ("sample knot --faces 500 --noise 1 x.obj", "--noise and --truth go with the sample part"),
        ("sample part --faces 500 --noise 11 x.obj", "noise must be from 0 to 10 percent, not 11"),
        ("cluster s.obj", "--clusters is missing"),
        ("cluster s.obj -k 0", "--clusters must be at least 1, not 0"),
        ("cluster s.obj -k 2 --optimize none", "--optimize goes with hierarchies"),
        (
            "cluster s.obj --algorithm pml --optimize none --optimize-iterations 3",
            "--optimize-iterations does not go with --optimize none",
        ),
        ("cluster s.obj --algorithm pml --optimize-iterations 0", "(--optimize none leaves them out)"),
        ("cluster s.obj --algorithm pml --max-iterations 3", "--max-iterations goes with flat clusterings"),
        ("cluster s.obj --algorithm pml --collapse-fraction 3", "pml with --switch-to-ml-at"),
        ("cluster s.obj --algorithm ml --switch-to-ml-at 0", "--switch-to-ml-at must be at least 1"),
        ("cluster s.obj -k 2 --curvature-exponent 11", "--curvature-exponent must be from 0 to 10"),
        ("cluster s.obj -k 2 --curvature-exponent -2", "--curvature-exponent must be from 0 to 10, not -2"),
        ("cluster s.obj -k -5", "invalid value '-5' for '--clusters <K>'"),
        ("cluster s.obj -k 5 --seed -1", "invalid value '-1' for '--seed <N>'"),
        ("cluster s.obj -k 2 --weight-attribute X", "--weight-attribute must begin with an underscore"),
        ("cluster s.obj -k 2 --seeds nowhere", "--seeds must be coarse, merged, morton, random or file:PATH"),
        ("cluster s.obj -k 2 --algorithm pml --levels 1", "--levels must not be below --clusters"),
        (
            "cut h.tsr -k 2 --hierarchy x.json --min-clusters 6 --max-clusters 5",
            "--min-clusters must not be above --max-clusters",
        ),
        ("cut h.tsr -k 1000 --labels x.npy", "--clusters must be between"),
        ("cut h.tsr --linkage x.npy", "ask for --optimize none"),
    ] {
        let done = folder.run(&command.split(' ').collect::<Vec<_>>());
        assert!([Some(1), Some(2)].contains(&done.status), "{command}: {done:?}");
        assert!(done.stderr.contains(words), "{command}: {done:?}");
        for name in Name::ALL.iter().map(Name::to_string).filter(|name| name.contains('_')) {
            assert!(!done.stderr.contains(&name), "{command}: {done:?}");
        }
    }
}

#[test]
fn every_usage_error_looks_as_the_parser_says_it() {
    let folder = Folder::new();
    folder.sample("sphere", 100, "s.obj");
    folder.run(&["cluster", "s.obj", "-k", "5", "--report", "r.json"]).expect_success();
    for (command, usage) in [
        ("clusters", "tesserae <COMMAND>"),
        ("cluster", "tesserae cluster "),
        ("cluster s.obj --no-such-flag", "tesserae cluster "),
        ("cluster s.obj -k many", "tesserae cluster"),
        ("cluster s.obj -k 2 --seeds nowhere", "tesserae cluster"),
        ("cluster s.obj -k 2 --labels l.xml", "tesserae cluster"),
        ("cluster s.obj -k 0", "tesserae cluster "),
        ("cluster s.obj -k 2 --labels s.obj.npy --report s.obj.npy", "tesserae cluster "),
        ("cluster s.obj -k 2 --report s.obj", "tesserae cluster "),
        ("cluster s.obj -k 2 --hierarchy h.tsr", "tesserae cluster "),
        ("cluster s.obj -k 2 --device cpu --adapter 0", "tesserae cluster "),
        ("cut s.obj", "tesserae cut "),
        ("sample knot --faces 1 k.obj", "tesserae sample "),
        ("sample knot --faces 100 k.stl", "tesserae sample "),
        ("sample teapot --faces 100 k.obj", "tesserae sample"),
        ("plot r.json r.png", "tesserae plot "),
        ("plot r.json", "tesserae plot "),
        ("bench --device cpu --adapter 0", "tesserae bench "),
        ("bench --mesh s.obj", "tesserae bench"),
        ("serve --device cpu --adapter 0", "tesserae serve "),
        ("serve --max-queued-jobs 0", "tesserae serve "),
        ("serve --listen 0.0.0.0:0", "tesserae serve "),
        ("serve --log a=b=c", "tesserae serve "),
        ("serve --drain-delay soon", "tesserae serve"),
        ("token new a/b --tokens t.json", "tesserae token new"),
        ("token new local --tokens t.json", "tesserae token new"),
        ("token list", "tesserae token list "),
        ("backup", "tesserae backup "),
        ("health --listen nowhere", "tesserae health"),
        ("evaluate paper", "tesserae evaluate paper "),
        ("devices --xml", "tesserae devices"),
    ] {
        let done = folder.run(&command.split(' ').collect::<Vec<_>>());
        let said = done.stderr.clone();
        done.expect_usage_error(&[]);
        let hint = "\n\nFor more information, try '--help'.\n";
        assert!(said.starts_with("error: ") && said.ends_with(hint), "{command}: {said}");
        let has_usage = said.contains(&format!("\n\nUsage: {usage}"));
        // the parser leaves the usage out where a single value is wrong
        assert!(has_usage || said.starts_with("error: invalid value '"), "{command}: {said}");
    }
}

#[test]
fn instances_of_a_mesh_are_limited_by_faces_and_on_request_by_faces_a_byte() {
    const INSTANCES: u32 = 400;
    let folder = Folder::new();
    folder.sample("torus", 2000, "torus.glb");
    let glb = folder.read("torus.glb");
    let length = u32::from_le_bytes(glb[12..16].try_into().expect("four bytes")) as usize;
    let mut document: serde_json::Value = serde_json::from_slice(&glb[20..20 + length]).expect("JSON");
    let mut bytes = glb[20 + length + 8..].to_vec();
    let start = bytes.len();
    bytes.extend((0..INSTANCES).flat_map(|at| [10.0 * at as f32, 0.0, 0.0]).flat_map(f32::to_le_bytes));
    let push = |list: &mut serde_json::Value, item: serde_json::Value| {
        let items = list.as_array_mut().expect("a list");
        items.push(item);
        items.len() - 1
    };
    let view = serde_json::json!({"buffer": 0, "byteOffset": start, "byteLength": bytes.len() - start});
    let view = push(&mut document["bufferViews"], view);
    let accessor = serde_json::json!({"bufferView": view, "componentType": 5126, "count": INSTANCES, "type": "VEC3"});
    let accessor = push(&mut document["accessors"], accessor);
    document["nodes"][0]["extensions"] =
        serde_json::json!({"EXT_mesh_gpu_instancing": {"attributes": {"TRANSLATION": accessor}}});
    document["extensionsUsed"] = serde_json::json!(["EXT_mesh_gpu_instancing"]);
    document["buffers"][0] = serde_json::json!({"uri": "instances.bin", "byteLength": bytes.len()});
    folder.write("instances.bin", &bytes);
    folder.write("instances.gltf", document.to_string());

    let command =
        ["cluster", "instances.gltf", "-k", "400", "--seeds", "random", "--quality", "fast", "--refine", "none"];
    folder.run(&[&command[..], &["--report", "r.json"]].concat()).expect_success();
    assert_eq!(folder.json("r.json")["input"]["faces"], 800_000);
    let refused = folder.run(&[&command[..], &["--max-faces-per-byte", "2"]].concat());
    refused.expect_failure(&["tesserae: instances.gltf: ", "--max-faces-per-byte", "800000"]);
    folder.run(&[&command[..], &["--max-faces-per-byte", "100"]].concat()).expect_success();
    folder.run(&[&command[..], &["--max-faces", "799999"]].concat()).expect_failure(&["--max-faces", "800000"]);
}

/// An array of floats in NumPy's format.
fn npy(numbers: &[f64]) -> Vec<u8> {
    let mut bytes = tesserae_mesh::artifacts::npy_header("<f8", &format!("({},)", numbers.len()));
    bytes.extend(numbers.iter().flat_map(|number| number.to_le_bytes()));
    bytes
}
