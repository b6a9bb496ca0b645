//! Line-of-sight jitter: configured and received jitter -> the track of one exposure.
//!
//! | source | what it is | in an exposure |
//! |---|---|---|
//! | configured lines | sinusoids, phases at a local instant | continuous, as they are |
//! | uploaded lines | sinusoids, phases at remote time 0 | continuous; frequency and phase by the remote clock |
//! | PSD and seed | Gaussian noise as 32 sinusoids per axis (`psd`) | continuous, by the remote clock |
//! | wheel harmonics and speeds | sinusoids of the wheels' angles (`wheels`) | continuous; speed frozen at mid-exposure |
//! | sampled bursts | points | linear between points |
//! | a record of the bench (`record`) | a series, measured or of a density (`spectrum`) | points, and lines with the moments of what is faster |
//!
//! Nothing is averaged beforehand: all of it is a function of time ([`JitterTrack::rotation_at`]), integrated inside
//! the image by the planner's quadrature. Its node count follows the highest line's frequency and every sampled point,
//! and its bound (`plan::exposure::weigh`) states the remaining error.
//!
//! Bursts arrive late and batched, so they are stored by epoch under the same rules as attitude samples, and an
//! exposure takes those that cover it. Jitter that stopped arriving is not held: a point further than `max_gap` from
//! the exposure is left out, and [`JitterCoverage`] states the covered part of the exposure.
//!
//! Uploaded tables need the remote clock ([`JitterHistory::follow_clock`]) and have no effect before it is known.
//! Memory for all tables is allocated at construction. Tests: `tests/physics/bus_jitter.rs`.

mod psd;
mod record;
mod spectrum;
mod stream;
mod table;
mod wheels;

pub use psd::{LINES_PER_AXIS, PSD_POINTS_MAX, PsdPoint, psd_variance};
pub use record::{JitterRecord, RECORD_SAMPLES_MAX, RecordEnd, RecordedJitter};
pub use spectrum::{DENSITY_ROWS_MAX, SpectrumBin, band_power_rad2, smear_power_rad2};
pub use table::{JitterTableError, read_density, read_series};
pub use wheels::{HARMONICS_MAX, WHEELS, WheelHarmonic};

use crate::attitude::error::{HistoryReject, JitterReject};
use crate::attitude::los::{JitterLine, JitterPoint, JitterTrack};
use crate::attitude::ring::{EpochRing, HistoryCounts, HistoryLimits};
use crate::attitude::{los::KNOTS_MAX, remote_clock::ClockEstimate};
use base::time::{Span, Tai};
use glam::DVec3;
use record::{RECORD_LINES, RECORD_POINTS_MAX, RecordReader};
use stream::Stream;
use wheels::WheelHarmonics;

/// Largest rotation of a jitter sample, rad: 1 degree. What turns the line of sight further is motion, and belongs into
/// the attitude.
const MOST_JITTER_RAD: f64 = core::f64::consts::PI / 180.0;
/// Largest number of uploaded lines.
pub const UPLOADED_LINES_MAX: usize = 32;
/// Largest number of lines that all tables of the bus can add to an exposure.
pub const BUS_LINES_MAX: usize = UPLOADED_LINES_MAX + 3 * LINES_PER_AXIS + HARMONICS_MAX;

impl JitterTrack {
    /// Returns an empty track with capacity for this many configured lines and received points, for the lines of all
    /// tables that come over the bus, for those of a record, and for the knots of a long exposure.
    pub fn with_capacity(lines: usize, points: usize) -> Self {
        let points = Vec::with_capacity(points + RECORD_POINTS_MAX + KNOTS_MAX);
        let lines = Vec::with_capacity(lines + BUS_LINES_MAX + RECORD_LINES);
        Self { lines, points, ..Self::none() }
    }
}

/// All known sources of jitter.
#[derive(Debug, Clone)]
pub struct JitterHistory {
    ring: EpochRing<JitterPoint>,
    stream: Stream,
    capacity: usize,
    max_gap: Span,
    counts: HistoryCounts,
    lines: Vec<JitterLine>,
    lines_epoch: Tai,
    /// Uploaded lines with phases at remote time 0.
    uploaded: Vec<JitterLine>,
    noise: Vec<JitterLine>,
    wheels: WheelHarmonics,
    remote: Option<ClockEstimate>,
    record: Option<RecordReader>,
}

