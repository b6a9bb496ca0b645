//! The XML that describes the camera's features and their addresses to clients; GenICam schema 1.1.
//!
//! It is written from the table of `features` and, for the chunk data, from the table that also writes the bytes. Tests
//! compare the whole with a frozen one and every address with the device's memory, and
//! `hil_scripts/tests/test_network_camera.py` loads it with the reference GenApi.

#![allow(clippy::wildcard_enum_match_arm, reason = "a question about one kind of feature concerns no other kind")]

use crate::network_camera::chunk::{self, Field};
use crate::network_camera::feature::{Access, Entry, Feature, Kind, Limit};
use crate::network_camera::features::TABLE;
use crate::network_camera::messages::{EVENTS, FRAME_ID_AT, TIMESTAMP_AT};
use crate::network_camera::params::{CommandParams, DeviceParams, Identity};
use base::bayer::BayerPattern;
use core::fmt::{Result, Write};
use frames::sink::facts::FeatureKind;

const FIRST_LINES: &str = "\
    <?xml version=\"1.0\" encoding=\"UTF-8\"?>\n\
    <RegisterDescription ModelName=\"{MODEL}\" \
    VendorName=\"{VENDOR}\" \
    ToolTip=\"Star-sensor frames of a bench\" \
    StandardNameSpace=\"None\" \
    SchemaMajorVersion=\"1\" SchemaMinorVersion=\"1\" SchemaSubMinorVersion=\"0\" \
    MajorVersion=\"1\" MinorVersion=\"0\" SubMinorVersion=\"0\" \
    ProductGuid=\"9c1f3a52-6d0e-4b7a-8f21-5b6a1c0d7e34\" \
    VersionGuid=\"9c1f3a52-6d0e-4b7a-8f21-5b6a1c0d7e35\" \
    xmlns=\"http://www.genicam.org/GenApi/Version_1_1\" \
    xmlns:xsi=\"http://www.w3.org/2001/XMLSchema-instance\" \
    xsi:schemaLocation=\"http://www.genicam.org/GenApi/Version_1_1 \
    http://www.genicam.org/GenApi/GenApiSchema_Version_1_1.xsd\">\n";
const LAST_LINES: &str = "<Port Name=\"Device\" NameSpace=\"Standard\">\n</Port>\n</RegisterDescription>\n";

/// Returns the XML.
pub(super) fn text(
    identity: &Identity,
    place: &DeviceParams,
    colours: Option<BayerPattern>,
    commands: Option<&CommandParams>,
) -> String {
    let mut text = FIRST_LINES.to_owned();
    for feature in TABLE.iter().filter(|feature| feature.is_of(commands.is_some())) {
        let _ = write_node(&mut text, feature, colours, commands.is_some()); // writing to a string cannot fail
    }
    text.push_str(LAST_LINES);
    let mut fields = vec![
        ("{VENDOR}", c_name(&identity.vendor)),
        ("{MODEL}", c_name(&identity.model)),
        ("{PACKET_MAX}", (place.packet_bytes_max & !3).to_string()),
        ("{OFFSET_STEP}", offset_step(colours).to_string()),
        ("{TRUTH_ID}", format!("{:08X}", chunk::TRUTH_ID)),
        ("{CHUNKS}", chunk_nodes()),
        ("{EVENTS}", event_nodes()),
        ("  <pFeature>{CHUNK_FEATURES}</pFeature>", chunk_names()),
        ("  <pFeature>{EVENT_FEATURES}</pFeature>", event_names()),
    ];
    if let Some(CommandParams { range, has_line, .. }) = commands {
        let [exposure_min, exposure_max] = range.exposure.map(|span| (span.s() * 1e6).to_string());
        fields.extend([
            ("{EXPOSURE_MIN}", exposure_min),
            ("{EXPOSURE_MAX}", exposure_max),
            ("{GAIN_MIN}", range.gain_db[0].to_string()),
            ("{GAIN_MAX}", range.gain_db[1].to_string()),
            ("{BLACK_MIN}", range.black_level_dn[0].to_string()),
            ("{BLACK_MAX}", range.black_level_dn[1].to_string()),
            ("{DELAY_MAX}", (range.delay_max.s() * 1e6).to_string()),
            ("{HAS_LINE}", u8::from(*has_line).to_string()),
        ]);
    }
    fields.iter().fold(text, |text, (field, value)| text.replace(field, value))
}

