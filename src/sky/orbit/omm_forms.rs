//! Orbit mean-elements messages as text: JSON, KVN, XML or CSV -> the keys and values of every message.
//!
//! KVN and XML are the forms of CCSDS 502.0-B and 505.0-B, JSON and CSV those of catalogs on the net, with the same
//! keys. Units are kept where a file states them, and compared by the reader of values. Tests: [`super::omm`].

use base::refused::Refused;
use serde_json::Value;
use std::collections::BTreeMap;

/// Most messages of one file.
const MOST_OBJECTS: usize = 100_000;
/// The first keyword of a message in KVN.
const FIRST_KEYWORD: &str = "CCSDS_OMM_VERS";

/// Other messages that an NDM of CCSDS 505.0-B may hold.
const OTHER_MESSAGES: [&str; 9] = ["acm", "aem", "apm", "cdm", "ocm", "oem", "opm", "rdm", "tdm"];

/// The form of a text.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Form {
    Json,
    Kvn,
    Xml,
    Csv,
}

/// A value with its unit, where the file states one.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(super) struct Stated {
    pub(super) value: String,
    pub(super) unit: Option<String>,
}

/// One message: its values by their keys.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub(super) struct Message {
    /// First line in the file; `None` in JSON.
    pub(super) line: Option<usize>,
    values: BTreeMap<String, Stated>,
    /// Keys that were given twice, with different values.
    pub(super) twice: Vec<String>,
}

impl Message {
    /// Returns a value that is there and not blank.
    pub(super) fn get(&self, key: &str) -> Option<&Stated> {
        self.values.get(key)
    }

    /// Adds a value unless it is blank.
    fn put(&mut self, key: &str, value: &str, unit: Option<&str>) {
        let (key, value) = (key.trim(), value.trim());
        if value.is_empty() {
            return;
        }
        let stated = Stated { value: value.to_owned(), unit: unit.map(|unit| unit.trim().to_owned()) };
        if self.values.get(key).is_some_and(|known| *known != stated) {
            self.twice.push(key.to_owned());
        }
        self.values.insert(key.to_owned(), stated);
    }
}

/// Returns the form of a text; `None` when it is not a message of mean elements.
pub(super) fn form_of(text: &str) -> Option<Form> {
    let text = text.trim_start();
    let first = text.lines().find(|line| !line.starts_with('#')).unwrap_or("");
    let has = |name: &str| first.split(',').any(|cell| without_quotes(cell) == name);
    match text.chars().next()? {
        '[' | '{' => Some(Form::Json),
        '<' => (text.contains("<omm") || text.contains(":omm")).then_some(Form::Xml),
        _ if text.lines().any(|line| line.trim_start().starts_with(FIRST_KEYWORD)) => Some(Form::Kvn),
        _ => (has("EPOCH") && has("MEAN_MOTION")).then_some(Form::Csv),
    }
}

/// Reads every message of a text.
pub(super) fn messages(text: &str, form: Form) -> Result<Vec<Message>, Refused> {
    let messages = match form {
        Form::Json => of_json(text)?,
        Form::Kvn => of_kvn(text),
        Form::Xml => of_xml(text)?,
        Form::Csv => of_csv(text)?,
    };
    if messages.len() > MOST_OBJECTS {
        let why = format!("wanted at most {MOST_OBJECTS} objects, got {}", messages.len());
        return Err(Refused(format!("orbit mean-elements message: {why}")));
    }
    Ok(messages)
}

fn of_json(text: &str) -> Result<Vec<Message>, Refused> {
    let whole: Value = serde_json::from_str(text).map_err(|error| {
        Refused(format!(
            "orbit mean-elements message, line {line}, column {column}: {error}",
            line = error.line(),
            column = error.column()
        ))
    })?;
    let objects = if let Value::Array(objects) = whole { objects } else { vec![whole] };
    let message = |object: Value| {
        let mut message = Message::default();
        for (key, value) in object.as_object().into_iter().flatten() {
            match value {
                Value::Null => {}
                Value::String(text) => message.put(key, text, None),
                Value::Bool(_) | Value::Number(_) | Value::Array(_) | Value::Object(_) => {
                    message.put(key, &value.to_string(), None);
                }
            }
        }
        message
    };
    Ok(objects.into_iter().map(message).collect())
}

fn of_kvn(text: &str) -> Vec<Message> {
    let mut messages: Vec<Message> = Vec::new();
    for (number, line) in (1..).zip(text.lines()) {
        let Some((key, value)) = line.split_once('=') else { continue };
        if key.trim() == FIRST_KEYWORD {
            messages.push(Message { line: Some(number), ..Message::default() });
        }
        let Some(message) = messages.last_mut() else { continue };
        match value.trim_end().strip_suffix(']').and_then(|value| value.rsplit_once('[')) {
            Some((value, unit)) => message.put(key, value, Some(unit)),
            None => message.put(key, value, None),
        }
    }
    messages
}

fn of_xml(text: &str) -> Result<Vec<Message>, Refused> {
    let document = roxmltree::Document::parse(text).map_err(|error| {
        let place = error.pos();
        Refused(format!(
            "orbit mean-elements message, line {line}, column {column}: {error}",
            line = place.row as usize,
            column = place.col as usize
        ))
    })?;
    let is_other = |node: &roxmltree::Node<'_, '_>| OTHER_MESSAGES.contains(&node.tag_name().name());
    if let Some(other) = document.descendants().find(is_other) {
        let (line, name) = (document.text_pos_at(other.range().start).row, other.tag_name().name().to_uppercase());
        let why = format!("wanted OMMs alone, got an {name} besides: give each kind of message a file of its own");
        return Err(Refused(format!("orbit mean-elements message, line {line}: {why}")));
    }
    let found = document.descendants().filter(|node| node.tag_name().name() == "omm");
    let message = |node: roxmltree::Node<'_, '_>| {
        let line = document.text_pos_at(node.range().start).row as usize;
        let mut message = Message { line: Some(line), ..Message::default() };
        for leaf in node.descendants().filter(|node| node.is_element()) {
            let parts = leaf.children().filter(|child| child.is_text()).filter_map(|child| child.text());
            message.put(leaf.tag_name().name(), &parts.collect::<String>(), leaf.attribute("units"));
        }
        message
    };
    Ok(found.map(message).collect())
}

fn of_csv(text: &str) -> Result<Vec<Message>, Refused> {
    let mut lines = (1..).zip(text.lines()).filter(|(_, line)| !line.trim().is_empty() && !line.starts_with('#'));
    let (_, header) = lines.next().unwrap_or_default();
    let keys: Vec<&str> = header.split(',').map(without_quotes).collect();
    let mut messages = Vec::new();
    for (number, line) in lines {
        let cells: Vec<&str> = line.split(',').map(without_quotes).collect();
        if cells.len() != keys.len() {
            let why = format!("wanted {} cells as in the header, got {}", keys.len(), cells.len());
            return Err(Refused(format!(
                "orbit mean-elements message, line {number}, column {column}: {why}",
                column = 1
            )));
        }
        let mut message = Message { line: Some(number), ..Message::default() };
        keys.iter().zip(cells).for_each(|(key, cell)| message.put(key, cell, None));
        messages.push(message);
    }
    Ok(messages)
}

fn without_quotes(cell: &str) -> &str {
    let cell = cell.trim();
    cell.strip_prefix('"').and_then(|cell| cell.strip_suffix('"')).unwrap_or(cell)
}
