//! Plain modern English: words of an old dialect, which readers had to look up, are not used in comments, names and
//! texts.
//!
//! A line is in breach with a word of [`WORDS`] (identifiers are split at `_` and at capitals), with a phrase that
//! [`phrases`] finds, or as the start of a comment that begins like a question and asks nothing ("What is in the file.").

use crate::source::{SourceFile, files, root};

/// Words that are not used, in any case, and what to write instead.
const WORDS: &[(&[&str], &str)] = &[
    (&["told", "tell", "tells", "telling"], "report, print, state"),
    (&["had"], "available, obtained; the present or past tense"),
    (&["hear", "hears", "heard"], "receive, received"),
    (&["stand", "stands", "stood"], "is, represents"),
    (&["mend", "mends", "mended", "mending"], "repair"),
    (&["lonely"], "outlier, single"),
    (&["anew"], "again"),
    (&["nobody"], "no program, without a reader"),
    (&["parcel", "parcels"], "packet"),
    (&["glass"], "surface"),
    (&["radio"], "link thread"),
    (&["rung", "rungs", "ladder"], "degradation level"),
    (&["room", "rooms"], "space, capacity"),
    (&["house", "houses"], "project"),
    (&["door", "doors"], "port, gateway, interface"),
    (&["road", "roads"], "path, method"),
];

/// Texts in which such a word has its usual meaning.
const USUAL: &[&str] = &["stand-in", "stand-alone", "standalone", "stand alone", "room temperature", "ground glass"];

/// Words after "is no" that do not make it a negated noun.
const COMPARED: &[&str] =
    &["longer", "more", "less", "later", "earlier", "greater", "larger", "smaller", "worse", "better"];
/// Words after "save" that give it the meaning "except".
const AFTER_SAVE: &[&str] = &["that", "for", "the", "in", "where", "what", "of", "a", "an", "when", "by", "as"];
/// First words of a comment without a verb of its own.
const QUESTION_WORDS: &[&str] = &["What ", "Who ", "Whose ", "Whoever "];

const FOLDERS: &[&str] = &["src", "firmware_protocol", "tests", "hil_scripts", "configs"];
const EXTENSIONS: &[&str] = &["rs", "py", "wgsl", "c", "h", "sh", "js", "html", "css", "toml", "md", "xml", "dbc"];
/// Recorded input, build output, and this list of words.
const NOT_READ: &[&str] =
    &["tests/fuzz/corpus/", "tests/golden/", "/target/", "/__pycache__/", "conformance/english.rs"];

/// A word that stays where it is part of a published name.
struct Exception {
    word: &'static str,
    /// Characters before the word that make it a name in data, not prose.
    after: &'static [&'static str],
    reason: &'static str,
}

const MOST_EXCEPTIONS: usize = 8;

const EXCEPTIONS: &[Exception] = &[
    Exception {
        word: "rung",
        after: &["\"", "`", ".", ",", "Chunk"],
        reason: "column of frames.csv, FITS card, GenICam feature and JSON key: readers of recorded frames use it",
    },
    Exception {
        word: "told",
        after: &["alias = \""],
        reason: "key in progress files of imports that an earlier version interrupted",
    },
];

/// A word or phrase at a line.
#[derive(Debug, Clone, PartialEq, Eq)]
struct Breach {
    line: usize,
    found: String,
}

/// Returns the breaches of a file.
fn breaches(file: &SourceFile) -> Vec<Breach> {
    let mut all = Vec::new();
    let mut is_inside_comment = false;
    for (line, text) in (1..).zip(file.text.lines()) {
        let bare = without_usual(text);
        let mut found: Vec<String> = words(&bare).into_iter().filter(|word| instead_of(word).is_some()).collect();
        found.extend(phrases(&bare));
        if !is_inside_comment && begins_like_a_question(&file.path, text) {
            found.push("a question without a question mark".to_owned());
        }
        is_inside_comment = is_comment(&file.path, text);
        all.extend(found.into_iter().map(|found| Breach { line, found }));
    }
    all
}

/// Returns what to write instead of a word, when it is not used.
fn instead_of(word: &str) -> Option<&'static str> {
    WORDS.iter().find(|(words, _)| words.contains(&word)).map(|(_, instead)| *instead)
}

