//! A bench file: one run of the stimulator.

use crate::budget::{Budget, BudgetKeys};
use crate::camera::{Camera, HEADS_MAX, Head, HeadKeys, check_heads, quaternion};
use crate::check::{Checker, Defaulted};
use crate::error::{ConfigError, Result};
use crate::flight_computer::{FlightComputer, FlightComputerKeys, JitterSource};
use crate::jitter::{JitterInput, JitterKeys};
use crate::key::{Section, section};
use crate::key_type::{Any, Numbers, Raw, Shape, Whole, Word};
use crate::link::{Carrier, Link, LinkKeys, SessionKeys, SessionParams};
use crate::observer::{Observer, ObserverKeys};
use crate::plant::{PlantKeys, PlantKind};
use crate::sink::{Sink, SinkKeys, SinkSettings};
use crate::stages::{AccuracyKeys, AttitudeKeys, AttitudeSettings, Render, RenderKeys, check_accuracy};
use crate::target::{Overlap, TargetKeys, TargetSettings, check_seen, check_targets};
use crate::timing::{Timing, TimingKeys};
use crate::tracker_in::{TrackerIn, TrackerInKeys, check_tracker_ins};
use crate::tracker_out::{TrackerOut, TrackerOutKeys, check_tracker_outs};
use crate::trigger_line::{TriggerLine, TriggerLineKeys, check_trigger_lines};
use crate::{document::Document, event_word::EventKeys, expect::ExpectKeys, plain_link};
use base::accuracy::AccuracyBudget;
use base::axes::{Body, Rotation, Sensor};
use link::{WireFormat, plain::TimeMeaning};
use std::path::{Path, PathBuf};

const BUILT_IN_BENCH: &str = "benches/loopback.toml";
const BUILT_IN_CAMERA: &str = "cameras/star_tracker_20deg.toml";

/// A bench, checked, with the camera it names.
#[derive(Debug, Clone, PartialEq)]
pub struct Bench {
    /// Name for people.
    pub name: String,
    /// The camera.
    pub camera: Camera,
    /// Targets that move over the detector.
    pub targets: Vec<TargetSettings>,
    /// Rule for pixels where targets cover stars.
    pub target_overlap: Overlap,
    /// Seed of every random number of the run but those that have a seed of their own.
    pub seed: u64,
    /// Seed of the noise of exposures, where it is given: see [`Self::noise_seed`].
    pub noise_seed_given: Option<u64>,
    /// Frames, duration, start.
    pub timing: Timing,
    /// The bus.
    pub link: Link,
    /// Further buses, listened to as well.
    pub extra_links: Vec<Link>,
    /// GPIO lines whose edges start exposures.
    pub trigger_lines: Vec<TriggerLine>,
    /// Telemetry of star trackers.
    pub tracker_outs: Vec<TrackerOut>,
    /// Star trackers outside.
    pub tracker_ins: Vec<TrackerIn>,
    /// The conversation with the flight computer.
    pub session: SessionParams,
    /// How the sensor is mounted.
    pub sensor_from_body: Rotation<Sensor, Body>,
    /// Further camera heads.
    pub extra_heads: Vec<Head>,
    /// Where the sensor is.
    pub observer: Observer,
    /// Whether the Sun bends the stars' light.
    pub light_deflection: bool,
    /// Layers of stars that are the sky; none: the built-in catalog is.
    pub layers: Vec<PathBuf>,
    /// Memory for stars of layers, MiB, for each head.
    pub star_memory_mb: u32,
    /// Planets, Moon and Earth are drawn, and hide what is behind them.
    pub bodies: bool,
    /// The simulated flight computer.
    pub flight_computer: FlightComputer,
    /// Jitter from a file, which is added to all other.
    pub jitter: Option<JitterInput>,
    /// History, prediction, time correlation.
    pub attitude: AttitudeSettings,
    /// How wrong a frame may be.
    pub accuracy: AccuracyBudget,
    /// How long it may take, and what its threads ask of the system.
    pub budget: Budget,
    /// Rendering.
    pub render: Render,
    /// Where frames go: `[sink]`, and then those beside it.
    pub sinks: Vec<SinkSettings>,
    /// Values that neither the bench nor the link file gives; the camera has its own list.
    pub defaulted: Vec<Defaulted>,
}

