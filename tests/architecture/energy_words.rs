//! Only `src/energy/` and `shaders/energy/` name an energy, or what its points are. A second energy then touches those
//! folders and no code above them. Comments may name what the paper does, and folders about geometry the centroids of
//! faces.

use std::fs;
use std::path::Path;

/// Code outside the energy that names it: file and line.
fn leaks(file: &str, text: &str) -> Vec<String> {
    if file.starts_with("src/energy/") || file.starts_with("shaders/energy/") || file.ends_with("/tests.rs") {
        return Vec::new();
    }
    let geometry = ["src/surface/", "src/mesh/", "src/dev/", "src/complex/", "src/remesh/", "src/artifacts/"];
    let is_geometry = geometry.iter().any(|folder| file.starts_with(folder));
    let names = |line: &&str| {
        let code = line.split("//").next().unwrap_or_default().to_lowercase().replace("acvd", "");
        let is_of_points = code.contains("centroid") || code.contains("squared_distance");
        code.contains("cvd") || (is_of_points && !is_geometry)
    };
    let code = text.split("\n#[cfg(test)]\nmod tests {").next().unwrap_or_default();
    code.lines().filter(names).map(|line| format!("{file}: {}", line.trim())).collect()
}

/// What all files of a folder leak, and how many files there are.
fn leaks_of(root: &Path, folder: &str, found: &mut Vec<String>) -> usize {
    let mut files = 0;
    for entry in fs::read_dir(root.join(folder)).expect("a folder") {
        let entry = entry.expect("an entry");
        let path = format!("{folder}/{}", entry.file_name().to_string_lossy());
        if entry.path().is_dir() {
            files += leaks_of(root, &path, found);
        } else {
            found.extend(leaks(&path, &fs::read_to_string(entry.path()).expect("a text file")));
            files += 1;
        }
    }
    files
}

#[test]
fn only_the_energy_names_itself_and_its_points() {
    let root = Path::new(env!("CARGO_MANIFEST_DIR"));
    let mut found = Vec::new();
    let files = leaks_of(root, "src", &mut found) + leaks_of(root, "shaders", &mut found);
    assert_eq!(found, Vec::<String>::new());
    assert!(files > 200, "{files}");
}

#[test]
fn a_leak_is_found_in_code_and_not_in_comments_or_names_that_contain_it() {
    let text = "use crate::energy::cvd::End; // cvd\nlet centroid = 1;\n// of centroids\nuse super::reference::acvd;";
    let found = leaks("src/cluster/x.rs", text);
    assert_eq!(
        found,
        ["use crate::energy::cvd::End; // cvd", "let centroid = 1;"].map(|line| format!("src/cluster/x.rs: {line}"))
    );
    assert_eq!(leaks("shaders/refine/x.wgsl", "let a = face.centroid;").len(), 1);
    assert_eq!(leaks("src/surface/x.rs", text).len(), 1);
    assert_eq!(leaks("src/energy/cvd.rs", text), Vec::<String>::new());
}
