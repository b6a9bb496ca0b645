//! Samples of an external plant that wait for their own instant on the virtual clock.
//!
//! In: samples in batches of any size, up to any time ahead. Out: single samples in order of time, each when the clock
//! has reached its instant. The receiver's input depends on the samples only, never on the batches, so that a run
//! repeats bit for bit. A list with one bad sample is refused as a whole. Tests: below, and
//! `tests/closed_loop/lockstep.rs`.
//!
//! One instant of an external plant, by the bench's clock, in double precision.
//!
//! Plain datagrams and the control socket bring them; attitudes go to the same history as those of the bus. Tests:
//! `receiver_tests`.

use base::axes::{Body, Icrf, Rotation};
use base::time::Tai;
use glam::DVec3;
use sky::observer::BarycentricState;
use std::collections::{BTreeMap, btree_map::Entry};

/// Capacity in parts of samples: 1000 s of 100 Hz, about 20 MB.
pub const WAITING_MAX: usize = 100_000;

/// Part of a sample; parts of one instant are taken in this order.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
enum Part {
    Observer,
    Attitude,
    Jitter,
}

impl Part {
    const ALL: [Self; 3] = [Self::Observer, Self::Attitude, Self::Jitter];

    const fn name(self) -> &'static str {
        match self {
            Self::Observer => "observer's state",
            Self::Attitude => "attitude",
            Self::Jitter => "jitter",
        }
    }

    /// Returns a sample with only this part.
    fn of(self, sample: &PlantSample) -> Option<PlantSample> {
        let alone = PlantSample::at(sample.at);
        match self {
            Self::Observer => sample.observer.map(|observer| PlantSample { observer: Some(observer), ..alone }),
            Self::Attitude => sample.attitude.map(|attitude| PlantSample { attitude: Some(attitude), ..alone }),
            Self::Jitter => sample.jitter_rad.map(|jitter| PlantSample { jitter_rad: Some(jitter), ..alone }),
        }
    }
}

/// Reason why a list of samples is refused.
#[derive(Debug, Clone, Copy, PartialEq, thiserror::Error)]
pub enum PlantRefusal {
    /// A sample of the past.
    #[error(
        "its time is not after the run's, which has passed it: an old attitude is never shown as a new one; send samples before \
         stepping to their instant"
    )]
    Past,
    /// Two samples of one instant.
    #[error("there is an {part} of this instant already; wanted one of each instant")]
    Twice {
        /// Name of the duplicate part.
        part: &'static str,
    },
    /// A number that is not finite.
    #[error("its {part} has a number that is not finite")]
    NotFinite {
        /// Name of the part that contains it.
        part: &'static str,
    },
    /// A sample without any part.
    #[error("it has neither attitude nor jitter nor an observer's state")]
    Empty,
    /// The queue is full.
    #[error("{} samples wait already; step before sending more", WAITING_MAX)]
    Full,
}

/// The samples that wait.
#[derive(Debug, Default)]
pub struct PlantQueue {
    waiting: BTreeMap<(Tai, Part), PlantSample>,
}

impl PlantQueue {
    /// Takes a list of samples, all or none. `open_from` is the first instant that has not passed.
    ///
    /// # Errors
    /// Returns the place in the list of the first refused sample, counted from 0, and the reason.
    pub fn put(&mut self, samples: &[PlantSample], open_from: Tai) -> Result<(), (usize, PlantRefusal)> {
        for (place, sample) in samples.iter().enumerate() {
            check(sample, open_from).map_err(|why| (place, why))?;
        }
        let mut added: Vec<(Tai, Part)> = Vec::new();
        for (place, sample) in samples.iter().enumerate() {
            if let Err(why) = self.add(sample, &mut added) {
                for key in &added {
                    self.waiting.remove(key);
                }
                return Err((place, why));
            }
        }
        Ok(())
    }

