//! The layers of the crate: no module imports in a circle, and the engine imports nothing that lies above it.
//!
//! The test reads the paths (`crate::`, `super::`, `self::`, `use`) in `src`, apart from comments and tests. A node of
//! the graph is a top-level module; of the engine's modules ([`ENGINE`]), also each module directly inside.

use std::collections::{BTreeMap, BTreeSet};
use std::fs;
use std::path::{Path, PathBuf};

/// The modules of the engine, and everything that each may import.
const ENGINE: [(&str, &[&str]); 4] = [
    ("energy", &[]),
    ("surface", &["energy", "error", "mesh", "prefetch", "union_find"]),
    ("device", &["energy", "error", "prefetch", "surface", "union_find"]),
    ("cluster", &["device", "energy", "error", "hierarchy", "surface", "union_find"]),
];

/// Circles that are still there, and why. An entry that is no longer needed fails the test.
const KNOWN_CIRCLES: [(&[&str], &str); 0] = [];

/// A module's file: the path of the module, and its source.
struct Source {
    module: Vec<String>,
    text: String,
}

/// Imports: for each node, the nodes it names.
type Graph = BTreeMap<String, BTreeSet<String>>;

fn sources() -> Vec<Source> {
    let root = Path::new(env!("CARGO_MANIFEST_DIR")).join("src");
    let mut files = Vec::new();
    list(&root, &mut files);
    let source = |file: PathBuf| {
        let inside = file.strip_prefix(&root).expect("a file of src").with_extension("");
        let mut module: Vec<String> = inside.iter().map(|part| part.to_string_lossy().into_owned()).collect();
        module.retain(|part| part != "mod" && part != "lib");
        Source { module, text: fs::read_to_string(&file).expect("a source file") }
    };
    files.into_iter().map(source).filter(|source| source.module != ["main"]).collect()
}

fn list(folder: &Path, files: &mut Vec<PathBuf>) {
    for entry in fs::read_dir(folder).expect("a folder of src") {
        let path = entry.expect("an entry").path();
        if path.is_dir() {
            list(&path, files);
        } else if path.extension().is_some_and(|extension| extension == "rs") {
            files.push(path);
        }
    }
}

/// The source without comments, and without the tests at its end.
fn code(source: &str) -> String {
    let source = source.split("\n#[cfg(test)]\nmod tests {").next().unwrap_or(source);
    source.lines().map(|line| line.split("//").next().unwrap_or("")).collect::<Vec<_>>().join("\n")
}

/// Every path that begins with `crate`, `super` or `self`, groups in braces taken apart.
fn paths(code: &str) -> Vec<Vec<String>> {
    let is_name = |c: char| c.is_alphanumeric() || c == '_';
    let mut all = Vec::new();
    for start in ["crate", "super", "self"] {
        for (at, _) in code.match_indices(start) {
            let follows_path = code[..at].ends_with(|c: char| is_name(c) || c == ':' || c == '$');
            if !follows_path && code[at + start.len()..].starts_with("::") {
                tree(&code[at..], &[], &mut all);
            }
        }
    }
    // a path without one of these is a crate's or a child's
    for (at, _) in code.match_indices("use ") {
        let begins = code[..at].ends_with(['\n', ' ']) || at == 0;
        let is_relative = !["crate", "super", "self"].iter().any(|start| code[at + 4..].starts_with(start));
        if begins && is_relative {
            tree(&code[at + 4..], &["self".to_owned()], &mut all);
        }
    }
    all
}

/// Reads one path or `use` tree at the start of `text`; returns the rest.
fn tree<'a>(text: &'a str, prefix: &[String], all: &mut Vec<Vec<String>>) -> &'a str {
    let mut path = prefix.to_vec();
    let mut text = text.trim_start();
    loop {
        let end = text.find(|c: char| !(c.is_alphanumeric() || c == '_')).unwrap_or(text.len());
        path.push(text[..end].to_owned());
        text = text[end..].strip_prefix('*').unwrap_or(&text[end..]);
        let Some(rest) = text.strip_prefix("::") else { break };
        text = rest.trim_start();
        if let Some(mut group) = text.strip_prefix('{') {
            loop {
                group = group.trim_start();
                if let Some(rest) = group.strip_prefix('}') {
                    return rest;
                }
                let before = group.len();
                group = tree(group, &path, all).trim_start();
                group = group.strip_prefix(',').unwrap_or(group);
                assert!(
                    group.len() < before,
                    "an import that this test cannot read: {}",
                    &group[..group.len().min(60)]
                );
            }
        }
    }
    if let Some(rest) = text.trim_start().strip_prefix("as ") {
        text = rest.trim_start().trim_start_matches(|c: char| c.is_alphanumeric() || c == '_');
    }
    all.push(path);
    text
}

/// The module path that a path in `module` names, from the crate's root.
fn absolute(module: &[String], path: &[String]) -> Vec<String> {
    let mut from = match path[0].as_str() {
        "crate" => Vec::new(),
        _ => module.to_vec(),
    };
    for part in path {
        match part.as_str() {
            "crate" | "self" => {}
            "super" => {
                from.pop();
            }
            name => from.push(name.to_owned()),
        }
    }
    from
}

