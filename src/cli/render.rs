//! `starloop render`: one image for a given attitude and time.

use crate::cli::attitude_file::KernelArgs;
use crate::cli::degrees::{declination_deg, right_ascension_deg};
use crate::cli::named_camera::named_camera;
use crate::cli::over_budget::over_budget_reported;
use crate::cli::render_input::{four, read_los, read_los_samples, read_sources, three};
use crate::cli::render_notes::notes;
use crate::cli::render_output::{Format, format_of, write_dn, write_electrons, write_truth};
use crate::cli::render_series::{Series, draw_all};
use crate::cli::run_args::BackendName;
use crate::cli::wcs_warning::warn_of_wcs;
use anyhow::{Context, Result, bail};
use base::accuracy::AccuracyBudget;
use base::axes::{Icrf, Rotation, Sensor, WRITTEN_NORM_TOLERANCE, sensor_from_ra_dec_roll};
use base::clock::Stopwatch;
use base::time::{Span, Tai};
use clap::{Args, ValueEnum};
use config::STAR_MEMORY_MB;
use frames::sink::SentFrame;
use glam::DVec3;
use image::detector::binning::Levels;
use image::detector::window::OutputGeometry;
use image::detector::{DetectorConditions, Seeds};
use plan::attitude::LosPath;
use plan::exposure::{ExposurePlan, MethodChoice, Motion, Planner, Source};
use run::runtime::Imager;
use run::runtime::engine::fill_meta;
use run::wiring::bench_parts::backend_choice;
use run::wiring::camera_parts::camera_params;
use run::wiring::memory::RunMemory;
use scene::SceneParams;
use scene::camera::CameraParams;
use scene::field_light::illumination_map;
use scene::truth::fill_truth;
use scene::wcs::WcsMaker;
use sky::almanac::Almanac;
use sky::astrometry::{Sight, Vantage};
use sky::observer::Observer;
use stars::Sky;
use std::path::{Path, PathBuf};

