//! The names of events: the word of an action, and the flag that frames have because of it.
//!
//! Files, reports and [`ActiveFault`](frames::sink::ActiveFault) have the word of `[[event]]`. [`FaultFlags`] has a name
//! of its own for each bit, because several words may share a bit. The test has a table of both.

use crate::event::{Action, GyroFaultKind};
use frames::sink::FaultFlags;
use link::tap::LinkFault;

impl Action {
    /// Returns its word for `do` in `[[event]]`, which events and reports name it by.
    #[must_use]
    pub fn word(&self) -> &'static str {
        match self {
            Action::Slew(_) => "slew",
            Action::Safe => "safe",
            Action::Resume => "resume",
            Action::Bus(LinkFault::Loss { .. }) => "bus_loss",
            Action::Bus(LinkFault::Silence) => "bus_silence",
            Action::Bus(LinkFault::Delay { .. }) => "bus_delay",
            Action::Bus(LinkFault::Duplicate { .. }) => "bus_duplicate",
            Action::Bus(LinkFault::WrongBits { .. }) => "bus_wrong_bits",
            Action::Bus(LinkFault::Reorder { .. }) => "bus_reorder",
            Action::Bus(LinkFault::Truncate { .. }) => "bus_truncate",
            Action::Bus(LinkFault::Babble { .. }) => "bus_babble",
            Action::Bus(LinkFault::Off) => "bus_off",
            Action::Bus(LinkFault::ClockStep { .. }) => "clock_step",
            Action::Bus(LinkFault::ClockDrift { .. }) => "clock_drift",
            Action::BusBack(_) => "bus_back_loss",
            Action::Frame { fault, .. } => fault.name(),
            Action::Gyro(GyroFaultKind::Dropout) => "gyro_dropout",
            Action::Gyro(GyroFaultKind::Stuck) => "gyro_stuck",
            Action::Gyro(GyroFaultKind::BiasJump(_)) => "gyro_bias_jump",
            Action::Gyro(GyroFaultKind::Spike(_)) => "gyro_spike",
            Action::WheelFailure { .. } => "wheel_failure",
            Action::TrackerOff { .. } => "tracker_off",
            Action::Trigger { .. } => "trigger",
        }
    }
}

/// Returns the flag of frames that are exposed while the bus towards the stimulator has this fault.
#[must_use]
pub fn link_flag(fault: &LinkFault) -> FaultFlags {
    match fault {
        LinkFault::Loss { .. } => FaultFlags::LINK_DROP,
        LinkFault::Silence => FaultFlags::LINK_STALE,
        LinkFault::Delay { .. } => FaultFlags::LINK_DELAY,
        LinkFault::Duplicate { .. } => FaultFlags::LINK_DUPLICATE,
        LinkFault::WrongBits { .. } | LinkFault::Truncate { .. } => FaultFlags::LINK_CORRUPT,
        LinkFault::Reorder { .. } => FaultFlags::LINK_REORDER,
        LinkFault::Babble { .. } => FaultFlags::LINK_BABBLE,
        LinkFault::Off => FaultFlags::LINK_OFF,
        LinkFault::ClockStep { .. } => FaultFlags::CLOCK_STEP,
        LinkFault::ClockDrift { .. } => FaultFlags::CLOCK_DRIFT,
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::event::tests::given_in_full;
    use crate::event_word::ACTIONS;

    /// Words whose flag has another name, each with the reason. Flags are in telemetry and files: their names stay.
    const FLAGS: [(&str, &str, &str); 15] = [
        ("bus_loss", "link_drop", "flags of the bus are named after the link that the stimulator sees"),
        ("bus_silence", "link_stale", "the stimulator sees an attitude that grows old"),
        ("bus_delay", "link_delay", "flags of the bus are named after the link"),
        ("bus_duplicate", "link_duplicate", "flags of the bus are named after the link"),
        ("bus_wrong_bits", "link_corrupt", "shares a bit with bus_truncate: both spoil the content of packets"),
        ("bus_reorder", "link_reorder", "flags of the bus are named after the link"),
        ("bus_truncate", "link_corrupt", "shares a bit with bus_wrong_bits"),
        ("bus_babble", "link_babble", "flags of the bus are named after the link"),
        ("bus_off", "link_off", "flags of the bus are named after the link"),
        ("frame_blank", "blank", "shares a bit with frames that are blank because no attitude is known"),
        ("stray_light_ramp", "stray_light", "shares a bit with stray_light: a ramp is stray light that changes"),
        ("defocus_step", "defocus", "the flag names the state, the word the change"),
        ("temperature_step", "temperature", "the flag names the state, the word the change"),
        ("missing_bright_stars", "missing_stars", "shares a bit with missing_stars: both leave stars out"),
        ("proton_storm", "proton_tracks", "the flag names what is in the image, the word its cause"),
    ];

    /// Words that leave no flag: commands, and faults of what is not the frames or the link that feeds them.
    const UNFLAGGED: [&str; 11] = [
        "slew",
        "safe",
        "resume",
        "bus_back_loss",
        "gyro_dropout",
        "gyro_stuck",
        "gyro_bias_jump",
        "gyro_spike",
        "wheel_failure",
        "tracker_off",
        "trigger",
    ];

    fn flag(action: &Action) -> Option<FaultFlags> {
        match action {
            Action::Bus(fault) => Some(link_flag(fault)),
            Action::Frame { fault, .. } => Some(fault.flag()),
            Action::Slew(_)
            | Action::Safe
            | Action::Resume
            | Action::BusBack(_)
            | Action::Gyro(_)
            | Action::WheelFailure { .. }
            | Action::TrackerOff { .. }
            | Action::Trigger { .. } => None,
        }
    }

    #[test]
    fn each_word_reads_as_an_action_that_is_named_by_the_same_word() {
        for (word, kind) in ACTIONS {
            assert_eq!(given_in_full(word, kind).action.word(), word);
        }
    }

    #[test]
    fn flag_has_the_name_of_its_word_or_the_one_in_the_table() {
        for (word, kind) in ACTIONS {
            let flags: Vec<_> =
                flag(&given_in_full(word, kind).action).into_iter().flat_map(FaultFlags::names).collect();
            let in_table = FLAGS.iter().find(|(other, ..)| *other == word).map(|(_, flag, _)| *flag);
            let wanted = if UNFLAGGED.contains(&word) { None } else { Some(in_table.unwrap_or(word)) };
            assert_eq!(flags, Vec::from_iter(wanted), "{word}");
        }
        assert!(FLAGS.iter().all(|(word, flag, why)| word != flag && !why.is_empty()), "rows that say nothing");
    }
}
