//! Names of files with `{name}` and `{k}`, for several meshes and several numbers of clusters.

use std::ffi::{OsStr, OsString};
use std::path::{Path, PathBuf};

/// The name of the mesh, without folder and extension.
pub const NAME: &str = "{name}";

/// The number of clusters.
pub const CLUSTERS: &str = "{k}";

/// Whether a path has a pattern in it.
pub fn has(path: &Path, pattern: &str) -> bool {
    path.to_str().is_some_and(|text| text.contains(pattern))
}

/// The path with the name and the number of clusters, if there is one, in place of their patterns. One that is not
/// UTF-8 has no patterns.
pub fn filled(path: &Path, name: &OsStr, clusters: Option<u64>) -> PathBuf {
    let Some(mut rest) = path.to_str() else { return path.to_owned() };
    let mut filled = OsString::new();
    while let Some(at) = rest.find('{') {
        filled.push(&rest[..at]);
        rest = &rest[at..];
        if let Some(after) = rest.strip_prefix(NAME) {
            filled.push(name);
            rest = after;
        } else if let (Some(after), Some(clusters)) = (rest.strip_prefix(CLUSTERS), clusters) {
            filled.push(clusters.to_string());
            rest = after;
        } else {
            filled.push("{");
            rest = &rest[1..];
        }
    }
    filled.push(rest);
    filled.into()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn patterns_are_filled_once_and_other_braces_stay() {
        let filled = |path: &str, k| filled(Path::new(path), OsStr::new("a{k}"), k);
        for (path, k, expected) in [
            ("out/{name}-{k}.npy", Some(7), "out/a{k}-7.npy"),
            ("{k}{k}", Some(12), "1212"),
            ("{name}-{k}", None, "a{k}-{k}"),
            ("{x}-{}{", Some(1), "{x}-{}{"),
        ] {
            assert_eq!(filled(path, k), PathBuf::from(expected));
        }
    }
}
