//! Trackers inside the program that fly a plan: the built-in one, which sees pixels and time tags only, and the
//! statistical one, which sees the truth; and the log that they write.

use crate::plan::{Plan, Source};
use crate::{attitudes::BrightBodies, poses::Pose};
use anyhow::Result;
use base::axes::Rotation;
use base::time::{Span, Tai};
use config::Camera;
use frames::sink::SentFrame;
use glam::{DQuat, DVec3};
use run::wiring::vehicle_parts::{exposed_light, tracker_params};
use stars::catalog::Catalog;
use std::{fmt::Write as _, sync::Arc};
use testbed::tracker::{Exposed, ExposedLight, GuideStars, Outcome, StarNoise, Tracker, TrackerParams, earth_beta};
use testbed::tracker_model::{ModelParams, NoiseMethod, TrackerModel};

/// Every n-th pixel shows the light of the background.
const PIXEL_STEP: usize = 61;
/// Pixels farther from the median than so many standard deviations are not background.
const CLIP_SIGMA: f64 = 3.0;
/// Light of the background beyond the usual that changes nothing, in the variance of a pixel without stars.
const LEAST_SHARE: f64 = 0.05;
/// Steps of the background's light in which the noise of stars is computed, e-folds.
const LIGHT_STEP: f64 = 0.02;

/// A tracker inside, made once for a plan.
pub(crate) struct Inside {
    eyes: InsideEyes,
    delay: Span,
    tag_error: Span,
}

enum InsideEyes {
    /// The built-in one, with its guide stars.
    Pixels(Box<TrackerParams>, Arc<GuideStars>),
    /// A statistical one, with the stars that its noise follows.
    Model(Box<ModelParams>, Option<Box<SkyNoise>>),
}

/// Stars that the noise of the statistical tracker follows, and the usual light on them.
#[derive(Debug, Clone)]
struct SkyNoise {
    stars: StarNoise,
    usual: ExposedLight,
    dark_e: f64,
}

impl Inside {
    /// Makes the tracker of a plan; `None` for a program outside.
    ///
    /// # Errors
    /// When stars are missing for it.
    pub(crate) fn of_plan(plan: &Plan, camera: &Camera, pixel_rad: f64) -> Result<Option<Self>> {
        // Its attitude comes after the readout and its own time.
        let delay = Span::from_s(camera.exposure.readout_s + plan.tracker.delay_ms * 1e-3);
        let tag_error = Span::from_s(plan.tracker.tag_error_ms * 1e-3);
        let guide = |params: &TrackerParams| -> Result<Arc<GuideStars>> {
            Ok(Arc::new(GuideStars::new(&Catalog::built_in()?, params, plan.start()?)?))
        };
        let eyes = match (plan.tracker.source, &plan.tracker.model) {
            (Source::BuiltIn, _) => {
                let params = tracker_params(camera, plan.tracker.stars);
                let guide = guide(&params)?;
                InsideEyes::Pixels(Box::new(params), guide)
            }
            (Source::Model, Some(figures)) => {
                let field_rad = pixel_rad * f64::from(camera.detector.width_px);
                let params = figures.params(field_rad, pixel_rad);
                let stars = match params.noise_method {
                    NoiseMethod::Even => None,
                    NoiseMethod::Stars => {
                        let tracker = tracker_params(camera, params.stars as usize);
                        let usual = exposed_light(camera, &tracker);
                        let stars = StarNoise::new(&tracker, guide(&tracker)?, &usual);
                        let binned = camera.detector.params.spatial.binning.map_or(1, |binning| binning.factor);
                        let pixels = f64::from(binned).powi(2);
                        let dark_e = camera.detector.params.dark_e_per_s * camera.exposure.exposure_s * pixels;
                        Some(Box::new(SkyNoise { stars, usual, dark_e }))
                    }
                };
                InsideEyes::Model(Box::new(params), stars)
            }
            (Source::Model, None) | (Source::Program, _) => return Ok(None),
        };
        Ok(Some(Self { eyes, delay, tag_error }))
    }

    /// Returns true where the tracker wants to know where the Earth is.
    pub(crate) fn looks_for_earth(&self) -> bool {
        match &self.eyes {
            InsideEyes::Pixels(..) => false,
            InsideEyes::Model(params, _) => params.earth_exclusion_rad > 0.0,
        }
    }
}

/// A tracker inside and its log.
pub(crate) struct TrackerLog<'a> {
    eyes: Eyes,
    bodies: Option<&'a BrightBodies>,
    delay: Span,
    tag_error: Span,
    frames_per_attitude: u32,
    last_group: Option<u32>,
    /// The log so far.
    pub(crate) text: String,
}

enum Eyes {
    Pixels(Box<Tracker>),
    Model(Box<TrackerModel>, Option<ModelLight>),
}

/// The light that a statistical tracker's stars are seen in.
#[derive(Debug, Clone, Copy)]
struct ModelLight {
    usual: ExposedLight,
    dark_e: f64,
}