section! {
    /// A bench: one run of the stimulator. Every key has a default.
    BenchKeys at "" {
        /// Name of the run; it names a folder below out/.
        name: String = Computed("the file's name"), "text";
        /// Camera file, relative to this one.
        camera: String = Computed("built-in cameras/star_tracker_20deg.toml"), "path";
        /// Seed of every random number of the run; any number repeats its own run.
        seed: Whole<u64> = 1, 0..=i64::MAX;
        /// Seed of the noise of exposures; left out, it is seed; any number repeats its own run.
        noise_seed: Whole<u64> = Optional, 0..=i64::MAX;
        /// Spacecraft file, relative to this one: it is flown inside the program.
        spacecraft: String = Optional, "path";
        /// Add: photons of stars and targets add up; brighter: each pixel shows the brighter of the two only.
        target_overlap: Word<Overlap> = "add", [("add", Overlap::Add), ("brighter", Overlap::Brighter)];
        tables:
        /// Point sources that move over the detector by a script, or fly about the Earth.
        target: Vec<TargetKeys>;
        /// Frames, duration and the simulated start.
        timing: TimingKeys;
        /// The bus to the flight computer.
        link: LinkKeys;
        /// Further buses, listened to as well.
        extra_link: Vec<LinkKeys>;
        /// GPIO lines of this machine whose edges start exposures, on the real clock.
        trigger_line: Vec<TriggerLineKeys>;
        /// Telemetry of star trackers on protocols that clients speak.
        tracker_out: Vec<TrackerOutKeys>;
        /// Star trackers outside that see frames and answer with attitudes.
        tracker_in: Vec<TrackerInKeys>;
        /// How the conversation with the flight computer is kept.
        session: SessionKeys;
        /// How the sensor is mounted.
        mounting: MountingKeys;
        /// Camera heads; they are all, and the first one counts as the bench's.
        head: Vec<HeadKeys>;
        /// Camera heads beside the first one.
        extra_head: Vec<HeadKeys>;
        /// Source of the spacecraft's motion.
        plant: PlantKeys;
        /// Commands and faults, each at its time.
        event: Vec<EventKeys>;
        /// Conditions that must be met for the run to pass.
        expect: ExpectKeys;
        /// Where the sensor is, for parallax and aberration.
        observer: ObserverKeys;
        /// Stars and bodies.
        sky: SkyKeys;
        /// The simulated flight computer at the other end of the link.
        flight_computer: FlightComputerKeys;
        /// Measured jitter that is added to the line of sight of every head.
        jitter: JitterKeys;
        /// History, prediction and time correlation of attitudes.
        attitude: AttitudeKeys;
        /// How wrong a frame may be.
        accuracy: AccuracyKeys;
        /// How long the stages of a frame may take on the real clock.
        budget: BudgetKeys;
        /// How frames are drawn.
        render: RenderKeys;
        /// Where frames go.
        sink: SinkKeys;
        /// Further sinks for the same frames.
        extra_sink: Vec<SinkKeys>;
    }

    /// How the sensor is mounted.
    MountingKeys at "mounting" {
        /// A unit quaternion [w, x, y, z], scalar first.
        sensor_from_body: [f64; 4] = Numbers([1.0, 0.0, 0.0, 0.0]), Within(-1.0, 1.0);
    }

    /// Stars and bodies.
    SkyKeys at "sky" {
        /// Layers of stars in place of the built-in catalog.
        layers: Raw<Vec<String>> = Optional, Shape::list(Shape::Text("path")),
            "as `starloop catalog import` writes them, relative to this file; without the key the built-in catalog";
        /// Memory for the stars of a field and of those that may come, MiB: 18,700 stars each.
        memory_mb: Whole = i64::from(STAR_MEMORY_MB), 1..=65_536;
        /// Planets, Moon and Earth are drawn, and hide what is behind them.
        bodies: bool = false, Any;
    }
}

impl SkyKeys {
    /// Layers beside the bench's file.
    fn files(&self, check: &Checker<'_>) -> Result<Vec<PathBuf>> {
        let Some(layers) = self.layers().raw() else { return Ok(Vec::new()) };
        if layers.is_empty() || layers.iter().any(|path| path.trim().is_empty()) {
            return Err(self.layers().invalid("no file", "layers of stars", check));
        }
        Ok(layers.iter().map(|path| check.document.file_beside(path)).collect())
    }

