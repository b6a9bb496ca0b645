//! The EDS file of the CANopen star tracker, from its dictionary (CiA 306). `starloop_tracker.eds` beside this file is
//! what comes out, for clients to load; a test compares them.

use super::dictionary::{ENTRIES, Entry, mapping_word, pdo_entries};
use core::fmt::Write as _;
use std::collections::BTreeMap;

/// The file that is shipped.
pub const SHIPPED: &str = include_str!("starloop_tracker.eds");

const HEAD: &str = "[FileInfo]\nFileName=starloop_tracker.eds\nFileVersion=1\nFileRevision=0\nEDSVersion=4.0\n\
    Description=Star tracker of starloop\nCreationTime=12:00PM\nCreationDate=01-01-2026\nCreatedBy=starloop\n\n\
    [DeviceInfo]\nVendorName=starloop\nVendorNumber=0\nProductName=starloop star tracker\nProductNumber=1\nRevisionNumber=1\n\
    OrderCode=none\nBaudRate_10=0\nBaudRate_20=0\nBaudRate_50=1\nBaudRate_125=1\nBaudRate_250=1\nBaudRate_500=1\nBaudRate_800=1\n\
    BaudRate_1000=1\nSimpleBootUpMaster=0\nSimpleBootUpSlave=1\nGranularity=0\nDynamicChannelsSupported=0\nGroupMessaging=0\n\
    NrOfRXPDO=0\nNrOfTXPDO=4\nLSS_Supported=0\n\n[DummyUsage]\nDummy0001=0\nDummy0002=0\nDummy0003=0\nDummy0004=0\nDummy0005=0\n\
    Dummy0006=0\nDummy0007=0\n";

/// Returns the text of the file.
pub fn text() -> String {
    let mut objects: BTreeMap<u16, Vec<Entry>> = BTreeMap::new();
    for entry in ENTRIES.iter().copied().chain(pdo_entries()) {
        objects.entry(entry.index).or_default().push(entry);
    }
    let mut text = HEAD.to_owned();
    let is_mandatory = |index: &u16| [0x1000, 0x1001, 0x1018].contains(index);
    let lists = [
        ("MandatoryObjects", objects.keys().copied().filter(is_mandatory).collect::<Vec<_>>()),
        ("OptionalObjects", objects.keys().copied().filter(|index| !is_mandatory(index) && *index < 0x2000).collect()),
        ("ManufacturerObjects", objects.keys().copied().filter(|index| *index >= 0x2000).collect()),
    ];
    for (name, indices) in lists {
        let _ = write!(text, "\n[{name}]\nSupportedObjects={}\n", indices.len()); // writing to a string does not fail
        for (number, index) in indices.iter().enumerate() {
            let _ = writeln!(text, "{}=0x{index:04X}", number + 1); // writing to a string does not fail
        }
    }
    for entries in objects.values() {
        write_object(&mut text, entries);
    }
    text
}

fn write_object(text: &mut String, entries: &[Entry]) {
    let Some(first) = entries.first() else { return };
    if entries.len() == 1 {
        let _ = write!(text, "\n[{:04X}]\nParameterName={}\n", first.index, first.names[0]); // writing to a string does not fail
        write_entry(text, first);
        return;
    }
    let object = if first.index >= 0x1800 && first.index < 0x1A00 || first.index == 0x1018 { 9 } else { 8 };
    let (index, name, count) = (first.index, first.names[0], entries.len());
    let _ = write!(text, "\n[{index:04X}]\nParameterName={name}\nObjectType=0x{object}\nSubNumber={count}\n"); // writing to a string does not fail
    for entry in entries {
        let _ = write!(text, "\n[{index:04X}sub{:X}]\nParameterName={}\n", entry.sub, entry.names[1]); // writing to a string does not fail
        write_entry(text, entry);
    }
}

fn write_entry(text: &mut String, entry: &Entry) {
    let at_start = match entry.index.checked_sub(super::dictionary::MAPPING) {
        Some(pdo) if pdo < 4 && entry.sub > 0 => {
            let word = mapping_word(usize::from(pdo), usize::from(entry.sub) - 1).unwrap_or(0);
            format!("0x{word:08X}")
        }
        Some(_) | None => entry.at_start.to_owned(),
    };
    let _ = write!(
        text,
        "ObjectType=0x7\nDataType=0x{:04X}\nAccessType={}\nDefaultValue={at_start}\nPDOMapping={}\n",
        entry.kind as u16,
        entry.access.word(),
        u8::from(entry.is_mapped)
    );
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn shipped_file_is_that_of_the_dictionary() {
        if let Some(path) = std::env::var_os("STARLOOP_WRITE_EDS") {
            std::fs::write(path, text()).unwrap();
        }
        assert!(SHIPPED == text(), "write it again: STARLOOP_WRITE_EDS=src/telemetry/canopen/starloop_tracker.eds");
    }

    #[test]
    fn each_object_has_its_section() {
        let text = text();
        for entry in ENTRIES {
            assert!(text.contains(&format!("\n[{:04X}", entry.index)), "{:04X}", entry.index);
        }
        assert!(text.contains("[4002sub5]\nParameterName=Real part\nObjectType=0x7\nDataType=0x0008\nAccessType=ro\n"));
    }
}