/// Coverage of a window by the received points.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct JitterCoverage {
    /// Points put into the track, those just outside the window included.
    pub points: usize,
    /// Part of the window between the first and the last of them.
    pub covered: Span,
    /// Longest time between neighbours in the track.
    pub longest_gap: Span,
    /// Part of the window that lacks samples of a stream that is expected to go on; zero without such a stream.
    pub missing: Span,
}

impl JitterHistory {
    /// Returns a history without jitter. Points further than `max_gap` outside an exposure are not used for it.
    pub fn new(limits: HistoryLimits, max_gap: Span) -> Self {
        Self {
            ring: EpochRing::new(limits),
            stream: Stream::default(),
            capacity: limits.capacity,
            max_gap,
            counts: HistoryCounts::default(),
            lines: Vec::new(),
            lines_epoch: Tai::from_ns(0),
            uploaded: Vec::with_capacity(UPLOADED_LINES_MAX),
            noise: Vec::with_capacity(3 * LINES_PER_AXIS),
            wheels: WheelHarmonics::new(),
            remote: None,
            record: None,
        }
    }

    /// Replaces the spectral lines, whose phases refer to `epoch`. May allocate: for set-up, not for every frame.
    ///
    /// # Errors
    /// When a number is not finite; the former lines remain.
    pub fn set_lines(&mut self, lines: &[JitterLine], epoch: Tai) -> Result<(), HistoryReject> {
        if !lines.iter().all(wheels::is_finite) {
            return Err(self.counts.count(HistoryReject::NotFinite));
        }
        self.lines.clear();
        self.lines.extend_from_slice(lines);
        self.lines_epoch = epoch;
        Ok(())
    }

    /// Adds a record to all other jitter, replacing a former one. Computes the tables of its filter: for set-up.
    pub fn set_record(&mut self, jitter: RecordedJitter) {
        self.record = Some(RecordReader::new(jitter));
    }

    /// Sets the length of the next exposures, s: a record's fast part is made for that time.
    pub fn set_exposure_s(&mut self, exposure_s: f64) {
        if let Some(record) = &mut self.record {
            record.set_exposure_s(exposure_s);
        }
    }

    /// Replaces the uploaded lines, whose phases refer to remote time 0 and whose frequencies are per remote second. An
    /// empty set removes them.
    ///
    /// # Errors
    /// When there are too many, or a number is not finite; the former lines remain.
    pub fn set_uploaded_lines(&mut self, lines: &[JitterLine]) -> Result<(), JitterReject> {
        if lines.len() > UPLOADED_LINES_MAX {
            return Err(JitterReject::TooMany { got: lines.len(), most: UPLOADED_LINES_MAX });
        }
        if let Some(row) = lines.iter().position(|line| !wheels::is_finite(line) || line.frequency_hz < 0.0) {
            return Err(JitterReject::Illegal { row });
        }
        self.uploaded.clear();
        self.uploaded.extend_from_slice(lines);
        Ok(())
    }

    /// Replaces the noise by one of this density, realised from the seed. Fewer than two points mean zero noise.
    /// The axes of the density are those of its sender: `turned` rotates their vectors into sensor axes. Takes about 1
    /// ms: for commands, not for every frame.
    ///
    /// # Errors
    /// When there are too many points, frequencies that do not rise, or an illegal number; the former noise remains.
    pub fn set_psd(
        &mut self,
        points: &[PsdPoint],
        seed: u64,
        turned: impl Fn(DVec3) -> DVec3,
    ) -> Result<(), JitterReject> {
        psd::check(points)?;
        self.noise.clear();
        psd::realise(points, seed, &mut self.noise);
        for line in &mut self.noise {
            line.amplitude_rad = turned(line.amplitude_rad);
        }
        Ok(())
    }

