//! A measured or synthetic series of jitter -> its contribution to one exposure.
//!
//! Input: equally spaced samples of a signal that is band-limited below half its rate. Output: points and lines of the
//! [`JitterTrack`] of an exposure, a fixed number at most, whatever the rate of the record.
//!
//! *Slow part.* The record is low-passed below what straight lines between the points can follow, and evaluated at
//! points 1/128 of the exposure apart (windowed sinc, Blackman, 16 lobes to either side): nothing faster is folded down
//! into them. *Fast part.* The frequencies above the points move the image to and fro many times within an exposure.
//! Their effect is a covariance: that of the record's samples in the exposure minus that of the points (none, where the
//! points have its whole band). It is represented by [`RECORD_LINES`] sinusoids with whole numbers of periods per
//! exposure, above the band of the points: their mean is zero, they are orthogonal to each other, and first and second
//! moments of the path are those of the record. *Limits.* Only the moments of the fast part are kept, per exposure: its
//! course within the exposure is not. Ends of the window count by halves of samples. Tests: below, and
//! `tests/physics/measured_jitter.rs`.

use crate::attitude::los::{JitterLine, JitterPoint, JitterTrack, polyline_at};
use base::refused::Refused;
use base::time::{Span, Tai};
use core::f64::consts::{FRAC_PI_2, PI, TAU};
use glam::{DMat3, DQuat, DVec3};
use std::sync::Arc;

/// Largest number of samples of a record: half a gigabyte.
pub const RECORD_SAMPLES_MAX: usize = 1 << 24;
/// Largest number of points that a record adds to an exposure with all its rows.
pub(crate) const RECORD_POINTS_MAX: usize = 900;
/// Number of lines that a record adds to an exposure.
pub(crate) const RECORD_LINES: usize = 12;
/// Number of points per exposure.
const POINTS_PER_EXPOSURE: f64 = 128.0;
/// Points per sample of a slow record: straight lines between them lose 2 % of the power at its highest frequency.
const POINTS_PER_SAMPLE: f64 = 8.0;
/// Highest frequency represented by points, per point.
const POINTS_BAND: f64 = 0.28;
/// Highest frequency of a record, per sample.
const RECORD_BAND: f64 = 0.46;
/// Lowest frequency of the lines, per point: above the filter's transition.
const LINES_FROM: f64 = 0.406;
/// Lobes of the filter to either side, and steps of its table in a lobe.
const LOBES: usize = 16;
const STEPS: usize = 256;
/// Amplitude below which lines are left out, rad.
const NEGLIGIBLE_RAD: f64 = 5e-11;

/// Behaviour after the last sample of a record.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum RecordEnd {
    /// No jitter; exposures there report missing jitter.
    Still,
    /// The record repeats from its first sample, one period later.
    Repeat,
}

/// Equally spaced samples of jitter.
#[derive(Debug, Clone, PartialEq)]
pub struct JitterRecord {
    period_s: f64,
    samples: Vec<DVec3>,
    end: RecordEnd,
}

impl JitterRecord {
    /// Returns a record of rotation vectors, rad, that are `period_s` apart.
    ///
    /// # Errors
    /// When there are too few or too many samples, an illegal period, or a sample that is not finite.
    pub fn new(period_s: f64, samples: Vec<DVec3>, end: RecordEnd) -> Result<Self, Refused> {
        if !(2..=RECORD_SAMPLES_MAX).contains(&samples.len()) {
            return Err(Refused(format!("{got} samples; wanted 2 to {RECORD_SAMPLES_MAX}", got = samples.len())));
        }
        if !(1e-6..=1000.0).contains(&period_s) {
            return Err(Refused(format!("a period of {period_s} s; wanted 1e-6 to 1000 s")));
        }
        if let Some(place) = samples.iter().position(|sample| !sample.is_finite()) {
            return Err(Refused(format!("sample {place} is not finite")));
        }
        Ok(Self { period_s, samples, end })
    }

    /// Returns the time between samples, s.
    pub fn period_s(&self) -> f64 {
        self.period_s
    }

    /// Returns the samples, rad.
    pub fn samples(&self) -> &[DVec3] {
        &self.samples
    }

    /// Returns its duration, s.
    pub fn duration_s(&self) -> f64 {
        self.period_s * self.samples.len() as f64
    }

    /// Returns the behaviour after its last sample.
    pub fn end(&self) -> RecordEnd {
        self.end
    }

    /// Returns the sample of this number, also for numbers before the first and after the last.
    fn sample(&self, number: i64) -> DVec3 {
        let place = match self.end {
            RecordEnd::Still => usize::try_from(number).ok(),
            RecordEnd::Repeat => usize::try_from(number.rem_euclid(self.samples.len() as i64)).ok(),
        };
        place.and_then(|place| self.samples.get(place)).copied().unwrap_or(DVec3::ZERO)
    }
}