    fn memory(&self, check: &mut Checker<'_>) -> Result<u32> {
        if !self.layers().is_given() {
            self.refuse(&["memory_mb"], "a bench with sky.layers", check)?;
            return Ok(STAR_MEMORY_MB);
        }
        self.memory_mb().check(check)
    }
}

/// Memory for stars of layers, MiB, when nothing is said: some nine million stars.
pub const STAR_MEMORY_MB: u32 = 512;

/// Checks that the constant delay of the bus is given once.
fn check_one_delay(is_given: bool, link: &Link, check: &Checker<'_>) -> Result<()> {
    if is_given && link.latency_us > 0.0 {
        let wanted = "not given beside link.latency_us";
        let advice = "both are the constant delay of the bus: give one of them";
        return Err(check.invalid("attitude.link_delay_us", "given", wanted, advice));
    }
    Ok(())
}

/// Checks the jitter rate for classic CAN, which carries jitter in pairs of one fixed rate.
fn check_classic_jitter(link: &Link, computer: &FlightComputer, check: &Checker<'_>) -> Result<()> {
    const PAIRS_HZ: f64 = 1000.0;
    let hz = computer.jitter_sample_hz;
    let paired = link.wire == WireFormat::CanClassic && computer.jitter_source == JitterSource::Samples;
    if paired && (hz - PAIRS_HZ).abs() > 0.0 {
        let advice = "classic CAN sends jitter at 1 kHz only; CAN FD and serial take other rates";
        return Err(check.invalid("flight_computer.jitter_sample_hz", hz, "1000 on classic CAN", advice));
    }
    Ok(())
}

/// Checks that no display is used with several heads: it shows one.
pub(super) fn check_sinks_of_heads(sinks: &[SinkSettings], extra_heads: &[Head], check: &Checker<'_>) -> Result<()> {
    let display = sinks.iter().position(|settings| matches!(settings.sink, Sink::Display(_)));
    match display {
        Some(place) if !extra_heads.is_empty() => {
            let key =
                place.checked_sub(1).map_or_else(|| "sink.kind".into(), |extra| format!("extra_sink[{extra}].kind"));
            let advice = "a display shows the frames of one head: give each head a bench of its own";
            Err(check.invalid(&key, "\"display\"", "another kind beside [[extra_head]]", advice))
        }
        _ => Ok(()),
    }
}

/// Refuses frames that are begun so early that every attitude is stale: at best the newest is as old as drawing has
/// begun.
fn check_not_stale(ahead_ms: f64, attitude: &AttitudeSettings, exposure_s: f64, check: &Checker<'_>) -> Result<()> {
    let most_ms = attitude.estimate.stale_after.ms() + 500.0 * exposure_s;
    if ahead_ms < most_ms {
        return Ok(());
    }
    let wanted = format!("less than {most_ms} (attitude.stale_after_ms and half the exposure)");
    let advice = "every attitude would be stale at mid-exposure: begin frames later, or call attitudes stale later";
    Err(check.invalid("timing.ahead_ms", ahead_ms, wanted, advice))
}