/// Command line of `render`.
#[derive(Debug, Args)]
pub struct RenderArgs {
    /// Camera or bench file (TOML), or the name of a built-in one, such as cameras/star_tracker_20deg.toml
    #[arg(long, value_name = "FILE")]
    camera: PathBuf,
    /// Right ascension of the boresight, degrees (ICRF)
    #[arg(long, value_name = "DEG", allow_hyphen_values = true, requires = "dec", conflicts_with = "attitude", value_parser = right_ascension_deg)]
    ra: Option<f64>,
    /// Declination of the boresight, degrees (ICRF)
    #[arg(long, value_name = "DEG", allow_hyphen_values = true, requires = "ra", value_parser = declination_deg)]
    dec: Option<f64>,
    /// Position angle of the image's up direction (towards row 0), east of north, degrees [default: 0, north up, east left]
    #[arg(long, value_name = "DEG", allow_hyphen_values = true, requires = "ra")]
    roll: Option<f64>,
    /// Attitude quaternion `sensor_from_icrf`: Hamilton, scalar first, passive (v_sensor = q v_icrf q*)
    #[arg(long, value_name = "W,X,Y,Z", allow_hyphen_values = true, value_parser = four)]
    attitude: Option<[f64; 4]>,
    /// File of attitudes of the sensor (CCSDS AEM, STK .a, table with a header, SPICE CK): one image for every row, named by --out with a
    /// number, its truth table beside it; times from a zero of the file's own count from --time
    #[arg(long, value_name = "FILE", conflicts_with_all = ["attitude", "ra", "rate", "los", "los_samples", "truth", "timing"])]
    attitudes: Option<PathBuf>,
    /// Seconds from image to image of --attitudes, in place of its rows
    #[arg(long, value_name = "S", requires = "attitudes", value_parser = step_s)]
    every: Option<f64>,
    #[command(flatten)]
    kernels: KernelArgs,
    /// Middle of the exposure, UTC; a time without a zone, or a date alone, is UTC too
    #[arg(long, value_name = "RFC3339", default_value = "2026-01-01T00:00:00Z", value_parser = Tai::from_rfc3339)]
    time: Tai,
    /// Angular rate of the sensor with respect to ICRF, sensor axes, deg/s
    #[arg(long, value_name = "X,Y,Z", allow_hyphen_values = true, value_parser = three)]
    rate: Option<[f64; 3]>,
    /// Displacement of the image on the detector during the exposure: t_s,dx_px,dy_px,roll_arcsec, linear between rows
    #[arg(long, value_name = "FILE.csv", conflicts_with = "los_samples")]
    los: Option<PathBuf>,
    /// The same as a list of equally weighted positions: dx_px,dy_px,roll_arcsec
    #[arg(long, value_name = "FILE.csv")]
    los_samples: Option<PathBuf>,
    /// Sources in place of the catalog: x_px,y_px,electrons (places at mid-exposure, electrons per exposure)
    #[arg(long, value_name = "FILE.csv")]
    sources: Option<PathBuf>,
    /// Layer of stars in place of the built-in catalog, as `starloop catalog import` writes it; may be repeated
    #[arg(long = "layer", value_name = "FILE.starlayer", conflicts_with = "sources")]
    layers: Vec<PathBuf>,
    /// Output: mean electrons before the detector, or the digital numbers it reads out
    #[arg(long, value_enum, default_value_t = StageName::Dn)]
    stage: StageName,
    /// Backend
    #[arg(long, value_enum, default_value_t = BackendName::Auto)]
    backend: BackendName,
    /// Method for motion: auto, static, gaussian, gauss-legendre[:N], segments[:N], samples[:N], effective-psf[:N], zonal-psf[:N]
    #[arg(long, value_name = "NAME", default_value = "auto")]
    method: MethodChoice,
    /// Seed of the sensor: its fixed patterns and the places of its defects
    #[arg(long, default_value_t = 1)]
    seed: u64,
    /// Seed of the exposure's noise (default: that of the sensor)
    #[arg(long)]
    noise_seed: Option<u64>,
    /// Number of the exposure: with the noise seed it fixes the noise, so that one sensor can be exposed many times
    #[arg(long, value_name = "N", default_value_t = 0)]
    frame: u32,
    /// Write the truth table (CSV): where each star is and how much light of it; src/guide/first_frames.md lists its columns
    #[arg(long, value_name = "FILE.csv")]
    truth: Option<PathBuf>,
    /// Print milliseconds per stage (median of several after a warm-up) as one JSON line
    #[arg(long)]
    timing: bool,
    /// Image to write: .fits (numbers) or .png (for people)
    #[arg(long, value_name = "FILE.fits|FILE.png")]
    out: PathBuf,
}

/// A stage of the chain, by name.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub(super) enum StageName {
    /// Mean electrons before the detector: f32, f64 from the reference
    Electrons,
    /// Digital numbers
    Dn,
}

/// Runs the command.
///
/// # Errors
/// With what could not be done, and why.
pub fn run(arguments: &RenderArgs) -> Result<()> {
    let format = format_of(&arguments.out)?;
    let camera = named_camera(Some(&arguments.camera))?;
    let layers_mb = (!arguments.layers.is_empty()).then_some(STAR_MEMORY_MB);
    RunMemory::of_image(&camera, arguments.backend == BackendName::Reference, layers_mb).check()?;
    let camera = camera_params(&camera)?;
    let read = |path| Series::read(path, &arguments.kernels, arguments.time, arguments.every);
    let series = arguments.attitudes.as_deref().map(read);
    let series = series.transpose()?;
    let mut scene = Scene::new(arguments, camera, series.as_ref())?;
    if let Some(note) = scene.imager.note() {
        eprintln!("{note}");
    }
    if let Some(series) = &series {
        return draw_all(arguments, &mut scene, series, format);
    }
    scene.draw(arguments.stage)?;
    scene.warn_of_error();
    if format == Format::Fits {
        scene.warn_of_wcs();
    }
    scene.write(&arguments.out, arguments.stage, format)?;
    if let Some(path) = &arguments.truth {
        write_truth(path, &scene.frame)?;
    }
    if arguments.timing {
        println!("{}", scene.time(arguments.stage)?);
    }
    Ok(())
}

