//! A tracker's log -> rows: a table with named columns, lines of JSON with the same names, an attitude file (AEM, STK),
//! or a capture of a bus.
//!
//! | column | meaning |
//! |---|---|
//! | `frame` | number of the frame, where the tracker knows it |
//! | `tai_ns`, `utc`, `unix_s` | the time at which the attitude holds |
//! | `q_w q_x q_y q_z` (or `qw`...; `q0 q1 q2 q3`; `q1 q2 q3 q4`) | the attitude; empty: no solution |
//! | `ra_deg dec_deg roll_deg` (or `ra dec roll`) | the attitude in degrees, with the roll of `log_form` |
//! | `valid` | 0 or false: no solution |
//! | `latency_ms`, or `available_tai_ns`, `available_utc` | when the attitude was there: after the time at which it holds, or absolute |
//! | `stars` | stars that were used |
//!
//! Lines of JSON may have the attitude as a list, `q` or `q_wxyz`, and `sent_tai_ns` or `sent_utc` for when it was
//! there: those that `[[tracker_out]]` sends are such lines. Captures of a bus are read by `captured`.
//!
//! A remark `# sense: icrf_from_body` before the rows says that quaternions are the conjugate of this program's; `# roll:`
//! and `# axes:` are those of `log_form`.

use crate::log_form::{LogForm, Roll, remark};
use crate::{captured, captured::Captured, record::LogRow};
use anyhow::{Context, Result, bail};
use base::{axes::WRITTEN_NORM_TOLERANCE, time::Tai};
use glam::DQuat;
use histories::read;
use std::{collections::HashMap, path::Path};

/// Names of quaternions: w, x, y, z.
const QUATERNIONS: [[&str; 4]; 4] =
    [["q_w", "q_x", "q_y", "q_z"], ["qw", "qx", "qy", "qz"], ["q0", "q1", "q2", "q3"], ["q4", "q1", "q2", "q3"]];

/// Names of right ascension, declination and roll.
const ANGLES: [[&str; 3]; 2] = [["ra_deg", "dec_deg", "roll_deg"], ["ra", "dec", "roll"]];

/// Names of the columns of attitudes.
#[derive(Clone, Copy)]
enum Columns {
    Quaternion(&'static [&'static str; 4]),
    Angles(&'static [&'static str; 3], Roll),
}

/// Reads a log, in the form that is stated beside it.
///
/// # Errors
/// With the file, the line, what was got and what was wanted.
pub fn read_log(path: &Path, stated: &LogForm) -> Result<Vec<LogRow>> {
    let name = path.display().to_string();
    let text = read::text_of(path)?;
    let begin = text.trim_start_matches('\u{feff}').trim_start();
    let form = stated.with_remarks(begin).with_context(|| name.clone())?;
    let mut rows = rows_of(&name, &text, begin, form.roll)?;
    for row in &mut rows {
        row.attitude = row.attitude.map(|attitude| form.turned(attitude));
    }
    Ok(rows)
}

/// Reads rows whose attitudes are in the tracker's own axes.
fn rows_of(name: &str, text: &str, begin: &str, roll: Option<Roll>) -> Result<Vec<LogRow>> {
    let first = begin.lines().map(str::trim).find(|line| !line.is_empty() && !line.starts_with('#'));
    if first.is_some_and(|line| line.starts_with('{')) {
        return json_lines(name, begin, roll);
    }
    let is_attitude_file = begin.starts_with('<') || begin.starts_with("CCSDS_") || begin.starts_with("stk.");
    if is_attitude_file || begin.starts_with("COMMENT") {
        refuse_roll(name, roll)?;
        return attitude_file(name, text);
    }
    if captured::is_capture(begin) {
        return match captured::read(name, begin)? {
            Captured::Rows(rows) => refuse_roll(name, roll).map(|()| rows),
            Captured::Json(lines) => json_lines(name, &lines, roll),
        };
    }
    table(name, begin, roll)
}