/// A record at its time in a run.
#[derive(Debug, Clone, PartialEq)]
pub struct RecordedJitter {
    /// The record.
    pub record: Arc<JitterRecord>,
    /// Instant of its first sample.
    pub start: Tai,
    /// Rotation from the axes of the record to sensor axes.
    pub sensor_from_record: DQuat,
    /// Exposure time of one row, s.
    pub exposure_s: f64,
}

/// A record at its time, and its filter.
#[derive(Debug, Clone)]
pub(super) struct RecordReader {
    jitter: RecordedJitter,
    /// Filter coefficients by steps of a lobe, from its middle.
    filter: Vec<f64>,
}

/// Sums of a path over time: duration, first and second moments.
#[derive(Debug, Clone, Copy)]
struct Moments {
    time: f64,
    first: DVec3,
    second: DMat3,
}

impl Moments {
    const NONE: Self = Self { time: 0.0, first: DVec3::ZERO, second: DMat3::ZERO };

    /// Adds a straight piece.
    fn add(&mut self, from: DVec3, to: DVec3, time: f64) {
        let (middle, half) = ((from + to) * 0.5, (to - from) * 0.5);
        self.time += time;
        self.first += middle * time;
        self.second += (outer(middle) + outer(half) * (1.0 / 3.0)) * time;
    }

    fn covariance(&self) -> DMat3 {
        if self.time > 0.0 { self.second * (1.0 / self.time) - outer(self.first / self.time) } else { DMat3::ZERO }
    }
}

fn outer(v: DVec3) -> DMat3 {
    DMat3::from_cols(v * v.x, v * v.y, v * v.z)
}

/// Grid on which a record is read for one window.
struct Grid {
    /// Time between points, s.
    step_s: f64,
    /// Highest frequency in the points, Hz.
    band_hz: f64,
    /// True when the record has higher frequencies than the points. Otherwise its few samples describe the moments
    /// worse than the points.
    leaves_out: bool,
}

impl RecordReader {
    pub(super) fn new(jitter: RecordedJitter) -> Self {
        let filter = (0..=LOBES * STEPS).map(|step| windowed_sinc(step as f64 / STEPS as f64)).collect();
        Self { jitter, filter }
    }

    /// Sets the exposure time of one row of the next exposures.
    pub(super) fn set_exposure_s(&mut self, exposure_s: f64) {
        self.jitter.exposure_s = exposure_s;
    }

    fn grid(&self, window_s: f64) -> Grid {
        let (record, exposure_s) = (&self.jitter.record, self.jitter.exposure_s);
        let by_window_s = window_s / (RECORD_POINTS_MAX - 4) as f64;
        let step_s = (exposure_s / POINTS_PER_EXPOSURE).max(by_window_s).max(record.period_s / POINTS_PER_SAMPLE);
        let (of_points_hz, of_record_hz) = (POINTS_BAND / step_s, RECORD_BAND / record.period_s);
        Grid { step_s, band_hz: of_points_hz.min(of_record_hz), leaves_out: of_points_hz < of_record_hz }
    }

    /// Adds the part that affects `from..=until` to a track whose lines' phases refer to `lines_epoch`; returns how
    /// much of the window lies outside the record.
    pub(super) fn add_to(&self, from: Tai, until: Tai, track: &mut JitterTrack) -> Span {
        let start = self.jitter.start;
        let window = [(from - start).s(), (until - start).s()];
        let grid = self.grid(window[1] - window[0]);
        let received = track.points.len();
        let mut seen = Moments::NONE;
        let [first, last] = [(window[0] / grid.step_s).floor(), (window[1] / grid.step_s).ceil()].map(whole);
        let mut before: Option<(f64, DVec3)> = None;
        for number in first..=last {
            let t_s = number as f64 * grid.step_s;
            let value = self.jitter.sensor_from_record * self.slow_at(t_s, grid.band_hz);
            if let Some((before_s, old)) = before {
                add_clipped(&mut seen, (before_s, old), (t_s, value), window);
            }
            before = Some((t_s, value));
            let at = start + Span::from_s(t_s);
            let others = polyline_at(&track.points[..received], at);
            track.points.push(JitterPoint { at, rotation_rad: value + others });
        }
        for point in &mut track.points[..received] {
            point.rotation_rad += self.jitter.sensor_from_record * self.slow_at((point.at - start).s(), grid.band_hz);
        }
        if received > 0 {
            track.points.sort_unstable_by_key(|point| point.at);
            track.points.dedup_by_key(|point| point.at);
        }
        if grid.leaves_out {
            self.add_lines(self.all_of(window).covariance() - seen.covariance(), &grid, (from, until), track);
        }
        self.missing(window)
    }

    /// Returns the record filtered below `band_hz`, `t_s` after its start, in its own axes.
    fn slow_at(&self, t_s: f64, band_hz: f64) -> DVec3 {
        let record = &self.jitter.record;
        let per_lobe = 2.0 * band_hz;
        let half_s = LOBES as f64 / per_lobe;
        let [first, last] =
            [((t_s - half_s) / record.period_s).ceil(), ((t_s + half_s) / record.period_s).floor()].map(whole);
        let (mut sum, mut weights) = (DVec3::ZERO, 0.0);
        for number in first..=last {
            let lobes = ((number as f64 * record.period_s - t_s) * per_lobe).abs();
            let weight = self.filter_at(lobes);
            sum += record.sample(number) * weight;
            weights += weight;
        }
        sum / weights
    }

