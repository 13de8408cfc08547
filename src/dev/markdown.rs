//! Tables of reports in Markdown.

use std::fmt::Write;

/// The head of a table: text to the left, numbers to the right.
pub(crate) fn table_head<S: AsRef<str>>(out: &mut String, cells: &[S]) {
    line(out, cells);
    let _ = writeln!(out, "|---|{}", "--:|".repeat(cells.len() - 1));
}

/// A line of a table.
pub(crate) fn line<S: AsRef<str>>(out: &mut String, cells: &[S]) {
    for cell in cells {
        let _ = write!(out, "| {} ", cell.as_ref().replace('|', "\\|"));
    }
    out.push_str("|\n");
}

/// What the processor calls itself, where the system tells.
pub(crate) fn processor() -> String {
    let text = std::fs::read_to_string("/proc/cpuinfo").unwrap_or_default();
    let name = text.lines().find_map(|line| line.strip_prefix("model name")?.split_once(':'));
    name.map_or_else(|| "processor unknown".to_owned(), |(_, name)| name.trim().to_owned())
}