/// Returns the line without the texts of [`USUAL`] and the names of [`EXCEPTIONS`].
fn without_usual(line: &str) -> String {
    let mut bare = line.to_owned();
    for usual in USUAL {
        while let Some(at) = bare.to_ascii_lowercase().find(usual) {
            bare.replace_range(at..at + usual.len(), " ");
        }
    }
    for exception in EXCEPTIONS {
        while let Some(at) = exception.place_in(&bare) {
            bare.replace_range(at..at + exception.word.len(), "-");
        }
    }
    bare
}

impl Exception {
    /// Returns the byte at which the first published name of a line has the word.
    fn place_in(&self, line: &str) -> Option<usize> {
        let lower = line.to_ascii_lowercase();
        let is_published = |at: &usize| self.after.iter().any(|before| line[..*at].ends_with(before));
        lower.match_indices(self.word).map(|(at, _)| at).find(is_published)
    }
}

/// Returns the words of a line in lower case, identifiers in pieces.
fn words(line: &str) -> Vec<String> {
    let letters: Vec<char> = line.chars().collect();
    let mut words = vec![String::new()];
    for (at, c) in letters.iter().enumerate() {
        let before = at.checked_sub(1).map_or(' ', |before| letters[before]);
        let after = letters.get(at + 1).copied().unwrap_or(' ');
        let is_start = c.is_ascii_uppercase() && (before.is_ascii_lowercase() || after.is_ascii_lowercase());
        if is_start || !c.is_ascii_alphabetic() {
            words.push(String::new());
        }
        words.last_mut().unwrap().extend(c.is_ascii_alphabetic().then_some(c.to_ascii_lowercase()));
    }
    words.retain(|word| !word.is_empty());
    words
}

/// Returns the phrases of a line that are not used.
fn phrases(line: &str) -> Vec<String> {
    let lower = line.to_ascii_lowercase();
    let pieces: Vec<&str> = lower.split(' ').collect();
    let piece = |at: usize| pieces.get(at).copied().unwrap_or_default();
    let starts = 0..pieces.len();
    starts.filter_map(|at| phrase([piece(at), piece(at + 1), piece(at + 2)])).collect()
}

/// Returns the phrase that begins in the first of three pieces between blanks.
fn phrase([first, second, third]: [&str; 3]) -> Option<String> {
    let (first, middle, last) = (last_word(first), first_word(second), first_word(third));
    let is_whole = |word: &str| second == word;
    let is_begin =
        middle == "begin" && !second.starts_with("begin_") && !(is_whole("begin") && matches!(last, "and" | "or"));
    let is_refused = match first {
        "held" | "hold" | "holds" | "holding" => middle == "against",
        "of" => middle == "which" || is_begin,
        "save" => AFTER_SAVE.contains(&middle),
        "is" | "are" | "was" | "were" => is_whole("no") && !last.is_empty() && !COMPARED.contains(&last),
        "a" => middle == "hair" || is_begin,
        "its" | "the" | "at" => is_begin,
        "so" => is_whole("much") && last == "as",
        _ => false,
    };
    let two = format!("{first} {middle}");
    is_refused.then(|| if matches!(middle, "no" | "much") { format!("{two} {last}") } else { two })
}

/// Returns the letters at the end of a piece.
fn last_word(piece: &str) -> &str {
    &piece[piece.trim_end_matches(char::is_alphabetic).len()..]
}

/// Returns the letters at the start of a piece.
fn first_word(piece: &str) -> &str {
    &piece[..piece.len() - piece.trim_start_matches(char::is_alphabetic).len()]
}

fn is_rust(path: &str) -> bool {
    path.rsplit('.').next() == Some("rs")
}

fn is_comment(path: &str, line: &str) -> bool {
    let line = line.trim_start();
    line.starts_with("//") || (line.starts_with('#') && !is_rust(path))
}

/// Returns true for the first line of a comment that begins with a question word and is not a question.
fn begins_like_a_question(path: &str, line: &str) -> bool {
    let is_prose = [".md", ".html", ".toml"].iter().any(|end| path.ends_with(end));
    let line = line.trim();
    let comment = ["///", "//!", "//", "#", "\"\"\""].iter().find_map(|prefix| line.strip_prefix(prefix));
    let text = comment.map(|text| text.strip_prefix(' ').unwrap_or(text)).unwrap_or_default();
    !is_prose && !line.ends_with('?') && QUESTION_WORDS.iter().any(|word| text.starts_with(word))
}