impl RenderArgs {
    /// Returns what is written.
    pub(super) fn stage(&self) -> StageName {
        self.stage
    }

    /// Returns the image to write.
    pub(super) fn out(&self) -> &Path {
        &self.out
    }
}

/// Returns seconds from image to image.
fn step_s(text: &str) -> Result<f64, String> {
    let step_s = text.parse::<f64>().ok().filter(|step_s| step_s.is_finite() && *step_s > 0.0);
    step_s.ok_or_else(|| format!("got \"{text}\", wanted seconds above 0"))
}

/// Everything one image needs.
pub(super) struct Scene {
    camera: CameraParams,
    planner: Planner,
    imager: Imager,
    scene: scene::Scene,
    /// Effect of the observer on directions; `None` without an attitude.
    sight: Option<Sight>,
    /// Maps the image to the sky.
    wcs: Option<WcsMaker>,
    /// In place of those of the scene.
    sources: Option<Vec<Source>>,
    frame: SentFrame,
    seeds: Seeds,
    number: u32,
}

impl Scene {
    fn new(arguments: &RenderArgs, camera: CameraParams, series: Option<&Series>) -> Result<Self> {
        let size = camera.output().size_px;
        let backend = backend_choice(arguments.backend.configured());
        let sensor = arguments.seed;
        let seeds = Seeds { sensor, noise: arguments.noise_seed.unwrap_or(sensor) };
        let mut imager = Imager::of_detector(backend, camera.make_detector(seeds)?)?;
        if let Some(map) = illumination_map(&camera) {
            imager.set_illumination_map(map)?;
        }
        let [first, last] = series.map_or([arguments.time; 2], Series::span);
        let sky = Sky::open(&arguments.layers, camera.limiting_mag, STAR_MEMORY_MB)?;
        let params = SceneParams {
            camera: &camera,
            observer: &Observer::Geocentre,
            almanac: &Almanac::over(first, last),
            light_deflection: true,
            bodies: false,
            targets: &[],
        };
        let scene = scene::Scene::new(&params, &sky);
        let motion = match series {
            Some(series) => Motion { los: series.los(0, camera.exposure_s)?.0, image_path: None },
            None => motion(arguments, camera.exposure_s)?,
        };
        let instrument = camera.instrument();
        let budget = AccuracyBudget::default();
        let mut planner = Planner::new(instrument, budget, imager.cost(), arguments.method, motion.los.clone());
        if imager.is_exact() {
            planner = planner.exact();
        }
        *planner.motion_mut() = motion;
        let sources = arguments.sources.as_deref().map(read_sources).transpose()?;
        if sources.is_none() {
            notes(first, camera.limiting_mag, sky.layers.magnitudes()[1]).iter().for_each(|note| eprintln!("{note}"));
        }
        let vantage = Vantage::of(scene.stars.observer(), first, true)?;
        let has_attitude = arguments.ra.is_some() || arguments.attitude.is_some() || series.is_some();
        let sight = has_attitude.then(|| vantage.sight());
        let wcs = WcsMaker::new(&camera.geometry, &output_of(arguments.stage, &camera));
        let frame =
            SentFrame::with_capacity(size[0], size[1], sources.as_ref().map_or(0, Vec::len), camera.name.clone());
        Ok(Self { camera, planner, imager, scene, sight, wcs, sources, frame, seeds, number: arguments.frame })
    }

