//! No two files of a folder import each other, not even by way of others: what a file imports can be read without it.
//!
//! The test reads the paths in the source that begin with `crate`, `super` or `self`. What is compiled for tests only does
//! not count, and neither does a `mod` item: a parent that declares a child does not use it.

use std::collections::{BTreeMap, BTreeSet};
use std::path::{Path, PathBuf};

/// Files by their module path below the crate, as in `["service", "store", "queue"]`.
type Sources = BTreeMap<Vec<String>, String>;

/// What each module imports.
type Imports = BTreeMap<Vec<String>, BTreeSet<Vec<String>>>;

#[test]
fn the_files_of_the_service_import_each_other_in_no_circle() {
    let sources = read(&Path::new(env!("CARGO_MANIFEST_DIR")).join("src"));
    let imports = imports(&sources, &["service"]);
    assert!(imports.len() > 50, "the service has more files: {}", imports.len());
    let circle = circle(&imports);
    assert!(circle.is_none(), "these files import each other in a circle: {}", circle.unwrap_or_default().join(" → "));
}

#[test]
fn a_circle_is_found_however_it_is_written() {
    for (first, second) in [
        ("use crate::a::second::B;", "use super::first::A;"),
        ("use super::{other::X, second::{self, B}};", "fn f() -> super::first::A {}"),
        ("pub use crate::{error::E, a::second};", "use crate::a::first::{A};"),
        ("use super::second;\n#[cfg(test)]\nmod tests {\n}\n", "// about it\nuse super::first as other;"),
    ] {
        let sources = sources(&[("first", first), ("second", second)]);
        assert!(circle(&imports(&sources, &["a"])).is_some(), "{first} {second}");
    }
    for (first, second) in [
        ("use crate::a::second::B;", "// use super::first::A;"),
        ("use crate::a::second::B;", "#[cfg(test)]\nmod tests {\n    use crate::a::first::A;\n}"),
        ("use crate::a::second::B;", "#[cfg(test)]\nuse crate::a::first::A;\n"),
        ("use crate::a::second::B;", "use crate::b::first::A;"),
    ] {
        let sources = sources(&[("first", first), ("second", second)]);
        assert_eq!(circle(&imports(&sources, &["a"])), None, "{first} {second}");
    }
}

fn sources(files: &[(&str, &str)]) -> Sources {
    files.iter().map(|(name, text)| (vec!["a".to_owned(), (*name).to_owned()], (*text).to_owned())).collect()
}

/// All source files below a folder.
fn read(root: &Path) -> Sources {
    let mut sources = Sources::new();
    let mut folders: Vec<(PathBuf, Vec<String>)> = vec![(root.to_owned(), Vec::new())];
    while let Some((folder, module)) = folders.pop() {
        for entry in std::fs::read_dir(&folder).expect("a folder") {
            let path = entry.expect("an entry").path();
            let name = path.file_stem().expect("a name").to_string_lossy().into_owned();
            let below = || [&module[..], std::slice::from_ref(&name)].concat();
            if path.is_dir() {
                folders.push((path.clone(), below()));
            } else if path.extension().is_some_and(|extension| extension == "rs") && name != "tests" {
                let module = if name == "mod" { module.clone() } else { below() };
                sources.insert(module, std::fs::read_to_string(&path).expect("readable"));
            }
        }
    }
    sources
}

/// What the modules strictly below `room` import of each other.
fn imports(sources: &Sources, room: &[&str]) -> Imports {
    let is_inside = |module: &[String]| {
        module.len() > room.len() && room.iter().zip(module).all(|(one, other)| *one == other.as_str())
    };
    let mut imports = Imports::new();
    for (module, text) in sources.iter().filter(|(module, _)| is_inside(module)) {
        if module.iter().any(|name| name == "conformance") {
            continue;
        }
        let targets = paths(&code(text)).into_iter().filter_map(|path| resolve(&path, module, sources));
        let targets = targets.filter(|target| target != module && is_inside(target)).collect();
        imports.insert(module.clone(), targets);
    }
    imports
}