/// Refuses the convention of a roll for a log that has none.
fn refuse_roll(name: &str, roll: Option<Roll>) -> Result<()> {
    if roll.is_some() {
        bail!(
            "{name}: got quaternions and the convention of a roll; wanted ra_deg,dec_deg,roll_deg with it, or no roll"
        );
    }
    Ok(())
}

/// Returns the names of the columns with the attitude; `None` where there are none.
///
/// # Errors
/// When there is a roll without a convention, or a convention without a roll.
fn columns(name: &str, has: &dyn Fn(&str) -> bool, roll: Option<Roll>) -> Result<Option<Columns>> {
    if let Some(quaternion) = QUATERNIONS.iter().find(|names| names.iter().all(|name| has(name))) {
        return refuse_roll(name, roll).map(|()| Some(Columns::Quaternion(quaternion)));
    }
    let Some(angles) = ANGLES.iter().find(|names| names.iter().all(|name| has(name))) else { return Ok(None) };
    match roll {
        Some(roll) => Ok(Some(Columns::Angles(angles, roll))),
        None => bail!(
            "{name}: got {} without the convention of the roll; wanted a remark such as # roll: tetra3 before the rows, --roll, \
             or tracker.roll of a plan: {}",
            angles.join(","),
            Roll::WORDS.map(|(word, _)| word).join(", ")
        ),
    }
}

/// Returns whether a remark says that quaternions are the conjugate of this program's.
fn is_conjugate(name: &str, text: &str) -> Result<bool> {
    match remark(text, "sense") {
        None | Some("body_from_icrf" | "sensor_from_icrf") => Ok(false),
        Some("icrf_from_body" | "icrf_from_sensor") => Ok(true),
        Some(other) => bail!("{name}: got the sense \"{other}\", wanted body_from_icrf or icrf_from_body"),
    }
}

fn attitude_file(name: &str, text: &str) -> Result<Vec<LogRow>> {
    let history = read::attitudes(name, text, None)?;
    let states = history.segments().iter().flat_map(|segment| segment.states().iter());
    let row = |state: &histories::AttitudeState| LogRow {
        at_ns: Some(state.t_ns),
        attitude: Some(state.body_from_icrf.quat()),
        ..LogRow::default()
    };
    Ok(states.map(row).collect())
}

fn table(name: &str, text: &str, roll: Option<Roll>) -> Result<Vec<LogRow>> {
    let is_conjugate = is_conjugate(name, text)?;
    let mut reader = csv::ReaderBuilder::new().comment(Some(b'#')).trim(csv::Trim::All).from_reader(text.as_bytes());
    let header: Vec<String> =
        reader.headers().with_context(|| name.to_owned())?.iter().map(str::to_ascii_lowercase).collect();
    let Some(columns) = columns(name, &|wanted| header.iter().any(|known| known == wanted), roll)? else {
        bail!(
            "{name}: got the columns {}; wanted a quaternion, q_w,q_x,q_y,q_z, or ra_deg,dec_deg,roll_deg",
            header.join(",")
        );
    };
    if is_conjugate && matches!(columns, Columns::Angles(..)) {
        bail!("{name}: got # sense: for right ascension, declination and roll; wanted it for quaternions only");
    }
    if !["frame", "tai_ns", "utc", "unix_s"].iter().any(|wanted| header.iter().any(|known| known == wanted)) {
        bail!("{name}: got the columns {}; wanted frame, tai_ns, utc or unix_s", header.join(","));
    }
    let mut rows = Vec::new();
    for record in reader.records() {
        let record = record.with_context(|| name.to_owned())?;
        let line = record.position().map_or(0, csv::Position::line);
        let cells: HashMap<&str, &str> = header.iter().map(String::as_str).zip(record.iter()).collect();
        let mut row = row(&cells, columns).with_context(|| format!("{name}, line {line}"))?;
        row.attitude = row.attitude.map(|q| if is_conjugate { q.conjugate() } else { q });
        rows.push(row);
    }
    Ok(rows)
}