/// Returns text filled up with line ends to whole words, as memory is read.
pub(super) fn in_words(text: &str) -> Vec<u8> {
    let mut bytes = text.as_bytes().to_vec();
    bytes.resize(bytes.len().next_multiple_of(4), b'\n');
    bytes
}

/// Steps of a region's first column and row: with colours the first pixel always has the same one.
pub(super) const fn offset_step(colours: Option<BayerPattern>) -> u32 {
    if colours.is_some() { 2 } else { 1 }
}

/// Returns a name as the identifier that the schema wants; registers report the names unchanged.
fn c_name(text: &str) -> String {
    let name: String = text.chars().map(|c| if c.is_ascii_alphanumeric() { c } else { '_' }).collect();
    if name.starts_with(|c: char| c.is_ascii_alphabetic() || c == '_') { name } else { format!("_{name}") }
}

/// Writes the node of a feature and the register behind it, with their elements in the order of the schema.
fn write_node(text: &mut String, feature: &Feature, colours: Option<BayerPattern>, is_commanded: bool) -> Result {
    let name = feature.name;
    let node = match feature.kind {
        Kind::Other(nodes) => return text.write_str(nodes),
        Kind::Number => return write_register(text, feature, name),
        Kind::Category(_) => "Category",
        Kind::Whole | Kind::Zero => "Integer",
        Kind::Real => "Float",
        Kind::Switch => "Boolean",
        Kind::Command(_) => "Command",
        Kind::Choice(_) | Kind::Only(_) => "Enumeration",
        Kind::Difference(_) => "IntSwissKnife",
        Kind::Text => "StringReg",
        Kind::Reading => "FloatReg",
    };
    let is_its_own_register = matches!(feature.kind, Kind::Text | Kind::Reading);
    let register = Some(format!("{name}Reg")).filter(|_| feature.bytes > 0 && !is_its_own_register);
    if let Some(register) = register.as_ref().filter(|_| feature.bits.is_some()) {
        write_register(text, feature, register)?;
    }
    writeln!(text, "<{node} Name=\"{name}\" NameSpace=\"{}\">", feature.space)?;
    tag(text, "ToolTip", feature.about)?;
    tag(text, "Visibility", feature.visibility)?;
    tag(text, "pIsLocked", feature.locked_by)?;
    match feature.kind {
        Kind::Category(names) => {
            let is_there = |name: &&&str| name.starts_with('{') || Feature::named(name, is_commanded).is_some();
            names.iter().filter(is_there).try_for_each(|name| tag(text, "pFeature", name))?;
        }
        Kind::Choice(entries) => entries.list(colours).iter().try_for_each(|entry| write_entry(text, entry))?,
        Kind::Only(entry) => write_entry(text, &Entry::new(entry, 0))?,
        Kind::Difference([(a, from), (b, less)]) => {
            writeln!(text, "  <pVariable Name=\"{a}\">{from}Reg</pVariable>")?;
            writeln!(text, "  <pVariable Name=\"{b}\">{less}Reg</pVariable>\n  <Formula>{a}-{b}</Formula>")?;
        }
        Kind::Text | Kind::Reading => write_place(text, feature)?,
        _ => {}
    }
    tag(text, "pValue", register.as_deref().unwrap_or_default())?;
    match feature.kind {
        Kind::Only(_) | Kind::Zero => tag(text, "Value", "0")?,
        Kind::Command(value) => tag(text, "CommandValue", &value.to_string())?,
        Kind::Switch => writeln!(text, "  <OnValue>1</OnValue>\n  <OffValue>0</OffValue>")?,
        _ => {}
    }
    for (end, limit) in ["Min", "Max"].into_iter().zip(feature.range) {
        match limit {
            Limit::Nothing => {}
            Limit::At(number) => tag(text, end, &number.to_string())?,
            Limit::Of(node) => tag(text, &format!("p{end}"), node)?,
            Limit::Given(field) => tag(text, end, field)?,
        }
    }
    tag(text, "Inc", feature.step)?;
    tag(text, "Unit", feature.unit)?;
    tag(text, "Representation", feature.form)?;
    feature.selects.iter().try_for_each(|name| tag(text, "pSelected", name))?;
    writeln!(text, "</{node}>")?;
    register.filter(|_| feature.bits.is_none()).map_or(Ok(()), |register| write_register(text, feature, &register))
}

