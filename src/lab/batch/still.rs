//! Single images of any attitude and instant, with all that a run knows: observer, bodies, targets, layers of stars,
//! faults.
//!
//! In: a checked bench, the instants between which images are drawn, faults. Out: images with truth and metadata. The
//! bits of an image depend on its attitude, instant, seeds and number alone, not on the images before it; a camera with
//! image lag is the exception, because it keeps charge from image to image. Tests: below, `hil_scripts/tests/test_files.py`
//! (the command `render`).

use base::refused::Refused;
use base::time::{Span, Tai};
use config::{Action, Bench, Event};
use frames::report::StageTimes;
use frames::sink::{FrameFault, SentFrame};
use image::gpu::Electrons;
use plan::exposure::target::Target;
use plan::exposure::{ExposurePlan, Motion};
use run::runtime::frame_faults::{Begin, FrameFaults};
use run::runtime::{FrameEngine, Imager, Ledger, RunError, RunParams, Slot, Started};
use run::{runtime::engine::Light, wiring::bench_parts::params_from};
use scene::wcs::WcsMaker;
use serde_json::{Map, Value};
use sky::almanac::Almanac;

/// Middle of an exposure where none is given.
pub const DEFAULT_TIME: &str = "2026-01-01T00:00:00Z";
/// Fastest turn that is drawn, deg/s.
pub const MOST_DEG_PER_S: f64 = 1000.0;
/// Most electrons of a given source: single precision still counts them.
pub const MOST_ELECTRONS: f64 = 1e12;

/// Time before and after all images for which a fault acts: a fault that changes while it lasts is near its middle.
const FAULT_SPAN: Span = Span::from_ns(1_000_000_000_000_000_000);

/// Parameters of single images.
#[derive(Debug, Clone)]
pub struct StillParams<'a> {
    /// Camera, sky, observer, bodies, targets, seeds, backend and method; nothing of its link or its motion is used.
    pub bench: &'a Bench,
    /// The earliest and the latest middle of an exposure.
    pub span: [Tai; 2],
    /// Faults of every image, see [`still_fault`].
    pub faults: &'a [FrameFault],
}

/// A camera and its sky, ready to draw.
pub struct Still {
    engine: FrameEngine,
    faults: FrameFaults,
    ledger: Ledger,
    frame: SentFrame,
    /// Magnitude of the faintest stars of the sky, G.
    pub faintest_mag: f32,
    /// Maps images of mean electrons to the sky.
    mean_wcs: Option<WcsMaker>,
    /// Time in which faults act.
    span: [Tai; 2],
}

impl Still {
    /// Returns a camera that is ready to draw: opens the stars, prepares the ephemeris of the span, makes the detector.
    ///
    /// # Errors
    /// When the camera, the observer, a layer of stars or the backend cannot be used.
    pub fn new(params: &StillParams<'_>) -> Result<Self, RunError> {
        let StillParams { bench, span: [first, last], faults } = *params;
        let exposure = Span::from_s(bench.camera.exposure.exposure_s);
        let start = first - Span::from_ns(exposure.ns() / 2);
        let run = params_from(bench, start).map_err(|error| RunError::Scene(Refused(format!("{error:#}"))))?;
        // Without a deadline images are drawn as exactly as the budget asks.
        let run = RunParams { degrade: false, ..run };
        let detector = run.camera.make_detector(run.seeds())?;
        let imager = Imager::of_detector(run.backend, detector)?;
        let sky = run.open_sky()?;
        let mean_wcs = WcsMaker::new(&run.camera.geometry, &run.camera.whole_sensor());
        let faintest_mag = sky.layers.magnitudes()[1];
        let [width, height] = run.camera.output().size_px;
        let frame = SentFrame::with_capacity(width, height, 0, run.camera.name.clone());
        let almanac = Almanac::over(first, last);
        let engine = FrameEngine::with_sky(run, imager, &sky, &almanac)?;
        let ledger = Ledger::default();
        let span = [first - FAULT_SPAN, last + FAULT_SPAN];
        let mut still = Self { engine, faults: FrameFaults::default(), ledger, frame, faintest_mag, mean_wcs, span };
        still.set_faults(faults, 1)?;
        Ok(still)
    }

    /// Sets the faults of the images to come in place of those before; the random places of a fault follow from the
    /// sensor's seed and its number, which is `first_number` for the first one.
    ///
    /// Faults of single pixels and of the optics stay in the detector and its tables: give them to a new [`Still`]
    /// ([`stays`]).
    ///
    /// # Errors
    /// When a fault cannot be prepared.
    pub fn set_faults(&mut self, faults: &[FrameFault], first_number: u16) -> Result<(), RunError> {
        self.faults = FrameFaults::default();
        let [from, until] = self.span;
        for (fault, number) in faults.iter().zip(first_number..) {
            self.faults.arm(Begin::At(from), until - from, *fault, number);
        }
        self.faults.prepare(&mut self.engine)
    }

