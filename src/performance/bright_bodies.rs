//! Where the observer of a case sees Moon and Earth, at the times of its attitudes.

use anyhow::{Context, Result};
use base::time::{Span, Tai};
use config::{Scenario, StartTime};
use glam::DVec3;
use run::wiring::bench_parts::run_params;
use sky::bodies::EARTH_RADIUS_KM;
use sky::observer::{Observer, ObserverTrack};
use testbed::tracker_model::EarthDisc;

/// The observer of a case.
#[derive(Debug, Clone)]
pub(crate) struct BrightBodies {
    track: ObserverTrack,
    zero: Tai,
    each_s: f64,
}

impl BrightBodies {
    /// Returns those of a run whose attitudes last `each_s`.
    ///
    /// # Errors
    /// When the run has no start, or no observer can be made for it.
    pub(crate) fn of_run(scenario: &Scenario, each_s: f64) -> Result<Self> {
        let StartTime::At(start) = scenario.bench.timing.start else {
            anyhow::bail!("timing.start_utc: got \"now\", wanted a time");
        };
        let params = run_params(&scenario.bench, start)?;
        Ok(Self::of(params.observer, params.first_exposure, each_s))
    }

    /// Returns those of an observer whose first exposure is at `zero`.
    pub(crate) fn of(observer: Observer, zero: Tai, each_s: f64) -> Self {
        Self { track: ObserverTrack::new(observer, zero), zero, each_s }
    }

    /// Returns the unit vector to the Moon in the middle of an attitude, ICRF.
    pub(crate) fn moon(&self, number: u32) -> Result<DVec3> {
        Ok(self.track.bodies(self.middle_of(number))?.moon_km.normalize())
    }

    /// Returns the Earth's disc in the middle of an attitude.
    pub(crate) fn earth_of_attitude(&self, number: u32) -> Result<EarthDisc> {
        self.earth(self.middle_of(number))?.context(
            "attitudes of kind \"from_earth\": got an observer at the Earth's centre; wanted one in orbit, such as set = \
             [\"observer.kind=circular_orbit\"]",
        )
    }

    /// Returns the Earth's disc; `None` from its centre.
    pub(crate) fn earth(&self, at: Tai) -> Result<Option<EarthDisc>> {
        let disc = |km: DVec3| EarthDisc {
            direction_icrf: km.normalize(),
            radius_rad: (EARTH_RADIUS_KM / km.length()).min(1.0).asin(),
        };
        Ok(self.track.bodies(at)?.earth_km.map(disc))
    }

    fn middle_of(&self, number: u32) -> Tai {
        self.zero + Span::from_s(self.each_s * (f64::from(number) + 0.5))
    }
}
