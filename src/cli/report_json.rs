//! `--json` of the commands that report: one line of JSON, whose field `schema` names the command and the version of
//! its fields.
//!
//! Fields may be added to a version; a version rises when a field goes, or changes its name, unit or meaning.

use anyhow::{Result, bail};
use serde::Serialize;

/// Reports by the command that prints them, as `schema` has them, and the version of their fields.
pub const SCHEMAS: &[(&str, u32)] = &[
    ("budget", 1),
    ("bus", 1),
    ("calibrate", 1),
    ("campaign", 1),
    ("catalog-info", 1),
    ("catalog-verify", 1),
    ("chart", 1),
    ("check", 1),
    ("compare", 1),
    ("dataset", 1),
    ("display-monitors", 1),
    ("doctor", 1),
    ("link-check", 1),
    ("psf", 1),
    ("render", 1),
    ("replay", 1),
    ("report", 1),
    ("run", 1),
    ("scenario", 1),
    ("snr", 1),
    ("study", 1),
    ("verify", 1),
];

/// Returns a report as one line of JSON.
///
/// # Errors
/// When the report does not go into JSON, or is not an object.
pub(super) fn json_line(command: &str, report: impl Serialize) -> Result<String> {
    let version = SCHEMAS.iter().find(|(name, _)| *name == command).map_or(0, |(_, version)| *version);
    debug_assert!(version > 0, "{command} is not in SCHEMAS");
    let text = serde_json::to_string(&report)?;
    if text.starts_with("{\"schema\":") {
        return Ok(text);
    }
    let Some(fields) = text.strip_prefix('{') else { bail!("the report of {command} is not an object") };
    let separator = if fields == "}" { "" } else { "," };
    Ok(format!("{{\"schema\":\"starloop.{command}/{version}\"{separator}{fields}"))
}

/// Prints a report as one line of JSON.
///
/// # Errors
/// When the report does not go into JSON.
pub(super) fn print_json(command: &str, report: impl Serialize) -> Result<()> {
    println!("{}", json_line(command, report)?);
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_schema_comes_first_and_the_fields_follow() {
        let line = json_line("snr", serde_json::json!({ "camera": "a" })).unwrap();
        assert_eq!(line, r#"{"schema":"starloop.snr/1","camera":"a"}"#);
        assert_eq!(json_line("snr", serde_json::json!({})).unwrap(), r#"{"schema":"starloop.snr/1"}"#);
        let own = serde_json::json!({ "schema": "starloop.other/2" });
        assert_eq!(json_line("snr", own).unwrap(), r#"{"schema":"starloop.other/2"}"#, "a report may have its own");
        assert!(json_line("snr", [1]).is_err());
    }

    #[test]
    fn schemas_are_sorted_and_each_is_there_once() {
        assert!(SCHEMAS.windows(2).all(|pair| pair[0].0 < pair[1].0), "{SCHEMAS:?}");
    }
}