    /// Returns points the camera as image `number` of a series, whose noise it has.
    pub(super) fn aim(&mut self, series: &Series, number: usize) -> Result<()> {
        let (los, at) = series.los(number, self.camera.exposure_s)?;
        self.planner.motion_mut().los = los;
        self.sight = Some(Vantage::of(self.scene.stars.observer(), at, true)?.sight());
        self.number = u32::try_from(number)?;
        Ok(())
    }

    /// Returns the latest image with its truth.
    pub(super) fn frame(&self) -> &SentFrame {
        &self.frame
    }

    /// Finds the sources and plans; the detector's conditions, and the wall time of both.
    fn plan(&mut self) -> Result<(DetectorConditions, [Span; 2])> {
        let mut watch = Stopwatch::start();
        let los = &self.planner.latest().motion.los;
        let report = self.scene.find(los, self.sources.is_none())?;
        let conditions = DetectorConditions::lit(los.exposure_s, report.background);
        let sky = watch.lap();
        self.planner.plan(self.sources.as_deref().unwrap_or_else(|| self.scene.sources()));
        Ok((conditions, [sky, watch.lap()]))
    }

    /// Draws up to `stage`; wall times: sky, plan, render, detector.
    pub(super) fn draw(&mut self, stage: StageName) -> Result<[Span; 4]> {
        let (conditions, [sky, planning]) = self.plan()?;
        let plan: &ExposurePlan = self.planner.latest();
        let mut watch = Stopwatch::start();
        let times = match stage {
            StageName::Electrons => {
                self.imager.render(plan)?;
                [sky, planning, watch.lap(), Span::ZERO]
            }
            StageName::Dn => {
                let times = self.imager.image(plan, self.number, &conditions, &mut self.frame.image)?;
                [sky, planning, times.render, times.detector]
            }
        };
        let output = output_of(stage, &self.camera);
        fill_truth(plan, &output, self.sight.as_ref(), &mut self.frame.truth);
        if self.sight.is_none() {
            // Sources given in pixels, and no attitude: they are nowhere on the sky.
            self.frame.truth.iter_mut().for_each(|row| row.apparent_deg = [f64::NAN; 2]);
        }
        if self.sources.is_none() {
            self.scene.stars.name_stars(&mut self.frame.truth);
        }
        let levels = Levels::of_output(&self.camera.detector);
        fill_meta(plan, self.number, self.seeds, &levels, self.imager.name(), &mut self.frame.meta);
        (self.frame.meta.binning, self.frame.meta.window_px) = (output.binning, output.first_px);
        self.frame.meta.facts = Some(self.camera.facts_of(&levels));
        let attitude = &plan.motion.los.mid_sensor_from_icrf;
        let maker = self.wcs.as_mut().zip(self.sight.as_ref());
        self.frame.meta.wcs = maker.and_then(|(maker, sight)| maker.at(attitude, sight));
        Ok(times)
    }

    /// Says what is over the budget, and by how much.
    pub(super) fn warn_of_error(&self) {
        let plan = self.planner.latest();
        if let Some(words) = over_budget_reported(plan, &AccuracyBudget::default()) {
            let who = if self.imager.is_exact() { "the reference".into() } else { plan.chosen.method.to_string() };
            eprintln!("WARNING: {who}: {words}");
        }
    }

    /// Warns of a map to the sky that is worse than promised.
    fn warn_of_wcs(&self) {
        self.frame.meta.wcs.iter().for_each(|wcs| warn_of_wcs(wcs.error_px));
    }

    /// Writes the latest image.
    pub(super) fn write(&self, path: &Path, stage: StageName, format: Format) -> Result<()> {
        match stage {
            StageName::Dn => write_dn(path, format, &self.frame)?,
            StageName::Electrons => write_electrons(path, format, &self.imager.latest_mean(), &self.frame.meta)?,
        };
        Ok(())
    }