    /// Sets the scripted targets of the images to come in place of those before.
    pub fn set_targets(&mut self, targets: &[Target]) {
        self.engine.drawer.set_targets(targets);
    }

    /// Draws the mean electrons of one target of the latest image alone; they are in [`Self::mean`] then. The scripted
    /// targets are gone then: set them before the next image.
    ///
    /// # Errors
    /// When the backend failed.
    pub fn draw_target_alone(&mut self, target: &Target) -> Result<(), RunError> {
        self.engine.drawer.draw_target_alone(target)
    }

    /// Draws and reads out one image; `number` fixes its noise together with the noise seed. It is in [`Self::frame`]
    /// then. Returns the wall time of the stages.
    ///
    /// # Errors
    /// When the backend failed, or the sky cannot be computed at that time.
    pub fn draw(&mut self, motion: &Motion, light: Light<'_>, number: u32) -> Result<StageTimes, RunError> {
        let slot = slot_of(motion, number);
        let fate = self.faults.begin(slot, &mut self.engine, &mut self.ledger);
        let times = self.engine.expose_along(slot, motion, light, &mut self.ledger, &mut self.frame)?;
        self.faults.spoil(&fate, &mut self.frame);
        Ok(times)
    }

    /// Draws the mean electrons before the detector; they are in [`Self::mean`] then, truth and metadata in [`Self::frame`].
    /// Returns the wall time of the stages.
    ///
    /// # Errors
    /// As [`Self::draw`].
    pub fn draw_mean(&mut self, motion: &Motion, light: Light<'_>, number: u32) -> Result<StageTimes, RunError> {
        let slot = slot_of(motion, number);
        self.faults.begin(slot, &mut self.engine, &mut self.ledger);
        let times = self.engine.mean_along(slot, motion, light, &mut self.ledger, &mut self.frame)?;
        let sight = self.engine.scene.stars.sight().filter(|_| light.is_on_sky());
        let maker = self.mean_wcs.as_mut().zip(sight);
        self.frame.meta.wcs = maker.and_then(|(maker, sight)| maker.at(&motion.los.mid_sensor_from_icrf, sight));
        Ok(times)
    }

    /// Returns the latest image with its truth.
    pub fn frame(&self) -> &SentFrame {
        &self.frame
    }

    /// Returns the latest mean electrons, sensor pixel by sensor pixel.
    pub fn mean(&self) -> Electrons<'_> {
        self.engine.drawer.imager.latest_mean()
    }

    /// Returns the plan of the latest image: methods, bounds and costs.
    pub fn plan(&self) -> &ExposurePlan {
        self.engine.drawer.planner.latest()
    }

    /// Returns the backend and the detector.
    pub fn imager(&self) -> &Imager {
        &self.engine.drawer.imager
    }

    /// Returns the camera, the sky and all other parameters as they are drawn with.
    pub fn params(&self) -> &RunParams {
        &self.engine.params
    }
}

/// Returns the place in time of an image.
fn slot_of(motion: &Motion, number: u32) -> Slot {
    let start = motion.los.exposure_start;
    let end = start + Span::from_s(motion.los.exposure_s);
    Slot { number, exposure_start: start, exposure_end: end, release: end, due: end, started: Started::Rate }
}

// Faults of single images, written as the keys of an `[[event]]`.

/// Returns the fault that the keys of an event describe, separated by commas: `do = "stray_light", e_per_s = 200`.
///
/// # Errors
/// When the keys are not those of a fault of frames that changes a single image.
pub fn still_fault(keys: &str) -> Result<FrameFault, Refused> {
    #[derive(serde::Deserialize)]
    struct Line {
        fault: Map<String, Value>,
    }
    let line = toml::from_str::<Line>(&format!("fault = {{ {keys} }}")).map_err(|error| {
        let wanted = "wanted keys of an event, such as do = \"stray_light\", e_per_s = 200";
        Refused(format!("a fault: {}; {wanted}", error.message()))
    })?;
    still_fault_of(line.fault)
}

