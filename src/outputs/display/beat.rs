//! Shutter against refresh: how much light an exposure collects from a display that flashes, and whether it beats.
//!
//! Input: exposure, frame period, refresh rate, the share of each refresh during which the display shines. Output:
//! light of an exposure over its phase, in refreshes; its spread in percent and magnitudes; the beat's period; advice.
//! Model: light is on for `duty` of each refresh period P, the same in all. An exposure E = (n + r) P, 0 <= r < 1,
//! collects n duty + (overlap of a window r with a pulse duty), so between n duty + max(0, r + duty - 1) and n duty +
//! min(r, duty). With duty 0 it collects n or n + 1 flashes. With duty 1 (light is held) a still picture does not beat,
//! but dithering and motion still have whole refreshes as their steps. The phase moves by the fraction of frame period
//! over P in every frame, so it repeats with the period of the nearest whole number; two clocks that are equal by name
//! drift apart by their tolerance. Limits: the scan from the first row to the last and a rolling shutter shift the
//! phase row by row, they do not change the spread. Tests below, against counted flashes.

use core::f64::consts::LN_10;

/// Spread that cannot be detected: it is below the errors of magnitudes that the detector makes anyway, mag.
const UNSEEN_MAG: f64 = 0.005;
/// An exposure within this share of a refresh of a whole number of them counts as whole.
const WHOLE: f64 = 1e-6;

/// The periods that beat against each other.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct BeatInput {
    /// Exposure of the tracker, seconds.
    pub exposure_s: f64,
    /// From one exposure's start to the next, seconds.
    pub frame_period_s: f64,
    /// Refreshes per second.
    pub refresh_hz: f64,
    /// Share of a refresh during which the display shines: 1 holds its light, 0 is a flash (the worst).
    pub duty: f64,
    /// By how much the ratio of the two clocks may be off, parts per million.
    pub drift_ppm: f64,
}

/// The light that an exposure collects.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Beat {
    /// Refreshes in one exposure.
    pub refreshes: f64,
    /// Least and most light over the phase, in the light of one refresh.
    pub light: [f64; 2],
    /// Spread from least to most over the mean, percent.
    pub ripple_percent: f64,
    /// Spread from least to most, magnitudes; infinite when an exposure may see nothing.
    pub ripple_mag: f64,
    /// From brightest to brightest, seconds; infinite when each frame begins at the same phase.
    pub period_s: f64,
    /// Exposures nearest to the one given that are whole numbers of refreshes, seconds: shorter (if there is one),
    /// longer.
    pub whole_exposures_s: [Option<f64>; 2],
}

/// A number that cannot be.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[error("shutter against refresh: {name} wanted {wanted}, got {got}")]
pub struct BeatError {
    name: &'static str,
    wanted: &'static str,
    got: f64,
}

impl BeatInput {
    /// Returns the light over phase, with advice.
    ///
    /// # Errors
    /// When a number is out of range.
    pub fn beat(&self) -> Result<Beat, BeatError> {
        self.check()?;
        let refreshes = self.exposure_s * self.refresh_hz;
        let nearest = refreshes.round();
        let is_whole = (refreshes - nearest).abs() <= WHOLE && nearest > 0.0;
        let whole = if is_whole { nearest } else { refreshes.floor() };
        let rest = if is_whole { 0.0 } else { refreshes - whole };
        let light = match self.duty {
            // A flash has no duration: its light is one whatever that is.
            0.0 => [whole, whole + f64::from(u8::from(rest > 0.0))],
            duty => [whole + (rest + duty - 1.0).max(0.0) / duty, whole + rest.min(duty) / duty],
        };
        let exposure_of = |n: f64| (n > 0.0).then(|| n / self.refresh_hz);
        Ok(Beat {
            refreshes,
            light,
            ripple_percent: 100.0 * (light[1] - light[0]) / refreshes,
            ripple_mag: 2.5 / LN_10 * (light[1] / light[0]).ln(),
            period_s: self.period_s(),
            whole_exposures_s: [exposure_of(whole), exposure_of(if is_whole { whole } else { whole + 1.0 })],
        })
    }

    fn check(&self) -> Result<(), BeatError> {
        let positive = |name, got: f64| {
            let good = got > 0.0 && got.is_finite();
            if good { Ok(()) } else { Err(BeatError { name, wanted: "more than 0", got }) }
        };
        positive("exposure_s", self.exposure_s)?;
        positive("frame_period_s", self.frame_period_s)?;
        positive("refresh_hz", self.refresh_hz)?;
        let within = |name, wanted, got: f64, most: f64| {
            if (0.0..=most).contains(&got) { Ok(()) } else { Err(BeatError { name, wanted, got }) }
        };
        within("duty", "0 to 1", self.duty, 1.0)?;
        within("drift_ppm", "0 to 1e5", self.drift_ppm, 1e5)
    }

    /// Returns the time in which the phase of a frame's start passes through one refresh.
    fn period_s(&self) -> f64 {
        let periods = self.frame_period_s * self.refresh_hz;
        let off = (periods - periods.round()).abs().max(periods * self.drift_ppm * 1e-6);
        if off <= WHOLE * 1e-3 { f64::INFINITY } else { self.frame_period_s / off }
    }
}

