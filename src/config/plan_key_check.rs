//! The check of keys against their declarations alone, for files whose values crates above read.

use crate::declared::{Declared, Key, Preset};
use crate::error::{ConfigError, Result, nearest};
use crate::file_kind::{FileKind, must_be};
use crate::test_plan_keys::{DataSetKeys, PlanKeys, RequirementKeys};
use crate::unknown_keys::{as_clause, wanted_by};
use crate::{check::Checker, document::Document, key_type::Shape, reference::declared, several::check_all};
use toml::{Table, Value};

/// Refuses a test plan, requirements or a data set with keys that are unknown, missing, of another type or out of range;
/// files of other kinds are checked where they are read.
///
/// # Errors
/// With every such key.
pub fn check_keys(kind: FileKind, document: &Document) -> Result<()> {
    // A plan without cases looks like a bench: what it lacks says more.
    if FileKind::of(document) != FileKind::Bench {
        must_be(kind, document)?;
    }
    let read = check_all(document, |document| match kind {
        FileKind::TestPlan => document.read_as::<PlanKeys>().map(|_| ((), Vec::new())),
        FileKind::Requirements => document.read_as::<RequirementKeys>().map(|_| ((), Vec::new())),
        FileKind::DataSet => document.read_as::<DataSetKeys>().map(|_| ((), Vec::new())),
        FileKind::Bench | FileKind::Scenario | FileKind::Camera | FileKind::Link | FileKind::Spacecraft => {
            Ok(((), Vec::new()))
        }
    });
    let mut errors: Vec<ConfigError> = read.err().into_iter().collect();
    if let (FileKind::TestPlan | FileKind::Requirements | FileKind::DataSet, Ok(table)) =
        (kind, document.read_as::<Table>())
    {
        check_table(&declared(kind), &table, "", &mut |name, (got, wanted, advice)| {
            errors.push(Checker::new(document).invalid(name, got, wanted, &advice));
        });
    }
    if errors.is_empty() { Ok(()) } else { Err(ConfigError::of(errors)) }
}

/// The value, the rule, and advice.
type Complaint = (String, String, String);

fn check_table(declared: &Declared, table: &Table, path: &str, complain: &mut dyn FnMut(&str, Complaint)) {
    let full = |name: &str| if path.is_empty() { name.to_owned() } else { format!("{path}.{name}") };
    for key in &declared.keys {
        if let Some(complaint) = complaint(key, table.get(key.name)) {
            complain(&full(key.name), complaint);
        }
    }
    for inner in &declared.tables {
        let (name, Some(form)) = (full(inner.name), inner.forms.first()) else { continue };
        match table.get(inner.name) {
            Some(Value::Table(inner)) => check_table(form, inner, &name, complain),
            Some(Value::Array(list)) => {
                for (place, table) in list.iter().enumerate().filter_map(|(place, one)| Some((place, one.as_table()?)))
                {
                    check_table(form, table, &format!("{name}[{place}]"), complain);
                }
            }
            None if inner.is_needed() => {
                complain(&name, ("missing".into(), "a table".into(), as_clause(inner.sentence)));
            }
            Some(_) | None => {}
        }
    }
}

/// Returns what is wrong with the value of a key.
fn complaint(key: &Key, given: Option<&Value>) -> Option<Complaint> {
    let wanted = wanted_by(&key.shape).unwrap_or_else(|| format!("a {}", key.shape));
    let advice = as_clause(&key.meaning());
    let Some(value) = given else {
        return matches!(key.preset, Preset::Needed).then(|| ("missing".into(), wanted, advice));
    };
    if is_within(&key.shape, value) {
        return None;
    }
    let meant = match (&key.shape, value.as_str()) {
        (Shape::Words(words), Some(word)) => nearest(word, words.iter().copied()),
        _ => None,
    };
    let hint = meant.map(|word| format!("did you mean \"{word}\"? ")).unwrap_or_default();
    Some((value.to_string(), wanted, format!("{hint}{advice}")))
}

/// Returns whether a value of the right type is within its limit.
fn is_within(shape: &Shape, value: &Value) -> bool {
    match shape {
        Shape::Number(rule) => {
            let number = value.as_float().or_else(|| value.as_integer().map(|whole| whole as f64));
            number.is_none_or(|number| rule.is_met_by(number))
        }
        Shape::Whole(range) => value.as_integer().is_none_or(|whole| range.contains(&whole)),
        Shape::Words(words) => value.as_str().is_none_or(|word| words.contains(&word)),
        Shape::Row(_, of) | Shape::List(of) => value.as_array().into_iter().flatten().all(|item| is_within(of, item)),
        Shape::Text(_) | Shape::Flag | Shape::Either(_) | Shape::Table(_) => true,
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::path::Path;

    fn refused(kind: FileKind, text: &str) -> String {
        let document = Document::from_text(text, Path::new("p.toml"));
        check_keys(kind, &document).map_or_else(|error| error.to_string(), |()| String::new())
    }

    const PLAN: &str = "name = \"x\"\ncamera = \"c.toml\"\n[[case]]\nname = \"a\"\nuse = \"slew\"\nframes = 3\n\
                        attitudes = { kind = \"uniform\", count = 2 }\n";

    #[test]
    fn every_wrong_key_is_reported_at_once_with_its_line() {
        assert_eq!(refused(FileKind::TestPlan, PLAN), "", "control");
        let text =
            format!("confidence = 2.0\ntracker = {{ stars = 0 }}\n{}frame_rate = 3\n", PLAN.replace("slew", "slow"));
        let error = refused(FileKind::TestPlan, &text);
        for wanted in [
            "p.toml:1: confidence is 2.0; wanted a number from 0.5 to 0.999999",
            "p.toml:2: tracker.stars is 0; wanted a whole number from 1",
            "p.toml:7: case[0].use is \"slow\"; wanted one of",
            "did you mean \"slew\"?",
            "unknown key `frame_rate`, did you mean `frame_rate_hz`?",
        ] {
            assert!(error.contains(wanted), "{wanted}: {error}");
        }
    }

    #[test]
    fn requirements_and_data_sets_have_keys_of_their_own() {
        let error = refused(FileKind::Requirements, "[[requirement]]\nid = \"A\"\nby = \"mean\"\n");
        assert!(error.contains("requirement[0].by is \"mean\"") && error.contains("metric is missing"), "{error}");
        assert_eq!(refused(FileKind::Requirements, "[[requirement]]\nid = \"A\"\nmetric = \"bias.x\"\nmost = 1\n"), "");
        let set = include_str!("../../configs/data_sets/targets.toml");
        assert_eq!(refused(FileKind::DataSet, set), "");
        assert!(refused(FileKind::DataSet, &format!("{set}mask_snr = 0\n")).contains("output.mask_snr is 0"));
        assert!(refused(FileKind::TestPlan, set).contains("is a dataset file; wanted a plan file"), "of another kind");
    }
}
