//! All parameters of a run, checked before it starts.

use base::axes::{Body, Rotation, Sensor};
use base::time::{Span, Tai};
use base::{accuracy::AccuracyBudget, refused::Refused};
use config::{AttitudeSettings, Backend, DeadlinePolicy, Overlap};
use image::detector::Seeds;
use plan::attitude::{JitterLine, RecordedJitter};
use plan::exposure::cost::CostModel;
use plan::exposure::{Degradation, MethodChoice, Target};
use scene::{SceneParams, camera::CameraParams, sky_targets::SkyTarget};
use sky::{almanac::Almanac, observer::Observer};
use stars::Sky;
use std::path::PathBuf;

/// Parameters of `plan::attitude`.
#[derive(Debug, Clone, PartialEq)]
pub struct AttitudeParams {
    /// Prediction, histories, waiting and time correlation, with the policy of the clock that the run is on.
    pub settings: AttitudeSettings,
    /// Jitter lines given as parameters, sensor axes, and the instant of their phases.
    pub jitter_lines: Vec<JitterLine>,
    /// Instant of the lines' phases.
    pub jitter_epoch: Tai,
    /// A jitter record that is added to all other jitter.
    pub jitter_record: Option<RecordedJitter>,
    /// Mounting.
    pub sensor_from_body: Rotation<Sensor, Body>,
}

/// One run.
#[derive(Debug, Clone)]
pub struct RunParams {
    /// Camera.
    pub camera: CameraParams,
    /// Attitude.
    pub attitude: AttitudeParams,
    /// Targets that move over the detector.
    pub targets: Vec<Target>,
    /// Targets on the sky.
    pub sky_targets: Vec<SkyTarget>,
    /// Rule for pixels where targets cover stars.
    pub target_overlap: Overlap,
    /// Position of the observer.
    pub observer: Observer,
    /// True when the Sun's light deflection is applied to stars.
    pub light_deflection: bool,
    /// True when planets, Moon and Earth are drawn and hide the sources behind them.
    pub bodies: bool,
    /// Star layers that form the sky; empty: the built-in catalog.
    pub layers: Vec<PathBuf>,
    /// Memory for the stars of layers for each head, MiB.
    pub star_memory_mb: u32,
    /// Accuracy budget.
    pub budget: AccuracyBudget,
    /// Backend choice.
    pub backend: Backend,
    /// Method choice.
    pub method: MethodChoice,
    /// Cost constants measured on this machine; `None`: the backend's built-in ones, as always on the virtual clock.
    pub cost: Option<CostModel>,
    /// Whether frames that would not be drawn in time are degraded.
    pub degrade: bool,
    /// The last level of degradation that may be taken.
    pub last_degradation: Degradation,
    /// Seed of the sensor (fixed patterns) and of faults.
    pub seed: u64,
    /// Seed of the noise of exposures.
    pub noise_seed: u64,
    /// Start of the first exposure.
    pub first_exposure: Tai,
    /// Rotation to the axes in which frames are drawn when these differ from the sensor's own, as for a display in
    /// front of it. `attitude.sensor_from_body` ends with it; frame metadata leaves it out. `None`: frames are drawn in
    /// sensor axes.
    pub drawn_from_sensor: Option<Rotation<Sensor, Sensor>>,
    /// Time from one exposure's start to the next.
    pub frame_period: Span,
    /// How long before the end of an exposure work on its frame starts: zero for a sensor that reads out, more for a
    /// display, where a frame must be ready when its light is to leave the display.
    pub ahead: Span,
    /// Frames to expose.
    pub frames: u32,
    /// Number of camera heads drawn in turn in each slot: each gets its share of the readout time.
    pub heads: u32,
    /// Policy for late frames.
    pub deadline_policy: DeadlinePolicy,
}

/// Share of the readout time reserved for attitude, sky, planning, the sink's queue and a busy machine.
const TIME_MARGIN: f64 = 0.2;

impl RunParams {
    /// Returns the seeds of the detector.
    pub fn seeds(&self) -> Seeds {
        Seeds { sensor: self.seed, noise: self.noise_seed }
    }

    /// Prepares Earth, Sun and planets for the exposures of the run: takes milliseconds per day of the run.
    pub fn almanac(&self) -> Almanac {
        Almanac::over(self.first_exposure, self.exposure_start(self.frames))
    }

    /// Returns the parameters of the run's scene.
    pub fn scene<'a>(&'a self, almanac: &'a Almanac) -> SceneParams<'a> {
        SceneParams {
            camera: &self.camera,
            observer: &self.observer,
            almanac,
            light_deflection: self.light_deflection,
            bodies: self.bodies,
            targets: &self.sky_targets,
        }
    }

    /// Returns the stars of the run.
    ///
    /// # Errors
    /// When a layer cannot be read or is damaged, or the layers do not form one sky.
    pub fn open_sky(&self) -> Result<Sky, Refused> {
        Sky::open(&self.layers, self.camera.limiting_mag, self.star_memory_mb)
    }

    /// Returns the time in which a frame must be drawn, ms: its share of the readout time minus the detector's own time
    /// and a margin.
    pub fn drawing_budget_ms(&self, cost: &CostModel) -> f64 {
        self.drawing_budget_under_ms(cost, 1.0)
    }

    /// Returns the same, in predicted time, on a machine on which drawing and detector take `load` times as long as
    /// predicted.
    pub fn drawing_budget_under_ms(&self, cost: &CostModel, load: f64) -> f64 {
        self.drawing_budget_of_ms([1.0, self.camera.predicted_readout_ms(cost)], load)
    }

    /// Returns the same, ms, for a frame with this share of its rows read out and this detector time.
    pub fn drawing_budget_of_ms(&self, [rows_share, detector_ms]: [f64; 2], load: f64) -> f64 {
        let share_ms = self.camera.readout_s * rows_share * 1e3 / f64::from(self.heads.max(1));
        (1.0 - TIME_MARGIN) * share_ms / load - detector_ms
    }

    /// Returns true when any target may be drawn.
    pub fn has_targets(&self) -> bool {
        !self.targets.is_empty() || !self.sky_targets.is_empty()
    }

    /// Returns the first instant of frame `number`'s exposure.
    pub fn exposure_start(&self, number: u32) -> Tai {
        self.first_exposure + Span::from_ns(self.frame_period.ns() * i64::from(number))
    }
}
