//! `telemetry.svg`: pointing and knowledge of a flight over time, as people look at it.
//!
//! Rows are gathered into at most `BINS` bins of equal length that double when they run out, each with its largest
//! values, so that a flight of any length is one small picture and no spike is lost.

use base::{time::Tai, units::ARCSEC};
use frames::report::plot::{Axis, Chart, Series, Style, to_svg};
use run::wiring::assessment::mode_name;
use testbed::vehicle::TelemetryRow;

/// Most bins of the picture; even.
const BINS: usize = 400;

/// Largest values of one stretch of time, arcsec: pointing error, knowledge error, sigma of the estimate.
type Bin = [Option<f64>; 3];

/// The picture while it grows.
#[derive(Debug)]
pub struct TelemetryPlot {
    zero: Tai,
    bin_s: f64,
    bins: Vec<Bin>,
    modes: Vec<(f64, &'static str)>,
}

impl TelemetryPlot {
    /// Returns a picture without rows; times count from `zero`.
    pub fn new(zero: Tai) -> Self {
        Self { zero, bin_s: 0.1, bins: Vec::with_capacity(BINS), modes: Vec::new() }
    }

    /// Takes one row in.
    pub fn take(&mut self, row: &TelemetryRow) {
        let t_s = (row.at - self.zero).s();
        if t_s < 0.0 {
            return;
        }
        let mode = mode_name(row.mode);
        if self.modes.last().is_none_or(|(_, last)| *last != mode) {
            self.modes.push((t_s, mode));
        }
        while t_s >= self.bin_s * BINS as f64 {
            self.halve();
        }
        #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "0 to BINS")]
        let bin = (t_s / self.bin_s) as usize;
        self.bins.resize(self.bins.len().max(bin + 1), [None; 3]);
        let values = [
            Some(row.pointing_error_rad.length() / ARCSEC),
            row.knowledge_error_rad.map(|error| error.length() / ARCSEC),
            Some(row.sigma_rad / ARCSEC),
        ];
        self.bins[bin] = largest(self.bins[bin], values);
    }

    /// Bins of twice the length.
    fn halve(&mut self) {
        self.bin_s *= 2.0;
        let halved = self.bins.chunks(2).map(|pair| pair.iter().copied().fold([None; 3], largest)).collect();
        self.bins = halved;
    }

    /// Returns the picture.
    pub fn svg(&self, title: &str) -> String {
        let line = |label: &str, kind: usize, group: usize| {
            let point = |(i, bin): (usize, &Bin)| Some([(i as f64 + 0.5) * self.bin_s, bin[kind]?.max(1e-3)]);
            Series::new(label, Style::Line, group, self.bins.iter().enumerate().filter_map(point).collect())
        };
        let reported: Vec<String> = self.modes.iter().take(8).map(|(t_s, mode)| format!("{t_s:.0} s {mode}")).collect();
        let chart = Chart {
            title: title.into(),
            x: Axis::linear("time after the first exposure, s"),
            y: Axis::log("angle, arcsec (largest of each stretch)"),
            series: vec![
                line("true attitude to target", 0, 0),
                line("true attitude to estimate", 1, 1),
                line("sigma of the estimate", 2, 2),
            ],
            ring: String::new(),
            notes: vec![format!("modes: {}", reported.join(", "))],
        };
        to_svg(&chart)
    }
}

fn largest(a: Bin, b: Bin) -> Bin {
    core::array::from_fn(|i| match (a[i], b[i]) {
        (Some(a), Some(b)) => Some(f64::max(a, b)),
        (a, b) => a.or(b),
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use base::time::Span;
    use glam::DVec3;
    use testbed::acs::Mode;

    fn row(t_s: f64, pointing_rad: f64) -> TelemetryRow {
        TelemetryRow {
            at: Tai::from_ns(0) + Span::from_s(t_s),
            mode: Mode::FinePointing,
            pointing_error_rad: DVec3::X * pointing_rad,
            knowledge_error_rad: None,
            sigma_rad: 1e-5,
            rate_rad_s: DVec3::ZERO,
            bias_error_rad_s: DVec3::ZERO,
            torque_n_m: DVec3::ZERO,
            vibration_rad: 0.0,
            wheel_speed_rad_s: 0.0,
            wheel_momentum_n_m_s: 0.0,
            heads_solved: 1,
            no_solution: None,
            stars: 10,
            tracker_sigma_rad: None,
            sun_angle_rad: None,
        }
    }

    #[test]
    fn a_long_flight_fits_and_its_spike_is_not_lost() {
        let mut plot = TelemetryPlot::new(Tai::from_ns(0));
        for step in 0..200_000 {
            let spike = if step == 1234 { 1e-2 } else { 1e-5 };
            plot.take(&row(0.1 * f64::from(step), spike));
        }
        assert!(plot.bins.len() <= BINS, "{}", plot.bins.len());
        let largest = plot.bins.iter().filter_map(|bin| bin[0]).fold(0.0, f64::max);
        assert!((largest * ARCSEC - 1e-2).abs() < 1e-12, "{largest} arcsec");
        let svg = plot.svg("a <flight>");
        assert!(svg.contains("a &lt;flight&gt;") && !svg.contains("NaN"));
    }
}
