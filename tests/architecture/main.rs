//! What a compiler does not check about the source: layers, circles of imports, lengths of files and lines, words,
//! and names of packages.

mod energy_words;
mod imports;
mod names;
mod style;

use std::fs;
use std::path::{Path, PathBuf};

/// A source file.
struct Source {
    /// Path below the repository, as in `src/service/lib.rs`.
    path: String,
    text: String,
}

/// The files with these extensions below some folders of the repository.
fn sources(folders: &[&str], extensions: &[&str]) -> Vec<Source> {
    let root = Path::new(env!("CARGO_MANIFEST_DIR"));
    let mut open: Vec<PathBuf> = folders.iter().map(|folder| root.join(folder)).collect();
    let mut found = Vec::new();
    while let Some(folder) = open.pop() {
        for entry in fs::read_dir(folder).expect("a folder") {
            let path = entry.expect("an entry").path();
            if path.is_dir() {
                open.push(path);
            } else if path.extension().is_some_and(|extension| extensions.iter().any(|one| extension == *one)) {
                let inside = path.strip_prefix(root).expect("below the root").to_string_lossy().replace('\\', "/");
                found.push(Source { path: inside, text: fs::read_to_string(&path).expect("a source file") });
            }
        }
    }
    found.sort_by(|one, other| one.path.cmp(&other.path));
    found
}

/// An invented file, for the tests of the tests.
fn invented(path: &str, text: &str) -> Source {
    Source { path: path.to_owned(), text: text.to_owned() }
}