fn tag(text: &mut String, name: &str, value: &str) -> Result {
    if value.is_empty() { Ok(()) } else { writeln!(text, "  <{name}>{value}</{name}>") }
}

fn write_entry(text: &mut String, entry: &Entry) -> Result {
    let space = if entry.space.is_empty() { String::new() } else { format!(" NameSpace=\"{}\"", entry.space) };
    writeln!(text, "  <EnumEntry Name=\"{}\"{space}>", entry.name)?;
    if !entry.available.is_empty() {
        writeln!(text, "    <pIsAvailable>{}</pIsAvailable>", entry.available)?;
    }
    writeln!(text, "    <Value>{}</Value>\n  </EnumEntry>", entry.value)
}

fn write_register(text: &mut String, feature: &Feature, name: &str) -> Result {
    let node = match feature.kind {
        Kind::Real | Kind::Number => "FloatReg",
        _ if feature.bits.is_some() => "MaskedIntReg",
        _ => "IntReg",
    };
    writeln!(text, "<{node} Name=\"{name}\">")?;
    write_place(text, feature)?;
    writeln!(text, "</{node}>")
}

fn write_place(text: &mut String, feature: &Feature) -> Result {
    let access = match feature.access {
        Access::Read => "RO",
        Access::Write => "WO",
        Access::Both => "RW",
    };
    writeln!(text, "  <Address>0x{:X}</Address>\n  <Length>{}</Length>", feature.address, feature.bytes)?;
    writeln!(text, "  <AccessMode>{access}</AccessMode>\n  <pPort>Device</pPort>")?;
    tag(text, "Cachable", feature.cached)?;
    match feature.bits {
        Some([first, last]) if first == last => writeln!(text, "  <Bit>{first}</Bit>")?,
        Some([first, last]) => writeln!(text, "  <LSB>{first}</LSB>\n  <MSB>{last}</MSB>")?,
        None => {}
    }
    match feature.kind {
        Kind::Text => return Ok(()),
        Kind::Real | Kind::Reading | Kind::Number => {}
        _ => tag(text, "Sign", if feature.is_signed { "Signed" } else { "Unsigned" })?,
    }
    tag(text, "Endianess", "BigEndian")
}

fn event_names() -> String {
    let names = |name| ["", "Timestamp", "FrameID"].map(|end| format!("  <pFeature>Event{name}{end}</pFeature>"));
    let lines: Vec<String> = EVENTS.iter().flat_map(|event| names(event.name)).collect();
    lines.join("\n")
}

