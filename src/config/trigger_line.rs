//! `[[trigger_line]]`: GPIO lines of this machine whose edges start exposures.

use crate::key::{listed, section};
use crate::key_type::{Any, Whole, Word};
use crate::{camera::HEADS_MAX, check::Checker, error::Result};
use frames::camera_control::ExposureMode;
use link::gpio::{ActiveEdge, GpioLine, LineBias, LineName};
use std::{path::PathBuf, time::Duration};

/// Where chips are that are given by name.
const DEVICES: &str = "/dev";

/// A line that triggers heads, checked.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct TriggerLine {
    /// Device of its chip, or a named pipe.
    pub chip: PathBuf,
    /// The line, and how it is listened to.
    pub line: GpioLine,
    /// Number of the head that it triggers; `None`: all of them.
    pub head: Option<usize>,
    /// Exposures wait for triggers from the start.
    pub is_armed: bool,
    /// How the length of an exposure is determined.
    pub mode: ExposureMode,
}

section! {
    /// A GPIO line of this machine whose edges start exposures, on the real clock.
    TriggerLineKeys at "trigger_line" {
        /// GPIO chip: a device, such as "gpiochip0", or a named pipe that brings events of the kernel's form.
        chip: String = Needed, "name or path such as \"gpiochip0\"";
        /// Number of the line on its chip, from 0; give this or line_name.
        line: Whole = Optional, 0..=65_535;
        /// Name of the line, as `gpioinfo` shows it.
        line_name: String = Optional, "name such as \"CAMERA_TRIGGER\"";
        /// Edge with which the line becomes active and an exposure starts.
        edge: Word<ActiveEdge> = "rising", [("rising", ActiveEdge::Rising), ("falling", ActiveEdge::Falling)];
        /// Resistor on the chip's line; as_is leaves it unchanged.
        bias: Word<LineBias> = "as_is", [
            ("as_is", LineBias::AsIs), ("off", LineBias::Off), ("pull_up", LineBias::PullUp), ("pull_down", LineBias::PullDown),
        ];
        /// Microseconds that a level must last to count; the trigger is as much later. 0 for none.
        debounce_us: Whole = 0, 0..=1_000_000;
        /// Number of the camera head that it triggers, from 0; left out, all of them.
        head: Whole<usize> = Optional, 0..=HEADS_MAX as i64 - 1;
        /// Exposures of its heads wait for triggers from the start; false: only after a command.
        armed: bool = true, Any;
        /// How long an exposure lasts: its own time, or as long as the line is active.
        exposure: Word<ExposureMode> = "timed",
            [("timed", ExposureMode::Timed), ("trigger_width", ExposureMode::TriggerWidth)];
    }
}

/// Returns the lines of a bench. Whether the heads that they name are there shows when the run is put together.
pub(super) fn check_trigger_lines(keys: &[TriggerLineKeys], check: &mut Checker<'_>) -> Result<Vec<TriggerLine>> {
    let mut made: Vec<TriggerLine> = Vec::with_capacity(keys.len());
    for keys in listed(keys, "trigger_line") {
        let line = keys.trigger_line(check)?;
        if made.iter().any(|other| (&other.chip, &other.line.name) == (&line.chip, &line.line.name)) {
            let wanted = "a line that no other [[trigger_line]] has";
            return Err(keys.chip().advised("leave head out where a line triggers all heads").invalid(
                line.chip.display(),
                wanted,
                check,
            ));
        }
        made.push(line);
    }
    Ok(made)
}

impl TriggerLineKeys {
    fn trigger_line(&self, check: &mut Checker<'_>) -> Result<TriggerLine> {
        let chip = self.chip().check(check)?;
        let name = match (self.line().optional(check)?, self.line_name().raw()) {
            (Some(offset), None) => LineName::Offset(offset),
            (None, Some(name)) => LineName::Name(name.clone()),
            (None, None) => return Err(self.line().missing("the number of a line, or line_name", check)),
            (Some(_), Some(name)) => return Err(self.line_name().invalid(name, "no line beside it", check)),
        };
        Ok(TriggerLine {
            chip: if chip.contains('/') { PathBuf::from(chip) } else { PathBuf::from(DEVICES).join(chip) },
            line: GpioLine {
                name,
                active: self.edge().check(check)?,
                bias: self.bias().check(check)?,
                debounce: Duration::from_micros(u64::from(self.debounce_us().check(check)?)),
            },
            head: self.head().optional(check)?,
            is_armed: self.armed().check(check)?,
            mode: self.exposure().check(check)?,
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{Bench, Document};
    use std::path::Path;

    fn lines(text: &str) -> Result<Vec<TriggerLine>, String> {
        let document = Document::from_text(text, Path::new("lab/bench.toml"));
        Bench::from_document(&document).map(|bench| bench.trigger_lines).map_err(|error| error.to_string())
    }

    #[test]
    fn a_line_is_as_the_bench_file_says() {
        let got = lines("[[trigger_line]]\nchip = \"gpiochip1\"\nline = 17").unwrap();
        let line = GpioLine {
            name: LineName::Offset(17),
            active: ActiveEdge::Rising,
            bias: LineBias::AsIs,
            debounce: Duration::ZERO,
        };
        let chip = PathBuf::from("/dev/gpiochip1");
        let plain = TriggerLine { chip, line, head: None, is_armed: true, mode: ExposureMode::Timed };
        assert_eq!(got, [plain]);
        let got = lines(
            "[[trigger_line]]\nchip = \"/run/pulses\"\nline_name = \"TRIG\"\nedge = \"falling\"\nbias = \"pull_up\"\n\
             debounce_us = 50\nhead = 0\narmed = false\nexposure = \"trigger_width\"",
        );
        let line = GpioLine {
            name: LineName::Name("TRIG".into()),
            active: ActiveEdge::Falling,
            bias: LineBias::PullUp,
            debounce: Duration::from_micros(50),
        };
        let (chip, mode) = (PathBuf::from("/run/pulses"), ExposureMode::TriggerWidth);
        assert_eq!(got.unwrap(), [TriggerLine { chip, line, head: Some(0), is_armed: false, mode }]);
        assert_eq!(lines("").unwrap(), []);
    }

    #[test]
    fn each_rule_has_a_failing_example() {
        let two =
            "[[trigger_line]]\nchip = \"gpiochip0\"\nline = 1\n[[trigger_line]]\nchip = \"/dev/gpiochip0\"\nline = 1";
        for (text, parts) in [
            ("[[trigger_line]]\nline = 1", ["trigger_line[0].chip", "gpiochip0"]),
            ("[[trigger_line]]\nchip = \"gpiochip0\"", ["trigger_line[0].line", "line_name"]),
            ("[[trigger_line]]\nchip = \"a\"\nline = 1\nline_name = \"b\"", ["trigger_line[0].line_name", "no line"]),
            ("[[trigger_line]]\nchip = \"a\"\nline = 1\nhead = 8", ["trigger_line[0].head", "0 to 7"]),
            ("[[trigger_line]]\nchip = \"a\"\nline = 1\nedge = \"both\"", ["trigger_line[0].edge", "\"falling\""]),
            ("[[trigger_line]]\nchip = \"a\"\nline = 1\ndebounce_us = -1", ["trigger_line[0].debounce_us", "0 to"]),
            (two, ["trigger_line[1].chip", "no other"]),
        ] {
            let error = lines(text).expect_err(text);
            assert!(parts.iter().all(|part| error.contains(part)), "{text}: {error}");
        }
    }
}