/// Checks that every extra link leads to another program, and that one link at most has pulses. Whether the first link
/// leads to one depends on how the run is started ([`Bench::is_lockstep`]).
fn check_both_ends(link: &Link, extra_links: &[Link], computer: &FlightComputer, check: &Checker<'_>) -> Result<()> {
    if let Some(i) = extra_links.iter().position(Link::has_no_gateway) {
        let gateway_ports = "slcan_tcp, slcan_pty or socketcand: without a gateway no other program can reach this bus";
        let key = format!("extra_link[{i}].kind");
        return Err(check.invalid(&key, "\"simulated\" without gateways", gateway_ports, "or a real bus"));
    }
    let sources = core::iter::once(link).chain(extra_links).filter(|link| link.pps.is_some()).count();
    if sources > 1 {
        let advice = "the flight computer has one clock: name its pulses at one link";
        return Err(check.invalid("link.pps", format!("{sources} sources of pulses"), "one", advice));
    }
    let far_port = |link: &Link| match &link.carrier {
        Carrier::SerialPort { far_port, .. } => Some(far_port.is_some()),
        Carrier::Simulated(_) | Carrier::SocketCan { .. } | Carrier::Udp { .. } | Carrier::Tcp { .. } => None,
    };
    if far_port(link) == Some(false) && !computer.is_external {
        let advice = "a serial port has another program, or machine, at its other end; link.far_port names a second port at \
                      which the simulated one is";
        return Err(check.invalid(
            "flight_computer.kind",
            "\"simulated\"",
            "\"external\" with link.kind = \"serial\"",
            advice,
        ));
    }
    check.unused(
        "link.far_port",
        far_port(link) == Some(true) && computer.is_external,
        "a bench whose flight computer is simulated",
    )?;
    let extra = extra_links.iter().position(|link| far_port(link) == Some(true));
    extra.map_or(Ok(()), |i| check.unused(&format!("extra_link[{i}].far_port"), true, "[link]"))
}

impl Bench {
    /// Returns whether the plant is 42, which can drive the virtual clock: its lines have a time.
    pub fn can_be_driven_by_42(&self) -> bool {
        let has_time = self.link.plain.as_ref().is_some_and(|plain| plain.layout.time == TimeMeaning::Tag);
        let is_over_tcp = matches!(self.link.carrier, Carrier::Tcp { .. });
        self.flight_computer.is_external && self.link.is_of_42() && has_time && is_over_tcp
    }

    /// Returns true when the plant is outside and no bus leads out of the program: its samples can only come from
    /// whoever steps the run, over the control socket or as a library.
    pub fn is_lockstep(&self) -> bool {
        self.flight_computer.is_external && self.link.has_no_gateway()
    }

    /// Reads and checks a bench file and what it names.
    ///
    /// # Errors
    /// The first thing that is wrong.
    pub fn load(path: &Path) -> Result<Self> {
        Self::from_document(&Document::open(path)?)
    }

    /// Returns the bench of the binary: runs with no file, hardware or GPU.
    ///
    /// # Errors
    /// Never, as a test holds.
    pub fn built_in() -> Result<Self> {
        Self::from_document(&Self::built_in_document()?)
    }

    /// Returns the text of that bench.
    ///
    /// # Errors
    /// Never, as a test holds.
    pub fn built_in_document() -> Result<Document> {
        Document::built_in(BUILT_IN_BENCH)
    }

