//! Lengths of files and lines, and words that comments do without.

use super::{Source, invented, sources};

/// Lines of a file, unless one of its first [`HEAD`] lines says why it has more than "400 lines".
const LINES: usize = 400;

/// Lines at the beginning of a file that may give a reason for its length.
const HEAD: usize = 5;

/// Characters of a line.
const COLUMNS: usize = 120;

/// Words that hide the subject of a sentence (a type, a function, a thread), or a number.
const FORBIDDEN: [&str; 6] = ["whoever", "nobody", "is told", "asks for", "asked for", "so many that"];

#[test]
fn files_lines_and_words_are_as_they_should_be() {
    let found = complaints(&sources(&["src", "tests", "benches", "shaders"], &["rs", "wgsl"]));
    assert!(found.is_empty(), "{}", found.join("\n"));
}

#[test]
fn long_files_long_lines_and_forbidden_words_are_found() {
    let long = "x\n".repeat(LINES + 1);
    let found = complaints(&[
        invented("long.rs", &long),
        invented("reason.rs", &format!("//! More than 400 lines: one table.\n{long}")),
        invented("wide.wgsl", &format!("{}\n{}\n", "ü".repeat(COLUMNS), "ü".repeat(COLUMNS + 1))),
        invented("words.rs", "/// Nobody is told\nlet nobody = \"is told // asked for\"; // whoever\n"),
    ]);
    let expected = [
        "long.rs: 401 lines without a reason in the first 5",
        "wide.wgsl:2: 121 columns",
        "words.rs:1: \"nobody\" in a comment",
        "words.rs:1: \"is told\" in a comment",
        "words.rs:2: \"whoever\" in a comment",
    ];
    assert_eq!(found, expected);
}

fn complaints(sources: &[Source]) -> Vec<String> {
    let mut found = Vec::new();
    for Source { path, text } in sources {
        let lines = text.lines().count();
        if lines > LINES && !text.lines().take(HEAD).any(|line| line.contains("400 lines")) {
            found.push(format!("{path}: {lines} lines without a reason in the first {HEAD}"));
        }
        for (number, line) in (1..).zip(text.lines()) {
            let columns = line.chars().count();
            if columns > COLUMNS {
                found.push(format!("{path}:{number}: {columns} columns"));
            }
            let comment = comment(line).to_lowercase();
            let words = FORBIDDEN.iter().filter(|word| comment.contains(*word));
            found.extend(words.map(|word| format!("{path}:{number}: {word:?} in a comment")));
        }
    }
    found
}

/// The comment in a line: what follows the first `//` outside of a string.
fn comment(line: &str) -> &str {
    let quotes = |text: &str| text.matches('"').count() - text.matches("\\\"").count();
    let outside = line.match_indices("//").find(|(at, _)| quotes(&line[..*at]).is_multiple_of(2));
    outside.map_or("", |(at, _)| &line[at..])
}
