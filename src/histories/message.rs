//! CCSDS navigation messages (AEM, OEM) in one form, whether they came as lines of `KEY = VALUE` (KVN) or as XML: text ->
//! [`Message`].
//!
//! CCSDS 504.0-B (AEM), 502.0-B (OEM), 505.0-B (XML). A message is a version, and segments of metadata and rows of
//! text.
//!
//! Rows of XML are put into the order that KVN has. Elements are found by their names without name space; documents with a DTD are refused (`roxmltree`'s default), so
//! that no entity grows. Units are those of the standard (deg/s, km, km/s), which its schema fixes: an attribute `units` that
//! says another is refused.

use crate::error::{HistoryError, Source};
use core::fmt::Write;
use roxmltree::{Document, Node, ParsingOptions};
use std::borrow::Cow;

/// `KEY = VALUE` of a header or of metadata.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Entry<'a> {
    pub(crate) key: &'a str,
    pub(crate) value: &'a str,
    /// Byte of the text, for error messages.
    pub(crate) offset: usize,
}

/// One row of data: words separated by blanks, the epoch first.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Row<'a> {
    pub(crate) text: Cow<'a, str>,
    pub(crate) offset: usize,
}

/// One segment.
#[derive(Debug, Default)]
pub(crate) struct Segment<'a> {
    pub(crate) metadata: Vec<Entry<'a>>,
    pub(crate) rows: Vec<Row<'a>>,
    /// Where it begins.
    pub(crate) offset: usize,
}

/// Subject of a message: attitude or orbit.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Kind {
    Attitude,
    Orbit,
}

/// How a message is written.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Encoding {
    Kvn,
    Xml,
}

/// A message whose values are not yet read.
#[derive(Debug)]
pub(crate) struct Message<'a> {
    pub(crate) encoding: Encoding,
    /// `1.0`, `2.0`, as written.
    pub(crate) version: &'a str,
    pub(crate) segments: Vec<Segment<'a>>,
}

impl Kind {
    /// Returns the key of its version, by which a message is known.
    pub(crate) fn version_key(self) -> &'static str {
        match self {
            Self::Attitude => "CCSDS_AEM_VERS",
            Self::Orbit => "CCSDS_OEM_VERS",
        }
    }

    /// Returns its name and the name of its XML root.
    pub(crate) fn name(self) -> [&'static str; 2] {
        match self {
            Self::Attitude => ["AEM", "aem"],
            Self::Orbit => ["OEM", "oem"],
        }
    }
}

impl Message<'_> {
    /// Returns the name of its format, for people.
    pub(crate) fn format(&self, kind: Kind) -> String {
        let encoding = match self.encoding {
            Encoding::Kvn => "KVN",
            Encoding::Xml => "XML",
        };
        format!("CCSDS {} {} ({encoding})", kind.name()[0], self.version)
    }
}

impl Message<'_> {
    /// Takes a message apart and hands it to `read`; a text that begins with `<` is XML.
    pub(crate) fn with<T>(
        source: &Source<'_>,
        kind: Kind,
        read: impl FnOnce(&Message<'_>) -> Result<T, HistoryError>,
    ) -> Result<T, HistoryError> {
        if source.text.trim_start_matches('\u{feff}').trim_start().starts_with('<') {
            with_xml(source, kind, |message| check(source, message).and_then(|()| read(message)))
        } else {
            let message = of_lines(source, kind)?;
            check(source, &message)?;
            read(&message)
        }
    }
}

fn check(source: &Source<'_>, message: &Message<'_>) -> Result<(), HistoryError> {
    if message.segments.is_empty() {
        return Err(source.whole("no segment; wanted META_START ... META_STOP and rows of data, or <segment> in XML"));
    }
    Ok(())
}

/// Where in a message a line is.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Place {
    Header,
    Metadata,
    /// After metadata: rows of an orbit, or the beginning of a block.
    Body,
    /// Between DATA_START and DATA_STOP.
    Data,
    /// Between COVARIANCE_START and COVARIANCE_STOP, which are passed over.
    Covariance,
}

