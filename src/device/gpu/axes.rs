//! Points of several numbers of coordinates: kernels are written out for each.

/// Coordinates of a point at most. Sums of more take too many registers of a thread.
pub const MOST_AXES: usize = 8;

/// What repeats the text in its parentheses, and what joins the copies.
const REPEATS: [(&str, &str); 3] = [("@list(", ", "), ("@sum(", " + "), ("@each(", "\n    ")];

/// Writes out what WGSL has once for each axis of a point, as `$`, or for each sum of a cluster, as `#`: `@list(a[$])`
/// becomes `a[0], a[1], a[2]`; with `@sum`, plus signs join the copies, and with `@each` ends of lines.
pub fn written_out(text: &str, axes: usize, sums: usize) -> String {
    let mut written = String::with_capacity(text.len());
    let mut rest = text;
    let next = |rest: &str| REPEATS.iter().filter_map(|repeat| Some((rest.find(repeat.0)?, repeat))).min();
    while let Some((at, (mark, joint))) = next(rest) {
        let inside = &rest[at + mark.len()..];
        let end = closing(inside);
        let (sign, count) = if inside[..end].contains('#') { ("#", sums) } else { ("$", axes) };
        let copies: Vec<String> = (0..count).map(|at| inside[..end].replace(sign, &at.to_string())).collect();
        written.push_str(&rest[..at]);
        written.push_str(&copies.join(joint));
        rest = inside[end..].strip_prefix(')').unwrap_or("");
    }
    written + rest
}

/// The place of the parenthesis that closes one before the text, or its end.
fn closing(text: &str) -> usize {
    let mut open = 1;
    let is_closing = |&(_, sign): &(usize, char)| {
        open += i32::from(sign == '(') - i32::from(sign == ')');
        open == 0
    };
    text.char_indices().find(is_closing).map_or(text.len(), |(at, _)| at)
}

#[cfg(test)]
mod tests {
    use super::written_out;

    #[test]
    fn axes_and_sums_are_written_out() {
        let text = "a @list(f(x[$])) b @sum(y_$ * (z - $)) c\n    @each(add(#u, s[#]);) d";
        assert_eq!(
            written_out(text, 2, 3),
            "a f(x[0]), f(x[1]) b y_0 * (z - 0) + y_1 * (z - 1) c\n    add(0u, s[0]);\n    add(1u, s[1]);\n    \
             add(2u, s[2]); d"
        );
        assert_eq!(written_out("@list(a[$]", 2, 3), "a[0], a[1]");
        assert_eq!(written_out("nothing", 2, 3), "nothing");
    }
}