impl Beat {
    /// Returns true if frames of the same scene differ by a detectable amount.
    pub fn is_seen(&self) -> bool {
        self.ripple_mag > UNSEEN_MAG
    }

    /// Returns one or two sentences, for `check`.
    pub fn advice(&self) -> String {
        if !self.is_seen() {
            return format!("an exposure holds {:.3} refreshes; no beat above {UNSEEN_MAG} mag", self.refreshes);
        }
        let [least, most] = self.light;
        let period = if self.period_s.is_finite() {
            format!("returning every {:.3} s", self.period_s)
        } else {
            "fixed, but unknown until it is measured, as each frame begins at the same phase".to_owned()
        };
        let choices: Vec<String> =
            self.whole_exposures_s.iter().flatten().map(|s| format!("{:.6} ms", s * 1e3)).collect();
        format!(
            "an exposure holds {:.3} refreshes and collects the light of {least:.3} to {most:.3} of them: {:.2} % \
             ({:.3} mag) from least to most, {period}. Whole numbers of refreshes do not beat: {}; or trigger the \
             tracker by the display",
            self.refreshes,
            self.ripple_percent,
            self.ripple_mag,
            choices.join(" or ")
        )
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn input(exposure_s: f64, duty: f64) -> BeatInput {
        BeatInput { exposure_s, frame_period_s: 0.1, refresh_hz: 60.0, duty, drift_ppm: 0.0 }
    }

    /// Returns the light by adding up thin slices of time, phase by phase.
    fn counted(input: &BeatInput) -> [f64; 2] {
        const SLICES: u32 = 6000;
        let per_refresh = 1000.0;
        let at = |phase: u32| {
            let slices = (input.exposure_s * input.refresh_hz * per_refresh).round();
            let lit = (0..slices as u32).filter(|i| f64::from((i + phase) % 1000) < input.duty * per_refresh);
            lit.count() as f64 / (per_refresh * input.duty)
        };
        (0..SLICES / 6).map(at).fold([f64::INFINITY, 0.0], |[a, b], l: f64| [a.min(l), b.max(l)])
    }

    #[test]
    fn light_is_that_of_counted_slices() {
        for (refreshes, duty) in [(3.0, 0.2), (3.25, 0.2), (3.25, 0.9), (0.4, 0.3), (2.9, 0.5), (0.05, 0.5)] {
            let input = input(refreshes / 60.0, duty);
            let beat = input.beat().unwrap();
            let wanted = counted(&input);
            for i in 0..2 {
                // One slice of 1000 per refresh, over the duty.
                assert!((beat.light[i] - wanted[i]).abs() < 2e-3 / duty, "{refreshes} of {duty}: {beat:?} {wanted:?}");
            }
        }
    }

    #[test]
    fn flashes_are_counted_whole() {
        let beat = input(0.055, 0.0).beat().unwrap();
        assert_eq!(beat.light, [3.0, 4.0]);
        assert!((beat.ripple_percent - 100.0 / 3.3).abs() < 1e-9, "{}", beat.ripple_percent);
        assert!((beat.ripple_mag - 2.5 * (4.0_f64 / 3.0).log10()).abs() < 1e-12);
        assert!(beat.is_seen() && beat.advice().contains("50.000000 ms or 66.666667 ms"), "{}", beat.advice());
        let whole = input(0.05, 0.0).beat().unwrap();
        assert_eq!((whole.light, whole.is_seen()), ([3.0, 3.0], false));
        assert!(!input(0.055, 1.0).beat().unwrap().is_seen(), "held light does not beat");
        let dark = input(0.01, 0.0).beat().unwrap();
        assert_eq!(dark.ripple_mag, f64::INFINITY);
        assert_eq!(dark.whole_exposures_s[0], None, "nothing shorter is whole");
    }

    #[test]
    fn the_beat_returns_when_the_phase_does() {
        // 0.1 s holds 5.994 refreshes: the phase passes through one in 1 / 0.006 frames.
        let slow = BeatInput { refresh_hz: 59.94, ..input(0.055, 0.0) };
        assert!((slow.beat().unwrap().period_s - 0.1 / 0.006).abs() < 1e-6);
        assert_eq!(input(0.055, 0.0).beat().unwrap().period_s, f64::INFINITY);
        let drifting = BeatInput { drift_ppm: 50.0, ..input(0.055, 0.0) };
        assert!((drifting.beat().unwrap().period_s - 0.1 / (6.0 * 50e-6)).abs() < 1e-3);
    }

    #[test]
    fn invalid_inputs_are_refused() {
        for wrong in [
            BeatInput { exposure_s: 0.0, ..input(0.05, 0.5) },
            BeatInput { refresh_hz: f64::NAN, ..input(0.05, 0.5) },
            BeatInput { duty: 1.1, ..input(0.05, 0.5) },
            BeatInput { drift_ppm: -1.0, ..input(0.05, 0.5) },
        ] {
            assert!(wrong.beat().unwrap_err().to_string().contains("wanted"), "{wrong:?}");
        }
    }
}
