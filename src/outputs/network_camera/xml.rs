//! The XML that tells clients which features the camera has and where they lie; GenICam schema 1.1.
//!
//! Features and addresses stand in `camera.xml`; names, packet sizes and chunk data are filled in here, the latter from
//! the table that also writes the bytes. Tests hold every address of the XML to the device's memory, and
//! `hil_scripts/test_network_camera.py` holds the whole to the reference GenApi.

use crate::network_camera::chunk::{self, Field};
use crate::network_camera::device::DeviceParams;
use crate::network_camera::params::{Identity, PACKET_BYTES_MIN};
use core::fmt::Write;
use frames::sink::facts::FeatureKind;
use frames::zip_archive::archive;

const TEMPLATE: &str = include_str!("camera.xml");

/// The XML as text, filled up with line ends to whole words.
pub(super) fn plain(identity: &Identity, place: &DeviceParams) -> Vec<u8> {
    let mut text = filled_in(identity, place).into_bytes();
    text.resize(text.len().next_multiple_of(4), b'\n');
    text
}

/// The XML in a zip archive of whole words.
pub(super) fn zipped(identity: &Identity, place: &DeviceParams) -> std::io::Result<Vec<u8>> {
    archive(&[("starloop.xml", filled_in(identity, place).as_bytes())])
}

fn filled_in(identity: &Identity, place: &DeviceParams) -> String {
    TEMPLATE
        .replace("{VENDOR}", &c_name(&identity.vendor))
        .replace("{MODEL}", &c_name(&identity.model))
        .replace("{PACKET_MIN}", &PACKET_BYTES_MIN.to_string())
        .replace("{PACKET_MAX}", &(place.packet_bytes_max & !3).to_string())
        .replace("{TRUTH_ID}", &format!("{:08X}", chunk::TRUTH_ID))
        .replace("{CHUNK_FEATURES}", &chunk_names())
        .replace("{CHUNK_ENTRIES}", &chunk_entries())
        .replace("{CHUNKS}", &chunk_nodes())
}

/// The schema wants the names of an identifier; registers tell the names as they are.
fn c_name(text: &str) -> String {
    let name: String = text.chars().map(|c| if c.is_ascii_alphanumeric() { c } else { '_' }).collect();
    if name.starts_with(|c: char| c.is_ascii_alphabetic() || c == '_') { name } else { format!("_{name}") }
}

/// One entry of the selector for each field, without the word that all their names begin with.
fn chunk_entries() -> String {
    let entry = |(value, field): (usize, &Field)| {
        let name = field.feature.name.trim_start_matches("Chunk");
        format!("  <EnumEntry Name=\"{name}\" NameSpace=\"Custom\">\n    <Value>{value}</Value>\n  </EnumEntry>")
    };
    let entries: Vec<String> = chunk::FIELDS.iter().enumerate().map(entry).collect();
    entries.join("\n")
}

fn chunk_names() -> String {
    let lines: Vec<String> =
        chunk::FIELDS.iter().map(|field| format!("  <pFeature>{}</pFeature>", field.feature.name)).collect();
    lines.join("\n")
}

fn chunk_nodes() -> String {
    let (mut text, mut offset) = (String::new(), 0);
    for field in &chunk::FIELDS {
        let _text_grows = write_chunk_node(&mut text, field, offset);
        offset += field.bytes();
    }
    text
}

fn write_chunk_node(text: &mut String, field: &Field, offset: usize) -> core::fmt::Result {
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