    /// Replaces the table of wheel harmonics.
    ///
    /// # Errors
    /// When there are too many rows, or an illegal one; the former table remains.
    pub fn set_wheel_harmonics(&mut self, table: &[WheelHarmonic]) -> Result<(), JitterReject> {
        self.wheels.set_table(table)
    }

    /// Accepts the wheels' speeds, rad/s, at an instant.
    ///
    /// # Errors
    /// The reason of the refusal, which is also counted: not finite, or not later than the speeds before.
    pub fn wheel_speeds(&mut self, rad_s: [f64; WHEELS], at: Tai) -> Result<(), HistoryReject> {
        self.wheels.set_speeds(rad_s, at).map_err(|reject| self.counts.count(reject))
    }

    /// Sets the estimate of the remote clock, by which uploaded lines and noise run; call after every time mark.
    pub fn follow_clock(&mut self, estimate: &ClockEstimate) {
        self.remote = Some(*estimate);
    }

    /// Returns the largest error of taking the wheels' speeds as constant during an exposure, sensor axes, rad.
    pub fn frozen_speed_bound_rad(&self, from: Tai, until: Tai) -> DVec3 {
        self.wheels.frozen_bound_rad(from, until)
    }

    /// Inserts one point that arrived at `received_at`.
    ///
    /// # Errors
    /// The reason of the refusal, which is also counted.
    pub fn insert(&mut self, point: JitterPoint, received_at: Tai) -> Result<(), HistoryReject> {
        let admitted = match point.rotation_rad {
            rotation_rad if !rotation_rad.is_finite() => Err(HistoryReject::NotFinite),
            rotation_rad if rotation_rad.length() > MOST_JITTER_RAD => Err(HistoryReject::TooFast),
            _ => self.ring.admit(point.at, received_at),
        };
        let place = admitted.map_err(|reject| self.counts.count(reject))?;
        if !self.ring.insert(place, point.at, point) {
            self.counts.out_of_order += 1;
        }
        self.counts.accepted += 1;
        Ok(())
    }

    /// Inserts a burst of equally spaced points; returns how many were accepted (the others are counted by reason).
    pub fn insert_burst(&mut self, first_at: Tai, interval: Span, rotations_rad: &[DVec3], received_at: Tai) -> usize {
        let mut at = first_at;
        let mut accepted = 0;
        for &rotation_rad in rotations_rad {
            accepted += usize::from(self.insert(JitterPoint { at, rotation_rad }, received_at).is_ok());
            at = at + interval;
        }
        accepted
    }

    /// Records a message whose samples start at `first_at` and are `period` apart: from now on samples are expected.
    pub fn note_stream(&mut self, first_at: Tai, period: Span, received_at: Tai) {
        self.stream.note(first_at, period, received_at);
    }

    /// Returns true while samples are expected: a message of the stream arrived in the second before `at`.
    pub fn is_streaming(&self, at: Tai) -> bool {
        self.stream.is_live(at)
    }

    /// Returns true when samples of an exposure that ends at `until` are still to come.
    pub fn is_behind(&self, until: Tai) -> bool {
        self.stream.is_behind(self.ring.newest().map(|point| point.at), until)
    }

    /// Removes the points and their stream, after a restart of the flight computer (but not the lines or the counters).
    pub fn clear_points(&mut self) {
        self.ring.clear();
        self.stream.clear();
    }

    /// Returns the counts of accepted and refused points.
    pub fn counts(&self) -> HistoryCounts {
        self.counts
    }

    /// Returns an empty track with capacity for everything this history can put into it, so that filling never
    /// allocates.
    pub fn new_track(&self) -> JitterTrack {
        let lines_epoch = self.lines_epoch;
        JitterTrack { lines_epoch, ..JitterTrack::with_capacity(self.lines.len(), self.capacity) }
    }