    fn filter_at(&self, lobes: f64) -> f64 {
        let step = lobes * STEPS as f64;
        #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "0 to LOBES * STEPS")]
        let place = (step as usize).min(LOBES * STEPS - 1);
        let share = step - place as f64;
        self.filter[place] * (1.0 - share) + self.filter[place + 1] * share
    }

    /// Returns the moments of the whole record in a window: each sample counts for the time that is nearest to it.
    fn all_of(&self, window: [f64; 2]) -> Moments {
        let (record, mut all) = (&self.jitter.record, Moments::NONE);
        let [first, last] = window.map(|t_s| whole((t_s / record.period_s).round()));
        for number in first..=last {
            let middle_s = number as f64 * record.period_s;
            let [begin, end] = [-0.5, 0.5].map(|half| middle_s + half * record.period_s);
            let value = self.jitter.sensor_from_record * record.sample(number);
            all.add(value, value, (end.min(window[1]) - begin.max(window[0])).max(0.0));
        }
        all
    }

    /// Adds the covariance missing in the points, as cosines about the middle of the window.
    fn add_lines(&self, lacking: DMat3, grid: &Grid, (from, until): (Tai, Tai), track: &mut JitterTrack) {
        let exposure_s = self.jitter.exposure_s;
        if exposure_s <= 0.0 {
            return;
        }
        let to_epoch_s = (from - track.lines_epoch).s() + 0.5 * (until - from).s();
        let lowest = (LINES_FROM * exposure_s / grid.step_s).ceil().max(1.0);
        let columns = root(lacking);
        // Each column is shared by lines that are three apart.
        let share = (2.0 * 3.0 / RECORD_LINES as f64).sqrt();
        for (place, column) in (0..RECORD_LINES).map(|place| (place, columns[place % 3])) {
            let frequency_hz = (lowest + place as f64) / exposure_s;
            let amplitude_rad = column * share;
            if amplitude_rad.length() > NEGLIGIBLE_RAD {
                let phase_rad = FRAC_PI_2 - TAU * (frequency_hz * to_epoch_s).fract();
                track.lines.push(JitterLine { frequency_hz, amplitude_rad, phase_rad });
            }
        }
    }

    fn missing(&self, [begin, end]: [f64; 2]) -> Span {
        match self.jitter.record.end {
            RecordEnd::Repeat => Span::ZERO,
            RecordEnd::Still => {
                let covered = (end.min(self.jitter.record.duration_s()) - begin.max(0.0)).max(0.0);
                Span::from_s((end - begin - covered).max(0.0))
            }
        }
    }
}

fn add_clipped(moments: &mut Moments, a: (f64, DVec3), b: (f64, DVec3), window: [f64; 2]) {
    let [begin, end] = [a.0.max(window[0]), b.0.min(window[1])];
    if end > begin {
        let at = |t_s: f64| a.1.lerp(b.1, (t_s - a.0) / (b.0 - a.0));
        moments.add(at(begin), at(end), end - begin);
    }
}

/// Returns columns whose outer products sum to the positive part of a covariance (Cholesky; negative values are left
/// out).
fn root(covariance: DMat3) -> [DVec3; 3] {
    let c = covariance;
    let least = 1e-9 * (c.x_axis.x.abs() + c.y_axis.y.abs() + c.z_axis.z.abs());
    let pivot = |value: f64| if value > least { value.sqrt() } else { 0.0 };
    let under = |value: f64, pivot: f64| if pivot > 0.0 { value / pivot } else { 0.0 };
    let a = pivot(c.x_axis.x);
    let (b, d) = (under(c.x_axis.y, a), under(c.x_axis.z, a));
    let e = pivot(c.y_axis.y - b * b);
    let f = under(c.y_axis.z - b * d, e);
    let g = pivot(c.z_axis.z - d * d - f * f);
    [DVec3::new(a, b, d), DVec3::new(0.0, e, f), DVec3::new(0.0, 0.0, g)]
}

/// Returns a sinc with this many lobes, windowed by Blackman's window of [`LOBES`].
fn windowed_sinc(lobes: f64) -> f64 {
    let sinc = if lobes.abs() < 1e-12 { 1.0 } else { libm::sin(PI * lobes) / (PI * lobes) };
    let turn = PI * lobes / LOBES as f64;
    sinc * (0.42 + 0.5 * libm::cos(turn) + 0.08 * libm::cos(2.0 * turn))
}

#[allow(clippy::cast_possible_truncation, reason = "saturates; runs are shorter than 2^53 samples")]
fn whole(value: f64) -> i64 {
    value as i64
}

#[cfg(test)]
#[path = "record_tests.rs"]
mod tests;