    fn add(&mut self, sample: &PlantSample, added: &mut Vec<(Tai, Part)>) -> Result<(), PlantRefusal> {
        for (part, alone) in Part::ALL.into_iter().filter_map(|part| part.of(sample).map(|alone| (part, alone))) {
            if self.waiting.len() >= WAITING_MAX {
                return Err(PlantRefusal::Full);
            }
            let key = (sample.at, part);
            match self.waiting.entry(key) {
                Entry::Occupied(_) => return Err(PlantRefusal::Twice { part: part.name() }),
                Entry::Vacant(place) => {
                    place.insert(alone);
                }
            }
            added.push(key);
        }
        Ok(())
    }

    /// Returns the instant of the next sample.
    pub fn next_at(&self) -> Option<Tai> {
        self.waiting.first_key_value().map(|((at, _), _)| *at)
    }

    /// Returns the next sample whose instant has come by `now`, with one part each.
    pub fn take(&mut self, now: Tai) -> Option<PlantSample> {
        self.next_at().filter(|at| *at <= now)?;
        self.waiting.pop_first().map(|(_, sample)| sample)
    }

    /// Returns the number of parts that wait.
    pub fn len(&self) -> usize {
        self.waiting.len()
    }

    /// Returns true when nothing waits.
    pub fn is_empty(&self) -> bool {
        self.waiting.is_empty()
    }

    /// Returns the instant of the last attitude that waits.
    pub fn last_attitude_at(&self) -> Option<Tai> {
        self.waiting.keys().rev().find(|(_, part)| *part == Part::Attitude).map(|(at, _)| *at)
    }
}

/// Checks one sample by itself.
fn check(sample: &PlantSample, open_from: Tai) -> Result<(), PlantRefusal> {
    let PlantSample { at, attitude, jitter_rad, observer } = sample;
    if *at < open_from {
        return Err(PlantRefusal::Past);
    }
    if attitude.is_none() && jitter_rad.is_none() && observer.is_none() {
        return Err(PlantRefusal::Empty);
    }
    let attitude_ok = attitude.is_none_or(|given| {
        let is_rotation = given.body_from_icrf.quat().is_finite();
        is_rotation && given.rate_rad_s.is_finite() && given.acceleration_rad_s2.is_finite()
    });
    let observer_ok = observer.is_none_or(|state| state.position_km.is_finite() && state.velocity_km_s.is_finite());
    let jitter_ok = jitter_rad.is_none_or(|rotation| rotation.is_finite());
    let parts = [(Part::Attitude, attitude_ok), (Part::Observer, observer_ok), (Part::Jitter, jitter_ok)];
    match parts.into_iter().find(|(_, is_ok)| !is_ok) {
        Some((part, _)) => Err(PlantRefusal::NotFinite { part: part.name() }),
        None => Ok(()),
    }
}

/// State of an external plant at one instant.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PlantSample {
    /// The instant.
    pub at: Tai,
    /// Attitude and rates, where they are given.
    pub attitude: Option<PlantAttitude>,
    /// Rotation vector of the line of sight beside the attitude, body axes, rad.
    pub jitter_rad: Option<DVec3>,
    /// State of the observer from the centre of the body that it orbits, ICRF axes, km and km/s.
    pub observer: Option<BarycentricState>,
}

/// Attitude and motion of the body.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PlantAttitude {
    /// Attitude of the body.
    pub body_from_icrf: Rotation<Body, Icrf>,
    /// Angular rate of the body with respect to ICRF, body axes, rad/s.
    pub rate_rad_s: DVec3,
    /// Angular acceleration, body axes, rad/s^2.
    pub acceleration_rad_s2: DVec3,
}