fn json_lines(name: &str, text: &str, roll: Option<Roll>) -> Result<Vec<LogRow>> {
    let mut rows = Vec::new();
    let is_row = |line: &str| !line.trim().is_empty() && !line.trim_start().starts_with('#');
    let is_conjugate = is_conjugate(name, text)?;
    for (number, line) in text.lines().enumerate().filter(|(_, line)| is_row(line)) {
        let place = || format!("{name}, line {}", number + 1);
        let object: serde_json::Map<String, serde_json::Value> = serde_json::from_str(line).with_context(place)?;
        let text_of = |value: &serde_json::Value| match value {
            serde_json::Value::String(text) => text.clone(),
            serde_json::Value::Null => String::new(),
            serde_json::Value::Bool(_)
            | serde_json::Value::Number(_)
            | serde_json::Value::Array(_)
            | serde_json::Value::Object(_) => value.to_string(),
        };
        let mut texts: HashMap<String, String> = HashMap::new();
        for (key, value) in &object {
            let list = value.as_array().filter(|_| key == "q" || key == "q_wxyz");
            match list {
                Some(list) => {
                    let names = QUATERNIONS[0].iter().zip(list);
                    texts.extend(names.map(|(name, value)| ((*name).to_owned(), text_of(value))));
                }
                None => drop(texts.insert(key.to_ascii_lowercase(), text_of(value))),
            }
        }
        let cells: HashMap<&str, &str> = texts.iter().map(|(key, value)| (key.as_str(), value.as_str())).collect();
        // A line without a solution may have neither.
        let columns = columns(name, &|wanted| cells.contains_key(wanted), roll)?;
        let mut row = row(&cells, columns.unwrap_or(Columns::Quaternion(&QUATERNIONS[0]))).with_context(place)?;
        row.attitude = row.attitude.map(|q| if is_conjugate { q.conjugate() } else { q });
        rows.push(row);
    }
    Ok(rows)
}

/// One row of cells by their names.
fn row(cells: &HashMap<&str, &str>, columns: Columns) -> Result<LogRow> {
    let cell = |name: &str| cells.get(name).copied().filter(|text| !text.is_empty());
    let time = |absolute: &str, utc: &str| -> Result<Option<i64>> {
        if let Some(ns) = whole(cell(absolute), absolute)? {
            return Ok(Some(ns));
        }
        cell(utc).map(|text| Ok(Tai::from_rfc3339(text).with_context(|| utc.to_owned())?.ns())).transpose()
    };
    let mut at_ns = time("tai_ns", "utc")?;
    if let (None, Some(unix_s)) = (at_ns, number(cell("unix_s"), "unix_s")?) {
        #[allow(clippy::cast_possible_truncation, reason = "times of this century")]
        let unix_ns = (unix_s * 1e9).round() as i64;
        at_ns = Some(Tai::from_unix_ns(unix_ns).ns());
    }
    let mut available_ns = time("available_tai_ns", "available_utc")?.or(time("sent_tai_ns", "sent_utc")?);
    if let (None, Some(at_ns), Some(ms)) = (available_ns, at_ns, number(cell("latency_ms"), "latency_ms")?) {
        #[allow(clippy::cast_possible_truncation, reason = "a latency is far below 292 years")]
        let latency_ns = (ms * 1e6).round() as i64;
        available_ns = Some(at_ns.saturating_add(latency_ns));
    }
    let is_valid = !matches!(cell("valid"), Some("0" | "false" | "False" | "no"));
    let attitude = match columns {
        Columns::Quaternion(names) => numbers(cells, names)?.filter(|_| is_valid).map(quaternion).transpose()?,
        Columns::Angles(names, roll) => {
            numbers(cells, names)?.filter(|_| is_valid).map(|angles| roll.attitude(angles)).transpose()?
        }
    };
    Ok(LogRow {
        frame: whole(cell("frame"), "frame")?.map(u32::try_from).transpose().context("frame")?,
        at_ns,
        attitude,
        available_ns,
        stars: whole(cell("stars"), "stars")?.map(u32::try_from).transpose().context("stars")?,
    })
}

