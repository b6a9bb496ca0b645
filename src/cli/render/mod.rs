//! `starloop render`: one image for a given attitude and time.

pub mod input;
pub mod output;

use crate::cli::check::camera::{left_out, seen_mag};
use crate::cli::named::{
    KernelArgs, declination_deg, drawn_text, named_camera, one_of, right_ascension_deg, warn_of_wcs,
};
use crate::cli::render::input::{Series, four, numbered, read_los, read_los_samples, read_sources, three};
use crate::cli::render::output::{Format, WrittenImage, format_of, write_dn, write_electrons, write_truth};
use crate::cli::{frame_plan::over_budget_text, report_json::print_json, run::args::BACKENDS};
use anyhow::{Context, Result, bail};
use base::axes::{Icrf, Rotation, Sensor, WRITTEN_NORM_TOLERANCE, sensor_from_ra_dec_roll};
use base::least_squares::median;
use base::time::{Span, Tai};
use batch::still::{DEFAULT_TIME, MOST_DEG_PER_S, Still, StillParams, still_fault};
use clap::{Args, ValueEnum};
use config::{Backend, Bench, Document, Scenario, StartTime};
use frames::report::Stage;
use frames::sink::{FrameFault, SentFrame};
use glam::DVec3;
use plan::attitude::LosPath;
use plan::exposure::{MethodChoice, Motion, Source};
use run::{runtime::engine::Light, wiring::memory::RunMemory};
use sky::astrometry::PROVEN_YEARS;
use std::path::{Path, PathBuf};

/// Command line of `render`.
#[derive(Debug, Args)]
pub struct RenderArgs {
    /// Camera or bench file (TOML), or the name of a built-in one, such as cameras/star_tracker_20deg.toml
    #[arg(long, value_name = "FILE", required_unless_present = "bench")]
    camera: Option<PathBuf>,
    /// Bench file (TOML), or the name of a built-in one, such as benches/moon.toml: its camera unless --camera is
    /// given, and its observer, bodies, targets, layers of stars, accuracy and seeds
    #[arg(long, value_name = "FILE")]
    bench: Option<PathBuf>,
    /// Fault of the image, as the keys of an event: 'do = "stray_light", e_per_s = 200'; may be repeated
    #[arg(long = "fault", value_name = "KEYS")]
    faults: Vec<String>,
    /// Right ascension of the boresight, degrees (ICRF)
    #[arg(long, value_name = "DEG", allow_hyphen_values = true, requires = "dec", conflicts_with = "attitude", value_parser = right_ascension_deg)]
    ra: Option<f64>,
    /// Declination of the boresight, degrees (ICRF)
    #[arg(long, value_name = "DEG", allow_hyphen_values = true, requires = "ra", value_parser = declination_deg)]
    dec: Option<f64>,
    /// Position angle of the image's up direction (towards row 0), east of north, degrees [default: 0, north up, east
    /// left]
    #[arg(long, value_name = "DEG", allow_hyphen_values = true, requires = "ra")]
    roll: Option<f64>,
    /// Attitude quaternion `sensor_from_icrf`: Hamilton, scalar first, passive (v_sensor = q v_icrf q*)
    #[arg(long, value_name = "W,X,Y,Z", allow_hyphen_values = true, value_parser = four)]
    attitude: Option<[f64; 4]>,
    /// File of attitudes of the sensor (CCSDS AEM, STK .a, table with a header, SPICE CK): one image for every row,
    /// named by --out with a number, its truth table beside it; times from a zero of the file's own count from --time
    #[arg(long, value_name = "FILE", conflicts_with_all = ["attitude", "ra", "rate", "los", "los_samples", "truth", "timing"])]
    attitudes: Option<PathBuf>,
    /// Seconds from image to image of --attitudes, in place of its rows
    #[arg(long, value_name = "S", requires = "attitudes", value_parser = step_s)]
    every: Option<f64>,
    #[command(flatten)]
    kernels: KernelArgs,
    /// Middle of the exposure, UTC; a time without a zone, or a date alone, is UTC too (default: 2026-01-01T00:00:00Z,
    /// or the start of --bench)
    #[arg(long, value_name = "RFC3339", value_parser = Tai::from_rfc3339)]
    time: Option<Tai>,
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
    #[arg(long, value_parser = one_of(BACKENDS), default_value = "auto")]
    backend: Backend,
    /// Method for motion: auto, static, gaussian, gauss-legendre[:N], segments[:N], corners[:N], samples[:N],
    /// effective-psf[:N], zonal-psf[:N]
    #[arg(long, value_name = "NAME", default_value = "auto")]
    method: MethodChoice,
    /// Seed of the sensor: its fixed patterns and the places of its defects (default: 1, or that of --bench)
    #[arg(long)]
    seed: Option<u64>,
    /// Seed of the exposure's noise (default: that of the sensor)
    #[arg(long)]
    noise_seed: Option<u64>,
    /// Number of the exposure: with the noise seed it fixes the noise, so that one sensor can be exposed many times
    #[arg(long, value_name = "N", default_value_t = 0)]
    frame: u32,
    /// Write the truth table (CSV): where each star is and how much light of it; src/guide/first_frames.md lists its
    /// columns
    #[arg(long, value_name = "FILE.csv")]
    truth: Option<PathBuf>,
    /// Print milliseconds per stage (median of several after a warm-up of 50 ms) as one JSON line
    #[arg(long)]
    timing: bool,
    /// Print what was written as one line of JSON
    #[arg(long, conflicts_with = "attitudes")]
    json: bool,
    /// Image to write: .fits (numbers) or .png (for people)
    #[arg(long, value_name = "FILE.fits|FILE.png")]
    out: PathBuf,
}

