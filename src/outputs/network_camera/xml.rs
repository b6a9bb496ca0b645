//! The XML that describes the camera's features and their addresses to clients; GenICam schema 1.1.
//!
//! Features and addresses are in `camera.xml` and `xml_features`; names, packet sizes and chunk data are filled in
//! here, the latter from the table that also writes the bytes. Tests compare every address of the XML with the device's
//! memory, and `hil_scripts/test_network_camera.py` loads the whole with the reference GenApi.

use crate::network_camera::chunk::{self, Field};
use crate::network_camera::params::{CommandParams, DeviceParams, Identity, PACKET_BYTES_MIN};
use crate::network_camera::xml_features;
use base::bayer::BayerPattern;
use core::fmt::Write;
use frames::{sink::facts::FeatureKind, zip_archive::archive};

const TEMPLATE: &str = include_str!("camera.xml");
/// Settings that clients read.
const READ_ONLY: &str = include_str!("read_only.xml");
/// Settings that clients command.
const COMMANDED: &str = include_str!("commanded.xml");
const CHOSEN_RATE_TIP: &str =
    "Frames per second: those of the bench at most, or of each n-th of its frames; the nearest is taken";
const ACQUISITION_FEATURES: [&str; 7] = [
    "ExposureMode",
    "ExposureAuto",
    "AcquisitionFrameRateEnable",
    "AcquisitionBurstFrameCount",
    "TriggerActivation",
    "TriggerDelay",
    "TriggerOverlap",
];
const GAIN_FEATURES: [&str; 4] = ["GainSelector", "GainAuto", "BlackLevelSelector", "BlackLevel"];

/// Returns the XML as text, filled up with line ends to whole words.
pub(super) fn plain(
    identity: &Identity,
    place: &DeviceParams,
    colours: Option<BayerPattern>,
    commands: Option<&CommandParams>,
) -> Vec<u8> {
    let mut text = filled_in(identity, place, colours, commands).into_bytes();
    text.resize(text.len().next_multiple_of(4), b'\n');
    text
}

/// Returns the XML in a zip archive of whole words.
pub(super) fn zipped(
    identity: &Identity,
    place: &DeviceParams,
    colours: Option<BayerPattern>,
    commands: Option<&CommandParams>,
) -> std::io::Result<Vec<u8>> {
    archive(&[("starloop.xml", filled_in(identity, place, colours, commands).as_bytes())])
}

fn filled_in(
    identity: &Identity,
    place: &DeviceParams,
    colours: Option<BayerPattern>,
    commands: Option<&CommandParams>,
) -> String {
    let more = xml_features::more_features(commands.is_some());
    with_settings(commands)
        .replace("{VENDOR}", &c_name(&identity.vendor))
        .replace("{MODEL}", &c_name(&identity.model))
        .replace("{PACKET_MIN}", &PACKET_BYTES_MIN.to_string())
        .replace("{PACKET_MAX}", &(place.packet_bytes_max & !3).to_string())
        .replace("{TRUTH_ID}", &format!("{:08X}", chunk::TRUTH_ID))
        .replace("{CHUNK_FEATURES}", &chunk_names())
        .replace("{CHUNK_ENTRIES}", &chunk_entries())
        .replace("{CHUNKS}", &chunk_nodes())
        .replace("{OFFSET_STEP}", &offset_step(colours).to_string())
        .replace("{PIXEL_FORMATS}", &xml_features::pixel_formats(colours))
        .replace("{MORE_CATEGORIES}", &more.categories)
        .replace("{MORE_NODES}", more.nodes.trim_end())
}

/// Steps of a region's first column and row: with colours the first pixel always has the same one.
pub(super) const fn offset_step(colours: Option<BayerPattern>) -> u32 {
    if colours.is_some() { 2 } else { 1 }
}

/// Returns the template with the settings that clients command, or only read.
fn with_settings(commands: Option<&CommandParams>) -> String {
    let Some(commands) = commands else {
        let fields = ["\n{ACQUISITION_FEATURES}", "\n{GAIN_FEATURES}", "\n{MORE_SOURCES}"];
        let template = fields.iter().fold(TEMPLATE.to_owned(), |text, field| text.replace(field, ""));
        return template
            .replace("{SETTINGS}\n", READ_ONLY)
            .replace("{TRIGGER_TIP}", "Sends the next frame of the bench")
            .replace("{RATE_TIP}", CHOSEN_RATE_TIP);
    };
    let range = &commands.range;
    let names = |names: &[&str]| names.iter().map(|name| format!("  <pFeature>{name}</pFeature>")).collect::<Vec<_>>();
    let source = |(value, name): (usize, &str)| {
        format!("  <EnumEntry Name=\"{name}\">\n    <Value>{value}</Value>\n  </EnumEntry>")
    };
    let sources: Vec<String> = [(2, "Line1"), (3, "Bus"), (4, "Control")].map(source).into();
    let [exposure_min, exposure_max] = range.exposure.map(|span| span.s() * 1e6);
    let mut text = TEMPLATE
        .replace("{SETTINGS}\n", COMMANDED)
        .replace("{ACQUISITION_FEATURES}", &names(&ACQUISITION_FEATURES).join("\n"))
        .replace("{GAIN_FEATURES}", &names(&GAIN_FEATURES).join("\n"))
        .replace("{MORE_SOURCES}", &sources.join("\n"))
        .replace("{TRIGGER_TIP}", "Starts an exposure")
        .replace("{RATE_TIP}", "Exposures per second, when the rate is enabled")
        .replace("{HAS_LINE}", if commands.has_line { "1" } else { "0" });
    for (field, value) in [
        ("{EXPOSURE_MIN}", exposure_min),
        ("{EXPOSURE_MAX}", exposure_max),
        ("{GAIN_MIN}", range.gain_db[0]),
        ("{GAIN_MAX}", range.gain_db[1]),
        ("{BLACK_MIN}", range.black_level_dn[0]),
        ("{BLACK_MAX}", range.black_level_dn[1]),
        ("{DELAY_MAX}", range.delay_max.s() * 1e6),
    ] {
        text = text.replace(field, &value.to_string());
    }
    text
}

/// Returns a name as the identifier that the schema wants; registers report the names unchanged.
fn c_name(text: &str) -> String {
    let name: String = text.chars().map(|c| if c.is_ascii_alphanumeric() { c } else { '_' }).collect();
    if name.starts_with(|c: char| c.is_ascii_alphabetic() || c == '_') { name } else { format!("_{name}") }
}

/// Returns one entry of the selector for each field, without the word that all their names begin with.
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
        let _ = write_chunk_node(&mut text, field, offset); // writing to a string cannot fail
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
