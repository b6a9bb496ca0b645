//! Faults of single images, written as the keys of an `[[event]]`.

use base::time::Span;
use config::{Action, ConfigError, Event};
use frames::sink::FrameFault;
use serde_json::{Map, Value};

/// A fault that a single image cannot have.
#[derive(Debug, thiserror::Error)]
pub enum StillFaultError {
    /// The keys are not those of an event.
    #[error(transparent)]
    Keys(#[from] ConfigError),
    /// It is not written as keys of a table.
    #[error("a fault: {0}; wanted keys of an event, such as do = \"stray_light\", e_per_s = 200")]
    Form(String),
    /// It does not change an image.
    #[error(
        "a fault: got do = \"{0}\", wanted one that changes a single image: frame_drop, frame_late, frame_duplicate and frame_torn need a run, faults \
         of the bus and of the spacecraft do too"
    )]
    NotOfAnImage(&'static str),
}

/// Returns the fault that the keys of an event describe, separated by commas: `do = "stray_light", e_per_s = 200`.
///
/// # Errors
/// When the keys are not those of a fault of frames that changes a single image.
pub fn still_fault(keys: &str) -> Result<FrameFault, StillFaultError> {
    #[derive(serde::Deserialize)]
    struct Line {
        fault: Map<String, Value>,
    }
    let line: Line = toml::from_str(&format!("fault = {{ {keys} }}"))
        .map_err(|error| StillFaultError::Form(error.message().into()))?;
    still_fault_of(line.fault)
}

/// Returns the fault that the keys of an event describe.
///
/// # Errors
/// As [`still_fault`].
pub fn still_fault_of(mut keys: Map<String, Value>) -> Result<FrameFault, StillFaultError> {
    // It lasts as long as the image does.
    keys.entry("for_s").or_insert_with(|| Value::from(1.0));
    let event = Event::from_json(&keys, 0.0, Span::from_s(1.0))?;
    match event.action {
        Action::Frame { fault, .. } if !matches!(fault, FrameFault::Sending(_)) => Ok(fault),
        Action::Frame { .. }
        | Action::Slew(_)
        | Action::Safe
        | Action::Resume
        | Action::Bus(_)
        | Action::BusBackLoss { .. }
        | Action::Aboard(_)
        | Action::Trigger { .. } => Err(StillFaultError::NotOfAnImage(event.action.word())),
    }
}

/// Returns whether a fault changes the detector or the optics for all images after it, until it is taken back.
pub fn stays(fault: &FrameFault) -> bool {
    matches!(fault, FrameFault::Camera(_))
}

#[cfg(test)]
mod tests {
    use super::*;
    use frames::sink::ImageFault;

    #[test]
    fn keys_of_an_event_become_a_fault() {
        let fault = still_fault("do = \"stray_light\", e_per_s = 200").unwrap();
        assert_eq!(fault, FrameFault::Image(ImageFault::StrayLight { e_per_s: 200.0 }));
    }

    #[test]
    fn faults_of_other_places_are_refused_with_advice() {
        let wrong = |text: &str| still_fault(text).unwrap_err().to_string();
        assert!(wrong("do = \"frame_torn\"").contains("need a run"));
        assert!(wrong("do = \"gyro_dropout\"").contains("need a run"));
        assert!(wrong("do = ").contains("wanted keys of an event"));
        assert!(wrong("do = \"stray_light\"").contains("e_per_s"));
    }
}
