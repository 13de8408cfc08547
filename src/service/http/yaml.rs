//! YAML that readers of both versions understand: 1.1, which many programs read, takes some words for booleans.

/// Quotes the words that YAML 1.1 takes for booleans, where they are values.
pub(crate) fn quoted(yaml: &str) -> String {
    let line = |line: &str| match line.rsplit_once(' ') {
        Some((head, word @ ("on" | "off" | "yes" | "no" | "y" | "n"))) if head.ends_with(['-', ':']) => {
            format!("{head} '{word}'\n")
        }
        _ => format!("{line}\n"),
    };
    yaml.lines().map(line).collect()
}

#[cfg(test)]
mod tests {
    use super::quoted;

    #[test]
    fn words_that_are_values_are_quoted_and_texts_are_not() {
        let (yaml, expected) = (
            "enum:\n- off\n- obj\ndefault: on\ntext: on and off\n",
            "enum:\n- 'off'\n- obj\ndefault: 'on'\ntext: on and off\n",
        );
        assert_eq!(quoted(yaml), expected);
    }
}
