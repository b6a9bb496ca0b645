//! Line-of-sight jitter: spectral lines set once, and sampled bursts received over the bus.
//!
//! Bursts arrive late and batched, so they are kept by epoch under the same rules as attitude samples, and an exposure
//! takes what covers it. Jitter that stopped arriving is not held for ever: a point further than `max_gap` from the
//! exposure is left out, and [`JitterCoverage`] says how much of the exposure had data.

use crate::attitude::error::HistoryReject;
use crate::attitude::los::{JitterLine, JitterPoint, JitterTrack};
use crate::attitude::ring::{EpochRing, HistoryCounts, HistoryLimits};
use crate::base::time::{Span, Tai};
use glam::DVec3;

/// Jitter known so far.
#[derive(Debug, Clone)]
pub struct JitterHistory {
    ring: EpochRing<JitterPoint>,
    capacity: usize,
    max_gap: Span,
    counts: HistoryCounts,
    lines: Vec<JitterLine>,
    lines_epoch: Tai,
}

/// How much of a window the received points cover.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct JitterCoverage {
    /// Points put into the track, those just outside the window included.
    pub points: usize,
    /// Part of the window between the first and the last of them.
    pub covered: Span,
    /// Longest time between neighbours in the track.
    pub longest_gap: Span,
}

impl JitterHistory {
    /// No jitter yet. Points further than `max_gap` outside an exposure are not used for it.
    #[must_use]
    pub fn new(limits: HistoryLimits, max_gap: Span) -> Self {
        Self {
            ring: EpochRing::new(limits),
            capacity: limits.capacity,
            max_gap,
            counts: HistoryCounts::default(),
            lines: Vec::new(),
            lines_epoch: Tai::from_ns(0),
        }
    }

    /// Replaces the spectral lines, whose phases hold at `epoch`. May allocate: for set-up, not for every frame.
    ///
    /// # Errors
    /// When a number is not finite; the former lines stay.
    pub fn set_lines(&mut self, lines: &[JitterLine], epoch: Tai) -> Result<(), HistoryReject> {
        let is_finite = |line: &JitterLine| {
            line.frequency_hz.is_finite() && line.amplitude_rad.is_finite() && line.phase_rad.is_finite()
        };
        if !lines.iter().all(is_finite) {
            return Err(self.counts.count(HistoryReject::NotFinite));
        }
        self.lines.clear();
        self.lines.extend_from_slice(lines);
        self.lines_epoch = epoch;
        Ok(())
    }

    /// Takes one point that arrived at `received_at`.
    ///
    /// # Errors
    /// The reason of a refusal, which is also counted.
    pub fn insert(&mut self, point: JitterPoint, received_at: Tai) -> Result<(), HistoryReject> {
        let admitted = if point.rotation_rad.is_finite() {
            self.ring.admit(point.at, received_at)
        } else {
            Err(HistoryReject::NotFinite)
        };
        let place = admitted.map_err(|reject| self.counts.count(reject))?;
        if !self.ring.insert(place, point.at, point) {
            self.counts.out_of_order += 1;
        }
        self.counts.accepted += 1;
        Ok(())
    }

    /// Takes a burst of equally spaced points; returns how many were accepted (the others are counted by reason).
    pub fn insert_burst(&mut self, first_at: Tai, interval: Span, rotations_rad: &[DVec3], received_at: Tai) -> usize {
        let mut at = first_at;
        let mut accepted = 0;
        for &rotation_rad in rotations_rad {
            accepted += usize::from(self.insert(JitterPoint { at, rotation_rad }, received_at).is_ok());
            at = at + interval;
        }
        accepted
    }

    /// Forgets the points (not the lines, nor the counters).
    pub fn clear_points(&mut self) {
        self.ring.clear();
    }

    /// What was taken and refused so far.
    #[must_use]
    pub fn counts(&self) -> HistoryCounts {
        self.counts
    }

    /// An empty track with room for all this history can put into it, so that filling never allocates.
    #[must_use]
    pub fn new_track(&self) -> JitterTrack {
        let lines_epoch = self.lines_epoch;
        JitterTrack { lines_epoch, ..JitterTrack::with_capacity(self.lines.len(), self.capacity) }
    }

    /// Replaces the track's content by the lines and the points that bear on `from..=until`: those inside, and the
    /// nearest on each side.
    pub fn fill(&self, from: Tai, until: Tai, track: &mut JitterTrack) -> JitterCoverage {
        track.lines.clear();
        track.lines.extend_from_slice(&self.lines);
        track.lines_epoch = self.lines_epoch;
        track.points.clear();
        let (earliest, latest) = (from - self.max_gap, until + self.max_gap);
        let first = self.ring.count_until(from).saturating_sub(1);
        let last = self.ring.count_until(until);
        let bearing = (first..=last).filter_map(|place| self.ring.get(place));
        track.points.extend(bearing.filter(|point| point.at >= earliest && point.at <= latest));
        coverage(&track.points, from, until)
    }
}

fn coverage(points: &[JitterPoint], from: Tai, until: Tai) -> JitterCoverage {
    let (Some(first), Some(last)) = (points.first(), points.last()) else {
        return JitterCoverage::default();
    };
    let covered = (last.at.min(until) - first.at.max(from)).max(Span::ZERO);
    let gaps = points.windows(2).map(|pair| pair[1].at - pair[0].at);
    JitterCoverage { points: points.len(), covered, longest_gap: gaps.max().unwrap_or(Span::ZERO) }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::base::units::ARCSEC;
    use proptest::prelude::*;

    fn us(t_us: i64) -> Tai {
        Tai::from_ns(t_us * 1000)
    }

    fn limits() -> HistoryLimits {
        HistoryLimits { capacity: 64, max_age: Span::from_ms(1000), max_lead: Span::from_ms(10) }
    }

    /// 20 ms of 1 kHz jitter from t = 0, in two bursts that arrive in the wrong order.
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
        let wanted = JitterCoverage { points: 6, covered: Span::from_ms(4), longest_gap: Span::from_ms(1) };
        assert_eq!(coverage, wanted);
        assert!((track.rotation_at(us(6_500)).x / ARCSEC - 6.5).abs() < 1e-12, "linear between samples");
    }

    #[test]
    fn a_stream_that_stopped_is_neither_held_for_ever_nor_silent() {
        let history = history();
        let mut track = history.new_track();
        let soon = history.fill(us(15_000), us(22_000), &mut track);
        assert_eq!(soon.covered, Span::from_ms(4), "data up to 19 ms");
        assert_eq!(track.rotation_at(us(22_000)), track.points[4].rotation_rad, "held to the end of this exposure");
        let after = history.fill(us(22_000), us(30_000), &mut track);
        assert_eq!((after.points, after.covered), (1, Span::ZERO), "3 ms old: held, and told");
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
        assert_eq!(history.counts().out_of_order, 10, "the early burst");
    }

    #[test]
    fn a_reused_track_does_not_grow() {
        let history = history();
        let mut track = history.new_track();
        let room = track.points.capacity();
        for i in 0..100 {
            history.fill(us(i * 100), us(i * 100 + 9_000), &mut track);
        }
        assert_eq!(track.points.capacity(), room);
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
            let point = |&t: &i64| JitterPoint { at: us(t), rotation_rad: DVec3::X * ((t * 7919 % 101) as f64) };
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
