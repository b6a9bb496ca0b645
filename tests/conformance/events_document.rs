//! `src/guide/events.md` has every event of the ledger, as the program describes it, and `src/guide/tables.md` every column
//! of the tables that a run writes.
//!
//! The table of events is written from the program: when they differ, the new page is left in `target/guide`. Columns
//! are described by hand, and each must have a row.

use crate::source::root;
use run::runtime::EventKind;
use std::{path::Path, process::Command};

const PAGE: &str = "src/guide/events.md";
const TABLES: &str = "src/guide/tables.md";
const START: &str = "<!-- events: written from the program -->\n";
const END: &str = "<!-- end of events -->\n";

fn table() -> String {
    let row = |kind: &EventKind| format!("| `{}` | {} |\n", kind.name(), kind.meaning());
    let rows: String = EventKind::ALL.iter().map(row).collect();
    format!("\n| event | what happened |\n|---|---|\n{rows}\n")
}

/// Returns the page with the table of events as the program has it.
fn written(page: &str, table: &str) -> Option<String> {
    let (head, rest) = page.split_once(START)?;
    let (_, tail) = rest.split_once(END)?;
    Some(format!("{head}{START}{table}{END}{tail}"))
}

/// Returns the columns of a file that have no row in the page, under the heading of the file.
fn undescribed(page: &str, file: &str, header: &str) -> Vec<String> {
    let heading = format!("## {file}\n");
    let section = page.split_once(&heading).map_or("", |(_, rest)| rest);
    let section = section.split("\n#").next().unwrap_or_default();
    let described: Vec<&str> = section
        .lines()
        .filter(|line| line.starts_with("| `"))
        .filter_map(|line| line.split('|').nth(1))
        .flat_map(|cell| cell.split('`').skip(1).step_by(2))
        .collect();
    let missing = header.trim().split(',').filter(|column| !described.contains(column));
    missing.map(|column| format!("{file}: {column}")).collect()
}

/// Tables whose columns are the fields of a structure.
const ROWS: [(&str, &str, &str); 7] = [
    ("study.csv", "src/lab/batch/study/point.rs", "StudyPoint"),
    ("methods.csv", "src/lab/batch/chart/rows.rs", "MethodRow"),
    ("crowding.csv", "src/lab/batch/chart/crowding.rs", "CrowdingRow"),
    ("effects.csv", "src/lab/batch/chart/effects.rs", "EffectRow"),
    ("poisson.csv", "src/lab/batch/chart/poisson.rs", "PoissonRow"),
    ("prediction.csv", "src/lab/batch/chart/prediction.rs", "PredictionRow"),
    ("footprint.csv", "src/lab/batch/chart/sampling.rs", "FootprintRow"),
];

/// Returns the fields of a structure, separated by commas.
fn fields(path: &str, name: &str) -> String {
    let text = std::fs::read_to_string(root().join(path)).unwrap_or_else(|error| panic!("{path}: {error}"));
    let (_, body) = text.split_once(&format!("pub struct {name} {{")).unwrap_or_else(|| panic!("{path} has no {name}"));
    let body = body.split("\n}").next().unwrap_or_default();
    let names = body.lines().filter_map(|line| line.trim().strip_prefix("pub ")?.split(':').next());
    names.collect::<Vec<_>>().join(",")
}

fn first_line(path: &Path) -> String {
    let text = std::fs::read_to_string(path).unwrap_or_else(|error| panic!("{}: {error}", path.display()));
    text.lines().next().unwrap_or_default().to_owned()
}

/// Runs the program in a folder.
fn starloop(arguments: &[&str], folder: &Path) {
    let output = Command::new(env!("CARGO_BIN_EXE_starloop")).args(arguments).current_dir(folder).output().unwrap();
    let error = String::from_utf8_lossy(&output.stderr);
    assert!(matches!(output.status.code(), Some(0 | 4)), "starloop {}: {error}", arguments.join(" "));
}

#[test]
fn every_event_is_in_the_guide() {
    let page = std::fs::read_to_string(root().join(PAGE)).unwrap();
    let wanted = written(&page, &table()).expect("the marks of the table");
    if page != wanted {
        let folder = root().join("target/guide");
        std::fs::create_dir_all(&folder).unwrap();
        std::fs::write(folder.join("events.md"), wanted).unwrap();
        panic!("{PAGE} differs from the program's events: copy target/guide/events.md there");
    }
}

#[test]
fn changed_event_is_noticed() {
    let page = format!("head\n{START}{}{END}tail\n", table());
    assert_eq!(written(&page, &table()).unwrap(), page, "control");
    let other = table().replace("| `late` |", "| `too_late` |");
    assert_ne!(written(&page, &other).unwrap(), page);
    assert!(written("no marks", &table()).is_none());
}

#[test]
fn every_column_of_a_run_is_in_the_guide() {
    let folder = tempfile::tempdir().unwrap();
    let flown = ["run", "scenarios/campaign.toml", "--clock", "virtual", "--duration", "2", "--sink", "null"];
    starloop(&[&flown[..], &["--out", "flown"]].concat(), folder.path());
    let timed = ["run", "benches/loopback.toml", "--duration", "0.5", "--sink", "null", "--out", "timed"];
    starloop(&[&timed[..], &["--report", "report"]].concat(), folder.path());
    let page = std::fs::read_to_string(root().join(TABLES)).unwrap();
    let files = ["flown/telemetry.csv", "report/frames_timing.csv"].map(|path| folder.path().join(path));
    let printed = |arguments: &[&str]| {
        let output = Command::new(env!("CARGO_BIN_EXE_starloop")).args(arguments).output().unwrap();
        String::from_utf8(output.stdout).unwrap().lines().next().unwrap_or_default().to_owned()
    };
    let query = printed(&["catalog", "query", "--ra", "1", "--dec", "2", "--radius", "1"]);
    starloop(&["catalog", "map", "--out", "map.png", "--csv", "map.csv"], folder.path());
    let map = first_line(&folder.path().join("map.csv"));
    let of_structs = ROWS.map(|(file, path, name)| (file, fields(path, name)));
    let others = [("catalog query", query), ("catalog map --csv", map)].into_iter().chain(of_structs);
    let in_others = others.flat_map(|(file, header)| undescribed(&page, file, &header));
    let found: Vec<_> = files
        .iter()
        .flat_map(|path| undescribed(&page, path.file_name().unwrap().to_str().unwrap(), &first_line(path)))
        .chain(in_others)
        .collect();
    assert!(found.is_empty(), "{TABLES} does not describe these columns:\n{}", found.join("\n"));
}

#[test]
fn undescribed_columns_are_noticed() {
    let page = "## a.csv\n\n| column |\n|---|\n| `x`, `y` | - |\n\n## b.csv\n| `z` | - |\n";
    assert_eq!(undescribed(page, "a.csv", "x,y"), Vec::<String>::new());
    assert_eq!(undescribed(page, "a.csv", "x,y,z"), ["a.csv: z"]);
    assert_eq!(undescribed(page, "c.csv", "x"), ["c.csv: x"]);
}
