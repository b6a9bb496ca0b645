//! The most recently received samples, in order of epoch.
//!
//! Late samples are inserted in order; duplicates, stale and future tags, and motion that no spacecraft makes are
//! refused and counted. Replayed sequence numbers are refused earlier, by `firmware_protocol`. The property test
//! `any_arrival_order_equals_a_sorted_reference` compares it with sorting.

use crate::attitude::error::HistoryReject;
use crate::attitude::ring::{EpochRing, HistoryCounts, HistoryLimits};
use base::axes::{Body, Icrf, Rotation};
use base::{time::Tai, units::DEG};
use glam::DVec3;

/// Bounded history of attitude samples.
#[derive(Debug, Clone)]
pub struct AttitudeHistory {
    ring: EpochRing<AttitudeSample>,
    counts: HistoryCounts,
}

impl AttitudeHistory {
    /// Returns an empty history; all memory is allocated here.
    pub fn new(limits: HistoryLimits) -> Self {
        Self { ring: EpochRing::new(limits), counts: HistoryCounts::default() }
    }

    /// Inserts a sample that arrived at `received_at`.
    ///
    /// # Errors
    /// The reason of the refusal, which is also counted.
    pub fn insert(&mut self, sample: AttitudeSample, received_at: Tai) -> Result<(), HistoryReject> {
        let place = self.admit(&sample, received_at).map_err(|reject| self.counts.count(reject))?;
        if !self.ring.insert(place, sample.at, sample) {
            self.counts.out_of_order += 1;
        }
        self.counts.accepted += 1;
        Ok(())
    }

    fn admit(&self, sample: &AttitudeSample, received_at: Tai) -> Result<usize, HistoryReject> {
        if !sample.is_finite() {
            return Err(HistoryReject::NotFinite);
        }
        let place = self.ring.admit(sample.at, received_at)?;
        let neighbours = [place.checked_sub(1), Some(place)].into_iter().flatten();
        let is_too_far = neighbours.filter_map(|at| self.ring.get(at)).any(|other| other.is_too_far_from(sample));
        if sample.is_too_fast() || is_too_far {
            return Err(HistoryReject::TooFast);
        }
        Ok(place)
    }

    /// Removes all samples, after a restart of the flight computer; the counters are kept.
    pub fn clear(&mut self) {
        self.ring.clear();
    }

    /// Returns the counts of accepted and refused samples.
    pub fn counts(&self) -> HistoryCounts {
        self.counts
    }

    /// Returns the number of stored samples.
    pub fn len(&self) -> usize {
        self.ring.len()
    }

    /// Returns true before the first sample.
    pub fn is_empty(&self) -> bool {
        self.ring.len() == 0
    }

    /// Returns the stored sample with the earliest epoch.
    pub fn oldest(&self) -> Option<&AttitudeSample> {
        self.ring.oldest()
    }

    /// Returns the stored sample with the latest epoch.
    pub fn newest(&self) -> Option<&AttitudeSample> {
        self.ring.newest()
    }

    /// Returns the last sample at or before `at`, and the first after it.
    pub fn around(&self, at: Tai) -> (Option<&AttitudeSample>, Option<&AttitudeSample>) {
        let after = self.ring.count_until(at);
        (after.checked_sub(1).and_then(|place| self.ring.get(place)), self.ring.get(after))
    }

    /// Returns all samples, earliest epoch first.
    pub fn iter(&self) -> impl DoubleEndedIterator<Item = &AttitudeSample> {
        self.ring.iter()
    }
}

/// Attitude, rate and angular acceleration of the body at one instant.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct AttitudeSample {
    /// Epoch of the attitude.
    pub at: Tai,
    /// Sequence number of the message that carried it.
    pub seq: u8,
    /// Attitude of the body.
    pub body_from_icrf: Rotation<Body, Icrf>,
    /// Angular rate of the body with respect to ICRF, body axes, rad/s.
    pub rate_rad_s: DVec3,
    /// Angular acceleration, body axes, rad/s^2.
    pub acceleration_rad_s2: DVec3,
}

