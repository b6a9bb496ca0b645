//! Reference, schema and templates say what the program reads: no key more, no key less.

use crate::declared::{Declared, Key, Presence};
use crate::reference::{declared, sample};
use crate::test_plan_keys::{PlanKeys, RequirementKeys};
use crate::{Camera, Document, FileKind, Scenario, Spacecraft, check_keys};
use crate::{
    bench::BenchKeys, camera::CameraKeys, key_type::Shape, link::LinkTable, scenario::ScenarioKeys,
    spacecraft::SpacecraftKeys, test_plan_keys::DataSetKeys,
};
use crate::{key_reference, key_schema, key_search, key_template};
use std::path::Path;

/// Reads a text as the tables of a kind, without checking it.
fn read(kind: FileKind, text: &str) -> Result<(), String> {
    let document = Document::from_text(text, Path::new("lab/file.toml"));
    match kind {
        FileKind::Bench => document.read_as::<BenchKeys>().map(drop),
        FileKind::Scenario => document.read_as::<ScenarioKeys>().map(drop),
        FileKind::Camera => document.read_as::<CameraKeys>().map(drop),
        FileKind::Link => document.read_as::<LinkTable>().map(drop),
        FileKind::Spacecraft => document.read_as::<SpacecraftKeys>().map(drop),
        FileKind::TestPlan => document.read_as::<PlanKeys>().map(drop),
        FileKind::Requirements => document.read_as::<RequirementKeys>().map(drop),
        FileKind::DataSet => document.read_as::<DataSetKeys>().map(drop),
    }
    .map_err(|error| error.to_string())
}

/// Calls `visit` with the header of each table that has one form, and what is declared there.
fn each_table(declared: &Declared, path: &str, around: &str, visit: &mut impl FnMut(&str, &Declared)) {
    visit(around, declared);
    for table in &declared.tables {
        let path = if path.is_empty() { table.name.to_owned() } else { format!("{path}.{}", table.name) };
        let header = match table.presence {
            Presence::List | Presence::ListOrFiles | Presence::NeededList => format!("[[{path}]]\n"),
            Presence::Once | Presence::Optional | Presence::OrFile => format!("[{path}]\n"),
        };
        // A table within a list is a part of the last table of that list.
        let header = if around.starts_with("[[") { format!("{around}{header}") } else { header };
        if let [form] = table.forms.as_slice() {
            each_table(form, &path, &header, visit);
        }
    }
}

#[test]
fn the_guide_has_the_page_that_the_program_prints() {
    let page = include_str!("../guide/keys.md");
    assert!(page == key_reference(&FileKind::ALL), "write it again: starloop keys > src/guide/keys.md");
}

#[test]
fn words_find_the_keys_that_have_them() {
    let found = |words: &str| {
        let words: Vec<String> = words.split(' ').map(str::to_owned).collect();
        key_search(&FileKind::ALL, &words)
    };
    let exposure = found("Exposure");
    assert!(exposure.contains("## Camera files\n") && exposure.contains("### `[exposure]`\n"), "{exposure}");
    assert!(exposure.contains("| `exposure_s` |") && !exposure.contains("| `pixel_pitch_um` |"));
    let limit = found("limiting magnitude");
    assert!(limit.contains("| `limiting_mag` |") && limit.lines().count() < exposure.lines().count(), "{limit}");
    assert_eq!(found("no_such_key"), "");
    let heads = exposure.lines().filter(|line| line.starts_with("## ")).count();
    assert!(heads <= FileKind::ALL.len(), "each heading once: {heads}");
}

#[test]
fn every_declared_key_is_read_where_it_is_declared() {
    let mut seen = 0;
    for kind in FileKind::ALL {
        each_table(&declared(kind), "", "", &mut |header, declared| {
            for Key { name, shape, .. } in &declared.keys {
                let text = format!("{header}{name} = {}\n", sample(shape));
                read(kind, &text).unwrap_or_else(|error| panic!("{text}: {error}"));
                let wrong = if matches!(shape, Shape::Flag | Shape::Table(_)) { "7" } else { "{ no = true }" };
                if matches!(shape, Shape::Either(forms) if matches!(forms[1], Shape::Table(_))) {
                    continue; // a value that may be drawn: those who draw check it
                }
                read(kind, &format!("{header}{name} = {wrong}\n")).expect_err("another type");
                seen += 1;
            }
        });
    }
    assert!(seen > 300, "{seen} keys");
}