/// A stage of the chain, by name.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
enum StageName {
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
    let bench = arguments.bench()?;
    let layers_mb = (!bench.layers.is_empty()).then_some(bench.star_memory_mb);
    RunMemory::of_image(&bench.camera, arguments.backend == Backend::Reference, layers_mb).check()?;
    let time = arguments.time(&bench)?;
    let read = |path| Series::read(path, &arguments.kernels, time, arguments.every);
    let series = arguments.attitudes.as_deref().map(read).transpose()?;
    let mut scene = Scene::new(arguments, (&bench, time), series.as_ref())?;
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
        write_truth(path, scene.frame())?;
    }
    let written = scene.written(arguments, bench.camera.fov_deg())?;
    if arguments.json {
        return print_json("render", &written);
    }
    match &written.timing {
        Some(timing) => {
            eprintln!("{}", written.line());
            println!("{timing}");
        }
        None => println!("{}", written.line()),
    }
    Ok(())
}

/// Draws and writes every image: `name_000000.fits` and `name_000000.truth.csv` for `name.fits`.
fn draw_all(arguments: &RenderArgs, scene: &mut Scene, series: &Series, format: Format) -> Result<()> {
    for number in 0..series.len() {
        scene.aim(series, number)?;
        scene.draw(arguments.stage)?;
        scene.warn_of_error();
        let path = numbered(&arguments.out, number)?;
        scene.write(&path, arguments.stage, format)?;
        write_truth(&path.with_extension("truth.csv"), scene.frame())?;
    }
    println!(
        "{} images, the last {}",
        series.len(),
        numbered(&arguments.out, series.len().saturating_sub(1))?.display()
    );
    Ok(())
}

impl RenderArgs {
    /// Returns the bench whose sky, observer, bodies and targets are drawn: the one that was named, or the built-in one
    /// without any of these, with the camera that was named.
    fn bench(&self) -> Result<Bench> {
        let mut bench = match &self.bench {
            Some(path) => Scenario::from_document(&Document::open(path)?)?.bench,
            // Nothing but the stars, from the centre of the Earth: the defaults of an empty file.
            None => Bench::from_document(&Document::from_text("", Path::new("a bench without keys")))?,
        };
        if let Some(camera) = &self.camera {
            bench.camera = named_camera(Some(camera))?;
        }
        if !self.layers.is_empty() {
            bench.layers.clone_from(&self.layers);
        }
        (bench.render.backend, bench.render.method) = (self.backend, self.method);
        let seed = self.seed.unwrap_or(if self.bench.is_some() { bench.seed } else { 1 });
        let noise_seed = self.noise_seed.or(bench.noise_seed_given.filter(|_| self.seed.is_none()));
        (bench.seed, bench.noise_seed_given) = (seed, Some(noise_seed.unwrap_or(seed)));
        Ok(bench)
    }

    /// Returns the middle of the exposure: as given, or the start of the bench, or a day without meaning.
    fn time(&self, bench: &Bench) -> Result<Tai> {
        match (self.time, &self.bench, &bench.timing.start) {
            (Some(time), _, _) => Ok(time),
            (None, Some(_), StartTime::At(start)) => Ok(*start),
            (None, Some(_), StartTime::Now | StartTime::Plant) => {
                bail!("--time: the bench starts now, or with its plant; give the instant of the image")
            }
            (None, None, _) => Tai::from_rfc3339(DEFAULT_TIME).map_err(anyhow::Error::msg),
        }
    }
}

