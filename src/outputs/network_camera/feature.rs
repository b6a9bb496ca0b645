//! One feature of the camera: a row of the table in `features`.

use Access::{Both, Read, Write};
use base::bayer::BayerPattern;

/// Access of clients to a register.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Access {
    Read,
    Write,
    Both,
}

/// Cameras that have a feature.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Cameras {
    All,
    /// Those that clients command.
    Commanded,
    /// Those that only send the frames of the bench.
    ReadOnly,
}

/// Kind of a feature.
#[derive(Debug, Clone, Copy)]
pub(super) enum Kind {
    Category(&'static [&'static str]),
    Whole,
    Real,
    Switch,
    /// Clients write this number to it.
    Command(u32),
    Choice(Entries),
    /// A choice of one entry, which takes no register.
    Only(&'static str),
    /// A number that is always 0, which takes no register.
    Zero,
    /// One number less another one, with their letters in the formula.
    Difference([(&'static str, &'static str); 2]),
    /// Text; feature and register are one node.
    Text,
    /// A number that clients read; feature and register are one node.
    Reading,
    /// A register of double precision that only other features name.
    Number,
    /// Other nodes.
    Other(&'static str),
}

/// Values of a choice.
#[derive(Debug, Clone, Copy)]
pub(super) enum Entries {
    /// Numbered from 0.
    Words(&'static [&'static str]),
    Numbers(&'static [(&'static str, u32)]),
    /// Those of a sensor with these colours or none.
    Made(fn(Option<BayerPattern>) -> Vec<Entry>),
}

/// One value of a choice.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(super) struct Entry {
    pub(super) name: String,
    pub(super) value: u32,
    /// Name space; empty for none.
    pub(super) space: &'static str,
    /// The node that makes it available; empty for none.
    pub(super) available: &'static str,
}

/// An end of a range.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Limit {
    Nothing,
    At(u32),
    /// The number of another node.
    Of(&'static str),
    /// A number of this camera, which is put into the XML.
    Given(&'static str),
}

/// One feature; what it does not have is empty.
#[derive(Debug, Clone, Copy)]
pub(super) struct Feature {
    pub(super) name: &'static str,
    pub(super) about: &'static str,
    pub(super) kind: Kind,
    pub(super) cameras: Cameras,
    /// Address and bytes of its register; 0 bytes: it has none.
    pub(super) address: u32,
    pub(super) bytes: u32,
    pub(super) access: Access,
    /// First and last bit, counted from the highest, of a part of a word.
    pub(super) bits: Option<[u32; 2]>,
    pub(super) is_signed: bool,
    /// How clients may keep its value.
    pub(super) cached: &'static str,
    pub(super) space: &'static str,
    pub(super) visibility: &'static str,
    /// The node that locks it while it is not zero.
    pub(super) locked_by: &'static str,
    pub(super) range: [Limit; 2],
    pub(super) step: &'static str,
    pub(super) unit: &'static str,
    pub(super) form: &'static str,
    pub(super) selects: &'static [&'static str],
}

/// The node that is not zero while frames are acquired.
const LOCK: &str = "TLParamsLocked";

impl Feature {
    pub(super) fn is_of(&self, is_commanded: bool) -> bool {
        self.cameras == Cameras::All || (self.cameras == Cameras::Commanded) == is_commanded
    }

    /// Returns true if it must not change while frames are acquired.
    pub(super) fn is_locked_by_acquisition(&self) -> bool {
        self.locked_by == LOCK
    }

    const fn new(name: &'static str, about: &'static str, kind: Kind) -> Self {
        Self {
            name,
            about,
            kind,
            cameras: Cameras::All,
            address: 0,
            bytes: 0,
            access: Read,
            bits: None,
            is_signed: false,
            cached: "NoCache",
            space: "Standard",
            visibility: "",
            locked_by: "",
            range: [Limit::Nothing; 2],
            step: "",
            unit: "",
            form: "",
            selects: &[],
        }
    }

    const fn register(self, address: u32, bytes: u32, access: Access) -> Self {
        Self { address, bytes, access, ..self }
    }

    pub(super) const fn long(self) -> Self {
        Self { bytes: 8, ..self }
    }

    pub(super) const fn signed(self) -> Self {
        Self { is_signed: true, ..self }
    }

    pub(super) const fn bits(self, first: u32, last: u32) -> Self {
        Self { bits: Some([first, last]), ..self }
    }

    /// The value changes by itself.
    pub(super) const fn fresh(self) -> Self {
        Self { cached: "NoCache", ..self }
    }

    pub(super) const fn custom(self) -> Self {
        Self { space: "Custom", ..self }
    }

