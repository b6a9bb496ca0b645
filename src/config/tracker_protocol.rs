//! Protocols of star trackers, as `[[tracker_out]]` and `[[tracker_in]]` name them.

/// Protocol of a tracker.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum TrackerProtocol {
    /// Plain JSON.
    Json,
    /// The generic star tracker of NOS3.
    Nos3,
    /// Sagitta, as C2A has it.
    Sagitta,
    /// CANopen.
    CanOpen {
        /// Node number.
        node: u8,
        /// Time between heartbeats, ms.
        heartbeat_ms: u16,
        /// It is operational without being started.
        starts_operational: bool,
        /// Map of its transmit PDOs.
        pdos: TrackerPdos,
    },
    /// CCSDS space packets with PUS services.
    Ccsds {
        /// Application process.
        apid: u16,
    },
}

/// Map of the transmit PDOs of a CANopen node.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum TrackerPdos {
    /// This program's own.
    Starloop,
    /// That of OreSat's star tracker.
    OreSat,
}

/// Every map by its word in files.
pub(super) const PDO_MAPS: [(&str, TrackerPdos); 2] =
    [("starloop", TrackerPdos::Starloop), ("oresat", TrackerPdos::OreSat)];

/// Every protocol by its word in files and messages, with the values that its own keys have when they are left out.
pub(super) const PROTOCOLS: [(&str, TrackerProtocol); 5] = [
    ("json", TrackerProtocol::Json),
    ("nos3", TrackerProtocol::Nos3),
    ("sagitta", TrackerProtocol::Sagitta),
    (
        "canopen",
        TrackerProtocol::CanOpen {
            node: 96,
            heartbeat_ms: 1000,
            starts_operational: false,
            pdos: TrackerPdos::Starloop,
        },
    ),
    ("ccsds", TrackerProtocol::Ccsds { apid: 100 }),
];

impl TrackerProtocol {
    /// Its word in files and messages.
    pub fn name(&self) -> &'static str {
        let is_same = |known: &TrackerProtocol| core::mem::discriminant(known) == core::mem::discriminant(self);
        PROTOCOLS.iter().find(|(_, known)| is_same(known)).map_or("", |(name, _)| name)
    }
}
