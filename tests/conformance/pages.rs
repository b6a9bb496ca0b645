//! README.md and the guide: the pages exist, the first one is short, and every link leads somewhere.

use crate::source::root;
use std::path::{Path, PathBuf};

/// Most bytes of the first page.
const FIRST_PAGE_BYTES_MAX: usize = 8192;

/// Most bytes of a page of the guide.
const PAGE_BYTES_MAX: usize = 10_000;

/// Pages that are longer, with the reason.
const LONGER: [(&str, &str); 1] = [("src/guide/keys.md", "is what one command prints, to be searched and not read")];

/// The page of the guide that is the list of its book.
pub(crate) const SUMMARY: &str = "SUMMARY.md";

/// One document.
pub(crate) struct Page {
    /// From the root of the repository.
    pub(crate) path: String,
    pub(crate) text: String,
}

/// Returns README.md, the architecture and the guide.
pub(crate) fn pages() -> Vec<Page> {
    let mut paths = vec!["README.md".to_owned(), "src/ARCHITECTURE.md".to_owned()];
    let guide = std::fs::read_dir(root().join("src/guide")).unwrap();
    let names = guide.map(|entry| entry.unwrap().file_name().into_string().unwrap());
    let mut of_guide: Vec<_> =
        names.filter(|name| name.ends_with(".md")).map(|name| format!("src/guide/{name}")).collect();
    of_guide.sort();
    paths.append(&mut of_guide);
    let read = |path: String| Page { text: std::fs::read_to_string(root().join(&path)).unwrap(), path };
    paths.into_iter().map(read).collect()
}

/// Returns the lines outside fenced blocks.
fn prose(text: &str) -> impl Iterator<Item = &str> {
    let mut is_code = false;
    text.lines().filter(move |line| {
        let is_fence = line.starts_with("```");
        is_code ^= is_fence;
        !is_code && !is_fence
    })
}

/// Targets of links and pictures within this repository.
pub(crate) fn targets(text: &str) -> Vec<String> {
    let joined = prose(text).collect::<Vec<_>>().join("\n");
    let behind = joined.split("](").skip(1).filter_map(|rest| rest.split_once(')'));
    let targets = behind.map(|(target, _)| target.to_owned());
    targets.filter(|target| !target.contains("://") && !target.contains([' ', '`', '\n'])).collect()
}

/// Returns the anchor of a heading, as forges make it.
fn anchor(heading: &str) -> String {
    let heading = heading.trim().to_lowercase();
    let kept = heading.chars().filter(|c| c.is_alphanumeric() || matches!(c, ' ' | '-' | '_'));
    kept.map(|c| if c == ' ' { '-' } else { c }).collect()
}

fn has_anchor(text: &str, wanted: &str) -> bool {
    prose(text).filter(|line| line.starts_with('#')).any(|line| anchor(line.trim_start_matches('#')) == wanted)
}

/// Returns whether a link of the page at `from` leads to a file, and to a heading of it where one is named.
fn leads_somewhere(from: &Path, target: &str) -> bool {
    let (file, wanted) = target.split_once('#').unwrap_or((target, ""));
    let folder = from.parent().unwrap_or(Path::new(""));
    let path: PathBuf = if file.is_empty() { root().join(from) } else { root().join(folder).join(file) };
    if wanted.is_empty() {
        return path.exists();
    }
    std::fs::read_to_string(path).is_ok_and(|text| has_anchor(&text, wanted))
}

#[test]
fn the_first_page_is_short() {
    let first = &pages()[0];
    assert!(first.text.len() <= FIRST_PAGE_BYTES_MAX, "{} has {} bytes", first.path, first.text.len());
}

/// Returns the pages of the guide that are too long.
fn long_pages(pages: &[Page]) -> Vec<String> {
    let is_long = |page: &&Page| page.path.starts_with("src/guide/") && page.text.len() > PAGE_BYTES_MAX;
    pages.iter().filter(is_long).map(|page| page.path.clone()).collect()
}

#[test]
fn the_pages_of_the_guide_are_short() {
    let allowed: Vec<_> = LONGER.iter().map(|(path, _)| (*path).to_owned()).collect();
    assert_eq!(long_pages(&pages()), allowed, "split or shorten a page of more than {PAGE_BYTES_MAX} bytes");
    let page = |bytes| Page { path: "src/guide/a.md".into(), text: "a".repeat(bytes) };
    assert_eq!(long_pages(&[page(PAGE_BYTES_MAX), page(PAGE_BYTES_MAX + 1)]).len(), 1, "control");
}

#[test]
fn the_address_of_the_project_is_that_of_the_manifest() {
    let manifest = std::fs::read_to_string(root().join("Cargo.toml")).unwrap();
    let line = manifest.lines().find_map(|line| line.strip_prefix("repository = \"")).unwrap();
    let address = line.trim_end_matches('"');
    let first = &pages()[0].text;
    assert!(first.contains(&format!("git clone {address}\n")), "README.md clones from {address}");
    assert!(first.contains(&format!("{address}/issues")), "README.md says where a bug is reported");
}

#[test]
fn every_link_leads_somewhere() {
    let mut broken = Vec::new();
    let mut followed = 0;
    for page in pages() {
        for target in targets(&page.text) {
            followed += 1;
            if !leads_somewhere(Path::new(&page.path), &target) {
                broken.push(format!("{}: {target}", page.path));
            }
        }
    }
    assert!(followed > 50, "{followed} links followed");
    assert!(broken.is_empty(), "\n{}", broken.join("\n"));
}

#[test]
fn every_page_of_the_guide_is_listed() {
    let pages = pages();
    let list = &pages.iter().find(|page| page.path == "src/guide/README.md").unwrap().text;
    let names = pages.iter().filter_map(|page| page.path.strip_prefix("src/guide/"));
    let listed = names.filter(|name| !["README.md", SUMMARY].contains(name));
    let missing: Vec<_> = listed.filter(|name| !list.contains(&format!("]({name})"))).collect();
    assert!(missing.is_empty(), "src/guide/README.md lacks {missing:?}");
}

#[test]
fn broken_links_are_noticed() {
    let readme = Path::new("README.md");
    assert!(leads_somewhere(readme, "src/guide/developing.md#tests"), "control");
    assert!(!leads_somewhere(readme, "src/guide/developing.md#no-such-heading"));
    assert!(!leads_somewhere(readme, "src/guide/nowhere.md"));
    assert_eq!(targets("[a](b.md)\n```text\n[c](d.md)\n```\n[e](https://f.org) [g](h.md#i)"), ["b.md", "h.md#i"]);
}
