//! Names of what is published. `tesserae` is another program on the Python package index and on crates.io, so no text
//! installs it: the distribution and the crate are `tesserae-mesh`.

use std::fs;
use std::path::Path;

use super::{Source, invented, sources};

#[test]
fn no_text_installs_a_stranger_s_package() {
    let folders = ["src", "docs", "python", "deploy", "tests", "benches", "fuzz/fuzz_targets", "web/src", "web/tests"];
    let mut read = sources(&folders, &["rs", "md", "py", "pyi", "toml", "ipynb", "sh", "yaml", "ts", "mjs", "html"]);
    read.retain(|source| !source.path.ends_with("architecture/names.rs"));
    for path in ["README.md", "CHANGELOG.md", "openapi.yaml", "Makefile"] {
        let text = fs::read_to_string(Path::new(env!("CARGO_MANIFEST_DIR")).join(path)).expect(path);
        read.push(invented(path, &text));
    }
    assert!(read.len() > 500, "{}", read.len());
    let found: Vec<_> = read.iter().flat_map(strangers).collect();
    assert!(found.is_empty(), "{}", found.join("\n"));
}

#[test]
fn a_stranger_s_package_is_found_and_ours_is_not() {
    let text = "pip install tesserae\npip install 'tesserae[plot]'\npip install -q tesserae-mesh[plot]\n\
                cargo install tesserae\ncargo add --quiet tesserae_mesh\npip install ./python # for tesserae\n\
                pip download tesserae --no-deps\n";
    let found = strangers(&invented("x.md", text));
    let expected = [
        "x.md:1: pip install tesserae",
        "x.md:2: pip install 'tesserae[plot]'",
        "x.md:4: cargo install tesserae",
        "x.md:7: pip download tesserae --no-deps",
    ];
    assert_eq!(found, expected);
}

/// Lines of a text that install, add or fetch a package of the name `tesserae`.
fn strangers(source: &Source) -> Vec<String> {
    let verbs =
        ["pip install", "pip download", "pip3 install", "pipx install", "uvx", "uv add", "cargo install", "cargo add"];
    let names_it = |line: &str| {
        let words = verbs.iter().find_map(|verb| line.split_once(verb)).map(|(_, rest)| rest);
        let words = words.unwrap_or_default().split('#').next().unwrap_or_default();
        words.split_whitespace().any(|word| {
            let word = word.trim_matches(|c: char| !c.is_ascii_alphanumeric() && c != '[' && c != ']');
            word.split(['[', '=', '<', '>', '`', '"', '\'', '.', ',']).next() == Some("tesserae")
        })
    };
    let lines = (1..).zip(source.text.lines()).filter(|(_, line)| names_it(line));
    lines.map(|(number, line)| format!("{}:{number}: {}", source.path, line.trim())).collect()
}
