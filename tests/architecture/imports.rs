//! Imports: no module and no file imports in a circle, no folder of the service does, and each only what stands above
//! it in the map of the crate.
//!
//! The tests read the paths in the source (`crate::`, `super::`, `self::`, `use`, names of the other crates), without
//! comments and test code. A `mod` item is no import: a parent that declares a child does not use it.

use std::collections::{BTreeMap, BTreeSet};

use super::{Source, invented, sources};

/// The modules of the engine.
const ENGINE: [&str; 6] = ["energy", "surface", "complex", "remesh", "device", "cluster"];

/// What modules may not import although it stands above them in the map: an energy is arithmetic, and neither devices
/// nor algorithms know file formats.
const APART: [(&str, &[&str]); 3] = [("energy", &["error", "mesh"]), ("device", &["mesh"]), ("cluster", &["mesh"])];

/// The crates: the folder of each, and the name by which others import it.
const CRATES: [(&str, &str); 3] = [("", "tesserae_mesh"), ("service", "tesserae_service"), ("cli", "tesserae_cli")];

/// Imports: for each node, the nodes that it names.
type Graph = BTreeMap<String, BTreeSet<String>>;

#[test]
fn modules_do_not_import_in_circles() {
    assert_eq!(circles(&imports(&crate_sources(), layer)), Vec::<Vec<String>>::new());
}

#[test]
fn files_do_not_import_in_circles() {
    let graph = without_parents(imports(&crate_sources(), file));
    assert!(graph.len() > 300 && graph["mesh::format"].contains("mesh::gltf"), "{graph:?}");
    assert_eq!(circles(&graph), Vec::<Vec<String>>::new());
    let graph = without_parents(python_imports(&sources(&["python/tesserae_mesh"], &["py"])));
    let of = |from: &str, to: &str| graph[from].contains(to);
    assert!(of("_cluster", "_clustering") && of("client::sync", "client::results"), "{graph:?}");
    assert_eq!(circles(&graph), Vec::<Vec<String>>::new());
}

#[test]
fn files_of_the_service_do_not_import_in_circles() {
    let graph = imports(&crate_sources(), file_of_the_service);
    assert!(graph.len() > 50 && graph["service::files::retention"].contains("service::store"), "{graph:?}");
    assert_eq!(circles(&graph), Vec::<Vec<String>>::new());
}

#[test]
fn folders_of_the_service_do_not_import_in_circles() {
    let graph = imports(&crate_sources(), folder_of_the_service);
    assert!(graph.len() > 10 && graph["service::files"].contains("service::blobs"), "{graph:?}");
    assert_eq!(circles(&graph), Vec::<Vec<String>>::new());
}

#[test]
fn modules_import_only_modules_above_them_in_the_map_of_the_crate() {
    let sources = crate_sources();
    let order = map(&sources.iter().find(|source| source.path == "src/lib.rs").expect("the library").text);
    assert!(order.len() > 10, "{order:?}");
    let graph = imports(&sources, layer);
    assert_eq!(arrows_downwards(&graph, &order), Vec::<String>::new());
    let order = map("//! | [`mod@error`] | x |\n//! | [`mesh`] | y |");
    let graph = Graph::from([("error".to_owned(), BTreeSet::from(["mesh".to_owned(), "error".to_owned()]))]);
    assert_eq!(arrows_downwards(&graph, &order), ["error -> mesh"]);
}

#[test]
fn rooms_of_the_service_import_only_rooms_below_them_in_its_map() {
    let sources = crate_sources();
    let order = map(&sources.iter().find(|source| source.path == "src/service/lib.rs").expect("the service").text);
    let order: Vec<String> = order.iter().rev().map(|room| format!("service::{room}")).collect();
    let graph = imports(&sources, folder_of_the_service);
    let left_out: Vec<&String> = graph.keys().filter(|room| !order.contains(room)).collect();
    assert_eq!(left_out, ["service::backup", "service::fuzzing", "service::server"]);
    assert_eq!(arrows_downwards(&graph, &order), Vec::<String>::new());
    let order = ["service::queue", "service::store"].map(str::to_owned);
    let graph = Graph::from([("service::queue".to_owned(), BTreeSet::from(["service::store".to_owned()]))]);
    assert_eq!(arrows_downwards(&graph, &order), ["service::queue -> service::store"]);
    // what the crate exports for others, its rooms import from where it is
    let of_the_crate = sources.iter().filter(|source| source.path.starts_with("src/service/"));
    let from_the_root = of_the_crate.filter(|source| {
        let is_type = |name: &String| name.starts_with(char::is_uppercase);
        paths(&code(&source.text)).iter().any(|path| path[0] == "crate" && path.get(1).is_some_and(is_type))
    });
    assert_eq!(from_the_root.map(|source| &source.path).collect::<Vec<_>>(), Vec::<&String>::new());
}

