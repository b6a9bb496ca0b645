//! CCSDS messages as XML: text -> [`Message`]. Rows are put into the order that KVN has.
//!
//! Elements are found by their names without name space; documents with a DTD are refused (`roxmltree`'s default), so
//! that no entity grows. Units are those of the standard (deg/s, km, km/s), which its schema fixes: an attribute `units` that
//! says another is refused.

use crate::error::{HistoryError, Source};
use crate::message::{Encoding, Entry, Kind, Message, Row, Segment};
use core::fmt::Write;
use roxmltree::{Document, Node, ParsingOptions};
use std::borrow::Cow;

/// Most elements, attributes and texts of a document.
const MOST_NODES: u32 = 30_000_000;

/// Order of the values of a row.
const ATTITUDE_ORDER: [&str; 28] = [
    "EPOCH",
    "Q1",
    "Q2",
    "Q3",
    "QC",
    "Q1_DOT",
    "Q2_DOT",
    "Q3_DOT",
    "QC_DOT",
    "ANGLE_1",
    "ANGLE_2",
    "ANGLE_3",
    "ANGLE_1_DOT",
    "ANGLE_2_DOT",
    "ANGLE_3_DOT",
    "ANGVEL_X",
    "ANGVEL_Y",
    "ANGVEL_Z",
    "SPIN_ALPHA",
    "SPIN_DELTA",
    "SPIN_ANGLE",
    "SPIN_ANGLE_VEL",
    "NUTATION",
    "NUTATION_PER",
    "NUTATION_PHASE",
    "MOMENTUM_ALPHA",
    "MOMENTUM_DELTA",
    "NUTATION_VEL",
];
const ORBIT_ORDER: [&str; 7] = ["EPOCH", "X", "Y", "Z", "X_DOT", "Y_DOT", "Z_DOT"];

/// Takes a document apart and hands the message to `read`, which may not outlive it.
pub(crate) fn with_message<T>(
    source: &Source<'_>,
    kind: Kind,
    read: impl FnOnce(&Message<'_>) -> Result<T, HistoryError>,
) -> Result<T, HistoryError> {
    let options = ParsingOptions { allow_dtd: false, nodes_limit: MOST_NODES, ..ParsingOptions::default() };
    let text = source.text.trim_start_matches('\u{feff}').trim_start();
    let skipped = source.text.len() - text.len();
    let document = Document::parse_with_options(text, options).map_err(|error| {
        let line = usize::try_from(error.pos().row).unwrap_or(1);
        let before = source.text[..skipped].matches('\n').count();
        source.at_line(line + before, &error.to_string(), "well-formed XML without a DTD")
    })?;
    read(&message(source, kind, &document, skipped)?)
}

fn message<'a>(
    source: &Source<'_>,
    kind: Kind,
    document: &'a Document<'a>,
    skipped: usize,
) -> Result<Message<'a>, HistoryError> {
    let [name, root_name] = kind.name();
    let is_root = |node: &Node<'_, '_>| node.tag_name().name() == root_name;
    let mut roots = document.descendants().filter(is_root);
    let root = roots.next().ok_or_else(|| source.whole(format!("no element <{root_name}>; wanted an {name}")))?;
    if roots.next().is_some() {
        return Err(source.whole(format!("several elements <{root_name}>; wanted one: split the file")));
    }
    let version = root
        .attribute("version")
        .ok_or_else(|| source.refuse(skipped + root.range().start, root_name, "a version, such as version=\"2.0\""))?;
    let segments = root.descendants().filter(|node| node.tag_name().name() == "segment");
    let segments = segments.map(|node| segment(source, kind, node, skipped)).collect::<Result<_, _>>()?;
    Ok(Message { encoding: Encoding::Xml, version, segments })
}

fn segment<'a>(
    source: &Source<'_>,
    kind: Kind,
    node: Node<'a, 'a>,
    skipped: usize,
) -> Result<Segment<'a>, HistoryError> {
    let mut segment = Segment { offset: skipped + node.range().start, ..Segment::default() };
    let parts = |name: &'static str| node.children().filter(move |node| node.tag_name().name() == name);
    for entry in parts("metadata").flat_map(|node| node.children()).filter(Node::is_element) {
        let (key, offset) = (entry.tag_name().name(), skipped + entry.range().start);
        if key == "COMMENT" {
            continue;
        }
        if segment.metadata.iter().any(|known| known.key == key) {
            return Err(source.refuse(offset, key, "this element once in a segment"));
        }
        let value = value_of(entry).ok_or_else(|| source.refuse(offset, key, WANTED_VALUE))?;
        segment.metadata.push(Entry { key, value, offset });
    }
    let (state, order): (_, &[&str]) = match kind {
        Kind::Attitude => ("attitudeState", &ATTITUDE_ORDER),
        Kind::Orbit => ("stateVector", &ORBIT_ORDER),
    };
    for state in parts("data").flat_map(|node| node.children()).filter(|node| node.tag_name().name() == state) {
        segment.rows.push(row(source, state, order, skipped)?);
    }
    Ok(segment)
}

