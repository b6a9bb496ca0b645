//! Who may import whom. `src/ARCHITECTURE.md` prints the same table; `imports` holds the sources to it.

use crate::source::root;

/// One room: a folder of `src/`.
pub(crate) struct Room {
    pub(crate) name: &'static str,
    /// Rooms, or modules of rooms, or `firmware_protocol`; `base` is free to all.
    pub(crate) may_import: &'static [&'static str],
}

/// The rooms in the order data flows: each row imports only from rows above it.
pub(crate) const ROOMS: &[Room] = &[
    Room { name: "base", may_import: &[] },
    Room { name: "link", may_import: &["firmware_protocol"] },
    Room { name: "attitude", may_import: &["link", "firmware_protocol"] },
    Room { name: "sky", may_import: &[] },
    Room { name: "astrometry", may_import: &["sky"] },
    Room { name: "optics", may_import: &[] },
    Room { name: "exposure", may_import: &["attitude", "astrometry", "optics"] },
    Room { name: "gpu", may_import: &[] },
    Room { name: "render", may_import: &["exposure", "optics", "gpu"] },
    Room { name: "detector", may_import: &["gpu"] },
    Room { name: "sink", may_import: &[] },
    Room { name: "display", may_import: &["astrometry", "sink"] },
    Room { name: "network_camera", may_import: &["sink"] },
    Room { name: "report", may_import: &[] },
    Room { name: "live", may_import: &["sink", "report"] },
    Room {
        name: "chart",
        may_import: &["attitude", "astrometry", "optics", "exposure", "render", "detector", "gpu", "report"],
    },
    Room { name: "verify", may_import: &["optics", "exposure", "detector", "report"] },
    Room { name: "testbed", may_import: &["link", "firmware_protocol", "sky::catalog"] },
    Room {
        name: "runtime",
        may_import: &[
            "link",
            "firmware_protocol",
            "attitude",
            "sky",
            "astrometry",
            "optics",
            "exposure",
            "gpu",
            "render",
            "detector",
            "sink",
            "report",
        ],
    },
    Room {
        name: "config",
        may_import: &[
            "link",
            "attitude",
            "sky",
            "astrometry",
            "optics",
            "exposure",
            "render",
            "detector",
            "sink",
            "display",
            "network_camera",
            "testbed",
        ],
    },
    Room {
        name: "wiring",
        may_import: &[
            "link",
            "firmware_protocol",
            "attitude",
            "sky",
            "astrometry",
            "optics",
            "exposure",
            "detector",
            "sink",
            "display",
            "network_camera",
            "report",
            "testbed",
            "runtime",
            "config",
        ],
    },
    Room {
        name: "cli",
        may_import: &[
            "link",
            "attitude",
            "sky",
            "astrometry",
            "optics",
            "exposure",
            "render",
            "detector",
            "sink",
            "display",
            "report",
            "testbed",
            "runtime",
            "config",
            "chart",
            "verify",
            "wiring",
            "live",
            // The type of an image that may live on a device, and the identifiers of the bus.
            "gpu",
            "firmware_protocol",
        ],
    },
];

/// The checker of the loop must not share the code it checks.
const NEVER_IN_TESTBED: &[&str] = &["astrometry", "optics", "exposure", "render", "detector"];

/// Names that a row of `ARCHITECTURE.md` may add: free to all, or held by another rule.
const FREE_IN_DOCUMENT: &[&str] = &["base", "wgpu"];

/// What `room` may import; `None` for a room that the table lacks.
pub(crate) fn may_import(room: &str) -> Option<&'static [&'static str]> {
    ROOMS.iter().find(|row| row.name == room).map(|row| row.may_import)
}

/// The head of an import, the room it stands in: `sky::catalog` -> `sky`.
fn room_of(import: &str) -> &str {
    import.split("::").next().unwrap_or(import)
}