impl PlantSample {
    /// Returns an empty sample for an instant.
    pub fn at(at: Tai) -> Self {
        Self { at, attitude: None, jitter_rad: None, observer: None }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::runtime::plant_queue::PlantAttitude;
    use base::axes::Rotation;
    use glam::DVec3;

    fn at(ms: i64) -> Tai {
        Tai::from_ns(ms * 1_000_000)
    }

    fn attitude(ms: i64) -> PlantSample {
        let body_from_icrf = Rotation::from_rotation_vector(DVec3::X * ms as f64 * 1e-3);
        let (rate_rad_s, acceleration_rad_s2) = (DVec3::X, DVec3::ZERO);
        let attitude = Some(PlantAttitude { body_from_icrf, rate_rad_s, acceleration_rad_s2 });
        PlantSample { attitude, ..PlantSample::at(at(ms)) }
    }

    fn taken(queue: &mut PlantQueue, until_ms: i64) -> Vec<PlantSample> {
        core::iter::from_fn(|| queue.take(at(until_ms))).collect()
    }

    #[test]
    fn samples_come_out_at_their_own_instant_whatever_the_batches() {
        let all: Vec<PlantSample> = (0..40).map(|i| attitude(10 * i)).collect();
        let fed = |batch: usize, is_reversed: bool| {
            let mut queue = PlantQueue::default();
            let mut batches: Vec<Vec<PlantSample>> = all.chunks(batch).map(<[_]>::to_vec).collect();
            if is_reversed {
                batches.reverse();
            }
            batches.iter().for_each(|batch| queue.put(batch, at(0)).expect("good samples"));
            assert_eq!(queue.next_at(), Some(at(0)));
            (0..40).map(|step| taken(&mut queue, 10 * step + 5)).collect::<Vec<_>>()
        };
        let one = fed(1, false);
        assert!(one.iter().zip(&all).all(|(got, wanted)| got.as_slice() == [*wanted]), "each in its own step");
        assert_eq!(fed(40, false), one);
        assert_eq!(fed(7, true), one);
        let mut other = PlantQueue::default();
        other.put(&all[1..], at(0)).expect("good samples");
        assert_ne!(taken(&mut other, 5), one[0], "control: a missing sample shows");
    }

    #[test]
    fn parts_of_one_instant_wait_beside_each_other() {
        let mut queue = PlantQueue::default();
        let jitter = PlantSample { jitter_rad: Some(DVec3::Y), ..PlantSample::at(at(10)) };
        queue.put(&[jitter], at(0)).expect("jitter");
        queue.put(&[attitude(10)], at(0)).expect("an attitude beside it");
        assert_eq!((queue.len(), queue.last_attitude_at()), (2, Some(at(10))));
        assert_eq!(taken(&mut queue, 10), [attitude(10), jitter], "attitude first");
        assert!(queue.is_empty());
    }

    #[test]
    fn bad_lists_are_refused_as_a_whole_with_place_and_reason() {
        let mut queue = PlantQueue::default();
        queue.put(&[attitude(50)], at(20)).expect("good");
        let spinning = PlantAttitude { rate_rad_s: DVec3::NAN, ..attitude(30).attitude.expect("one") };
        let not_finite = PlantSample { attitude: Some(spinning), ..attitude(30) };
        let endless = PlantSample { jitter_rad: Some(DVec3::INFINITY), ..PlantSample::at(at(30)) };
        for (list, wanted) in [
            (vec![attitude(20), attitude(19)], (1, PlantRefusal::Past)),
            (vec![attitude(30), attitude(50)], (1, PlantRefusal::Twice { part: "attitude" })),
            (vec![attitude(30), attitude(31), attitude(30)], (2, PlantRefusal::Twice { part: "attitude" })),
            (vec![not_finite], (0, PlantRefusal::NotFinite { part: "attitude" })),
            (vec![endless], (0, PlantRefusal::NotFinite { part: "jitter" })),
            (vec![attitude(30), PlantSample::at(at(31))], (1, PlantRefusal::Empty)),
        ] {
            assert_eq!(queue.put(&list, at(20)), Err(wanted));
            assert_eq!(queue.len(), 1, "nothing of the list is kept: {wanted:?}");
        }
        queue.put(&[attitude(20)], at(20)).expect("control: the first open instant itself");
    }

    #[test]
    fn a_full_queue_takes_no_more_and_keeps_what_it_has() {
        let mut queue = PlantQueue::default();
        let many: Vec<PlantSample> = (0..WAITING_MAX as i64).map(attitude).collect();
        queue.put(&many, at(0)).expect("as many as fit");
        assert_eq!(queue.put(&[attitude(-1)], at(-1)), Err((0, PlantRefusal::Full)));
        assert_eq!(queue.len(), WAITING_MAX);
    }
}
