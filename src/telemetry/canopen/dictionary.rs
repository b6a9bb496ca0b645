//! The object dictionary of the CANopen star tracker: its objects, their types, and which of them can be written.
//!
//! One table, from which the device answers and the EDS file is written (CiA 306), and two maps of transmit PDOs over it.
//! `starloop_tracker.eds` beside this file is what comes out with the first map, for clients to load; a test compares
//! them. The second map is the one of the OreSat1 mission in PyPI's `oresat-configs` 1.2.0; the PDOs of its Linux board,
//! 1 and 2, are left out.

use Access::{Constant, ReadOnly, ReadWrite, WriteOnly};
use Type::{F32, I16, Text, U8, U16, U32};
use core::fmt::Write as _;
use std::collections::BTreeMap;

/// Types of CiA 301, by their numbers in a dictionary.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[repr(u16)]
pub enum Type {
    /// Signed, 16 bits.
    I16 = 0x03,
    /// Unsigned, 8 bits.
    U8 = 0x05,
    /// Unsigned, 16 bits.
    U16 = 0x06,
    /// Unsigned, 32 bits.
    U32 = 0x07,
    /// IEEE 754, 32 bits.
    F32 = 0x08,
    /// Visible characters, as many as there are.
    Text = 0x09,
}

impl Type {
    /// Its bytes; 0 for a text, which is read in segments.
    pub fn bytes(self) -> u8 {
        match self {
            Self::Text => 0,
            Self::U8 => 1,
            Self::I16 | Self::U16 => 2,
            Self::U32 | Self::F32 => 4,
        }
    }
}

/// Ways to use an object.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Access {
    /// Read.
    ReadOnly,
    /// Read; never changes.
    Constant,
    /// Read and write.
    ReadWrite,
    /// Write.
    WriteOnly,
}

impl Access {
    /// Its word in EDS files.
    pub fn word(self) -> &'static str {
        match self {
            Self::ReadOnly => "ro",
            Self::Constant => "const",
            Self::ReadWrite => "rw",
            Self::WriteOnly => "wo",
        }
    }
}

/// One entry.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Entry {
    /// Index.
    pub index: u16,
    /// Sub-index.
    pub sub: u8,
    /// Name of the object, and of its part where it has several.
    pub names: [&'static str; 2],
    /// Type.
    pub kind: Type,
    /// Access.
    pub access: Access,
    /// Value at the start as an EDS file has it; empty for what has none.
    pub at_start: &'static str,
    /// It is in a transmit PDO.
    pub is_mapped: bool,
}