/// Every room that `room` reaches through its imports.
fn reached_from(room: &str) -> Vec<&'static str> {
    let mut reached: Vec<&str> = Vec::new();
    let mut waiting = vec![room];
    while let Some(next) = waiting.pop() {
        for import in may_import(next).unwrap_or(&[]) {
            let import = room_of(import);
            if !reached.contains(&import) {
                reached.push(import);
                waiting.push(import);
            }
        }
    }
    reached
}

#[test]
fn data_flows_one_way() {
    for (at, row) in ROOMS.iter().enumerate() {
        for import in row.may_import.iter().filter(|import| **import != "firmware_protocol") {
            let is_above = ROOMS[..at].iter().any(|above| above.name == room_of(import));
            assert!(is_above, "`{}` may import `{import}`, which does not stand above it", row.name);
        }
    }
}

#[test]
fn testbed_shares_no_code_with_what_it_checks() {
    let reached = reached_from("testbed");
    assert!(reached.contains(&"sky"), "the walk reaches what the testbed imports: {reached:?}");
    for room in NEVER_IN_TESTBED {
        assert!(!reached.contains(room), "`testbed` reaches `{room}`");
    }
}

type Row<'a> = (&'a str, Vec<&'a str>);

/// The rows of each table headed `| room | may import |`.
fn document_rows(document: &str) -> Vec<Row<'_>> {
    let mut rows = Vec::new();
    let mut is_in_table = false;
    for line in document.lines() {
        let cells: Vec<_> = line.trim().trim_matches('|').split('|').map(str::trim).collect();
        if !line.trim_start().starts_with('|') {
            is_in_table = false;
        } else if cells == ["room", "may import"] {
            is_in_table = true;
        } else if is_in_table && cells.len() == 2 && !cells[0].starts_with('-') {
            rows.push((cells[0].trim_matches('`'), in_backticks(cells[1])));
        }
    }
    rows
}

fn in_backticks(cell: &str) -> Vec<&str> {
    let mut words: Vec<_> =
        cell.split('`').skip(1).step_by(2).filter(|word| !FREE_IN_DOCUMENT.contains(word)).collect();
    words.sort_unstable();
    words
}

fn expected_rows() -> Vec<Row<'static>> {
    let sorted = |row: &Room| {
        let mut imports = row.may_import.to_vec();
        imports.sort_unstable();
        (row.name, imports)
    };
    ROOMS.iter().map(sorted).collect()
}

/// The table as `src/ARCHITECTURE.md` prints it.
fn printed() -> String {
    let mut text = "| room | may import |\n|---|---|\n".to_owned();
    for row in ROOMS {
        let imports: Vec<_> = row.may_import.iter().map(|import| format!("`{import}`")).collect();
        text += &format!("| `{}` | {} |\n", row.name, imports.join(", "));
    }
    text
}

/// Rows that differ between `document` and the table, in words.
fn differences(document: &str) -> Vec<String> {
    let (had, wanted) = (document_rows(document), expected_rows());
    let missing = wanted.iter().filter(|row| !had.contains(row)).map(|row| format!("missing: {row:?}"));
    let surplus = had.iter().filter(|row| !wanted.contains(row)).map(|row| format!("not in the table: {row:?}"));
    missing.chain(surplus).collect()
}

#[test]
fn architecture_prints_this_table() {
    let document = std::fs::read_to_string(root().join("src/ARCHITECTURE.md"));
    let document = document.unwrap_or_else(|error| panic!("src/ARCHITECTURE.md is needed: {error}\n{}", printed()));
    let found = differences(&document);
    assert!(found.is_empty(), "ARCHITECTURE.md differs:\n{}\nwanted:\n{}", found.join("\n"), printed());
}

#[test]
fn a_changed_document_is_caught() {
    assert!(differences(&printed()).is_empty(), "{:?}", differences(&printed()));
    assert_eq!(differences(&printed().replace("| `astrometry` | `sky` |", "| `astrometry` | `optics` |")).len(), 2);
    assert_eq!(differences(&(printed() + "| `cellar` | |\n")).len(), 1);
    assert_eq!(differences("").len(), ROOMS.len());
}