    /// Checks the bench of a document; what else is in it is returned as it was read.
    pub(super) fn checked(document: &Document) -> Result<(Self, BesideBench)> {
        let keys: BenchKeys = document.read_as()?;
        let mut check = Checker::new(document);
        let name = check.folder_name(keys.name().raw().cloned())?;
        let camera = camera(&keys, &mut check)?;
        let sinks =
            SinkSettings::check_all(keys.sink.clone(), keys.extra_sink.clone(), &name, camera.image_px(), &mut check)?;
        // A calibrated display shows each frame from one refresh to the next, whatever the tracker's exposure is.
        let own_exposure_s = (!is_drawn_for_display(&sinks)).then_some(camera.exposure.exposure_s);
        let timing = Timing::check(&keys.timing, own_exposure_s, &mut check)?;
        let exposure_s = own_exposure_s.unwrap_or(1.0 / timing.frame_rate_hz);
        let link = Link::check(&keys.link, &mut check)?;
        let extra_links = Link::check_extra(&keys.extra_link, &mut check)?;
        let trigger_lines = check_trigger_lines(&keys.trigger_line, &mut check)?;
        let session = SessionParams::check(&keys.session, &mut check)?;
        let sensor_from_body = mounting(&keys.mounting, &mut check)?;
        let observer = Observer::check(&keys.observer, &mut check)?;
        let light_deflection = keys.observer.light_deflection().check(&mut check)?;
        let layers = keys.sky.files(&check)?;
        let star_memory_mb = keys.sky.memory(&mut check)?;
        let bodies = keys.sky.bodies().check(&mut check)?;
        let flight_computer = FlightComputer::check(&keys.flight_computer, keys.plant.is_outside(), &mut check)?;
        let plant_kind = keys.plant.mover(keys.spacecraft().is_given(), flight_computer.is_external, &check)?;
        flight_computer.check_slew_begins_before(timing.duration_s, &check)?;
        let is_moved_by_plant = plant_kind != PlantKind::FlightComputer && flight_computer.motion.is_some();
        check.unused("flight_computer.motion", is_moved_by_plant, "plant.kind = \"flight_computer\"")?;
        check_classic_jitter(&link, &flight_computer, &check)?;
        check_both_ends(&link, &extra_links, &flight_computer, &check)?;
        plain_link::check_bench((&link, &extra_links), &flight_computer, &session, &check)?;
        session.check_has_run(&link, &flight_computer, &check)?;
        let (attitude_hz, jitter_hz) = (flight_computer.attitude_hz, flight_computer.jitter_sample_hz);
        check_one_delay(keys.attitude.link_delay_us().is_given(), &link, &check)?;
        let attitude = AttitudeSettings::check(&keys.attitude, attitude_hz, jitter_hz, exposure_s, &mut check)?;
        check_not_stale(timing.ahead_ms, &attitude, exposure_s, &check)?;
        let accuracy = check_accuracy(&keys.accuracy, &mut check)?;
        let budget = Budget::check(&keys.budget, camera.exposure.readout_s, &mut check)?;
        let render = Render::check(&keys.render, &mut check)?;
        let (targets, target_overlap) = targets_of(&keys, timing.duration_s, &mut check)?;
        let jitter = JitterInput::check(&keys.jitter, timing.duration_s, &mut check)?;
        let bench = Self {
            targets,
            target_overlap,
            seed: keys.seed().check(&mut check)?,
            noise_seed_given: keys.noise_seed().optional(&check)?,
            name,
            camera,
            timing,
            link,
            extra_links,
            trigger_lines,
            tracker_outs: Vec::new(),
            tracker_ins: Vec::new(),
            session,
            sensor_from_body,
            extra_heads: Vec::new(),
            observer,
            light_deflection,
            layers,
            star_memory_mb,
            bodies,
            flight_computer,
            jitter,
            attitude,
            accuracy,
            budget,
            render,
            sinks,
            defaulted: Vec::new(),
        };
        let mut bench =
            bench.with_heads(&keys.head, &keys.extra_head, keys.mounting.sensor_from_body().is_given(), &mut check)?;
        bench.tracker_ins =
            check_tracker_ins(&keys.tracker_in, bench.head_count(), bench.link.is_simulated_can(), &mut check)?;
        bench.tracker_outs = check_tracker_outs(&keys.tracker_out, &bench, &mut check)?;
        check_sinks_of_heads(&bench.sinks, &bench.extra_heads, &check)?;
        bench.defaulted = check.defaulted;
        let BenchKeys { spacecraft, plant, event, expect, .. } = keys;
        let named_errors = check.named_errors;
        Ok((bench, BesideBench { plant_kind, spacecraft, plant, event, expect, named_errors }))
    }

    /// Returns the bench with all its heads: those of `[[head]]`, which are all, or the first one and `[[extra_head]]`.
    fn with_heads(
        self,
        all: &[HeadKeys],
        extra: &[HeadKeys],
        has_mounting: bool,
        check: &mut Checker<'_>,
    ) -> Result<Self> {
        if all.is_empty() {
            let extra_heads = check_heads("extra_head", extra, HEADS_MAX - 1, &self.first_head(), check)?;
            return Ok(Self { extra_heads, ..self });
        }
        check.unused("extra_head", !extra.is_empty(), "a bench without [[head]], which lists all of them")?;
        check.unused("mounting.sensor_from_body", has_mounting, "a bench without [[head]], which says it for each")?;
        let heads = check_heads("head", all, HEADS_MAX, &self.first_head(), check)?;
        Ok(self.of_heads(heads))
    }
}

/// Contents of a bench file beside the bench, unchecked.
#[derive(Debug)]
pub(super) struct BesideBench {
    pub(super) plant_kind: PlantKind,
    pub(super) spacecraft: Option<String>,
    pub(super) plant: PlantKeys,
    pub(super) event: Vec<EventKeys>,
    pub(super) expect: ExpectKeys,
    /// Errors of files that the bench names.
    pub(super) named_errors: Vec<ConfigError>,
}

