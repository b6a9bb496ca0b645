//! Builds nodes of the XML: a feature with the register behind it, in the order of elements that the schema wants.

use core::fmt::{Result, Write};

/// Access of clients to a register.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Access {
    Read,
    Write,
    Both,
}

impl Access {
    const fn word(self) -> &'static str {
        match self {
            Self::Read => "RO",
            Self::Write => "WO",
            Self::Both => "RW",
        }
    }
}

/// One entry of an enumeration.
#[derive(Debug, Clone, Copy)]
pub(super) struct Entry<'a> {
    pub(super) name: &'a str,
    pub(super) value: u32,
    pub(super) is_standard: bool,
}

impl<'a> Entry<'a> {
    /// Returns an entry that the naming convention has.
    pub(super) const fn standard(name: &'a str, value: u32) -> Self {
        Self { name, value, is_standard: true }
    }
}

/// A feature: its name, its meaning, and the features that it selects, or that lock it.
#[derive(Debug, Clone, Copy)]
pub(super) struct Feature<'a> {
    pub(super) name: &'a str,
    pub(super) about: &'a str,
    /// The node that locks it while it is not zero; empty for none.
    pub(super) locked_by: &'a str,
    pub(super) selects: &'a [&'a str],
}

impl<'a> Feature<'a> {
    pub(super) const fn new(name: &'a str, about: &'a str) -> Self {
        Self { name, about, locked_by: "", selects: &[] }
    }

    pub(super) const fn locked_by(self, locked_by: &'a str) -> Self {
        Self { locked_by, ..self }
    }

    pub(super) const fn selects(self, selects: &'a [&'a str]) -> Self {
        Self { selects, ..self }
    }
}

/// Nodes as text. Writing to a text does not fail.
#[derive(Debug, Default)]
pub(super) struct Nodes {
    pub(super) text: String,
}

impl Nodes {
    fn put(&mut self, write: impl FnOnce(&mut String) -> Result) {
        let _ = write(&mut self.text); // writing to a string cannot fail
    }

    fn begin(&mut self, node: &str, feature: &Feature<'_>) {
        self.put(|text| {
            writeln!(text, "<{node} Name=\"{}\" NameSpace=\"Standard\">", feature.name)?;
            writeln!(text, "  <ToolTip>{}</ToolTip>", feature.about)?;
            if feature.locked_by.is_empty() {
                return Ok(());
            }
            writeln!(text, "  <pIsLocked>{}</pIsLocked>", feature.locked_by)
        });
    }

    fn end(&mut self, node: &str, feature: &Feature<'_>) {
        self.put(|text| {
            feature.selects.iter().try_for_each(|name| writeln!(text, "  <pSelected>{name}</pSelected>"))?;
            writeln!(text, "</{node}>")
        });
    }

    /// Adds a group of features.
    pub(super) fn category(&mut self, name: &str, features: &[String]) {
        self.put(|text| {
            writeln!(text, "<Category Name=\"{name}\" NameSpace=\"Standard\">")?;
            features.iter().try_for_each(|feature| writeln!(text, "  <pFeature>{feature}</pFeature>"))?;
            writeln!(text, "</Category>")
        });
    }

    /// Adds a register of a whole number, behind a feature of this name.
    fn register(&mut self, name: &str, address: u32, bytes: u32, access: Access, is_signed: bool) {
        let sign = if is_signed { "Signed" } else { "Unsigned" };
        self.put(|text| {
            writeln!(text, "<IntReg Name=\"{name}Reg\">\n  <Address>0x{address:X}</Address>")?;
            writeln!(text, "  <Length>{bytes}</Length>\n  <AccessMode>{}</AccessMode>", access.word())?;
            writeln!(text, "  <pPort>Device</pPort>\n  <Cachable>NoCache</Cachable>")?;
            writeln!(text, "  <Sign>{sign}</Sign>\n  <Endianess>BigEndian</Endianess>\n</IntReg>")
        });
    }

    /// Adds an enumeration in a word of memory; without an address it always has its first entry.
    pub(super) fn enumeration(
        &mut self,
        feature: &Feature<'_>,
        address: Option<u32>,
        access: Access,
        entries: &[Entry<'_>],
    ) {
        self.begin("Enumeration", feature);
        self.put(|text| write_entries(text, entries));
        self.put(|text| match address {
            Some(_) => writeln!(text, "  <pValue>{}Reg</pValue>", feature.name),
            None => writeln!(text, "  <Value>{}</Value>", entries.first().map_or(0, |entry| entry.value)),
        });
        self.end("Enumeration", feature);
        if let Some(address) = address {
            self.register(feature.name, address, 4, access, false);
        }
    }

    /// Adds a command: a word of memory to which clients write a one.
    pub(super) fn command(&mut self, feature: &Feature<'_>, address: u32) {
        self.begin("Command", feature);
        self.put(|text| writeln!(text, "  <pValue>{}Reg</pValue>\n  <CommandValue>1</CommandValue>", feature.name));
        self.end("Command", feature);
        self.register(feature.name, address, 4, Access::Write, false);
    }

    /// Adds a switch in a word of memory.
    pub(super) fn boolean(&mut self, feature: &Feature<'_>, address: u32) {
        self.begin("Boolean", feature);
        self.put(|text| {
            writeln!(text, "  <pValue>{}Reg</pValue>", feature.name)?;
            writeln!(text, "  <OnValue>1</OnValue>\n  <OffValue>0</OffValue>")
        });
        self.end("Boolean", feature);
        self.register(feature.name, address, 4, Access::Both, false);
    }

    /// Adds a whole number of 8 bytes that clients read. `representation` may be empty.
    pub(super) fn long(
        &mut self,
        feature: &Feature<'_>,
        address: u32,
        (unit, representation, is_signed): (&str, &str, bool),
    ) {
        self.begin("Integer", feature);
        self.put(|text| {
            writeln!(text, "  <pValue>{}Reg</pValue>", feature.name)?;
            if !unit.is_empty() {
                writeln!(text, "  <Unit>{unit}</Unit>")?;
            }
            if representation.is_empty() {
                return Ok(());
            }
            writeln!(text, "  <Representation>{representation}</Representation>")
        });
        self.end("Integer", feature);
        self.register(feature.name, address, 8, Access::Read, is_signed);
    }

    /// Adds a number of double precision that clients read.
    pub(super) fn float(&mut self, feature: &Feature<'_>, address: u32, unit: &str) {
        self.begin("FloatReg", feature);
        self.put(|text| {
            writeln!(text, "  <Address>0x{address:X}</Address>\n  <Length>8</Length>\n  <AccessMode>RO</AccessMode>")?;
            writeln!(text, "  <pPort>Device</pPort>\n  <Cachable>NoCache</Cachable>")?;
            writeln!(text, "  <Endianess>BigEndian</Endianess>\n  <Unit>{unit}</Unit>")
        });
        self.end("FloatReg", feature);
    }

    /// Adds any other nodes.
    pub(super) fn raw(&mut self, nodes: &str) {
        self.text.push_str(nodes);
    }
}

/// Entries of an enumeration.
pub(super) fn write_entries(text: &mut String, entries: &[Entry<'_>]) -> Result {
    for Entry { name, value, is_standard } in entries {
        let space = if *is_standard { "Standard" } else { "Custom" };
        writeln!(
            text,
            "  <EnumEntry Name=\"{name}\" NameSpace=\"{space}\">\n    <Value>{value}</Value>\n  </EnumEntry>"
        )?;
    }
    Ok(())
}