const fn entry(at: (u16, u8), names: [&'static str; 2], kind: Type, access: Access, at_start: &'static str) -> Entry {
    Entry { index: at.0, sub: at.1, names, kind, access, at_start, is_mapped: false }
}

const fn mapped(at: (u16, u8), names: [&'static str; 2], kind: Type, access: Access) -> Entry {
    Entry { index: at.0, sub: at.1, names, kind, access, at_start: "", is_mapped: true }
}

/// Profile and state.
pub const STATE: u16 = 0x4000;
/// Attitude, where OreSat has it.
pub const ATTITUDE: u16 = 0x4002;
/// Rates.
pub const RATE: u16 = 0x4003;
/// Stars used.
pub const STARS: u16 = 0x4004;
/// Exposure.
pub const EXPOSURE: u16 = 0x4005;
/// Frame.
pub const FRAME: u16 = 0x4006;
/// Reset.
pub const RESET: u16 = 0x4007;
/// Temperature.
pub const TEMPERATURE: u16 = 0x4008;
/// Name of the device.
pub const NAME: u16 = 0x1008;
/// The name itself.
pub const NAME_TEXT: &str = "starloop star tracker";
/// Heartbeat.
pub const HEARTBEAT: u16 = 0x1017;
/// First of the communication parameters of transmit PDOs.
pub const TPDO: u16 = 0x1800;
/// First of their mappings.
pub const MAPPING: u16 = 0x1A00;
/// Error register.
pub const ERROR_REGISTER: u16 = 0x1001;

/// A transmit PDO.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Pdo {
    /// Its number, from 1.
    pub number: u16,
    /// Index and sub-index of its objects.
    pub objects: &'static [(u16, u8)],
}

impl Pdo {
    /// Its identifier less the node's number. Those beyond the fourth have the first ones of the next node.
    pub const fn id(self) -> u16 {
        let before = self.number - 1;
        0x180 + 0x100 * (before % 4) + before / 4
    }

    /// Index of its communication parameters.
    const fn communication(self) -> u16 {
        TPDO + self.number - 1
    }

    /// Index of its mapping.
    const fn mapping(self) -> u16 {
        MAPPING + self.number - 1
    }

    /// Returns an object's bytes in the data of the PDO, padded with zeros; `None` where it has none.
    pub fn part(self, data: &[u8], object: (u16, u8)) -> Option<[u8; 4]> {
        let place = self.objects.iter().position(|other| *other == object)?;
        let bytes_of = |objects: &[(u16, u8)]| objects.iter().map(|object| bytes_of(*object)).sum::<usize>();
        let (from, to) = (bytes_of(&self.objects[..place]), bytes_of(&self.objects[..=place]));
        let mut part = [0; 4];
        part.get_mut(..to - from)?.copy_from_slice(data.get(from..to)?);
        Some(part)
    }

    /// Bytes of its data.
    pub fn bytes(self) -> usize {
        self.objects.iter().map(|object| bytes_of(*object)).sum()
    }
}

fn bytes_of((index, sub): (u16, u8)) -> usize {
    let is_it = |entry: &&Entry| (entry.index, entry.sub) == (index, sub);
    ENTRIES.iter().find(is_it).map_or(0, |entry| entry.kind.bytes().into())
}

/// A map of transmit PDOs.
#[derive(Debug, PartialEq, Eq)]
pub struct PdoMap {
    /// Its name.
    pub name: &'static str,
    /// Name of its EDS file.
    pub file: &'static str,
    /// Its PDOs, in the order of a report.
    pub pdos: &'static [Pdo],
}

/// Most PDOs of a map.
pub const PDOS_MAX: usize = 5;

/// This program's own map.
pub const STARLOOP: PdoMap = PdoMap {
    name: "starloop",
    file: "starloop_tracker.eds",
    pdos: &[
        Pdo { number: 1, objects: &[(STATE, 0), (ATTITUDE, 6), (STARS, 0), (ATTITUDE, 4)] },
        Pdo { number: 2, objects: &[(ATTITUDE, 5), (ATTITUDE, 1)] },
        Pdo { number: 3, objects: &[(ATTITUDE, 2), (ATTITUDE, 3)] },
        Pdo { number: 4, objects: &[(RATE, 1), (RATE, 2), (RATE, 3), (FRAME, 0)] },
    ],
};

/// The map of OreSat1.
pub const ORESAT: PdoMap = PdoMap {
    name: "oresat",
    file: "starloop_tracker_oresat.eds",
    pdos: &[
        Pdo { number: 3, objects: &[(STATE, 0), (ATTITUDE, 6), (ATTITUDE, 4)] },
        Pdo { number: 4, objects: &[(ATTITUDE, 5), (ATTITUDE, 1)] },
        Pdo { number: 5, objects: &[(ATTITUDE, 2), (ATTITUDE, 3)] },
    ],
};

/// Every map.
pub const MAPS: [&PdoMap; 2] = [&STARLOOP, &ORESAT];

const ATTITUDE_NAME: &str = "Attitude";
const RATE_NAME: &str = "Rate";
const IDENTITY: &str = "Identity object";

/// All entries but those of the PDOs.
pub const ENTRIES: [Entry; 31] = [
    entry((0x1000, 0), ["Device type", ""], U32, Constant, "0x0"),
    entry((ERROR_REGISTER, 0), ["Error register", ""], U8, ReadOnly, "0x0"),
    entry((0x1005, 0), ["COB-ID SYNC", ""], U32, Constant, "0x80"),
    entry((NAME, 0), ["Manufacturer device name", ""], Text, Constant, NAME_TEXT),
    entry((0x1014, 0), ["COB-ID EMCY", ""], U32, ReadOnly, "$NODEID+0x80"),
    entry((HEARTBEAT, 0), ["Producer heartbeat time", ""], U16, ReadWrite, "1000"),
    entry((0x1018, 0), [IDENTITY, "Number of entries"], U8, Constant, "4"),
    entry((0x1018, 1), [IDENTITY, "Vendor-ID"], U32, Constant, "0x0"),
    entry((0x1018, 2), [IDENTITY, "Product code"], U32, Constant, "0x1"),
    entry((0x1018, 3), [IDENTITY, "Revision number"], U32, Constant, "0x1"),
    entry((0x1018, 4), [IDENTITY, "Serial number"], U32, Constant, "0x0"),
    entry((0x1200, 0), ["SDO server parameter", "Number of entries"], U8, Constant, "2"),
    entry((0x1200, 1), ["SDO server parameter", "COB-ID client to server"], U32, ReadOnly, "$NODEID+0x600"),
    entry((0x1200, 2), ["SDO server parameter", "COB-ID server to client"], U32, ReadOnly, "$NODEID+0x580"),
    mapped((STATE, 0), ["State", ""], U8, ReadWrite),
    entry((ATTITUDE, 0), [ATTITUDE_NAME, "Number of entries"], U8, Constant, "6"),
    mapped((ATTITUDE, 1), [ATTITUDE_NAME, "i"], F32, ReadOnly),
    mapped((ATTITUDE, 2), [ATTITUDE_NAME, "j"], F32, ReadOnly),
    mapped((ATTITUDE, 3), [ATTITUDE_NAME, "k"], F32, ReadOnly),
    mapped((ATTITUDE, 4), [ATTITUDE_NAME, "Milliseconds of the UTC day at mid-exposure"], U32, ReadOnly),
    mapped((ATTITUDE, 5), [ATTITUDE_NAME, "Real part"], F32, ReadOnly),
    mapped((ATTITUDE, 6), [ATTITUDE_NAME, "Known"], U8, ReadOnly),
    entry((RATE, 0), [RATE_NAME, "Number of entries"], U8, Constant, "3"),
    mapped((RATE, 1), [RATE_NAME, "About x, arcsec/s"], I16, ReadOnly),
    mapped((RATE, 2), [RATE_NAME, "About y, arcsec/s"], I16, ReadOnly),
    mapped((RATE, 3), [RATE_NAME, "About z, arcsec/s"], I16, ReadOnly),
    mapped((STARS, 0), ["Stars used", ""], U16, ReadOnly),
    entry((EXPOSURE, 0), ["Exposure, us", ""], U32, ReadWrite, ""),
    mapped((FRAME, 0), ["Frame, low 16 bits", ""], U16, ReadOnly),
    entry((RESET, 0), ["Reset: write 1", ""], U8, WriteOnly, ""),
    entry((TEMPERATURE, 0), ["Temperature, degrees Celsius", ""], F32, ReadOnly, ""),
];

impl PdoMap {
    /// Returns an entry of the table or of the PDOs.
    pub fn find(&self, index: u16, sub: u8) -> Option<Entry> {
        let is_it = |entry: &Entry| (entry.index, entry.sub) == (index, sub);
        ENTRIES.into_iter().find(is_it).or_else(|| self.entries().into_iter().find(is_it))
    }

    /// Returns true when there is an object of this index, whatever its sub-index.
    pub fn has_index(&self, index: u16) -> bool {
        self.find(index, 0).is_some()
    }

    /// Returns the place in the list of the PDO whose communication parameters or mapping are at this index.
    pub fn place(&self, index: u16) -> Option<usize> {
        self.pdos.iter().position(|pdo| [pdo.communication(), pdo.mapping()].contains(&index))
    }

    /// Entries of the communication parameters and mappings of the transmit PDOs.
    fn entries(&self) -> Vec<Entry> {
        const COMMUNICATION: [&str; PDOS_MAX] =
            ["TPDO1 parameter", "TPDO2 parameter", "TPDO3 parameter", "TPDO4 parameter", "TPDO5 parameter"];
        const OF_MAPPING: [&str; PDOS_MAX] =
            ["TPDO1 mapping", "TPDO2 mapping", "TPDO3 mapping", "TPDO4 mapping", "TPDO5 mapping"];
        const COB: [&str; PDOS_MAX] =
            ["$NODEID+0x180", "$NODEID+0x280", "$NODEID+0x380", "$NODEID+0x480", "$NODEID+0x181"];
        const PARTS: [&str; 4] = ["Mapped object 1", "Mapped object 2", "Mapped object 3", "Mapped object 4"];
        const COUNTS: [&str; 5] = ["0", "1", "2", "3", "4"];
        let mut entries = Vec::new();
        for pdo in self.pdos {
            let place = usize::from(pdo.number) - 1;
            let (about, of) = ((pdo.communication(), COMMUNICATION[place]), (pdo.mapping(), OF_MAPPING[place]));
            entries.push(entry((about.0, 0), [about.1, "Number of entries"], U8, Constant, "2"));
            entries.push(entry((about.0, 1), [about.1, "COB-ID"], U32, ReadOnly, COB[place]));
            entries.push(entry((about.0, 2), [about.1, "Transmission type"], U8, ReadWrite, "255"));
            let count = COUNTS[pdo.objects.len()];
            entries.push(entry((of.0, 0), [of.1, "Number of entries"], U8, Constant, count));
            for (sub, _) in (1_u8..).zip(pdo.objects) {
                entries.push(entry((of.0, sub), [of.1, PARTS[usize::from(sub) - 1]], U32, Constant, ""));
            }
        }
        entries
    }

    /// Returns the word of a mapping: index, sub-index, bits.
    pub fn mapping_word(&self, pdo: usize, place: usize) -> Option<u32> {
        let (index, sub) = *self.pdos.get(pdo)?.objects.get(place)?;
        let bits = u32::try_from(bytes_of((index, sub)) * 8).ok()?;
        Some(u32::from(index) << 16 | u32::from(sub) << 8 | bits)
    }

    /// Returns the text of the EDS file.
    pub fn text(&self) -> String {
        let mut objects: BTreeMap<u16, Vec<Entry>> = BTreeMap::new();
        for entry in ENTRIES.into_iter().chain(self.entries()) {
            objects.entry(entry.index).or_default().push(entry);
        }
        let mut text = HEAD.replace("{FILE}", self.file).replace("{PDOS}", &self.pdos.len().to_string());
        let is_mandatory = |index: &u16| [0x1000, 0x1001, 0x1018].contains(index);
        let is_optional = |index: &u16| !is_mandatory(index) && *index < 0x2000;
        let lists = [
            ("MandatoryObjects", objects.keys().copied().filter(is_mandatory).collect::<Vec<_>>()),
            ("OptionalObjects", objects.keys().copied().filter(is_optional).collect()),
            ("ManufacturerObjects", objects.keys().copied().filter(|index| *index >= 0x2000).collect()),
        ];
        for (name, indices) in lists {
            let _ = write!(text, "\n[{name}]\nSupportedObjects={}\n", indices.len()); // writing to a string does not fail
            for (number, index) in indices.iter().enumerate() {
                let _ = writeln!(text, "{}=0x{index:04X}", number + 1); // writing to a string does not fail
            }
        }
        for entries in objects.values() {
            self.write_object(&mut text, entries);
        }
        text
    }

    fn write_object(&self, text: &mut String, entries: &[Entry]) {
        let Some(first) = entries.first() else { return };
        if entries.len() == 1 {
            let _ = write!(text, "\n[{:04X}]\nParameterName={}\n", first.index, first.names[0]); // writing to a string does not fail
            self.write_entry(text, first);
            return;
        }
        let object = if (TPDO..MAPPING).contains(&first.index) || first.index == 0x1018 { 9 } else { 8 };
        let (index, name, count) = (first.index, first.names[0], entries.len());
        let _ = write!(text, "\n[{index:04X}]\nParameterName={name}\nObjectType=0x{object}\nSubNumber={count}\n"); // writing to a string does not fail
        for entry in entries {
            let _ = write!(text, "\n[{index:04X}sub{:X}]\nParameterName={}\n", entry.sub, entry.names[1]); // writing to a string does not fail
            self.write_entry(text, entry);
        }
    }

    fn write_entry(&self, text: &mut String, entry: &Entry) {
        let at_start = match self.place(entry.index) {
            Some(pdo) if entry.index >= MAPPING && entry.sub > 0 => {
                let word = self.mapping_word(pdo, usize::from(entry.sub) - 1).unwrap_or(0);
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
}

const HEAD: &str = "[FileInfo]\nFileName={FILE}\nFileVersion=1\nFileRevision=0\nEDSVersion=4.0\n\
    Description=Star tracker of starloop\nCreationTime=12:00PM\nCreationDate=01-01-2026\nCreatedBy=starloop\n\n\
    [DeviceInfo]\nVendorName=starloop\nVendorNumber=0\nProductName=starloop star tracker\nProductNumber=1\nRevisionNumber=1\n\
    OrderCode=none\nBaudRate_10=0\nBaudRate_20=0\nBaudRate_50=1\nBaudRate_125=1\nBaudRate_250=1\nBaudRate_500=1\nBaudRate_800=1\n\
    BaudRate_1000=1\nSimpleBootUpMaster=0\nSimpleBootUpSlave=1\nGranularity=0\nDynamicChannelsSupported=0\nGroupMessaging=0\n\
    NrOfRXPDO=0\nNrOfTXPDO={PDOS}\nLSS_Supported=0\n\n[DummyUsage]\nDummy0001=0\nDummy0002=0\nDummy0003=0\nDummy0004=0\nDummy0005=0\n\
    Dummy0006=0\nDummy0007=0\n";

#[cfg(test)]
mod tests {
    use super::*;

    /// The EDS file that is shipped.
    const SHIPPED: &str = include_str!("starloop_tracker.eds");

    #[test]
    fn every_mapped_object_is_there_and_each_pdo_is_full() {
        for pdo in MAPS.iter().flat_map(|map| map.pdos) {
            let is_short = *pdo == ORESAT.pdos[0];
            assert_eq!(pdo.bytes(), if is_short { 6 } else { 8 });
            assert!(pdo.objects.iter().all(|(index, sub)| STARLOOP.find(*index, *sub).unwrap().is_mapped));
        }
        assert_eq!(STARLOOP.mapping_word(1, 0), Some(0x4002_0520));
        assert!(STARLOOP.find(0x4002, 7).is_none() && STARLOOP.has_index(0x4002) && !STARLOOP.has_index(0x5000));
        assert!(ORESAT.has_index(0x1804) && !STARLOOP.has_index(0x1804) && !ORESAT.has_index(0x1800));
    }

    /// Numbers from the DCF file that `oresat-configs` 1.2.0 writes for star_tracker_1 of OreSat1, node 0x2C.
    #[test]
    fn map_of_oresat_is_that_of_its_own_files() {
        let ids: Vec<u16> = ORESAT.pdos.iter().map(|pdo| pdo.id() + 0x2C).collect();
        assert_eq!(ids, [940, 1196, 429]);
        let words: Vec<Vec<u32>> =
            (0..3).map(|pdo| (0..4).map_while(|n| ORESAT.mapping_word(pdo, n)).collect()).collect();
        let wanted: [&[u32]; 3] = [
            &[1_073_741_832, 1_073_874_440, 1_073_873_952],
            &[1_073_874_208, 1_073_873_184],
            &[1_073_873_440, 1_073_873_696],
        ];
        assert_eq!(words, wanted);
        assert_ne!(STARLOOP.mapping_word(2, 0), ORESAT.mapping_word(1, 0), "control");
    }

    #[test]
    fn shipped_file_is_that_of_the_dictionary() {
        if let Some(path) = std::env::var_os("STARLOOP_WRITE_EDS") {
            std::fs::write(path, STARLOOP.text()).unwrap();
        }
        let advice = "write it again: STARLOOP_WRITE_EDS=src/telemetry/canopen/starloop_tracker.eds";
        assert!(SHIPPED == STARLOOP.text(), "{advice}");
    }

    #[test]
    fn each_object_has_its_section() {
        let [text, other] = [STARLOOP.text(), ORESAT.text()];
        for entry in ENTRIES {
            assert!(text.contains(&format!("\n[{:04X}", entry.index)), "{:04X}", entry.index);
        }
        assert!(text.contains("[4002sub5]\nParameterName=Real part\nObjectType=0x7\nDataType=0x0008\nAccessType=ro\n"));
        assert!(other.contains("[1804sub1]\nParameterName=COB-ID\n") && other.contains("$NODEID+0x181"));
        assert!(other.contains("NrOfTXPDO=3\n") && other.contains("FileName=starloop_tracker_oresat.eds\n"));
    }
}