#[test]
fn the_engine_knows_no_file_format_and_an_energy_nothing() {
    let graph = imports(&crate_sources(), layer);
    assert_eq!(arrows_between(&graph, &APART), Vec::<String>::new());
    let of = |from: &str, to: &str| graph[from].contains(to);
    assert!(of("cluster::run", "device") && of("device::cpu", "energy") && of("job", "surface"), "{graph:?}");
    assert!(of("cli", "service") && of("cli", "job") && of("service", "job"), "{graph:?}");
}

#[test]
fn invented_circles_and_arrows_are_found() {
    let graph = imports(
        &[
            invented("src/energy.rs", "use crate::{error::{self, Error}, job::Job as Work};"),
            invented("src/error.rs", "//! [`crate::job`]\nfn f() { crate::surface::build(); }"),
            invented("src/surface/mod.rs", "mod inner;\npub use inner::X;"),
            invented(
                "src/surface/inner.rs",
                "use super::{Surface, y};\n#[cfg(test)]\nmod tests { use crate::error::E; }",
            ),
            invented("src/job.rs", "use crate::energy::Energy;"),
        ],
        layer,
    );
    assert_eq!(circles(&graph), [vec!["energy", "job"], vec!["surface", "surface::inner"]]);
    assert_eq!(arrows_between(&graph, &APART), ["energy -> error"]);
    let order = ["error", "energy", "job"].map(str::to_owned);
    assert_eq!(arrows_downwards(&graph, &order), ["energy -> job"]);
    assert_eq!(graph["error"], BTreeSet::from(["surface".to_owned()]));
}

#[test]
fn a_circle_of_files_is_found_however_it_is_written() {
    let circles_of = |first: &str, second: &str| {
        let files = [invented("src/service/first.rs", first), invented("src/service/second.rs", second)];
        circles(&imports(&files, file_of_the_service)).len()
    };
    for (first, second) in [
        ("use crate::second::B;", "use super::first::A;"),
        ("use super::{other::X, second::{self, B}};", "fn f() -> super::first::A {}"),
        ("pub use crate::{error::E, second};", "use crate::first::{A};"),
        ("use super::second;\n#[cfg(test)]\nmod tests {\n}\n", "// about it\nuse super::first as other;"),
        ("use super::second;", "trait T {\n    #[cfg(test)]\n    fn f() {\n    }\n    fn g() -> super::first::A;\n}"),
    ] {
        assert_eq!(circles_of(first, second), 1, "{first} {second}");
    }
    for (first, second) in [
        ("use tesserae_service::second::B;", "// use super::first::A;"),
        ("use crate::second::B;", "#[cfg(test)]\nmod tests {\n    use crate::first::A;\n}"),
        ("use crate::second::B;", "#[cfg(test)]\nuse crate::first::A;\n"),
        ("use crate::second::B;", "use tesserae_mesh::first::A;"),
        ("use super::second::B;", "pub(in crate::first) struct B;"),
    ] {
        assert_eq!(circles_of(first, second), 0, "{first} {second}");
    }
}

#[test]
fn circles_of_files_are_found_below_one_parent_and_in_python() {
    let files = [
        invented("src/mesh/mod.rs", "mod one;\npub use self::one::One;\npub struct Part;"),
        invented("src/mesh/one.rs", "use super::Part;\nuse super::two::Two;"),
        invented("src/mesh/two.rs", "use super::one::One;"),
    ];
    assert_eq!(circles(&without_parents(imports(&files, file))), [["mesh::one", "mesh::two"]]);
    let files = [
        invented("python/tesserae_mesh/__init__.py", "from tesserae_mesh._one import One"),
        invented(
            "python/tesserae_mesh/_one.py",
            "from tesserae_mesh import _native\nfrom tesserae_mesh.client import two",
        ),
        invented(
            "python/tesserae_mesh/client/two.py",
            "def f():\n    from tesserae_mesh._one import (\n        One,\n    )",
        ),
    ];
    assert_eq!(circles(&without_parents(python_imports(&files))), [["_one", "client::two"]]);
}