/// Returns the values of one state in this order; those that are missing are left out, others are refused.
fn row<'a>(source: &Source<'_>, state: Node<'_, '_>, order: &[&str], skipped: usize) -> Result<Row<'a>, HistoryError> {
    let mut values: [Option<&str>; ATTITUDE_ORDER.len()] = [None; ATTITUDE_ORDER.len()];
    let is_leaf = |node: &Node<'_, '_>| node.is_element() && !node.children().any(|child| child.is_element());
    for leaf in state.descendants().filter(is_leaf) {
        let offset = skipped + leaf.range().start;
        let name = angle_of(leaf).unwrap_or(leaf.tag_name().name());
        check_unit(leaf, name).map_err(|(got, wanted)| source.refuse(offset, &got, &wanted))?;
        if name == "COMMENT" || is_ignored(name) {
            continue;
        }
        let place = order.iter().position(|known| *known == name);
        let value = place.and_then(|place| values.get_mut(place)).filter(|value| value.is_none());
        let wanted = || format!("elements of {}, each once", order.join(", "));
        let found = value_of(leaf).ok_or_else(|| source.refuse(offset, name, WANTED_VALUE))?;
        *value.ok_or_else(|| source.refuse(offset, name, &wanted()))? = Some(found);
    }
    let mut text = String::new();
    for value in values.iter().flatten() {
        // Writing to a string cannot fail.
        let _ = write!(text, "{value} ");
    }
    Ok(Row { text: Cow::Owned(text), offset: skipped + state.range().start })
}

const WANTED_VALUE: &str = "a value without a comment or an element inside";

/// Returns the text of an element; `None` where it has more than a text.
fn value_of<'a>(node: Node<'a, '_>) -> Option<&'a str> {
    node.children().all(|child| child.is_text()).then(|| node.text().unwrap_or_default().trim())
}

/// Returns the name of an angle of version 1: `rotation1` to `rotation3` in `rotationAngles`, about the axis of its own
/// place.
fn angle_of(leaf: Node<'_, '_>) -> Option<&'static str> {
    const NAMES: [(&str, &str, &str); 3] =
        [("rotation1", "X_ANGLE", "ANGLE_1"), ("rotation2", "Y_ANGLE", "ANGLE_2"), ("rotation3", "Z_ANGLE", "ANGLE_3")];
    let is_angle = leaf.parent().is_some_and(|parent| parent.tag_name().name() == "rotationAngles");
    let (_, axis, name) = NAMES.into_iter().find(|(tag, _, _)| is_angle && *tag == leaf.tag_name().name())?;
    leaf.attribute("angle").is_none_or(|given| given == axis).then_some(name)
}

/// Refuses a unit that is not that of the standard; an error is what was got and what was wanted.
fn check_unit(leaf: Node<'_, '_>, name: &str) -> Result<(), (String, String)> {
    let (Some(given), Some(wanted)) = (leaf.attribute("units"), unit_of(name)) else { return Ok(()) };
    if given.trim().eq_ignore_ascii_case(wanted) {
        return Ok(());
    }
    Err((format!("{name} with units=\"{given}\""), format!("units=\"{wanted}\"")))
}

/// Returns the unit of an element of a row; `None` where it has none.
fn unit_of(name: &str) -> Option<&'static str> {
    match name {
        "X" | "Y" | "Z" => Some("km"),
        "X_DOT" | "Y_DOT" | "Z_DOT" => Some("km/s"),
        "X_DDOT" | "Y_DDOT" | "Z_DDOT" => Some("km/s**2"),
        "NUTATION_PER" => Some("s"),
        "EPOCH" | "COMMENT" | "QC" | "Q1" | "Q2" | "Q3" => None,
        _ if name.starts_with('Q') => Some("1/s"),
        _ if name.starts_with("ANGVEL") || name.ends_with("_DOT") || name.ends_with("_VEL") => Some("deg/s"),
        _ => Some("deg"),
    }
}

/// Accelerations of an orbit are optional and not needed.
fn is_ignored(name: &str) -> bool {
    ["X_DDOT", "Y_DDOT", "Z_DDOT"].contains(&name)
}