/// The source without comments and without what is compiled for tests only.
fn code(text: &str) -> String {
    let lines: Vec<&str> = text.lines().map(|line| line.split("//").next().unwrap_or_default()).collect();
    let text = lines.join("\n");
    let mut parts = text.split("#[cfg(test)]");
    let mut code = parts.next().unwrap_or_default().to_owned();
    for part in parts {
        // an item in braces ends at a brace that begins a line, another one at its semicolon
        let is_statement = part.find(';').is_some_and(|end| part.find('{').is_none_or(|brace| end < brace));
        let is_import = part.trim_start().starts_with("use ");
        let end = if is_statement || is_import { part.find(';') } else { part.find("\n}") };
        code.push_str(end.map_or("", |end| &part[end + 1..]));
    }
    code
}

/// All paths that begin with `crate`, `super` or `self`, groups in braces taken apart.
fn paths(code: &str) -> Vec<Vec<String>> {
    let mut paths = Vec::new();
    let mut rest = code;
    let starts = ["crate::", "super::", "self::"];
    while let Some(at) = starts.iter().filter_map(|start| rest.find(start)).min() {
        let is_whole = !rest[..at].ends_with(|before: char| before.is_alphanumeric() || before == '_' || before == ':');
        let is_visibility = rest[..at].ends_with("pub(in ");
        let mut length = 0;
        if is_whole && !is_visibility {
            length = tree(&rest[at..], &[], &mut paths);
        }
        rest = &rest[at + length.max(4)..];
    }
    paths
}

/// Reads a path or a group of paths; how many bytes it takes.
fn tree(text: &str, before: &[String], paths: &mut Vec<Vec<String>>) -> usize {
    let mut path = before.to_vec();
    let mut at = 0;
    loop {
        let name: String = text[at..].chars().take_while(|c| c.is_alphanumeric() || *c == '_').collect();
        at += name.len();
        if !name.is_empty() {
            path.push(name);
        }
        if text[at..].starts_with('{') {
            at += 1;
            while at < text.len() && !text[at..].starts_with('}') {
                at += tree(&text[at..], &path, paths).max(1);
            }
            return at + 1;
        }
        if !text[at..].starts_with("::") {
            break;
        }
        at += 2;
    }
    if path.len() > before.len() {
        paths.push(path);
    }
    at
}

/// The module that a path leads to.
fn resolve(path: &[String], module: &[String], sources: &Sources) -> Option<Vec<String>> {
    let mut base = module.to_vec();
    let mut names = path;
    while let Some((first, rest)) = names.split_first() {
        match first.as_str() {
            "crate" => base.clear(),
            "super" => drop(base.pop()),
            "self" => {}
            _ => break,
        }
        names = rest;
    }
    base.extend(names.iter().cloned());
    while !base.is_empty() && !sources.contains_key(&base) {
        base.pop();
    }
    (!base.is_empty()).then_some(base)
}

/// A circle of modules, if there is one.
fn circle(imports: &Imports) -> Option<Vec<String>> {
    fn visit(
        module: &Vec<String>,
        imports: &Imports,
        way: &mut Vec<Vec<String>>,
        done: &mut BTreeSet<Vec<String>>,
    ) -> Option<Vec<String>> {
        if let Some(start) = way.iter().position(|one| one == module) {
            return Some(way[start..].iter().chain([module]).map(|one| one.join("/")).collect());
        }
        if !done.insert(module.clone()) {
            return None;
        }
        way.push(module.clone());
        let found = imports.get(module).into_iter().flatten().find_map(|next| visit(next, imports, way, done));
        way.pop();
        found
    }
    let mut done = BTreeSet::new();
    imports.keys().find_map(|module| visit(module, imports, &mut Vec::new(), &mut done))
}