    /// Replaces the track's content by the lines and the points that affect `from..=until`: those inside, and the
    /// nearest on each side.
    pub fn fill(&self, from: Tai, until: Tai, track: &mut JitterTrack) -> JitterCoverage {
        self.fill_lines(from + Span::from_ns((until - from).ns() / 2), track);
        track.points.clear();
        let (earliest, latest) = (from - self.max_gap, until + self.max_gap);
        let first = self.ring.count_until(from).saturating_sub(1);
        let last = self.ring.count_until(until);
        let bearing = (first..=last).filter_map(|place| self.ring.get(place));
        track.points.extend(bearing.filter(|point| point.at >= earliest && point.at <= latest));
        let received = coverage(&track.points, from, until);
        let missing = self.stream.missing(&track.points, from, until);
        let beyond = self.record.as_ref().map_or(Span::ZERO, |record| record.add_to(from, until, track));
        JitterCoverage { missing: missing.max(beyond), ..received }
    }

    /// Adds the lines. With tables of the bus in effect all phases are moved to mid-exposure: short times keep their
    /// digits.
    fn fill_lines(&self, mid_exposure: Tai, track: &mut JitterTrack) {
        track.lines.clear();
        let by_remote = self.remote.filter(|_| !(self.uploaded.is_empty() && self.noise.is_empty()));
        if by_remote.is_none() && self.wheels.is_empty() {
            track.lines.extend_from_slice(&self.lines);
            track.lines_epoch = self.lines_epoch;
            return;
        }
        track.lines_epoch = mid_exposure;
        let since_epoch = mid_exposure - self.lines_epoch;
        track.lines.extend(self.lines.iter().map(|line| wheels::moved(line, since_epoch)));
        if let Some(remote) = by_remote {
            let since_boot = Span::from_ns(remote.to_remote_ns(mid_exposure));
            let remote_s_per_s = 1.0 / (1.0 + remote.drift);
            track.lines.extend(self.uploaded.iter().chain(&self.noise).map(|line| {
                let there = wheels::moved(line, since_boot);
                JitterLine { frequency_hz: line.frequency_hz * remote_s_per_s, ..there }
            }));
        }
        self.wheels.add_lines(mid_exposure, &mut track.lines);
    }
}

fn coverage(points: &[JitterPoint], from: Tai, until: Tai) -> JitterCoverage {
    let (Some(first), Some(last)) = (points.first(), points.last()) else {
        return JitterCoverage::default();
    };
    let covered = (last.at.min(until) - first.at.max(from)).max(Span::ZERO);
    let gaps = points.windows(2).map(|pair| pair[1].at - pair[0].at);
    let longest_gap = gaps.max().unwrap_or(Span::ZERO);
    JitterCoverage { points: points.len(), covered, longest_gap, missing: Span::ZERO }
}

#[cfg(test)]
mod tests {
    use super::*;
    use base::units::ARCSEC;
    use proptest::prelude::*;

    fn us(t_us: i64) -> Tai {
        Tai::from_ns(t_us * 1000)
    }

    fn limits() -> HistoryLimits {
        HistoryLimits { capacity: 64, max_age: Span::from_ms(1000), max_lead: Span::from_ms(10) }
    }

    /// Returns 20 ms of 1 kHz jitter from t = 0, in two bursts that arrive in the wrong order.
    fn history() -> JitterHistory {
        let mut history = JitterHistory::new(limits(), Span::from_ms(5));
        let rotation = |i: i32| DVec3::X * (f64::from(i) * ARCSEC);
        let [early, late]: [Vec<DVec3>; 2] = [(0..10).map(rotation).collect(), (10..20).map(rotation).collect()];
        assert_eq!(history.insert_burst(us(10_000), Span::from_ms(1), &late, us(25_000)), 10);
        assert_eq!(history.insert_burst(us(0), Span::from_ms(1), &early, us(26_000)), 10);
        history
    }

    #[test]
    fn an_exposure_takes_its_points_and_one_neighbour_each_side() {
        let history = history();
        let mut track = history.new_track();
        let coverage = history.fill(us(4_500), us(8_500), &mut track);
        let epochs: Vec<i64> = track.points.iter().map(|p| p.at.ns() / 1_000_000).collect();
        assert_eq!(epochs, [4, 5, 6, 7, 8, 9]);
        let (covered, longest_gap) = (Span::from_ms(4), Span::from_ms(1));
        let wanted = JitterCoverage { points: 6, covered, longest_gap, missing: Span::ZERO };
        assert_eq!(coverage, wanted);
        assert!((track.rotation_at(us(6_500)).x / ARCSEC - 6.5).abs() < 1e-12, "linear between samples");
    }