#[test]
fn every_key_that_is_read_is_declared() {
    for kind in FileKind::ALL {
        each_table(&declared(kind), "", "", &mut |header, declared| {
            let error = read(kind, &format!("{header}no_such_key = 1\n")).expect_err("unknown");
            let (_, known) = error.split_once("known here: ").expect("a list");
            let tables = declared.tables.iter().map(|table| table.name);
            let names: Vec<&str> = declared.keys.iter().map(|key| key.name).chain(tables).collect();
            assert_eq!(known, names.join(", "), "{header}");
        });
    }
}

#[test]
fn every_key_has_a_sentence_and_a_default_within_its_limit() {
    let mut page = String::new();
    for kind in FileKind::ALL {
        each_table(&declared(kind), "", "", &mut |header, declared| {
            for key in &declared.keys {
                assert!(
                    key.sentence.ends_with('.') && key.sentence.len() >= 5,
                    "{header}{}: {}",
                    key.name,
                    key.sentence
                );
                let [sentence, advice] =
                    [key.sentence, &key.advice].map(|text| text.trim_end_matches('.').to_lowercase());
                let parts = advice.split([';', ',', ':']).map(str::trim);
                let is_said_again = |part: &str| part.split(' ').count() > 2 && sentence.contains(part);
                let again = parts.filter(|part| is_said_again(part) && !sentence.contains(&advice)).count();
                assert_eq!(again, 0, "{header}{}: said twice: {}", key.name, key.meaning());
                page.push_str(key.name);
            }
        });
    }
    assert!(page.contains("exposure_s"));
}

#[test]
fn templates_mark_the_values_that_are_no_defaults() {
    let template = key_template(FileKind::Camera);
    for line in
        ["#bits = 12\n", "#gain_e_per_dn = 1.0  # an example, not the default\n", "\nwidth_px = 1024  # an example"]
    {
        assert!(template.contains(line), "{line}");
    }
}

#[test]
fn templates_check_as_they_are_printed() {
    let configs = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../configs");
    let document = |kind: FileKind, folder: &str| {
        Document::from_text(&key_template(kind), &configs.join(folder).join("template.toml"))
    };
    Camera::from_document(&document(FileKind::Camera, "cameras")).unwrap();
    Scenario::from_document(&document(FileKind::Bench, "benches")).unwrap();
    Scenario::from_document(&document(FileKind::Scenario, "scenarios")).unwrap();
    Spacecraft::from_document(&document(FileKind::Spacecraft, "spacecraft")).unwrap();
    let folder = tempfile::tempdir().unwrap();
    std::fs::write(folder.path().join("link.toml"), key_template(FileKind::Link)).unwrap();
    let bench = Document::from_text("link = \"link.toml\"\n", &folder.path().join("bench.toml"));
    Scenario::from_document(&bench).unwrap();
    for kind in [FileKind::TestPlan, FileKind::Requirements, FileKind::DataSet] {
        let document = Document::from_text(&key_template(kind), &folder.path().join("file.toml"));
        assert_eq!(FileKind::of(&document), kind);
        check_keys(kind, &document).unwrap();
    }
    // Control: a template without what must be given does not check.
    let bare = key_template(FileKind::Camera).replace("focal_length_mm = 50.0", "");
    Camera::from_document(&Document::from_text(&bare, Path::new("bare.toml"))).unwrap_err();
}

#[test]
fn a_schema_has_ranges_words_defaults_and_what_must_be_given() {
    let schema = key_schema(FileKind::Camera);
    assert_eq!(schema["required"], serde_json::json!(["detector", "optics"]));
    let detector = &schema["properties"]["detector"];
    assert_eq!(detector["additionalProperties"], false);
    let bits = &detector["properties"]["bits"];
    assert_eq!((&bits["minimum"], &bits["maximum"], &bits["default"]), (&1.into(), &16.into(), &12.into()));
    assert_eq!(detector["properties"]["rounding"]["enum"], serde_json::json!(["nearest", "truncate"]));
    assert!(bits["description"].as_str().unwrap().contains("converter"));
}
