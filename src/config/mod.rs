//! TOML -> schema -> checked parameters; nothing after this room re-validates.
//!
//! Input: a bench file, which names a camera file and perhaps a link file. Output: [`Bench`] and
//! [`Camera`], in the units of their field names, with every default that was taken listed by
//! name ([`Defaulted`]).
//!
//! Each section has one file: the keys as serde reads them (all optional), the checked struct, and the rules between
//! them. Unknown keys are refused with file, line and the nearest known key; violated rules say file, line, key, wanted,
//! got, and what to try. Input paths are relative to the file that names them. The output directory of a sink is relative
//! to the working directory: a configuration may lie where nobody can write.
//!
//! The built-in bench and all it names are compiled in, so the binary runs from any directory.

mod bench;
mod budget;
mod camera;
mod check;
mod detector;
mod document;
mod error;
mod event;
mod expect;
mod flight_computer;
mod link;
mod link_keys;
mod observer;
mod optics;
mod psf;
mod radiometry;
mod scenario;
mod session;
mod setting;
mod spacecraft;
mod stages;
mod timing;

pub use bench::Bench;
pub use budget::Budget;
pub use camera::Camera;
pub use check::Defaulted;
pub use detector::Detector;
pub use document::{Document, PackedDocuments};
pub use error::ConfigError;
pub use event::{Action, Event, GyroFaultKind, Pointing};
pub use expect::Expect;
pub use flight_computer::{FlightComputer, JitterLineSettings, JitterSource, Slew};
pub use link::{Carrier, Doors, FlowControl, Link, Parity, SerialPort, Wire};
pub use observer::Observer;
pub use optics::{Distortion, Optics, Psf};
pub use radiometry::{Exposure, Radiometry};
pub use scenario::{Scenario, is_scenario};
pub use session::{Session, SessionStart};
pub use setting::Setting;
pub use spacecraft::{Control, Spacecraft};
pub use stages::{AttitudeSettings, Backend, Render, Sink};
pub use timing::{DeadlinePolicy, Degrade, StartTime, Timing};

#[cfg(test)]
mod setting_tests;
#[cfg(test)]
mod tests;