    pub(super) const fn seen_by(self, visibility: &'static str) -> Self {
        Self { visibility, ..self }
    }

    pub(super) const fn locked(self) -> Self {
        self.locked_by(LOCK)
    }

    pub(super) const fn locked_by(self, locked_by: &'static str) -> Self {
        Self { locked_by, ..self }
    }

    pub(super) const fn between(self, least: Limit, most: Limit) -> Self {
        Self { range: [least, most], ..self }
    }

    pub(super) const fn step(self, step: &'static str) -> Self {
        Self { step, ..self }
    }

    pub(super) const fn unit(self, unit: &'static str) -> Self {
        Self { unit, ..self }
    }

    pub(super) const fn form(self, form: &'static str) -> Self {
        Self { form, ..self }
    }

    pub(super) const fn selects(self, selects: &'static [&'static str]) -> Self {
        Self { selects, ..self }
    }

    pub(super) const fn commanded(self) -> Self {
        Self { cameras: Cameras::Commanded, ..self }
    }

    pub(super) const fn read_only(self) -> Self {
        Self { cameras: Cameras::ReadOnly, ..self }
    }
}

pub(super) const fn category(name: &'static str, features: &'static [&'static str]) -> Feature {
    Feature::new(name, "", Kind::Category(features))
}

pub(super) const fn whole(name: &'static str, about: &'static str, address: u32, access: Access) -> Feature {
    Feature::new(name, about, Kind::Whole).register(address, 4, access)
}

pub(super) const fn real(name: &'static str, about: &'static str, address: u32) -> Feature {
    Feature::new(name, about, Kind::Real).register(address, 8, Both)
}

pub(super) const fn switch(name: &'static str, about: &'static str, address: u32) -> Feature {
    Feature::new(name, about, Kind::Switch).register(address, 4, Both)
}

/// A switch that the camera alone sets.
pub(super) const fn flag(name: &'static str, about: &'static str, address: u32) -> Feature {
    Feature::new(name, about, Kind::Switch).register(address, 4, Read)
}

pub(super) const fn command(name: &'static str, about: &'static str, address: u32, value: u32) -> Feature {
    Feature::new(name, about, Kind::Command(value)).register(address, 4, Write)
}

pub(super) const fn choice(
    name: &'static str,
    about: &'static str,
    address: u32,
    access: Access,
    entries: Entries,
) -> Feature {
    Feature::new(name, about, Kind::Choice(entries)).register(address, 4, access)
}

pub(super) const fn text(name: &'static str, about: &'static str, address: u32, bytes: u32, access: Access) -> Feature {
    let cached = if matches!(access, Read) { "WriteThrough" } else { "NoCache" };
    Feature { cached, ..Feature::new(name, about, Kind::Text) }.register(address, bytes, access)
}

pub(super) const fn reading(name: &'static str, about: &'static str, address: u32) -> Feature {
    Feature { cached: "", ..Feature::new(name, about, Kind::Reading) }.register(address, 8, Read)
}

pub(super) const fn number(name: &'static str, address: u32) -> Feature {
    Feature { cached: "", ..Feature::new(name, "", Kind::Number) }.register(address, 8, Read)
}

pub(super) const fn only(name: &'static str, about: &'static str, entry: &'static str) -> Feature {
    Feature::new(name, about, Kind::Only(entry))
}

pub(super) const fn zero(name: &'static str, about: &'static str) -> Feature {
    Feature::new(name, about, Kind::Zero)
}

pub(super) const fn difference(
    name: &'static str,
    about: &'static str,
    parts: [(&'static str, &'static str); 2],
) -> Feature {
    Feature::new(name, about, Kind::Difference(parts))
}

pub(super) const fn other(nodes: &'static str) -> Feature {
    Feature::new("", "", Kind::Other(nodes))
}

impl Entry {
    pub(super) fn new(name: impl Into<String>, value: u32) -> Self {
        Self { name: name.into(), value, space: "Standard", available: "" }
    }
}

impl Entries {
    /// Returns the values, of a sensor with these colours or none.
    pub(super) fn list(&self, colours: Option<BayerPattern>) -> Vec<Entry> {
        match self {
            Self::Words(words) => numbered(words.iter().copied()),
            Self::Numbers(named) => named.iter().map(|(name, value)| Entry::new(*name, *value)).collect(),
            Self::Made(make) => make(colours),
        }
    }
}

/// Returns values numbered from 0.
pub(super) fn numbered<T: Into<String>>(names: impl Iterator<Item = T>) -> Vec<Entry> {
    (0..).zip(names).map(|(value, name)| Entry::new(name, value)).collect()
}