impl<'a> TrackerLog<'a> {
    /// Returns an empty log of a tracker that is lost in space. Bodies blind a statistical one where their light falls on
    /// the detector of the case's camera.
    pub(crate) fn new(
        inside: &Inside,
        frames_per_attitude: u32,
        (seed, start): (u64, Tai),
        (camera, bodies): (&Camera, Option<&'a BrightBodies>),
    ) -> Self {
        let eyes = match &inside.eyes {
            InsideEyes::Pixels(params, guide) => Eyes::Pixels(Box::new(Tracker::new(**params, Arc::clone(guide)))),
            InsideEyes::Model(params, sky) => {
                let stars = sky.as_ref().map(|sky| sky.stars.clone());
                let light = sky.as_ref().map(|sky| ModelLight { usual: sky.usual, dark_e: sky.dark_e });
                Eyes::Model(Box::new(TrackerModel::new(blinded(params, camera), stars, seed, start)), light)
            }
        };
        let text = "frame,tai_ns,q_w,q_x,q_y,q_z,latency_ms,stars,why\n".to_owned();
        let (delay, tag_error, last_group) = (inside.delay, inside.tag_error, None);
        Self { eyes, bodies, delay, tag_error, frames_per_attitude, last_group, text }
    }

    /// Measures a frame, which was drawn at this pose, and writes a row.
    pub(crate) fn take(&mut self, frame: &SentFrame, pose: Option<&Pose>) -> Result<()> {
        let meta = &frame.meta;
        let group = meta.number / self.frames_per_attitude;
        let begins = self.last_group != Some(group);
        self.last_group = Some(group);
        let outcome = match &mut self.eyes {
            Eyes::Pixels(tracker) => {
                if begins {
                    tracker.forget();
                }
                tracker.expose(&Exposed { exposure_s: meta.exposure_s, regions: meta.regions });
                tracker.measure(&frame.image, meta.mid_exposure, earth_beta(meta.mid_exposure), None)
            }
            Eyes::Model(model, light) => {
                if begins {
                    model.forget();
                }
                if let Some(bodies) = self.bodies {
                    model.see_earth(bodies.earth(meta.mid_exposure)?);
                }
                if let Some(light) = light {
                    model.expose(&light.of(frame));
                }
                let [w, x, y, z] = meta.attitude_wxyz;
                let rate_rad_s = DVec3::from_array(meta.rate_deg_s.map(f64::to_radians));
                let middle = DQuat::from_xyzw(x, y, z, w);
                // Stars are where they were on the mean over the exposure.
                let seen = pose.and_then(|pose| pose.mean(meta.exposure_s)).unwrap_or(middle);
                model.measure(meta.number, meta.mid_exposure, &Rotation::from_quat(seen), rate_rad_s)
            }
        };
        self.write(frame, &outcome)
    }

    fn write(&mut self, frame: &SentFrame, outcome: &Outcome) -> Result<()> {
        let meta = &frame.meta;
        match outcome {
            Outcome::Solved(solution) => {
                let [w, x, y, z] = solution.sensor_from_icrf.wxyz();
                let latency_ms = (0.5 * meta.exposure_s) * 1e3 + self.delay.ms() - self.tag_error.ms();
                let (number, at_ns, stars) = (meta.number, (solution.at + self.tag_error).ns(), solution.stars);
                writeln!(self.text, "{number},{at_ns},{w:.15},{x:.15},{y:.15},{z:.15},{latency_ms},{stars},")?;
            }
            Outcome::NoSolution(reason) => {
                writeln!(self.text, "{},{},,,,,,,{reason}", meta.number, meta.mid_exposure.ns())?;
            }
        }
        Ok(())
    }
}

/// Returns figures without the exclusion of bodies whose light does not fall on this camera's detector.
fn blinded(params: &ModelParams, camera: &Camera) -> ModelParams {
    let [sun, moon, earth] = camera.baffle.as_ref().map_or([false; 3], |baffle| baffle.shade.shines);
    let angle = |shines: bool, angle_rad: f64| if shines { angle_rad } else { 0.0 };
    ModelParams {
        sun_exclusion_rad: angle(sun, params.sun_exclusion_rad),
        moon_exclusion_rad: angle(moon, params.moon_exclusion_rad),
        earth_exclusion_rad: angle(earth, params.earth_exclusion_rad),
        ..*params
    }
}

impl ModelLight {
    /// Returns the light of a frame: the share of it that comes through, and the background of its pixels.
    fn of(&self, frame: &SentFrame) -> ExposedLight {
        let active = frame.meta.active.named().iter();
        let shares = active.filter(|fault| fault.name == "contamination").map(|fault| fault.amount.value);
        let more_e = background_e(frame, self.usual.background_sigma_e) - self.dark_e;
        let usual_e2 = self.usual.background_sigma_e.powi(2);
        let more_e = if more_e > LEAST_SHARE * usual_e2 {
            // In steps: the noise of stars is computed again only where it changes.
            ((more_e.ln() / LIGHT_STEP).round() * LIGHT_STEP).exp()
        } else {
            0.0
        };
        ExposedLight {
            zero_magnitude_e: self.usual.zero_magnitude_e * shares.product::<f64>(),
            background_sigma_e: (usual_e2 + more_e).sqrt(),
            background_e: more_e,
        }
    }
}

/// Returns the mean electrons of pixels without stars.
fn background_e(frame: &SentFrame, sigma_e: f64) -> f64 {
    let (gain, black) = (frame.meta.gain_e_per_dn, frame.meta.black_level_dn);
    let mut some: Vec<u16> = frame.image.pixels().iter().step_by(PIXEL_STEP).copied().collect();
    let Some(middle) = some.len().checked_sub(1).map(|last| last / 2) else { return 0.0 };
    let median = f64::from(*some.select_nth_unstable(middle).1);
    let median_e = gain * (median - black);
    let clip_dn = CLIP_SIGMA * (sigma_e * sigma_e + median_e.max(0.0)).sqrt() / gain;
    let near = some.iter().map(|dn| f64::from(*dn)).filter(|dn| (dn - median).abs() <= clip_dn);
    let (sum, count) = near.fold((0.0, 0.0), |(sum, count), dn| (sum + dn, count + 1.0));
    gain * (sum / count - black)
}