    /// Returns the median wall times as one JSON line.
    fn time(&mut self, stage: StageName) -> Result<String> {
        const MOST_REPEATS: usize = 21;
        const LONG_ENOUGH_S: f64 = 5.0;
        let mut repeats: Vec<[f64; 4]> = Vec::new();
        let mut total_s = 0.0;
        while repeats.len() < MOST_REPEATS && (repeats.len() < 3 || total_s < LONG_ENOUGH_S) {
            let times = self.draw(stage)?.map(Span::ms);
            total_s += times.iter().sum::<f64>() * 1e-3;
            repeats.push(times);
        }
        let median = |mut values: Vec<f64>| {
            values.sort_by(f64::total_cmp);
            values[values.len() / 2]
        };
        let [sky, plan, render, detector] =
            core::array::from_fn(|i| median(repeats.iter().map(|times| times[i]).collect()));
        let total = median(repeats.iter().map(|times| times.iter().sum()).collect());
        Ok(serde_json::json!({
            "backend": self.imager.name(),
            "device": self.imager.description(),
            "method": self.planner.latest().chosen.method.to_string(),
            "stars": self.planner.latest().stars.len(),
            "sky_ms": sky,
            "plan_ms": plan,
            "render_ms": render,
            "detector_ms": detector,
            "total_ms": total,
            "repeats": repeats.len(),
        })
        .to_string())
    }
}

/// Returns where the pixels of an image of this stage are on the sensor.
fn output_of(stage: StageName, camera: &CameraParams) -> OutputGeometry {
    match stage {
        StageName::Electrons => OutputGeometry::whole(camera.sensor_px()),
        StageName::Dn => camera.output(),
    }
}

/// Returns the motion of the image during the exposure.
fn motion(arguments: &RenderArgs, exposure_s: f64) -> Result<Motion> {
    let start = arguments.time - Span::from_s(0.5 * exposure_s);
    let mut los = LosPath::commanded(attitude(arguments)?, start, exposure_s);
    let rate_deg_s = DVec3::from_array(arguments.rate.unwrap_or_default());
    if rate_deg_s.length() > MOST_DEG_PER_S {
        bail!("--rate: got {} deg/s, wanted at most {MOST_DEG_PER_S}", rate_deg_s.length());
    }
    los.rate_rad_s = rate_deg_s * 1_f64.to_radians();
    let image_path = match (&arguments.los, &arguments.los_samples) {
        (Some(path), _) => Some(read_los(path, exposure_s)?),
        (None, Some(path)) => Some(read_los_samples(path)?),
        (None, None) => None,
    };
    Ok(Motion { los, image_path })
}

/// Fastest turn that is drawn, deg/s.
const MOST_DEG_PER_S: f64 = 1000.0;

fn attitude(arguments: &RenderArgs) -> Result<Rotation<Sensor, Icrf>> {
    if let Some(wxyz) = arguments.attitude {
        return Rotation::from_wxyz(wxyz, WRITTEN_NORM_TOLERANCE).with_context(|| {
            let norm = wxyz.iter().map(|v| v * v).sum::<f64>().sqrt();
            format!("--attitude: got a quaternion of norm {norm}, wanted 1 within {WRITTEN_NORM_TOLERANCE}")
        });
    }
    match (arguments.ra, arguments.dec, &arguments.sources) {
        (Some(ra), Some(dec), _) => {
            let roll = arguments.roll.unwrap_or(0.0);
            if !(ra.is_finite() && roll.is_finite() && (-90.0..=90.0).contains(&dec)) {
                bail!("--ra {ra} --dec {dec} --roll {roll}: wanted finite degrees and a declination from -90 to 90");
            }
            Ok(sensor_from_ra_dec_roll(ra.to_radians(), dec.to_radians(), roll.to_radians()))
        }
        // Sources given in pixels need no sky.
        (_, _, Some(_)) => Ok(Rotation::IDENTITY),
        _ => bail!("wanted --ra and --dec (and --roll), or --attitude, --attitudes or --sources"),
    }
}