/// Fastest turn that is accepted as a spacecraft's attitude, rad/s: 1000 deg/s, beyond what a star sensor follows.
pub const MOST_RATE_RAD_S: f64 = 1000.0 * DEG;
/// Largest angular acceleration that is accepted, rad/s^2: 10,000 deg/s^2. Actuators stay far below it; a vibration of
/// 80 arcsec at 50 Hz has 2,200.
pub const MOST_ACCELERATION_RAD_S2: f64 = 10_000.0 * DEG;
/// Tolerance for noise of attitudes and of their time tags, rad: 3.4 arcmin.
const TURN_NOISE_RAD: f64 = 1e-3;

impl AttitudeSample {
    /// Returns true when every rate and acceleration is finite.
    pub(super) fn is_finite(&self) -> bool {
        self.rate_rad_s.is_finite() && self.acceleration_rad_s2.is_finite()
    }

    /// Returns true when the rate or the acceleration is above its limit.
    pub(super) fn is_too_fast(&self) -> bool {
        self.rate_rad_s.length() > MOST_RATE_RAD_S || self.acceleration_rad_s2.length() > MOST_ACCELERATION_RAD_S2
    }

    /// Returns true when the turn from this sample to `other`, of another epoch, needs more than the largest rate.
    pub(super) fn is_too_far_from(&self, other: &Self) -> bool {
        let turned_rad = self.body_from_icrf.rotation_vector_to(&other.body_from_icrf).length();
        turned_rad > TURN_NOISE_RAD + MOST_RATE_RAD_S * (other.at - self.at).s().abs()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::attitude::history::{MOST_ACCELERATION_RAD_S2, MOST_RATE_RAD_S};
    use base::{axes::Rotation, time::Span};
    use glam::DVec3;
    use proptest::prelude::*;

    fn sample(at_ns: i64, seq: u8) -> AttitudeSample {
        AttitudeSample {
            at: Tai::from_ns(at_ns),
            seq,
            body_from_icrf: Rotation::IDENTITY,
            rate_rad_s: DVec3::ZERO,
            acceleration_rad_s2: DVec3::ZERO,
        }
    }

    fn limits(capacity: usize) -> HistoryLimits {
        HistoryLimits { capacity, max_age: Span::from_ns(1000), max_lead: Span::from_ns(100) }
    }

    #[test]
    fn each_refusal_has_its_reason_and_its_counter() {
        let mut history = AttitudeHistory::new(limits(4));
        let now = Tai::from_ns(2000);
        assert_eq!(history.insert(sample(2000, 1), now), Ok(()));
        assert_eq!(history.insert(sample(2000, 2), now), Err(HistoryReject::DuplicateEpoch));
        assert_eq!(history.insert(sample(999, 3), now), Err(HistoryReject::Stale));
        assert_eq!(history.insert(sample(2101, 3), now), Err(HistoryReject::Future));
        let spinning = AttitudeSample { rate_rad_s: DVec3::new(f64::NAN, 0.0, 0.0), ..sample(2020, 3) };
        assert_eq!(history.insert(spinning, now), Err(HistoryReject::NotFinite));
        let jerking = AttitudeSample { acceleration_rad_s2: DVec3::INFINITY, ..sample(2020, 3) };
        assert_eq!(history.insert(jerking, now), Err(HistoryReject::NotFinite));
        let far = AttitudeSample { body_from_icrf: Rotation::from_rotation_vector(DVec3::Z), ..sample(2020, 3) };
        assert_eq!(history.insert(far, now), Err(HistoryReject::TooFast));
        for (at_ns, seq) in [(2030, 4), (2040, 5), (2050, 6)] {
            assert_eq!(history.insert(sample(at_ns, seq), now), Ok(()), "epoch {at_ns}");
        }
        assert_eq!(history.insert(sample(1990, 7), now), Err(HistoryReject::OlderThanHistory));
        let wanted = HistoryCounts {
            accepted: 4,
            out_of_order: 0,
            duplicate_epoch: 1,
            stale: 1,
            future: 1,
            not_finite: 2,
            too_fast: 1,
            older_than_history: 1,
        };
        assert_eq!(history.counts(), wanted);
        assert_eq!(wanted.refused(), 7);
    }

    #[test]
    fn limits_are_inclusive() {
        let mut history = AttitudeHistory::new(limits(8));
        let now = Tai::from_ns(2000);
        assert_eq!(history.insert(sample(1000, 1), now), Ok(()), "exactly max_age old");
        assert_eq!(history.insert(sample(2100, 2), now), Ok(()), "exactly max_lead ahead");
    }

    #[test]
    fn cleared_history_takes_any_epoch_again_and_keeps_its_counts() {
        let mut history = AttitudeHistory::new(limits(4));
        assert_eq!(history.insert(sample(5, 1), Tai::from_ns(5)), Ok(()));
        assert_eq!(history.insert(sample(5, 1), Tai::from_ns(5)), Err(HistoryReject::DuplicateEpoch));
        history.clear();
        assert!(history.is_empty());
        assert_eq!(history.insert(sample(5, 1), Tai::from_ns(5)), Ok(()));
        assert_eq!((history.counts().accepted, history.counts().duplicate_epoch), (2, 1));
    }

    /// Tests both sides of each limit, and a turn that is impossible because its two tags are a microsecond apart.
    #[test]
    fn motion_above_the_limits_is_refused() {
        let axis = DVec3::new(0.6, 0.0, -0.8);
        let turned = |rad: f64| Rotation::from_rotation_vector(DVec3::Y * rad);
        let at = |us: i64| AttitudeSample { at: Tai::from_ns(1000 * us), ..sample(0, 1) };
        let cases = [
            (AttitudeSample { rate_rad_s: axis * MOST_RATE_RAD_S * 0.999, ..at(1) }, Ok(())),
            (AttitudeSample { rate_rad_s: axis * MOST_RATE_RAD_S * 1.001, ..at(1) }, Err(HistoryReject::TooFast)),
            (AttitudeSample { acceleration_rad_s2: axis * MOST_ACCELERATION_RAD_S2 * 0.999, ..at(1) }, Ok(())),
            (
                AttitudeSample { acceleration_rad_s2: axis * MOST_ACCELERATION_RAD_S2 * 1.001, ..at(1) },
                Err(HistoryReject::TooFast),
            ),
            (AttitudeSample { body_from_icrf: turned(3.1), ..at(1) }, Err(HistoryReject::TooFast)),
            (AttitudeSample { body_from_icrf: turned(-3.1), ..at(-1) }, Err(HistoryReject::TooFast)),
            (AttitudeSample { body_from_icrf: turned(1e-4), ..at(1) }, Ok(())),
            (AttitudeSample { body_from_icrf: turned(1.6), ..at(100_000) }, Ok(())),
            (AttitudeSample { body_from_icrf: turned(1.8), ..at(100_000) }, Err(HistoryReject::TooFast)),
        ];
        for (sample, wanted) in cases {
            let mut history = AttitudeHistory::new(HistoryLimits::default());
            assert_eq!(history.insert(at(0), Tai::from_ns(0)), Ok(()));
            assert_eq!(history.insert(sample, Tai::from_ns(0)), wanted, "{sample:?}");
            assert_eq!(history.counts().too_fast, u64::from(wanted.is_err()));
        }
    }

    #[test]
    fn full_history_drops_the_oldest_and_never_grows() {
        let mut history = AttitudeHistory::new(limits(3));
        let allocated = history.ring.slots_allocated();
        for i in 0..50_u8 {
            history.insert(sample(i64::from(i) * 10, i), Tai::from_ns(i64::from(i) * 10)).expect("in order");
        }
        assert_eq!(history.iter().map(|s| s.at.ns()).collect::<Vec<_>>(), [470, 480, 490]);
        history.insert(sample(475, 100), Tai::from_ns(490)).expect("late, but newer than the oldest");
        assert_eq!(history.iter().map(|s| s.at.ns()).collect::<Vec<_>>(), [475, 480, 490]);
        assert_eq!(history.ring.slots_allocated(), allocated);
    }

    #[test]
    fn around_brackets_an_instant() {
        let mut history = AttitudeHistory::new(limits(4));
        for i in 0..3_u8 {
            history.insert(sample(i64::from(i) * 10, i), Tai::from_ns(20)).expect("in order");
        }
        let epochs = |at| {
            let (before, after) = history.around(Tai::from_ns(at));
            (before.map(|s| s.at.ns()), after.map(|s| s.at.ns()))
        };
        assert_eq!(epochs(-1), (None, Some(0)));
        assert_eq!(epochs(10), (Some(10), Some(20)));
        assert_eq!(epochs(15), (Some(10), Some(20)));
        assert_eq!(epochs(20), (Some(20), None));
    }

    /// Returns the expected history by brute force: sorts everything admitted and keeps the newest `capacity`.
    fn sorted_reference(arrivals: &[(i64, u8, i64)], limits: HistoryLimits) -> Vec<i64> {
        let mut held: Vec<i64> = Vec::new();
        for &(at_ns, _, received_ns) in arrivals {
            let is_outside = at_ns < received_ns - limits.max_age.ns() || at_ns > received_ns + limits.max_lead.ns();
            let is_too_old = held.len() >= limits.capacity && at_ns < held[0];
            if is_outside || held.contains(&at_ns) || is_too_old {
                continue;
            }
            held.push(at_ns);
            held.sort_unstable();
            let surplus = held.len().saturating_sub(limits.capacity);
            held.drain(..surplus);
        }
        held
    }

    fn taken(arrivals: &[(i64, u8, i64)], limits: HistoryLimits) -> (Vec<i64>, HistoryCounts) {
        let mut history = AttitudeHistory::new(limits);
        for &(at_ns, seq, received_ns) in arrivals {
            let _counted = history.insert(sample(at_ns, seq), Tai::from_ns(received_ns));
        }
        (history.iter().map(|s| s.at.ns()).collect(), history.counts())
    }

    proptest! {
        #[test]
        fn any_arrival_order_equals_a_sorted_reference(
            arrivals in proptest::collection::vec((0_i64..3000, any::<u8>(), 0_i64..3000), 0..200),
            capacity in 2_usize..40,
        ) {
            let limits = limits(capacity);
            let (held, counts) = taken(&arrivals, limits);
            prop_assert_eq!(&held, &sorted_reference(&arrivals, limits));
            prop_assert!(held.windows(2).all(|pair| pair[0] < pair[1]), "strictly ascending");
            prop_assert_eq!(counts.accepted + counts.refused(), arrivals.len() as u64);
        }

        #[test]
        fn extreme_epochs_never_panic(at_ns in any::<i64>(), received_ns in any::<i64>()) {
            let _outcome = taken(&[(at_ns, 0, received_ns), (received_ns, 1, at_ns)], limits(2));
        }
    }

    #[test]
    fn the_reference_would_notice_a_wrong_history() {
        let arrivals = [(10, 0, 10), (5, 1, 10), (10, 2, 10)];
        assert_eq!(sorted_reference(&arrivals, limits(4)), [5, 10]);
        assert_ne!(sorted_reference(&arrivals, limits(4)), [10, 5], "order matters");
        assert_ne!(taken(&arrivals[..1], limits(4)).0, sorted_reference(&arrivals, limits(4)), "a lost sample shows");
    }
}