/// Returns the fault that the keys of an event describe.
///
/// # Errors
/// As [`still_fault`].
pub fn still_fault_of(mut keys: Map<String, Value>) -> Result<FrameFault, Refused> {
    // It lasts as long as the image does.
    keys.entry("for_s").or_insert_with(|| Value::from(1.0));
    let event = Event::from_json(&keys, 0.0, Span::from_s(1.0)).map_err(Refused::of)?;
    match event.action {
        Action::Frame { fault, .. } if !matches!(fault, FrameFault::Sending(_)) => Ok(fault),
        Action::Frame { .. }
        | Action::Slew(_)
        | Action::Safe
        | Action::Resume
        | Action::Bus(_)
        | Action::BusBackLoss { .. }
        | Action::Aboard(_)
        | Action::Trigger { .. } => Err(Refused(format!(
            "a fault: got do = \"{}\", wanted one that changes a single image: frame_drop, frame_late, frame_duplicate and \
             frame_torn need a run, faults of the bus and of the spacecraft do too",
            event.action.word()
        ))),
    }
}

/// Returns whether a fault changes the detector or the optics for all images after it, until it is taken back.
pub fn stays(fault: &FrameFault) -> bool {
    matches!(fault, FrameFault::Camera(_))
}

#[cfg(test)]
mod still_tests {
    use super::*;
    use base::{axes::sensor_from_ra_dec_roll, image::DnImage};
    use plan::attitude::LosPath;

    fn motion(bench: &Bench, dec_deg: f64, at: Tai) -> Motion {
        let exposure_s = bench.camera.exposure.exposure_s;
        let attitude = sensor_from_ra_dec_roll(1.45, dec_deg.to_radians(), 0.3);
        Motion { los: LosPath::commanded(attitude, at - Span::from_s(0.5 * exposure_s), exposure_s), image_path: None }
    }

    fn drawn(still: &mut Still, dec_deg: f64, at: Tai, number: u32, bench: &Bench) -> (DnImage, usize) {
        still.draw(&motion(bench, dec_deg, at), Light::Sky, number).unwrap();
        (still.frame().image.clone(), still.frame().truth.len())
    }

    #[test]
    fn images_depend_on_attitude_instant_and_number_alone() {
        let mut bench = Bench::built_in().unwrap();
        bench.render.backend = config::Backend::Cpu;
        let at = Tai::from_rfc3339("2026-05-01T00:00:00Z").unwrap();
        let params = StillParams { bench: &bench, span: [at, at + Span::from_s(60.0)], faults: &[] };
        let mut one = Still::new(&params).unwrap();
        let first = drawn(&mut one, 5.0, at, 0, &bench);
        let second = drawn(&mut one, 6.0, at + Span::from_s(9.0), 1, &bench);
        let again = drawn(&mut one, 5.0, at, 0, &bench);
        assert!(first == again && first.1 > 10, "the image between them leaves no trace");
        let alone = drawn(&mut Still::new(&params).unwrap(), 6.0, at + Span::from_s(9.0), 1, &bench);
        assert!(second == alone, "and neither does an image before");
        assert!(first.0 != drawn(&mut one, 5.0, at, 7, &bench).0, "another number is another noise");
    }

    #[test]
    fn faults_act_on_every_image() {
        let mut bench = Bench::built_in().unwrap();
        bench.render.backend = config::Backend::Cpu;
        let at = Tai::from_rfc3339("2026-05-01T00:00:00Z").unwrap();
        let blank = still_fault(r#"do = "frame_blank""#).unwrap();
        let params = StillParams { bench: &bench, span: [at, at], faults: &[blank] };
        let mut still = Still::new(&params).unwrap();
        let (image, stars) = drawn(&mut still, 5.0, at, 0, &bench);
        assert_eq!(stars, 0);
        assert!(image.pixels().iter().all(|dn| *dn == image.pixels()[0]));
        assert!(!still.frame().meta.faults.is_empty());
    }
}

#[cfg(test)]
mod fault_tests {
    use super::*;
    use frames::sink::ImageFault;

    #[test]
    fn keys_of_an_event_become_a_fault() {
        let fault = still_fault("do = \"stray_light\", e_per_s = 200").unwrap();
        assert_eq!(fault, FrameFault::Image(ImageFault::StrayLight { e_per_s: 200.0 }));
    }

    #[test]
    fn faults_of_other_places_are_refused_with_advice() {
        let wrong = |text: &str| still_fault(text).unwrap_err().to_string();
        assert!(wrong("do = \"frame_torn\"").contains("need a run"));
        assert!(wrong("do = \"gyro_dropout\"").contains("need a run"));
        assert!(wrong("do = ").contains("wanted keys of an event"));
        assert!(wrong("do = \"stray_light\"").contains("e_per_s"));
    }
}