/// Takes the lines of a message apart.
fn of_lines<'a>(source: &Source<'a>, kind: Kind) -> Result<Message<'a>, HistoryError> {
    let mut reader = Reader { source: *source, kind, place: Place::Header, version: None, segments: Vec::new() };
    let mut offset = 0;
    for line in source.text.split_inclusive('\n') {
        reader.take(line.trim_start_matches('\u{feff}').trim(), offset)?;
        offset += line.len();
    }
    let ends = match reader.place {
        Place::Header | Place::Body => None,
        Place::Metadata => Some("META_STOP"),
        Place::Data => Some("DATA_STOP"),
        Place::Covariance => Some("COVARIANCE_STOP"),
    };
    if let Some(wanted) = ends {
        return Err(source.refuse(
            source.text.len(),
            "the end of the file",
            &format!("{wanted}: the file is cut short"),
        ));
    }
    let key = kind.version_key();
    let version = reader.version.ok_or_else(|| source.whole(format!("no line {key} = ...; wanted it first")))?;
    Ok(Message { encoding: Encoding::Kvn, version, segments: reader.segments })
}

struct Reader<'a> {
    source: Source<'a>,
    kind: Kind,
    place: Place,
    version: Option<&'a str>,
    segments: Vec<Segment<'a>>,
}

impl<'a> Reader<'a> {
    fn take(&mut self, line: &'a str, offset: usize) -> Result<(), HistoryError> {
        let is_comment =
            line == "COMMENT" || line.strip_prefix("COMMENT").is_some_and(|rest| rest.starts_with([' ', '\t']));
        if line.is_empty() || is_comment {
            return Ok(());
        }
        match self.place {
            Place::Header => self.header(line, offset),
            Place::Metadata if line == "META_STOP" => self.go(Place::Body),
            Place::Metadata => self.metadata(line, offset),
            Place::Body => self.body(line, offset),
            Place::Data if line == "DATA_STOP" => self.go(Place::Body),
            Place::Data => self.row(line, offset),
            Place::Covariance if line == "COVARIANCE_STOP" => self.go(Place::Body),
            Place::Covariance => Ok(()),
        }
    }

    fn go(&mut self, place: Place) -> Result<(), HistoryError> {
        self.place = place;
        Ok(())
    }

    fn header(&mut self, line: &'a str, offset: usize) -> Result<(), HistoryError> {
        if line == "META_START" {
            return self.segment(offset);
        }
        let entry = self.entry(line, offset, "KEY = VALUE or META_START")?;
        if self.version.is_none() {
            let key = self.kind.version_key();
            if entry.key != key {
                return Err(self.source.refuse(offset, line, &format!("{key} = ... as the first line")));
            }
            self.version = Some(entry.value);
        }
        Ok(())
    }

    fn segment(&mut self, offset: usize) -> Result<(), HistoryError> {
        self.segments.push(Segment { offset, ..Segment::default() });
        self.go(Place::Metadata)
    }

    fn metadata(&mut self, line: &'a str, offset: usize) -> Result<(), HistoryError> {
        let entry = self.entry(line, offset, "KEY = VALUE or META_STOP")?;
        let Some(segment) = self.segments.last_mut() else { return Ok(()) };
        if segment.metadata.iter().any(|known| known.key == entry.key) {
            return Err(self.source.refuse(offset, line, &format!("{} once in a segment", entry.key)));
        }
        segment.metadata.push(entry);
        Ok(())
    }

    fn body(&mut self, line: &'a str, offset: usize) -> Result<(), HistoryError> {
        match (line, self.kind) {
            ("META_START", _) => self.segment(offset),
            ("DATA_START", Kind::Attitude) => self.go(Place::Data),
            ("COVARIANCE_START", Kind::Orbit) => self.go(Place::Covariance),
            (_, Kind::Orbit) => self.row(line, offset),
            (_, Kind::Attitude) => Err(self.source.refuse(offset, line, "DATA_START or META_START")),
        }
    }

    fn row(&mut self, line: &'a str, offset: usize) -> Result<(), HistoryError> {
        if let Some(segment) = self.segments.last_mut() {
            segment.rows.push(Row { text: Cow::Borrowed(line), offset });
        }
        Ok(())
    }

    fn entry(&self, line: &'a str, offset: usize, wanted: &str) -> Result<Entry<'a>, HistoryError> {
        let (key, value) = line.split_once('=').ok_or_else(|| self.source.refuse(offset, line, wanted))?;
        // A unit in brackets may follow.
        let value = value.trim();
        let value = value.split_once(" [").map_or(value, |(value, _)| value.trim_end());
        Ok(Entry { key: key.trim(), value, offset })
    }
}

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
fn with_xml<T>(
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
    read(&of_document(source, kind, &document, skipped)?)
}

fn of_document<'a>(
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
