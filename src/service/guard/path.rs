//! How much of a client's path is repeated.

/// Longest path of a request that is logged or sent back, in bytes.
const MAX_PATH: usize = 256;

pub(crate) fn cut(path: &str) -> &str {
    &path[..path.floor_char_boundary(MAX_PATH)]
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_path_is_cut_between_characters() {
        assert_eq!(cut("/v1/jobs"), "/v1/jobs");
        let long = format!("/{}", "ü".repeat(500));
        assert!(cut(&long).len() == MAX_PATH - 1 && long.starts_with(cut(&long)));
    }
}