/// Returns the numbers of cells; `None` where one is missing.
fn numbers<const N: usize>(cells: &HashMap<&str, &str>, names: &[&str; N]) -> Result<Option<[f64; N]>> {
    let mut found = [f64::NAN; N];
    for (value, name) in found.iter_mut().zip(names) {
        let cell = cells.get(name).copied().filter(|text| !text.is_empty());
        *value = number(cell, name)?.unwrap_or(f64::NAN);
    }
    Ok(found.iter().all(|value| value.is_finite()).then_some(found))
}

fn quaternion([w, x, y, z]: [f64; 4]) -> Result<DQuat> {
    let written = DQuat::from_xyzw(x, y, z, w);
    let norm = written.length();
    if (norm - 1.0).abs() > WRITTEN_NORM_TOLERANCE {
        bail!("got a quaternion of norm {norm}, wanted 1 within {WRITTEN_NORM_TOLERANCE}");
    }
    Ok(written.normalize())
}

fn number(cell: Option<&str>, name: &str) -> Result<Option<f64>> {
    cell.map(|text| text.parse().with_context(|| format!("{name}: got \"{text}\", wanted a number"))).transpose()
}

fn whole(cell: Option<&str>, name: &str) -> Result<Option<i64>> {
    cell.map(|text| text.parse().with_context(|| format!("{name}: got \"{text}\", wanted a whole number"))).transpose()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn read_text(text: &str) -> Result<Vec<LogRow>> {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("log.csv");
        std::fs::write(&path, text).unwrap();
        read_log(&path, &LogForm::default())
    }

    #[test]
    fn a_table_and_lines_of_json_say_the_same() {
        let rows = read_text(
            "frame,utc,q_w,q_x,q_y,q_z,latency_ms,stars\n3,2026-03-01T00:00:01Z,0.8,0.6,0,0,150,12\n4,,,,,,,\n",
        )
        .unwrap();
        assert_eq!(rows[0].frame, Some(3));
        assert_eq!(rows[0].attitude, Some(DQuat::from_xyzw(0.6, 0.0, 0.0, 0.8)));
        assert_eq!(rows[0].available_ns.unwrap() - rows[0].at_ns.unwrap(), 150_000_000);
        assert_eq!((rows[1].frame, rows[1].attitude, rows[1].at_ns), (Some(4), None, None));
        let json = "{\"frame\": 3, \"utc\": \"2026-03-01T00:00:01Z\", \"q\": [0.8, 0.6, 0, 0], \"latency_ms\": 150, \"stars\": 12}\n{\"frame\": 4, \"q\": null}\n";
        assert_eq!(read_text(json).unwrap(), rows);
    }

    #[test]
    fn captured_packets_of_json_are_its_lines() {
        let report = |frame: u32| {
            format!("{{\"frame\":{frame},\"tai_ns\":5,\"sent_tai_ns\":9,\"q_wxyz\":[0.8,0.6,0,0],\"stars\":3}}\n")
        };
        let packet = |text: &str| {
            let bytes: String = text.bytes().map(|byte| format!("{byte:02x}")).collect();
            format!("2026-03-01T00:00:01.000000Z 1772323238000000000 - {bytes}\n")
        };
        let rows = read_text(&format!("{}{}", packet(&report(7)), packet(&report(8)))).unwrap();
        assert_eq!((rows[1].frame, rows[1].available_ns, rows.len()), (Some(8), Some(9), 2));
        assert_eq!(rows, read_text(&format!("{}{}", report(7), report(8))).unwrap());
        let other = format!("{:#}", read_text(&packet("\u{1}x")).unwrap_err());
        assert!(other.contains("begin with 01"), "{other}");
    }

    #[test]
    fn senses_and_orders_of_quaternions_are_as_named() {
        let of = |text: &str| read_text(text).unwrap()[0].attitude.unwrap();
        let wanted = DQuat::from_xyzw(0.6, 0.0, 0.0, 0.8);
        assert_eq!(of("tai_ns,q1,q2,q3,q4\n5,0.6,0,0,0.8\n"), wanted, "scalar last");
        assert_eq!(of("tai_ns,q0,q1,q2,q3\n5,0.8,0.6,0,0\n"), wanted, "scalar first");
        assert_eq!(of("# sense: icrf_from_body\ntai_ns,qw,qx,qy,qz\n5,0.8,0.6,0,0\n"), wanted.conjugate());
        assert_eq!(read_text("frame,valid,qw,qx,qy,qz\n5,0,0.8,0.6,0,0\n").unwrap()[0].attitude, None);
    }

    #[test]
    fn what_cannot_be_meant_is_refused_with_its_line() {
        let refused = |text: &str| format!("{:#}", read_text(text).unwrap_err());
        assert!(refused("frame,a,b\n1,2,3\n").contains("wanted a quaternion"));
        assert!(refused("qw,qx,qy,qz\n1,0,0,0\n").contains("wanted frame, tai_ns"));
        let far = refused("frame,qw,qx,qy,qz\n1,1,0,0,0\n2,1,1,0,0\n");
        assert!(far.contains("line 3") && far.contains("norm"), "{far}");
        assert!(refused("frame,qw,qx,qy,qz\nx,1,0,0,0\n").contains("wanted a whole number"));
        assert!(refused("frame,ra,dec,roll\n1,2,3,4\n").contains("without the convention of the roll"));
        assert!(refused("# roll: up\nframe,ra,dec,roll\n1,2,93,4\n").contains("line 3: got a declination of 93"));
        assert!(refused("# roll: up\nframe,qw,qx,qy,qz\n1,1,0,0,0\n").contains("or no roll"));
        assert!(refused("# roll: up\n# sense: icrf_from_body\nframe,ra,dec,roll\n1,2,3,4\n").contains("only"));
        assert!(refused("# sense: other\nframe,qw,qx,qy,qz\n1,1,0,0,0\n").contains("sense \"other\""));
    }

    #[test]
    fn angles_and_axes_are_attitudes_of_the_sensor() {
        let of = |text: &str| read_text(text).unwrap()[0].attitude;
        let wanted = Roll::Up.attitude([83.8, -1.2, 37.0]);
        let wanted = wanted.unwrap();
        let is_it = |text: &str| of(text).unwrap().dot(wanted).abs() > 1.0 - 1e-12;
        assert!(is_it("# roll: lost\nframe,ra_deg,dec_deg,roll_deg\n1,83.8,-1.2,37\n"));
        assert!(is_it("# roll: tetra3\nframe,RA,Dec,Roll\n1,83.8,-1.2,-37\n"));
        assert!(is_it("# roll: astrometry\nframe,ra,dec,roll\n1,83.8,-1.2,217\n"));
        assert!(!is_it("# roll: tetra3\nframe,ra,dec,roll\n1,83.8,-1.2,37\n"), "control: another convention");
        assert!(is_it("# roll: lost\n{\"frame\": 1, \"ra\": 83.8, \"dec\": -1.2, \"roll\": 37}\n"));
        assert_eq!(of("# roll: lost\nframe,ra,dec,roll\n1,,,\n"), None);
        // The same sky in axes whose x is the boresight, y image left and z image up.
        let axes: crate::log_form::Axes = "-y -z x".parse().unwrap();
        let own = axes.quat().conjugate() * wanted;
        let row = format!("frame,qw,qx,qy,qz\n1,{},{},{},{}\n", own.w, own.x, own.y, own.z);
        assert!(is_it(&format!("# axes: -y -z x\n{row}")));
        assert!(!is_it(&row), "control: without its axes");
    }
}