/// Returns seconds from image to image.
fn step_s(text: &str) -> Result<f64, String> {
    let step_s = text.parse::<f64>().ok().filter(|step_s| step_s.is_finite() && *step_s > 0.0);
    step_s.ok_or_else(|| format!("got \"{text}\", wanted seconds above 0"))
}

/// Everything one image needs.
struct Scene {
    still: Still,
    motion: Motion,
    /// In place of those of the sky.
    sources: Option<Vec<Source>>,
    /// False for sources in pixels without an attitude.
    has_attitude: bool,
    number: u32,
}

impl Scene {
    fn new(arguments: &RenderArgs, (bench, time): (&Bench, Tai), series: Option<&Series>) -> Result<Self> {
        let span = series.map_or([time; 2], Series::span);
        let faults: Vec<FrameFault> =
            arguments.faults.iter().map(|keys| still_fault(keys)).collect::<Result<_, _>>()?;
        let still = Still::new(&StillParams { bench, span, faults: &faults })?;
        let exposure_s = still.params().camera.exposure_s;
        let motion = match series {
            Some(series) => Motion { los: series.los(0, exposure_s)?.0, image_path: None },
            None => motion(arguments, time, exposure_s)?,
        };
        let sources = arguments.sources.as_deref().map(read_sources).transpose()?;
        if sources.is_none() {
            let limiting_mag = still.params().camera.limiting_mag;
            notes(span[0], limiting_mag, still.faintest_mag).iter().for_each(|note| eprintln!("{note}"));
            let (drawn, faintest) = (f64::from(limiting_mag), f64::from(still.faintest_mag));
            let seen = seen_mag(still.params()).filter(|_| drawn <= faintest);
            let what = seen.and_then(|seen| left_out(&bench.camera.radiometry, [drawn, faintest, seen]));
            what.iter().for_each(|what| eprintln!("note: {what}"));
            if bench.camera.radiometry.limiting_mag.is_none() {
                eprintln!("note: {}", drawn_text(&bench.camera, limiting_mag));
            }
        }
        let has_attitude = arguments.ra.is_some() || arguments.attitude.is_some() || series.is_some();
        Ok(Self { still, motion, sources, has_attitude, number: arguments.frame })
    }

    /// Points the camera as image `number` of a series, whose noise it has.
    fn aim(&mut self, series: &Series, number: usize) -> Result<()> {
        self.motion.los = series.los(number, self.still.params().camera.exposure_s)?.0;
        self.number = u32::try_from(number)?;
        Ok(())
    }

    /// Returns the latest image with its truth.
    fn frame(&self) -> &SentFrame {
        self.still.frame()
    }

    /// Draws up to `stage`; returns the wall times of sky, plan, render, detector.
    fn draw(&mut self, stage: StageName) -> Result<[Span; 4]> {
        let is_on_sky = self.has_attitude;
        let light = match &self.sources {
            Some(sources) => Light::Sources { sources, is_on_sky },
            None => Light::Sky,
        };
        let times = match stage {
            StageName::Electrons => self.still.draw_mean(&self.motion, light, self.number)?,
            StageName::Dn => self.still.draw(&self.motion, light, self.number)?,
        };
        let sum = |stages: &[Stage]| stages.iter().filter_map(|stage| times.get(*stage)).fold(Span::ZERO, |a, b| a + b);
        let render = sum(&[Stage::Upload, Stage::Render]);
        Ok([sum(&[Stage::Sky]), sum(&[Stage::Plan]), render, sum(&[Stage::Detector, Stage::Readback])])
    }

    /// Prints what is over the budget, and by how much.
    fn warn_of_error(&self) {
        let plan = self.still.plan();
        if let Some(words) = over_budget_text(plan, &self.still.params().budget) {
            let who =
                if self.still.imager().is_exact() { "the reference".into() } else { plan.chosen.method.to_string() };
            eprintln!("WARNING: {who}: {words}");
        }
    }

    /// Warns of a map to the sky that is worse than promised.
    fn warn_of_wcs(&self) {
        self.frame().meta.wcs.iter().for_each(|wcs| warn_of_wcs(wcs.error_px));
    }

