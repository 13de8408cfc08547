//! The colour of a cluster, the same in every file: a hue of the table in turn, at one of three strengths. The page and
//! pictures have the same hues; they draw lines between clusters and choose hues that differ from those of neighbours.

/// Eight hues of near-equal lightness and chroma (OKLCH), sRGB.
pub const HUES: [[u8; 3]; 8] = [
    [241, 138, 142],
    [97, 185, 222],
    [222, 199, 112],
    [207, 142, 211],
    [150, 204, 131],
    [136, 153, 230],
    [240, 166, 108],
    [100, 195, 178],
];

/// Parts of full strength, in percent: clusters that are eight apart differ.
const STRENGTHS: [u32; 3] = [100, 76, 88];

/// Red, green and blue of a cluster, sRGB: hue i mod 8 at strength i / 8 mod 3.
pub fn of_cluster(cluster: u32) -> [u8; 3] {
    let strength = STRENGTHS[(cluster as usize / HUES.len()) % STRENGTHS.len()];
    HUES[cluster as usize % HUES.len()].map(|channel| ((u32::from(channel) * strength + 50) / 100) as u8)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The three numbers of each line of a file that is such a row of a table, whatever the brackets.
    fn rows(text: &str) -> Vec<[u8; 3]> {
        let row = |line: &str| {
            let numbers = line.split([',', ' ', '[', ']', '(', ')']).filter(|word| !word.is_empty());
            numbers.map(|word| word.parse().ok()).collect::<Option<Vec<u8>>>()?.try_into().ok()
        };
        text.lines().filter_map(row).collect()
    }

    #[test]
    fn page_pictures_and_guide_have_the_hues_of_this_table() {
        assert_eq!(rows("  [1, 2, 3],\n  (4, 5, 6),\nx [7, 8, 9]\n[1, 2],"), [[1, 2, 3], [4, 5, 6]]);
        for path in ["web/src/palette.ts", "tests/scripts/colours.py"] {
            let root = std::path::Path::new(env!("CARGO_MANIFEST_DIR"));
            let text = std::fs::read_to_string(root.join(path)).expect("a file of the repository");
            let found = rows(&text);
            assert_eq!(found.get(..HUES.len()), Some(&HUES[..]), "{path}");
        }
    }

    #[test]
    fn clusters_in_a_row_differ() {
        let colours: Vec<[u8; 3]> = (0..1000).map(of_cluster).collect();
        for (first, one) in colours.iter().enumerate() {
            for other in &colours[first + 1..colours.len().min(first + 24)] {
                let distance: i32 = (0..3).map(|at| (i32::from(one[at]) - i32::from(other[at])).abs()).sum();
                assert!(distance > 20, "{first}: {one:?} {other:?}");
            }
        }
        assert_eq!([of_cluster(0), of_cluster(8), of_cluster(24)], [HUES[0], [183, 105, 108], HUES[0]]);
        assert_eq!(of_cluster(u32::MAX).len(), 3);
    }
}
