//! Bytes of one message -> its values, by form; and back. Reading packed numbers allocates nothing.

use super::layout::{Encoding, PlainLayout, Values};
use super::{PlainReject, field::Field};
use core::fmt::Write;
use serde_json::{Map, Value};

/// Reads the values of a message of packed numbers, JSON or text.
pub(super) fn read(layout: &PlainLayout, bytes: &[u8]) -> Result<Values, PlainReject> {
    match layout.encoding {
        Encoding::F64Le => packed(layout, bytes, f64::from_le_bytes),
        Encoding::F64Be => packed(layout, bytes, f64::from_be_bytes),
        Encoding::Json => json(layout, bytes),
        Encoding::Text => text(layout, bytes),
        // Its lines have a reader of their own.
        Encoding::FortyTwo(_) => Err(PlainReject::Length),
    }
}

fn packed(layout: &PlainLayout, bytes: &[u8], number: fn([u8; 8]) -> f64) -> Result<Values, PlainReject> {
    let (words, rest) = bytes.as_chunks::<8>();
    if words.len() != layout.fields.len() || !rest.is_empty() {
        return Err(PlainReject::Length);
    }
    let mut values = Values::NONE;
    words.iter().zip(&layout.fields).for_each(|(word, field)| values.put(*field, number(*word)));
    Ok(values)
}

fn text(layout: &PlainLayout, bytes: &[u8]) -> Result<Values, PlainReject> {
    let text = core::str::from_utf8(bytes).map_err(|_| PlainReject::Text)?;
    let is_between = |c: char| c.is_ascii_whitespace() || matches!(c, ',' | ';');
    let mut words = text.split(is_between).filter(|word| !word.is_empty());
    let mut values = Values::NONE;
    for field in &layout.fields {
        let word = words.next().ok_or(PlainReject::Length)?;
        values.put(*field, word.parse().map_err(|_| PlainReject::Number)?);
    }
    if words.next().is_some() { Err(PlainReject::Length) } else { Ok(values) }
}

fn json(layout: &PlainLayout, bytes: &[u8]) -> Result<Values, PlainReject> {
    let value: Value = serde_json::from_slice(bytes).map_err(|_| PlainReject::Json)?;
    let mut values = Values::NONE;
    for (place, field) in layout.fields.iter().enumerate().filter(|(_, field)| **field != Field::Skip) {
        let found = match &value {
            Value::Array(row) if row.len() == layout.fields.len() => row.get(place),
            Value::Array(_) => return Err(PlainReject::Length),
            Value::Object(table) => match table.get(field.name()) {
                None => component(table, layout, *field)?,
                number => number,
            },
            Value::Null | Value::Bool(_) | Value::Number(_) | Value::String(_) => return Err(PlainReject::Json),
        };
        let number = found.ok_or(PlainReject::FieldMissing)?;
        values.put(*field, number.as_f64().ok_or(PlainReject::Number)?);
    }
    Ok(values)
}

/// Returns a component from a vector of its name, whose order is that of the layout: `"q": [w, x, y, z]`; a
/// longer one is another vector.
fn component<'v>(
    table: &'v Map<String, Value>,
    layout: &PlainLayout,
    field: Field,
) -> Result<Option<&'v Value>, PlainReject> {
    let vector = field.vector().and_then(|name| table.get(name)).and_then(Value::as_array);
    let Some(vector) = vector else { return Ok(None) };
    let of_vector = || layout.fields.iter().filter(|other| other.vector() == field.vector());
    if vector.len() > of_vector().count() {
        return Err(PlainReject::Length);
    }
    Ok(of_vector().position(|other| *other == field).and_then(|place| vector.get(place)))
}

/// Writes the message of values.
pub(super) fn write(layout: &PlainLayout, values: &Values) -> Vec<u8> {
    let numbers = layout.fields.iter().map(|field| values.get(*field));
    match layout.encoding {
        Encoding::F64Le => numbers.flat_map(f64::to_le_bytes).collect(),
        Encoding::F64Be => numbers.flat_map(f64::to_be_bytes).collect(),
        Encoding::Json => json_line(layout, values).into_bytes(),
        Encoding::Text => numbers.map(|number| number.to_string()).collect::<Vec<_>>().join(" ").into_bytes(),
        Encoding::FortyTwo(_) => Vec::new(),
    }
}

fn json_line(layout: &PlainLayout, values: &Values) -> String {
    let mut line = String::from("{");
    for field in layout.fields.iter().filter(|field| **field != Field::Skip) {
        let comma = if line.len() > 1 { "," } else { "" };
        let _ = write!(line, "{comma}\"{}\":{}", field.name(), values.get(*field)); // a String takes everything
    }
    line + "}"
}
