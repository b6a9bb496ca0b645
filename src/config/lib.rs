//! TOML -> schema -> checked parameters; nothing after this crate validates again.
//!
//! Input: a bench file, which names a camera file and perhaps a link file. Output: [`Bench`] and
//! [`Camera`], in the units of their field names, with every default that was taken listed by
//! name ([`Defaulted`]).
//!
//! Each section has one file: the declarations of its keys (`key`), the checked struct, and the rules between them.
//! Reference, JSON Schema and templates come from the declarations (`declared`). Unknown keys are refused with file,
//! line and the nearest known key (`unknown_keys`); violated rules say file, line, key, wanted, got, and what to try.
//! Input paths are relative to the file that names them. The output directory of a sink is relative to the working
//! directory: a configuration may be in a folder without write access.
//!
//! The built-in bench and all it names are compiled in, so the binary runs from any directory.

mod background;
mod band;
mod bench;
mod budget;
mod camera;
mod check;
mod declared;
mod detector;
mod detector_effects;
mod display;
mod document;
mod unknown_keys;
mod error;
mod event;
mod event_places;
mod event_reader;
mod event_word;
mod expect;
mod file_kind;
mod flight_computer;
mod jitter;
mod named_files;
mod key;
mod plan_key_check;
mod key_type;
mod link;
mod motion;
mod mtf;
mod network_camera;
mod observer;
mod optics;
mod packed;
mod plain_link;
mod plant;
mod psf;
mod radiometry;
mod reference;
mod scenario;
mod setting;
mod several;
mod sink;
mod spacecraft;
mod stages;
mod substitute;
mod target;
mod target_orbit;
mod test_plan_keys;
mod timing;
mod tracker_in;
mod tracker_out;
mod tracker_protocol;
mod trigger_line;

pub use ::link::gateway::GatewayParams;
pub use background::{Background, Baffle, Sky};
pub use bench::{Bench, STAR_MEMORY_MB};
pub use budget::Budget;
pub use camera::{Camera, Head, is_camera};
pub use check::Defaulted;
pub use detector::Detector;
pub use display::DisplaySettings;
pub use document::Document;
pub use error::{ConfigError, nearest};
pub use event::{Action, Event, Pointing};
pub use event_word::link_flag;
pub use expect::{Expect, ExpectFrames};
pub use file_kind::FileKind;
pub use flight_computer::{FlightComputer, JitterSource, RIGHT_ASCENSION_DEG, Slew};
pub use jitter::{JitterAxes, JitterFile, JitterInput};
pub use link::{Carrier, Link, SessionParams, SessionStart};
pub use motion::Motion;
pub use mtf::{Chain, LightOfChain};
pub use observer::{Observer, OrbitSettings, OrbitStart};
pub use optics::{Distortion, Optics};
pub use packed::PackedDocuments;
pub use plain_link::Plain;
pub use plan_key_check::check_keys;
pub use plant::{Begins, FilePlant, Plant, TrackerCommands, Vehicle};
pub use psf::Psf;
pub use radiometry::{Exposure, Radiometry, RadiometryModel};
pub use reference::{key_reference, key_schema, key_search, key_template};
pub use scenario::{OutsideTrackers, Scenario, is_scenario};
pub use setting::Setting;
pub use sink::{Sink, SinkMemory, SinkSettings};
pub use spacecraft::{Control, Spacecraft};
pub use stages::{AttitudeSettings, Backend, Render};
pub use target::{Overlap, TargetCourse, TargetLight, TargetSettings};
pub use timing::{DeadlinePolicy, Degrade, StartTime, Timing};
pub use tracker_in::{AnswerLine, TrackerIn};
pub use tracker_out::{TrackerLine, TrackerOut, TrackerOutFault, TrackerOutFaultKind, TrackerSource};
pub use tracker_protocol::{TrackerPdos, TrackerProtocol};
pub use trigger_line::TriggerLine;

#[cfg(test)]
mod declared_tests;
#[cfg(test)]
mod detector_tests;
#[cfg(test)]
mod light_tests;
#[cfg(test)]
mod name_tests;
#[cfg(test)]
mod setting_tests;
#[cfg(test)]
mod tests;
