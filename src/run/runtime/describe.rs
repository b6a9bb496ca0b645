//! Writes a frame's metadata: its plan, its attitude, and the settings of its exposure.
//!
//! Facts about a frame's line of sight: which part of it was extrapolated, the error of the quadratic, missing jitter.
//!
//! In: the report of the path. Out: fields of the frame's metadata, and events where attitudes or jitter samples were
//! missing. Tests: `tests/closed_loop/attitude.rs`, `tests/closed_loop/late_jitter.rs`.

use crate::runtime::ledger::{Event, EventKind, Ledger};
use crate::runtime::slot::Slot;
use base::axes::{Rotation, Sensor, ra_dec_roll};
use base::{drawn::FrameMethod, time::Span, units::ARCSEC};
use frames::camera_control::CameraSettings;
use frames::sink::{ActiveFaults, FaultFlags, FrameMeta};
use image::{detector::Seeds, detector::readout::Levels};
use plan::attitude::{LosPath, PathOrigin, PathReport};
use plan::exposure::ExposurePlan;

/// Corrects attitude and rate to the sensor's own axes for a frame that is drawn in other axes, for a display. Its
/// pixel values are luminance codes, so no gain is reported.
pub(super) fn describe_pointing(los: &LosPath, sensor_from_drawn: &Rotation<Sensor, Sensor>, meta: &mut FrameMeta) {
    let sensor_from_icrf = *sensor_from_drawn * los.mid_sensor_from_icrf;
    let [ra, dec, roll] = ra_dec_roll(&sensor_from_icrf).map(f64::to_degrees);
    meta.attitude_wxyz = sensor_from_icrf.wxyz();
    meta.jitter_rad = sensor_from_drawn.apply(los.jitter_rotation_rad(0.0)).to_array();
    (meta.ra_deg, meta.dec_deg, meta.roll_deg) = (ra, dec, roll);
    meta.rate_deg_s = sensor_from_drawn.apply(los.rate_rad_s).to_array().map(f64::to_degrees);
    meta.gain_e_per_dn = f64::NAN;
}

/// Writes everything a plan states about a frame, and the levels of its image.
pub fn fill_meta(
    plan: &ExposurePlan,
    number: u32,
    seeds: Seeds,
    levels: &Levels,
    backend: &'static str,
    meta: &mut FrameMeta,
) {
    let los = &plan.motion.los;
    let [ra, dec, roll] = ra_dec_roll(&los.mid_sensor_from_icrf).map(f64::to_degrees);
    meta.number = number;
    meta.mid_exposure = los.mid_exposure();
    meta.exposure_s = los.exposure_s;
    meta.attitude_wxyz = los.mid_sensor_from_icrf.wxyz();
    meta.jitter_rad = los.jitter_rotation_rad(0.0).to_array();
    (meta.ra_deg, meta.dec_deg, meta.roll_deg) = (ra, dec, roll);
    meta.rate_deg_s = los.rate_rad_s.to_array().map(f64::to_degrees);
    (meta.seed, meta.noise_seed) = (seeds.sensor, seeds.noise);
    meta.lateness = Span::ZERO;
    meta.horizon = los.horizon;
    PathFacts::default().describe(meta);
    meta.backend = backend;
    // The reference integrates the exact motion, regardless of the planned method.
    meta.method =
        if backend == "reference" { FrameMethod::Exact } else { FrameMethod::Planned(plan.chosen.method.name()) };
    meta.degradation = plan.degradation;
    (meta.left_out_stars, meta.left_out_e) = (plan.cut_off.stars, plan.cut_off.electrons);
    meta.origin = los.origin;
    meta.faults = FaultFlags::NONE;
    meta.active = ActiveFaults::NONE;
    meta.gain_e_per_dn = levels.gain_e_per_dn;
    meta.black_level_dn = levels.black_level_dn;
}

/// Writes what started the exposure, and the settings it was taken with other than its time.
pub(super) fn describe_exposure(slot: &Slot, settings: &CameraSettings, meta: &mut FrameMeta) {
    (meta.started_by, meta.trigger_delay) = (slot.started.name(), slot.trigger_delay());
    (meta.gain_db, meta.regions) = (settings.gain_db, settings.regions);
}

/// Metadata of a frame's line of sight; the default is that of a frame without one.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct PathFacts {
    end_horizon: Span,
    outside: Span,
    is_partly_extrapolated: bool,
    residual_rad: f64,
    jitter_missing: Span,
}

impl PathFacts {
    /// Reads the facts from a report. A path that was predicted or held as a whole is marked by its origin instead.
    pub(super) fn of(report: &PathReport, origin: PathOrigin) -> Self {
        Self {
            end_horizon: report.end_horizon,
            outside: report.outside,
            is_partly_extrapolated: origin == PathOrigin::Interpolated && report.is_partly_extrapolated(),
            residual_rad: report.residual_rad,
            jitter_missing: report.jitter.missing,
        }
    }

    /// Adds missing attitudes and samples to the ledger.
    pub(super) fn note(&self, slot: Slot, ledger: &mut Ledger) {
        let mut note = |kind, span| ledger.note(Event::new(kind, slot.release, Some(slot.number), span));
        if self.is_partly_extrapolated {
            note(EventKind::PartlyExtrapolated, self.outside);
        }
        if self.jitter_missing > Span::ZERO {
            note(EventKind::JitterMissing, self.jitter_missing);
        }
    }

    /// Writes the facts into a frame's metadata.
    pub(super) fn describe(&self, meta: &mut FrameMeta) {
        meta.end_horizon = self.end_horizon;
        meta.is_partly_extrapolated = self.is_partly_extrapolated;
        meta.residual_arcsec = self.residual_rad / ARCSEC;
        meta.jitter_missing = self.jitter_missing;
    }
}