fn crate_sources() -> Vec<Source> {
    sources(&["src"], &["rs"])
}

/// The path of a file's module, from the crate's root.
fn module(source: &Source) -> Vec<String> {
    let inside = source.path.trim_start_matches("src/").trim_end_matches(".rs");
    inside.split('/').filter(|part| !["mod", "lib", "main"].contains(part)).map(str::to_owned).collect()
}

/// The node of a module among layers: its top-level module, in the engine with the module directly inside.
fn layer(module: &[String]) -> Option<String> {
    let is_engine = ENGINE.iter().any(|name| module.first().is_some_and(|first| first == name));
    let depth = if is_engine { module.len().min(2) } else { 1 };
    module.get(..depth).filter(|node| !node.is_empty()).map(|node| node.join("::"))
}

/// The node of a module among all files.
fn file(module: &[String]) -> Option<String> {
    (!module.is_empty()).then(|| module.join("::"))
}

/// A graph of files less the imports between a module and those inside it, which make one unit: a parent exports what
/// its children define, and children use what it has in common for them.
fn without_parents(mut graph: Graph) -> Graph {
    let is_inside = |inner: &str, outer: &str| inner.strip_prefix(outer).is_some_and(|rest| rest.starts_with("::"));
    graph.iter_mut().for_each(|(from, all)| all.retain(|to| !is_inside(from, to) && !is_inside(to, from)));
    graph
}

/// The node of a module among the files of the service.
fn file_of_the_service(module: &[String]) -> Option<String> {
    (module.len() > 1 && module[0] == "service").then(|| module.join("::"))
}

/// The node of a module among the files and folders directly in the service.
fn folder_of_the_service(module: &[String]) -> Option<String> {
    file_of_the_service(module.get(..2)?)
}

/// The graph of imports between nodes.
fn imports(sources: &[Source], node: fn(&[String]) -> Option<String>) -> Graph {
    let modules: BTreeSet<Vec<String>> = sources.iter().map(module).collect();
    let mut graph = Graph::new();
    for source in sources {
        let from = module(source);
        let is_test = from.iter().any(|part| part == "tests" || part == "conformance");
        let Some(name) = node(&from).filter(|_| !is_test) else { continue };
        let named = paths(&code(&source.text)).into_iter().filter_map(|path| resolve(&path, &from, &modules));
        let to = named.filter_map(|to| node(&to)).filter(|to| *to != name);
        graph.entry(name.clone()).or_default().extend(to);
    }
    graph
}

/// The graph of imports between the modules of the Python package, those inside functions and for type checkers too.
fn python_imports(sources: &[Source]) -> Graph {
    let name = |path: &str| path.trim_start_matches("tesserae_mesh").trim_matches('.').replace('.', "::");
    let module = |source: &Source| {
        let path = source.path.trim_start_matches("python/").trim_end_matches(".py").trim_end_matches("/__init__");
        name(&path.replace('/', "."))
    };
    let modules: BTreeSet<String> = sources.iter().map(module).collect();
    let named = |line: &str| {
        let (from, names) = line.trim().strip_prefix("from tesserae_mesh")?.split_once(" import ")?;
        let names = names.trim_start_matches('(').split(", ").map(|inner| name(&format!("{from}.{inner}")));
        let known = names.map(|inner| if modules.contains(&inner) { inner } else { name(from) });
        Some(known.filter(|known| !known.is_empty()).collect::<Vec<_>>())
    };
    let imports = |source: &Source| source.text.lines().filter_map(named).flatten().collect();
    sources.iter().map(|source| (module(source), imports(source))).filter(|(name, _)| !name.is_empty()).collect()
}

/// The source without comments and without what is compiled for tests only.
fn code(text: &str) -> String {
    let text = text.lines().map(|line| line.split("//").next().unwrap_or("")).collect::<Vec<_>>().join("\n");
    let mut parts = text.split("#[cfg(test)]");
    let mut code = parts.next().unwrap_or_default().to_owned();
    for part in parts {
        let indent = code.len() - code.trim_end_matches(' ').len();
        // an item in braces ends at a brace with its indentation, another one at its semicolon
        let is_statement = part.find(';').is_some_and(|end| part.find('{').is_none_or(|brace| end < brace));
        let end = match is_statement || part.trim_start().starts_with("use ") {
            true => part.find(';').map(|at| at + 1),
            false => {
                let brace = format!("\n{}}}", " ".repeat(indent));
                part.find(&brace).map(|at| at + brace.len())
            }
        };
        code.push_str(end.map_or("", |end| &part[end..]));
    }
    code
}