    #[test]
    fn stopped_jitter_stream_is_not_held_and_is_reported() {
        let history = history();
        let mut track = history.new_track();
        let soon = history.fill(us(15_000), us(22_000), &mut track);
        assert_eq!(soon.covered, Span::from_ms(4), "data up to 19 ms");
        assert_eq!(track.rotation_at(us(22_000)), track.points[4].rotation_rad, "held to the end of this exposure");
        let after = history.fill(us(22_000), us(30_000), &mut track);
        assert_eq!((after.points, after.covered), (1, Span::ZERO), "3 ms old: held, and reported");
        let later = history.fill(us(40_000), us(50_000), &mut track);
        assert_eq!(later, JitterCoverage::default());
        assert!(track.is_still(), "21 ms old: dropped");
    }

    #[test]
    fn lines_are_copied_and_broken_ones_refused() {
        let mut history = history();
        let line = JitterLine { frequency_hz: 50.0, amplitude_rad: DVec3::Y * ARCSEC, phase_rad: 0.5 };
        assert_eq!(history.set_lines(&[line], us(7)), Ok(()));
        let broken = JitterLine { phase_rad: f64::NAN, ..line };
        assert_eq!(history.set_lines(&[broken], us(8)), Err(HistoryReject::NotFinite));
        let mut track = JitterTrack::none();
        history.fill(us(0), us(1), &mut track);
        assert_eq!((track.lines.as_slice(), track.lines_epoch), ([line].as_slice(), us(7)));
    }

    #[test]
    fn refusals_are_counted() {
        let mut history = history();
        let refused = history.insert_burst(us(0), Span::from_ms(1), &[DVec3::ZERO; 3], us(0));
        assert_eq!((refused, history.counts().duplicate_epoch), (0, 3));
        let broken = JitterPoint { at: us(500), rotation_rad: DVec3::NAN };
        assert_eq!(history.insert(broken, us(500)), Err(HistoryReject::NotFinite));
        let large = JitterPoint { at: us(500), rotation_rad: DVec3::X * (1.001 * MOST_JITTER_RAD) };
        assert_eq!(history.insert(large, us(500)), Err(HistoryReject::TooFast));
        assert_eq!(history.counts().too_fast, 1);
        assert_eq!(history.counts().out_of_order, 10, "the early burst");
    }

    #[test]
    fn a_reused_track_does_not_grow() {
        let history = history();
        let mut track = history.new_track();
        let space = track.points.capacity();
        for i in 0..100 {
            history.fill(us(i * 100), us(i * 100 + 9_000), &mut track);
        }
        assert_eq!(track.points.capacity(), space);
    }

    proptest! {
        #[test]
        fn the_track_agrees_with_all_points_inside_the_window(
            mut epochs in proptest::collection::btree_set(0_i64..20_000, 2..60),
            from in 0_i64..20_000,
            length in 0_i64..5_000,
        ) {
            epochs.insert(0);
            epochs.insert(19_999);
            let mut history = JitterHistory::new(limits(), Span::from_ms(1000));
            let point = |&t: &i64| JitterPoint { at: us(t), rotation_rad: DVec3::X * ((t * 7919 % 101) as f64 / 8192.0) };
            let all = JitterTrack { points: epochs.iter().map(point).collect(), ..JitterTrack::none() };
            for &point in all.points.iter().rev() {
                prop_assert_eq!(history.insert(point, us(10_000)).is_ok(), true);
            }
            let until = (from + length).min(19_999);
            let mut track = JitterTrack::none();
            history.fill(us(from), us(until), &mut track);
            for t in [from, (from + until) / 2, until] {
                prop_assert_eq!(track.rotation_at(us(t)), all.rotation_at(us(t)), "at {} us", t);
            }
        }
    }
}