/// Returns whether the first sink is a display with a calibration.
fn is_drawn_for_display(sinks: &[SinkSettings]) -> bool {
    matches!(sinks, [SinkSettings { sink: Sink::Display(display), .. }, ..] if display.calibration.is_some())
}

impl Bench {
    /// Returns the seed of the noise of exposures: the one that is given, or the run's.
    pub fn noise_seed(&self) -> u64 {
        self.noise_seed_given.unwrap_or(self.seed)
    }

    /// Returns the first head.
    pub fn first_head(&self) -> Head {
        let Self { sensor_from_body, ref camera, timing: Timing { frame_rate_hz, phase, .. }, .. } = *self;
        Head { sensor_from_body, camera: camera.clone(), frame_rate_hz, phase }
    }

    /// Returns how many heads there are, 1 at least.
    pub fn head_count(&self) -> usize {
        1 + self.extra_heads.len()
    }

    /// Returns how each head is mounted, the first one first.
    pub fn mountings(&self) -> Vec<Rotation<Sensor, Body>> {
        core::iter::once(self.sensor_from_body)
            .chain(self.extra_heads.iter().map(|head| head.sensor_from_body))
            .collect()
    }

    /// Returns the bench with these heads and no others; as it is when there are none.
    #[must_use]
    pub fn of_heads(mut self, heads: Vec<Head>) -> Self {
        let mut heads = heads.into_iter();
        let Some(first) = heads.next() else { return self };
        self.sensor_from_body = first.sensor_from_body;
        self.camera = first.camera;
        (self.timing.frame_rate_hz, self.timing.phase) = (first.frame_rate_hz, first.phase);
        self.extra_heads = heads.collect();
        self
    }

    /// Returns the bench as the head of this number is drawn from it: its camera, mounting and rate, and patterns and
    /// noise of its own.
    pub fn of_head(&self, number: usize) -> Self {
        let own = |seed: u64| seed.wrapping_add(number as u64);
        let mut bench = Self { seed: own(self.seed), noise_seed_given: self.noise_seed_given.map(own), ..self.clone() };
        if let Some(head) = number.checked_sub(1).and_then(|place| self.extra_heads.get(place)) {
            bench.sensor_from_body = head.sensor_from_body;
            bench.camera.clone_from(&head.camera);
            (bench.timing.frame_rate_hz, bench.timing.phase) = (head.frame_rate_hz, head.phase);
        }
        bench
    }
}

/// Returns the camera of the first head: its own, that of the bench, or the built-in one.
fn camera(keys: &BenchKeys, check: &mut Checker<'_>) -> Result<Camera> {
    if let Some(path) = keys.head.first().and_then(|head| head.camera().raw()) {
        let camera = Camera::partly(&check.document.named("head[0].camera", path)?)?;
        return Ok(check.take(camera));
    }
    match keys.camera().raw() {
        Some(path) => {
            let camera = Camera::partly(&check.document.named("camera", path)?)?;
            Ok(check.take(camera))
        }
        None => {
            check.note("camera", format!("built-in {BUILT_IN_CAMERA}"));
            Camera::from_document(&Document::built_in(BUILT_IN_CAMERA)?)
        }
    }
}

fn mounting(keys: &MountingKeys, check: &mut Checker<'_>) -> Result<Rotation<Sensor, Body>> {
    let given = keys.sensor_from_body();
    match given.raw() {
        Some(wxyz) => quaternion(&given.key(), *wxyz, check),
        None => given.check(check).map(|_| Rotation::IDENTITY),
    }
}

/// Returns the targets of a bench, and the rule for pixels where they cover stars.
fn targets_of(keys: &BenchKeys, duration_s: f64, check: &mut Checker<'_>) -> Result<(Vec<TargetSettings>, Overlap)> {
    let targets = check_targets(&keys.target, check)?;
    check_seen(&targets, duration_s, check)?;
    let overlap = if targets.is_empty() {
        keys.refuse(&["target_overlap"], "a bench with a [[target]]", check)?;
        Overlap::default()
    } else {
        keys.target_overlap().check(check)?
    };
    Ok((targets, overlap))
}