/// The node of a module path: its top-level module, in the engine with the module directly inside.
fn node(path: &[String], modules: &BTreeSet<Vec<String>>) -> Option<String> {
    let is_engine = ENGINE.iter().any(|(name, _)| path.first().is_some_and(|first| first == name));
    let depth = if is_engine && path.len() > 1 && modules.contains(&path[..2]) { 2 } else { 1 };
    modules.contains(path.get(..1)?).then(|| path[..depth].join("::"))
}

/// The graph of imports between the modules of some sources.
fn imports(sources: &[Source]) -> Graph {
    let modules: BTreeSet<Vec<String>> = sources.iter().map(|source| source.module.clone()).collect();
    let mut graph = Graph::new();
    for source in sources.iter().filter(|source| !source.module.iter().any(|part| part == "tests")) {
        let Some(from) = node(&source.module, &modules) else { continue };
        let named = paths(&code(&source.text)).into_iter().map(|path| absolute(&source.module, &path));
        let to = named.filter_map(|path| node(&path, &modules)).filter(|to| *to != from);
        graph.entry(from.clone()).or_default().extend(to);
    }
    graph
}

/// The sets of nodes that import each other in a circle.
fn circles(graph: &Graph) -> Vec<Vec<String>> {
    let reached = |from: &String| {
        let mut seen = BTreeSet::new();
        let mut open: Vec<&String> = graph[from].iter().collect();
        while let Some(next) = open.pop() {
            if seen.insert(next.clone()) {
                open.extend(graph.get(next).into_iter().flatten());
            }
        }
        seen
    };
    let reach: BTreeMap<&String, BTreeSet<String>> = graph.keys().map(|node| (node, reached(node))).collect();
    let mut found = BTreeSet::new();
    for (node, seen) in &reach {
        if seen.contains(*node) {
            let circle = seen.iter().filter(|other| reach.get(other).is_some_and(|back| back.contains(*node)));
            found.insert(circle.cloned().collect());
        }
    }
    found.into_iter().collect()
}

/// What a module of the engine imports although it may not: `from -> to`.
fn arrows_upwards(graph: &Graph) -> Vec<String> {
    let top = |node: &str| node.split("::").next().unwrap_or(node).to_owned();
    let mut found = Vec::new();
    for (engine, allowed) in ENGINE {
        for (from, to) in graph.iter().filter(|(from, _)| top(from) == engine) {
            let bad = to.iter().filter(|to| top(to) != engine && !allowed.contains(&top(to).as_str()));
            found.extend(bad.map(|to| format!("{from} -> {to}")));
        }
    }
    found
}

#[test]
fn modules_do_not_import_in_circles() {
    let known = KNOWN_CIRCLES.map(|(nodes, _)| nodes.iter().map(|&node| node.to_owned()).collect::<Vec<_>>());
    assert_eq!(circles(&imports(&sources())), known);
}

#[test]
fn the_engine_imports_nothing_above_it() {
    let graph = imports(&sources());
    assert_eq!(arrows_upwards(&graph), Vec::<String>::new());
    let of = |from: &str, to: &str| graph[from].contains(to);
    assert!(of("cluster::run", "device") && of("device::cpu", "energy") && of("job", "surface"), "{graph:?}");
}

/// Lines of code outside `energy` that name the CVD energy, or a distance of its proxies; the list of shaders may.
fn names_of_the_energy(sources: &[Source]) -> Vec<String> {
    let mut found = Vec::new();
    for source in sources.iter().filter(|source| source.module.first().is_some_and(|top| top != "energy")) {
        let is_test = source.module.iter().any(|part| part == "tests");
        for line in code(&source.text).lines().filter(|_| !is_test) {
            let rest = line.to_lowercase().replace("acvd", "").replace("\"energy/cvd\"", "");
            if rest.contains("cvd") || rest.contains("squared_distance") {
                found.push(format!("{}: {}", source.module.join("::"), line.trim()));
            }
        }
    }
    found
}

#[test]
fn only_the_module_of_energies_names_one() {
    assert_eq!(names_of_the_energy(&sources()), Vec::<String>::new());
    let module = vec!["cluster".to_owned()];
    let text = "use crate::energy::cvd::End; // cvd\nuse super::reference::acvd;".to_owned();
    assert_eq!(names_of_the_energy(&[Source { module, text }]), ["cluster: use crate::energy::cvd::End;"]);
}

#[test]
fn an_invented_circle_and_an_invented_arrow_upwards_are_found() {
    let source = |module: &str, text: &str| Source {
        module: module.split("::").map(str::to_owned).collect(),
        text: text.to_owned(),
    };
    let invented = [
        source("energy", "use crate::{error::{self, Error}, job::Job as Work};"),
        source("error", "//! [`crate::job`]\nfn f() { crate::surface::build(); }"),
        source("surface", "mod inner;\npub use inner::X;"),
        source("surface::inner", "use super::{Surface, y};\n#[cfg(test)]\nmod tests { use crate::error::E; }"),
        source("job", "use crate::energy::Energy;"),
    ];
    let graph = imports(&invented);
    let found = circles(&graph);
    assert_eq!(found, [vec!["energy", "job"], vec!["surface", "surface::inner"]]);
    assert_eq!(arrows_upwards(&graph), ["energy -> error", "energy -> job"]);
    assert_eq!(graph["error"], BTreeSet::from(["surface".to_owned()]));
}
