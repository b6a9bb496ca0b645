//! Messages as a terminal may show them: values of files may hold any character, and be of any length.
//!
//! Control characters are escaped, since they can move the cursor, ring the bell or change what is on the screen; lines
//! are shortened in the middle, since a value may be a file of its own. The operating system's numbers of errors and
//! the temporary names of files are left out: they help no reader. Every error passes here before it is printed.

/// Characters of a line at its beginning that are kept.
const KEPT_FIRST: usize = 2000;
/// Characters at its end that are kept.
const KEPT_LAST: usize = 300;

/// Returns the text with control characters escaped (line breaks and tabs stay) and long lines shortened.
pub(super) fn plain_text(text: &str) -> String {
    let text = without_error_numbers(&without_temporary_names(text));
    text.split('\n').map(|line| shortened(&escaped(line))).collect::<Vec<_>>().join("\n")
}

/// Returns the text without ` (os error 2)` and the like.
fn without_error_numbers(text: &str) -> String {
    const START: &str = " (os error ";
    let mut pieces = text.split(START);
    let mut kept = pieces.next().unwrap_or_default().to_owned();
    for piece in pieces {
        match piece.split_once(')') {
            Some((number, rest)) if number.bytes().all(|byte| byte.is_ascii_digit()) => kept.push_str(rest),
            _ => kept.extend([START, piece]),
        }
    }
    kept
}

/// Returns the text without ` at path ".../.frame.png.A1b2C3.part"`.
fn without_temporary_names(text: &str) -> String {
    const START: &str = " at path \"";
    let mut pieces = text.split(START);
    let mut kept = pieces.next().unwrap_or_default().to_owned();
    for piece in pieces {
        match piece.split_once('"') {
            Some((path, rest)) if path.ends_with(".part") => kept.push_str(rest),
            _ => kept.extend([START, piece]),
        }
    }
    kept
}

fn escaped(line: &str) -> String {
    let mut plain = String::with_capacity(line.len());
    for c in line.chars() {
        if c.is_control() && c != '\t' {
            plain.extend(c.escape_default());
        } else {
            plain.push(c);
        }
    }
    plain
}

fn shortened(line: &str) -> String {
    let characters = line.chars().count();
    let left_out = characters.saturating_sub(KEPT_FIRST + KEPT_LAST);
    if left_out == 0 {
        return line.into();
    }
    let first: String = line.chars().take(KEPT_FIRST).collect();
    let last: String = line.chars().skip(characters - KEPT_LAST).collect();
    format!("{first} ... ({left_out} characters left out) ... {last}")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn control_characters_are_escaped_and_line_breaks_stay() {
        assert_eq!(
            plain_text("name \u{1b}[2J\u{7}\u{9b}1m\r is\n\tnone"),
            "name \\u{1b}[2J\\u{7}\\u{9b}1m\\r is\n\tnone"
        );
        assert_eq!(plain_text("Größe 3 µm: ✓"), "Größe 3 µm: ✓", "other characters stay");
    }

    #[test]
    fn numbers_of_errors_and_temporary_names_are_left_out() {
        assert_eq!(
            plain_text("a.png: No such file (os error 2) at path \"/x/.a.png.q1.part\"; try b (os error 17)"),
            "a.png: No such file; try b"
        );
        let kept = "an (os error x) at path \"/x/a.png\"";
        assert_eq!(plain_text(kept), kept, "only what the system writes");
    }

    #[test]
    fn long_line_keeps_its_beginning_and_its_end() {
        let cell = "x".repeat(10_000_000);
        let text = plain_text(&format!("table.csv, line 2: wanted a number, got {cell}; try another\nshort"));
        assert!(text.len() < 3000, "{}", text.len());
        assert!(text.starts_with("table.csv, line 2: wanted a number, got xxx"), "{}", &text[..60]);
        assert!(text.ends_with("; try another\nshort") && text.contains("characters left out"));
        let longest_of_ours = "a".repeat(KEPT_FIRST + KEPT_LAST);
        assert_eq!(plain_text(&longest_of_ours), longest_of_ours);
    }
}