fn event_nodes() -> String {
    let of_event = |name: &str, id: u16| {
        let number = |what: &str, unit: &str, address: usize| {
            format!(
                "<IntReg Name=\"Event{name}{what}\" NameSpace=\"Standard\">\n  <Address>0x{address:X}</Address>\n  \
                 <Length>8</Length>\n  <AccessMode>RO</AccessMode>\n  <pPort>Event{name}Port</pPort>\n  \
                 <Cachable>NoCache</Cachable>\n  <Sign>Unsigned</Sign>\n  <Endianess>BigEndian</Endianess>\n{unit}</IntReg>\n"
            )
        };
        format!(
            "<Port Name=\"Event{name}Port\">\n  <EventID>{id:04X}</EventID>\n</Port>\n\
             <Integer Name=\"Event{name}\" NameSpace=\"Standard\">\n  <Value>{id}</Value>\n</Integer>\n{}{}",
            number("Timestamp", "  <Unit>ns</Unit>\n", TIMESTAMP_AT),
            number("FrameID", "", FRAME_ID_AT)
        )
    };
    EVENTS.iter().map(|event| of_event(event.name, event.id)).collect()
}

fn chunk_names() -> String {
    let lines: Vec<String> =
        chunk::FIELDS.iter().map(|field| format!("  <pFeature>{}</pFeature>", field.feature.name)).collect();
    lines.join("\n")
}

fn chunk_nodes() -> String {
    let (mut text, mut offset) = (String::new(), 0);
    for field in &chunk::FIELDS {
        let _ = write_chunk_node(&mut text, field, offset); // writing to a string cannot fail
        offset += field.bytes();
    }
    text
}

fn write_chunk_node(text: &mut String, field: &Field, offset: usize) -> Result {
    let feature = &field.feature;
    let (node, is_number) = match feature.kind {
        FeatureKind::Integer | FeatureKind::Bits => ("IntReg", true),
        FeatureKind::Float => ("FloatReg", true),
        FeatureKind::Text => ("StringReg", false),
    };
    writeln!(text, "<{node} Name=\"{}\" NameSpace=\"Custom\">", feature.name)?;
    writeln!(text, "  <ToolTip>{}</ToolTip>", feature.about)?;
    writeln!(text, "  <Address>{offset}</Address>\n  <Length>{}</Length>", field.bytes())?;
    writeln!(text, "  <AccessMode>RO</AccessMode>\n  <pPort>TruthPort</pPort>\n  <Cachable>NoCache</Cachable>")?;
    if node == "IntReg" {
        writeln!(text, "  <Sign>Signed</Sign>")?;
    }
    if is_number {
        writeln!(text, "  <Endianess>BigEndian</Endianess>")?;
    }
    if !feature.unit.is_empty() {
        writeln!(text, "  <Unit>{}</Unit>", feature.unit)?;
    }
    writeln!(text, "</{node}>")
}

#[cfg(test)]
mod tests {
    use super::*;
    use frames::sink::sample::{bare_sample_frame, compare_with_pinned, differs_from_pinned, hex_lines, sample_frame};

    /// Returns the entries of the selector as they are in the XML.
    fn chunk_entries() -> String {
        let selector = Feature::named("ChunkSelector", false).unwrap();
        let Kind::Choice(entries) = selector.kind else { panic!("not a choice") };
        let mut text = String::new();
        entries.list(None).iter().for_each(|entry| write_entry(&mut text, entry).unwrap());
        text.trim_end().to_owned()
    }

    #[test]
    fn chunk_features_of_the_xml_are_as_pinned() {
        let features = [chunk_names(), chunk_entries(), chunk_nodes()].join("\n");
        compare_with_pinned("chunk_features.xml", &features).unwrap();
        assert!(differs_from_pinned("chunk_features.xml", &features.replace("ChunkRoll", "ChunkRole")), "control");
    }

    #[test]
    fn chunk_bytes_are_as_pinned() {
        for (name, frame) in [("chunk.txt", sample_frame(7)), ("chunk_bare.txt", bare_sample_frame(8))] {
            let mut bytes = Vec::new();
            chunk::append_chunks(&frame.meta, 5, &mut bytes);
            compare_with_pinned(name, &hex_lines(&bytes)).unwrap();
            bytes[20] ^= 1;
            assert!(differs_from_pinned(name, &hex_lines(&bytes)), "control: one bit");
        }
    }
}
