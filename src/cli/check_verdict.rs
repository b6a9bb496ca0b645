//! The verdict of `starloop check`: the first line of its report, and the warnings that it counts.
//!
//! Every line of the report with the word WARNING is one warning, whichever section prints it: a bench with any is not
//! called sound. What several frames share is counted once.

/// Word that makes a line of the report a warning.
const WORD: &str = "WARNING";

/// Returns the warnings of a report in order, without the word, each once.
pub(super) fn warnings(report: &str) -> Vec<&str> {
    let mut found: Vec<&str> = Vec::new();
    for (_, words) in report.lines().filter_map(|line| line.split_once(WORD)) {
        let words = words.trim_start_matches([':', ' ']).trim_end();
        if !found.contains(&words) {
            found.push(words);
        }
    }
    found
}

/// Returns the verdict on `what`, such as `bench "lab"`: one line, and below it the warnings, numbered.
pub(super) fn verdict(what: &str, warnings: &[&str]) -> String {
    if warnings.is_empty() {
        return format!("{what} is sound\n");
    }
    let plural = if warnings.len() == 1 { "" } else { "s" };
    let lines = warnings.iter().zip(1..).map(|(words, number)| format!("  {number}. {words}\n"));
    format!("{WORD}: {what}: {} warning{plural}\n{}\n", warnings.len(), lines.collect::<String>())
}

#[cfg(test)]
mod tests {
    use super::*;

    const REPORT: &str = "bench \"a\"\n  camera       \"b\"\n  WARNING      too dark\n  level        full; WARNING: late\n  \
                          WARNING      too dark\n";

    #[test]
    fn warnings_of_the_text_are_listed_once_and_nothing_else() {
        assert_eq!(warnings(REPORT), ["too dark", "late"]);
    }

    #[test]
    fn a_report_with_warnings_is_not_called_sound() {
        assert_eq!(verdict("bench \"a\"", &[]), "bench \"a\" is sound\n");
        let text = verdict("bench \"a\"", &warnings(REPORT));
        assert_eq!(text, "WARNING: bench \"a\": 2 warnings\n  1. too dark\n  2. late\n\n");
        assert!(verdict("bench \"a\"", &["late"]).starts_with("WARNING: bench \"a\": 1 warning\n"));
    }
}