    /// Writes the latest image.
    fn write(&self, path: &Path, stage: StageName, format: Format) -> Result<()> {
        match stage {
            StageName::Dn => write_dn(path, format, self.frame())?,
            StageName::Electrons => write_electrons(path, format, &self.still.mean(), &self.frame().meta)?,
        };
        Ok(())
    }

    /// Returns the median wall times as one JSON line.
    fn time(&mut self, stage: StageName) -> Result<serde_json::Value> {
        const MOST_REPEATS: usize = 21;
        const LONG_ENOUGH_S: f64 = 5.0;
        /// Until the system has given threads that have just started a processor each.
        const WARM_UP_S: f64 = 0.05;
        let mut repeats: Vec<[f64; 4]> = Vec::new();
        let mut total_s = 0.0;
        while total_s < WARM_UP_S {
            total_s += self.draw(stage)?.iter().map(|span| span.s()).sum::<f64>();
        }
        total_s = 0.0;
        while repeats.len() < MOST_REPEATS && (repeats.len() < 3 || total_s < LONG_ENOUGH_S) {
            let times = self.draw(stage)?.map(Span::ms);
            total_s += times.iter().sum::<f64>() * 1e-3;
            repeats.push(times);
        }
        let median_of = |part: &dyn Fn(&[f64; 4]) -> f64| median(&mut repeats.iter().map(part).collect::<Vec<_>>());
        let [sky, plan, render, detector] = core::array::from_fn(|i| median_of(&|times| times[i]));
        let total = median_of(&|times| times.iter().sum());
        let (imager, latest) = (self.still.imager(), self.still.plan());
        Ok(serde_json::json!({
            "backend": imager.name(),
            "device": imager.description(),
            "method": latest.chosen.method.to_string(),
            "stars": latest.stars.len(),
            "sky_ms": sky,
            "plan_ms": plan,
            "render_ms": render,
            "detector_ms": detector,
            "total_ms": total,
            "repeats": repeats.len(),
        }))
    }

    /// Returns what was written, with times where they were asked for.
    fn written(&mut self, arguments: &RenderArgs, fov_deg: [f64; 2]) -> Result<WrittenImage> {
        let timing = arguments.timing.then(|| self.time(arguments.stage)).transpose()?;
        let camera = &self.still.params().camera;
        let output = match arguments.stage {
            StageName::Electrons => camera.whole_sensor(),
            StageName::Dn => camera.output(),
        };
        let plan = self.still.plan();
        Ok(WrittenImage {
            image: arguments.out.clone(),
            truth: arguments.truth.clone(),
            camera: camera.name.to_string(),
            width_px: output.size_px[0],
            height_px: output.size_px[1],
            fov_deg,
            exposure_s: camera.exposure_s,
            stars: plan.stars.len(),
            method: plan.chosen.method.to_string(),
            backend: self.still.imager().name(),
            timing,
        })
    }
}

/// Returns the motion of the image during the exposure.
fn motion(arguments: &RenderArgs, time: Tai, exposure_s: f64) -> Result<Motion> {
    let start = time - Span::from_s(0.5 * exposure_s);
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
        _ => bail!(
            "--ra and --dec are missing; wanted --ra and --dec (and --roll), or --attitude, --attitudes or --sources"
        ),
    }
}

// Notes of `render` about input that is legal, and often a mistake.

/// Returns what a person should know: a time for which places are not proven, a camera that sees more than the sky has.
pub(crate) fn notes(at: Tai, limiting_mag: f32, faintest_mag: f32) -> Vec<String> {
    let mut notes = Vec::new();
    let year = 2000.0 + at.years_since_j2000();
    let [first, last] = PROVEN_YEARS;
    if !(first..=last).contains(&year) {
        notes.push(format!(
            "note: {} is outside {first} to {last}, for which places are proven to 1 mas",
            at.to_rfc3339()
        ));
    }
    if limiting_mag > faintest_mag {
        notes.push(format!(
            "note: the camera is drawn to G = {limiting_mag}, but the catalog ends at G = {faintest_mag:.1}; --layer adds \
             fainter stars"
        ));
    }
    notes
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn unusual_input_is_noted_and_usual_input_is_not() {
        let at = |text: &str| Tai::from_rfc3339(text).unwrap();
        assert!(notes(at("2026-01-01T00:00:00Z"), 8.5, 8.5).is_empty());
        let both = notes(at("2226-01-01T00:00:00Z"), 17.0, 8.5);
        assert_eq!(both.len(), 2, "{both:?}");
        assert!(both[0].contains("2226") && both[1].contains("G = 17,") && both[1].contains("8.5"), "{both:?}");
    }
}
