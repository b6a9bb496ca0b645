//! The guide as a book (`mdbook build src/guide`): `SUMMARY.md` lists every page once, and `book.toml` has a search and builds
//! below `target`.

use crate::pages::{SUMMARY, pages, targets};
use crate::source::root;

const GUIDE: &str = "src/guide";

/// Returns what is wrong with the list of a book that has these pages.
fn breaches(summary: &str, pages: &[&str]) -> Vec<String> {
    let listed = targets(summary);
    let times = |page: &str| listed.iter().filter(|entry| *entry == page).count();
    let not_once = pages.iter().filter(|page| times(page) != 1).map(|page| format!("{page}: {} times", times(page)));
    let unknown = listed.iter().filter(|entry| !pages.contains(&entry.as_str()));
    not_once.chain(unknown.map(|entry| format!("{entry}: such a page does not exist"))).collect()
}

#[test]
fn the_book_has_every_page_once() {
    let pages = pages();
    let in_guide = pages.iter().filter_map(|page| page.path.strip_prefix("src/guide/"));
    let names: Vec<_> = in_guide.filter(|name| *name != SUMMARY).collect();
    let summary = std::fs::read_to_string(root().join(GUIDE).join(SUMMARY)).unwrap();
    assert!(names.len() > 40, "{}", names.len());
    let found = breaches(&summary, &names);
    assert!(found.is_empty(), "{GUIDE}/{SUMMARY}:\n{}", found.join("\n"));
}

#[test]
fn missing_doubled_and_unknown_pages_are_noticed() {
    let summary = "# Summary\n\n[Guide](README.md)\n\n- [A](a.md)\n    - [B](b.md)\n";
    assert_eq!(breaches(summary, &["README.md", "a.md", "b.md"]), Vec::<String>::new(), "control");
    assert_eq!(breaches(summary, &["README.md", "a.md", "b.md", "c.md"]), ["c.md: 0 times"]);
    assert_eq!(breaches(summary, &["README.md", "a.md"]), ["b.md: such a page does not exist"]);
    assert_eq!(breaches(&summary.replace("b.md", "a.md"), &["README.md", "a.md"]), ["a.md: 2 times"]);
}

#[test]
fn the_book_has_a_search_and_builds_below_target() {
    let text = std::fs::read_to_string(root().join(GUIDE).join("book.toml")).unwrap();
    let book: toml::Table = text.parse().unwrap();
    assert_eq!(book["book"]["src"].as_str(), Some("."));
    assert_eq!(book["build"]["create-missing"].as_bool(), Some(false), "a page that is missing is an error");
    assert_eq!(book["output"]["html"]["search"]["enable"].as_bool(), Some(true));
    let folder = book["build"]["build-dir"].as_str().unwrap();
    assert!(folder.starts_with("../../target/"), "{folder}: the work tree stays as it is");
}