fn all_files() -> Vec<SourceFile> {
    let mut all = files(FOLDERS, EXTENSIONS);
    all.retain(|file| !NOT_READ.iter().any(|folder| file.path.contains(folder)));
    let path = "README.md".to_owned();
    all.push(SourceFile { text: std::fs::read_to_string(root().join(&path)).unwrap(), path });
    all
}

#[test]
fn comments_names_and_texts_are_plain_english() {
    let mut lines = Vec::new();
    for file in all_files() {
        lines.extend(breaches(&file).into_iter().map(|Breach { line, found }| {
            let instead = instead_of(&found).map_or(String::new(), |instead| format!(" (write: {instead})"));
            format!("{}:{line}: {found}{instead}", file.path)
        }));
    }
    assert!(lines.is_empty(), "{} lines:\n{}", lines.len(), lines.join("\n"));
}

fn found_in(path: &str, text: &str) -> Vec<String> {
    let file = SourceFile { path: path.to_owned(), text: text.to_owned() };
    breaches(&file).into_iter().map(|breach| breach.found).collect()
}

#[test]
fn each_word_is_found_in_comments_names_and_texts() {
    for word in WORDS.iter().flat_map(|(words, _)| *words) {
        let camel = format!("{}{}", word[..1].to_uppercase(), &word[1..]);
        for text in [
            format!("/// A {word} one."),
            format!("let is_{word}_now = 1;"),
            format!("struct A{camel}Of;"),
            format!("print(\"no {camel}.\")"),
            format!("const {}: u8 = 0;", word.to_uppercase()),
        ] {
            assert_eq!(found_in("src/a.rs", &text), [*word], "{text}");
        }
        assert!(found_in("src/a.rs", &format!("// x{word}x {word}x")).is_empty(), "control: part of another word");
    }
    assert!(
        found_in("src/a.rs", "// a stand-in at room temperature, standalone").is_empty(),
        "control: usual meanings"
    );
}

#[test]
fn each_phrase_is_found() {
    for (text, wanted) in [
        ("it is held against this", "held against"),
        ("rows, of which two", "of which"),
        ("all, save the last", "save the"),
        ("this is no error", "is no error"),
        ("at the begin", "the begin"),
        ("its begin.", "its begin"),
        ("off by a hair", "a hair"),
        ("not so much as one", "so much as"),
    ] {
        assert_eq!(found_in("README.md", text), [wanted], "{text}");
    }
    for text in [
        "it is no longer so",
        "is not an error",
        "the begin and the end",
        "save it",
        "a begin_frame call",
        "of whichever kind",
    ] {
        assert!(found_in("README.md", text).is_empty(), "control: {text}");
    }
}

#[test]
fn comments_that_begin_like_a_question_are_found() {
    let found =
        ["/// What it is.", "//! Who flies.", "// Whose it is.", "    # What it does", "    \"\"\"What it does.\"\"\""];
    for text in found {
        assert_eq!(found_in("hil_scripts/a.py", text).len(), 1, "{text}");
    }
    let allowed =
        ["/// What is it?", "/// Returns one.\n/// What follows.", "let a = \"What now\";", "/// Whatever it is."];
    for text in allowed {
        assert!(found_in("src/a.rs", text).is_empty(), "control: {text}");
    }
    assert_eq!(found_in("src/a.rs", "#[test]\n// What it is.").len(), 1, "an attribute is not a comment");
}

#[test]
fn published_names_are_allowed_as_names_only() {
    for text in [
        "row(\"rung\", Kind::Text)",
        "Card(\"RUNG\", Plain)",
        "\"ChunkRung\"",
        "`meta.rung`",
        "\"load_bits,rung,fate\"",
    ] {
        assert!(found_in("src/a.rs", text).is_empty(), "{text}");
    }
    assert_eq!(found_in("src/a.rs", "// the last rung"), ["rung"]);
}

#[test]
fn each_exception_is_needed() {
    assert!(EXCEPTIONS.len() <= MOST_EXCEPTIONS, "{} exceptions", EXCEPTIONS.len());
    let all = all_files();
    for exception in EXCEPTIONS {
        assert!(instead_of(exception.word).is_some() && exception.reason.len() > 20, "{}", exception.word);
        let is_needed = all.iter().flat_map(|file| file.text.lines()).any(|line| exception.place_in(line).is_some());
        assert!(is_needed, "{}: not needed any more", exception.word);
    }
}