/// Every path that begins with `crate`, `super` or `self`, and every relative `use`, groups in braces taken apart.
fn paths(code: &str) -> Vec<Vec<String>> {
    let is_name = |c: char| c.is_alphanumeric() || c == '_';
    const STARTS: [&str; 6] = ["crate", "super", "self", CRATES[0].1, CRATES[1].1, CRATES[2].1];
    let mut all = Vec::new();
    for (at, _) in STARTS.iter().flat_map(|start| code.match_indices(start)) {
        let before = &code[..at];
        let follows_path =
            before.ends_with(|c: char| is_name(c) || c == ':' || c == '$') || before.ends_with("pub(in ");
        let rest = code[at..].trim_start_matches(is_name);
        if !follows_path && rest.starts_with("::") {
            tree(&code[at..], &[], &mut all);
        }
    }
    for (at, _) in code.match_indices("use ") {
        let begins = at == 0 || code[..at].ends_with(['\n', ' ']);
        if begins && !STARTS.iter().any(|start| code[at + 4..].starts_with(start)) {
            tree(&code[at + 4..], &["".to_owned()], &mut all);
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
                let start = &group[..group.len().min(60)];
                assert!(group.len() < before, "an import that this test cannot read: {start}");
            }
        }
    }
    if let Some(rest) = text.trim_start().strip_prefix("as ") {
        text = rest.trim_start().trim_start_matches(|c: char| c.is_alphanumeric() || c == '_');
    }
    all.push(path);
    text
}

/// The module that a path in `module` leads to. A relative path (with an empty first name) is a child's or a crate's.
fn resolve(path: &[String], module: &[String], modules: &BTreeSet<Vec<String>>) -> Option<Vec<String>> {
    let of_folder = |folder: &str| Vec::from_iter((!folder.is_empty()).then(|| folder.to_owned()));
    let own = CRATES.iter().find(|(folder, _)| module.first().is_some_and(|first| first == folder));
    let mut base = module.to_vec();
    for name in path {
        match name.as_str() {
            "crate" => base = of_folder(own.map_or("", |(folder, _)| folder)),
            "super" => drop(base.pop()),
            "self" | "" => {}
            name => match CRATES.iter().find(|(_, of_others)| *of_others == name) {
                Some((folder, _)) => base = of_folder(folder),
                None => base.push(name.to_owned()),
            },
        }
    }
    if path[0].is_empty() && !modules.contains(base.get(..=module.len())?) {
        return None;
    }
    while !base.is_empty() && !modules.contains(&base) {
        base.pop();
    }
    (!base.is_empty()).then_some(base)
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

/// The modules in the table of a crate's documentation, in its order.
fn map(text: &str) -> Vec<String> {
    let rows = text.lines().filter_map(|line| line.strip_prefix("//! | [`"));
    rows.filter_map(|row| Some(row.split('`').next()?.trim_start_matches("mod@").to_owned())).collect()
}

/// Imports of a module that stands lower in the map: `from -> to`. What the map leaves out lies below all of it.
fn arrows_downwards(graph: &Graph, order: &[String]) -> Vec<String> {
    let is_its = |name: &String, node: &str| node == name || node.starts_with(&format!("{name}::"));
    let place = |node: &str| order.iter().position(|name| is_its(name, node));
    let arrows = graph.iter().flat_map(|(from, to)| to.iter().map(move |to| (from, to)));
    let bad = arrows.filter(|(from, to)| place(from).is_some_and(|from| place(to).is_some_and(|to| to > from)));
    bad.map(|(from, to)| format!("{from} -> {to}")).collect()
}

/// Imports that a list forbids: `from -> to`.
fn arrows_between(graph: &Graph, forbidden: &[(&str, &[&str])]) -> Vec<String> {
    fn top(node: &str) -> &str {
        node.split("::").next().unwrap_or(node)
    }
    let arrows = graph.iter().flat_map(|(from, to)| to.iter().map(move |to| (from, to)));
    let is_bad = |from: &str, to: &str| forbidden.iter().any(|(one, others)| *one == from && others.contains(&to));
    arrows.filter(|(from, to)| is_bad(top(from), top(to))).map(|(from, to)| format!("{from} -> {to}")).collect()
}
