//! Files for other tools: `starloop export` and `starloop fmu`.
//!
//! `starloop export`: attitudes, the observer's orbit and places of stars of a run, in the files of other tools.
//!
//! Input: the folder of a recorded run, or a run file, which is not drawn. Output: files whose endings say what
//! they are; one that exists is refused without `--force`.

use anyhow::{Context, Result, bail};
use base::axes::Rotation;
use base::clock::{Clock, Monotonic};
use base::input_file::{DATA_BYTES, InputFile};
use base::time::{Span, Tai};
use clap::Args;
use config::{Bench, Document, Plant, Scenario, StartTime};
use core::fmt::Write as _;
use fmu::{archive::write_unit, description::FmiVersion, worker::serve};
use frames::sink::{frame_log::path_in, truth::read_truth};
use frames::sink::{write_file_atomically, write_new_file};
use histories::write::{AttitudeFormat, Header, OrbitFormat};
use histories::{AttitudeHistory, AttitudeState, Centre, OrbitHistory, OrbitState, read, write};
use run::wiring::{bench_parts, sinks::directory_of_head};
use sky::orbit::CentralBody;
use std::os::{fd::AsFd, unix::net::UnixStream};
use std::path::{Path, PathBuf};
use std::{io, io::Write};
use testbed::flight_computer::FlightComputer;

/// Command line of `export`.
#[derive(Debug, Args)]
#[command(
    after_help = "Endings: attitude .aem (CCSDS AEM, KVN), .xml (AEM 2, XML), .a (STK), .csv; observer .oem, .xml, .e \
                        (STK), .csv; places .csv.\n\nAttitudes are those at mid-exposure, of the sensor's axes (of the body's \
                        with --body), with rates where the format has them; src/guide/files_in_and_out.md has conventions."
)]
pub struct ExportArgs {
    /// Folder of a recorded run, or a bench or scenario file, or the name of a built-in one
    source: PathBuf,
    /// Attitude at mid-exposure of every frame
    #[arg(long, value_name = "FILE")]
    attitude: Option<PathBuf>,
    /// Where the observer is at mid-exposure of every frame, from the centre of the body that it is about
    #[arg(long, value_name = "FILE")]
    observer: Option<PathBuf>,
    /// Apparent and catalog places of the stars of every frame, from the truth tables of a recorded run
    #[arg(long, value_name = "FILE.csv")]
    places: Option<PathBuf>,
    /// Run file of a recorded run: with --observer and --body
    #[arg(long, value_name = "FILE")]
    bench: Option<PathBuf>,
    /// Camera head, counted from 0, whose frames or mounting are meant; needed where a recorded run has several [without it: 0]
    #[arg(long, value_name = "N")]
    head: Option<usize>,
    /// Attitude of the spacecraft's body instead of the sensor's
    #[arg(long)]
    body: bool,
    /// Version of an AEM as KVN: 1 has no rates
    #[arg(long, value_name = "1|2", default_value_t = 2, value_parser = clap::value_parser!(u8).range(1..=2))]
    aem_version: u8,
    /// Name of the object in the files
    #[arg(long, value_name = "NAME", default_value = "STARLOOP")]
    object_name: String,
    /// International designator of the object in the files
    #[arg(long, value_name = "ID", default_value = "UNKNOWN")]
    object_id: String,
    /// Replace files that exist
    #[arg(long)]
    force: bool,
}

/// Runs the command.
///
/// # Errors
/// With what could not be done, and why.
pub fn run(arguments: &ExportArgs) -> Result<()> {
    let attitude = match arguments.attitude.as_deref() {
        Some(path) => Some((path, attitude_format(path, arguments)?)),
        None => None,
    };
    let observer = match arguments.observer.as_deref() {
        Some(path) => Some((path, orbit_format(path)?)),
        None => None,
    };
    if attitude.is_none() && observer.is_none() && arguments.places.is_none() {
        bail!("nothing to write: wanted --attitude FILE, --observer FILE or --places FILE");
    }
    check_words(arguments)?;
    let source = ExportSource::open(&arguments.source, arguments.bench.as_deref(), arguments.head)?;
    let body = if arguments.body { "SC_BODY_1".to_owned() } else { format!("STARTRACKER_{}", source.head + 1) };
    let header = Header {
        object_name: arguments.object_name.clone(),
        object_id: arguments.object_id.clone(),
        body,
        created: Monotonic::start().now(),
    };
    if let Some((path, format)) = attitude {
        let history = source.attitudes(arguments.body)?;
        let rows = history.rows();
        save(path, arguments.force, |out| write::attitudes(out, format, &history, &header))?;
        println!("{}: {rows} attitudes of {}", path.display(), header.body);
    }
    if let Some((path, format)) = observer {
        let orbit = source.observer()?;
        let rows = orbit.rows();
        save(path, arguments.force, |out| write::orbit(out, format, &orbit, &header))?;
        println!("{}: {rows} states from {}", path.display(), orbit.centre.name());
    }
    if let Some(path) = &arguments.places {
        let mut text = String::new();
        let rows = source.write_places(&mut text)?;
        save(path, arguments.force, |out| out.write_all(text.as_bytes()))?;
        println!("{}: {rows} places", path.display());
    }
    Ok(())
}

/// Returns names go into lines of `KEY = VALUE`.
fn check_words(arguments: &ExportArgs) -> Result<()> {
    for (name, word) in [("--object-name", &arguments.object_name), ("--object-id", &arguments.object_id)] {
        if word.trim().is_empty() || word.chars().any(char::is_control) {
            bail!("{name}: got \"{}\", wanted text on one line", word.escape_debug());
        }
    }
    Ok(())
}

fn attitude_format(path: &Path, arguments: &ExportArgs) -> Result<AttitudeFormat> {
    let format = match ending(path).as_str() {
        "aem" | "kvn" if arguments.aem_version == 1 => AttitudeFormat::Aem1,
        "aem" | "kvn" => AttitudeFormat::Aem2,
        "xml" => AttitudeFormat::Aem2Xml,
        "a" => AttitudeFormat::Stk,
        "csv" => AttitudeFormat::Csv,
        _ => bail!("--attitude {}: wanted a name that ends in .aem, .xml, .a or .csv", path.display()),
    };
    if arguments.aem_version == 1 && format != AttitudeFormat::Aem1 {
        bail!("--aem-version 1: wanted a name that ends in .aem, got --attitude {}", path.display());
    }
    Ok(format)
}

fn orbit_format(path: &Path) -> Result<OrbitFormat> {
    match ending(path).as_str() {
        "oem" | "kvn" => Ok(OrbitFormat::Oem),
        "xml" => Ok(OrbitFormat::OemXml),
        "e" => Ok(OrbitFormat::Stk),
        "csv" => Ok(OrbitFormat::Csv),
        _ => bail!("--observer {}: wanted a name that ends in .oem, .xml, .e or .csv", path.display()),
    }
}

fn ending(path: &Path) -> String {
    path.extension().map_or_else(String::new, |ending| ending.to_string_lossy().to_ascii_lowercase())
}

fn save(path: &Path, replaces: bool, write: impl FnOnce(&mut dyn Write) -> io::Result<()>) -> Result<()> {
    let saved = if replaces { write_file_atomically(path, write) } else { write_new_file(path, write) };
    let advice = if replaces { "" } else { " (--force replaces a file that exists)" };
    saved.map(|_| ()).with_context(|| format!("{}{advice}", path.display()))
}

// Sources of attitudes and places for `export`: the folder of a recorded run, or a run file.

/// Attitudes of the sensor with their times, and the run file if there is one.
pub(super) struct ExportSource {
    /// Attitudes of the sensor's axes at mid-exposure.
    states: Vec<AttitudeState>,
    /// The folder of a recorded run.
    folder: Option<PathBuf>,
    scenario: Option<Scenario>,
    pub(super) head: usize,
    first_exposure: Tai,
}

impl ExportSource {
    /// Opens a folder that has a `frames.csv`, or one such folder for each head; or a run file.
    pub(super) fn open(source: &Path, bench: Option<&Path>, head: Option<usize>) -> Result<Self> {
        if source.is_dir() {
            return Self::of_folder(&folder_of_head(source, head)?, bench, head.unwrap_or(0));
        }
        let head = head.unwrap_or(0);
        if bench.is_some() {
            bail!("--bench: got a run file already, {}; it belongs to the folder of a recorded run", source.display());
        }
        let scenario = Scenario::from_document(&Document::open(source)?)?;
        check_head(&scenario.bench, head)?;
        let StartTime::At(start) = scenario.bench.timing.start else {
            bail!(
                "{}: timing.start_utc is \"now\" or \"plant\"; wanted an instant, or the folder of a recorded run",
                source.display()
            )
        };
        let params = bench_parts::run_params(&scenario.bench.of_head(head), start)?;
        match &scenario.plant {
            Plant::FlightComputer | Plant::File(_) => {}
            Plant::Outside | Plant::Vehicle(_) => bail!(
                "{}: its attitude is known only when it has been flown; run it, and export the folder that it records",
                source.display()
            ),
        }
        let zero = bench_parts::run_params(&scenario.bench, start)?.first_exposure;
        let computer = bench_parts::flight_computer_of(&scenario.plant, &scenario.bench, start, zero);
        let (computer, mounting) = (FlightComputer::new(computer), params.attitude.sensor_from_body);
        let half = Span::from_s(0.5 * params.camera.exposure_s);
        let state = |number: u32| {
            let at = params.exposure_start(number) + half;
            let truth = computer.truth(at)?;
            // The sensor's axes in the place of the body's: the history does not know which they are.
            let sensor = Rotation::from_quat((mounting * truth.body_from_icrf).quat());
            let rate_rad_s = Some(mounting.apply(truth.rate_rad_s));
            Some(AttitudeState { t_ns: at.ns(), body_from_icrf: sensor, rate_rad_s })
        };
        let states = (0..params.frames).filter_map(state).collect();
        let first_exposure = params.first_exposure;
        Ok(Self { states, folder: None, scenario: Some(scenario), head, first_exposure })
    }

    fn of_folder(folder: &Path, bench: Option<&Path>, head: usize) -> Result<Self> {
        let path = path_in(folder);
        let text = read::text_of(&path).with_context(|| {
            format!("{}: wanted the folder of a recorded run, with frames.csv (--sink recorder)", folder.display())
        })?;
        let (rising, left_out) = rising_rows(&text);
        if left_out > 0 {
            eprintln!("{left_out} frames that show again what an earlier one shows are left out");
        }
        let history = read::recorded_attitudes(&path.display().to_string(), &rising)?;
        let states: Vec<AttitudeState> =
            history.segments().iter().flat_map(|segment| segment.states().iter().copied()).collect();
        let scenario = bench.map(|bench| anyhow::Ok(Scenario::from_document(&Document::open(bench)?)?)).transpose()?;
        scenario.iter().try_for_each(|scenario| check_head(&scenario.bench, head))?;
        let first = states.first().map_or(0, |state| state.t_ns);
        Ok(Self { states, folder: Some(folder.into()), scenario, head, first_exposure: Tai::from_ns(first) })
    }

    /// Returns the attitudes of the sensor, or of the body.
    pub(super) fn attitudes(&self, of_body: bool) -> Result<AttitudeHistory> {
        let mut states = self.states.clone();
        if of_body {
            let bench = self.bench("--body")?.of_head(self.head);
            let body_from_sensor = bench.sensor_from_body.inverse();
            for state in &mut states {
                let turned = body_from_sensor.quat() * state.body_from_icrf.quat();
                state.body_from_icrf = Rotation::from_quat(turned);
                state.rate_rad_s = state.rate_rad_s.map(|rate| body_from_sensor.apply(rate));
            }
        }
        AttitudeHistory::of_states(states).context("no frame has an attitude: nothing to write")
    }

    /// Returns where the observer is at mid-exposure of every frame.
    pub(super) fn observer(&self) -> Result<OrbitHistory> {
        let bench = self.bench("--observer")?;
        if bench.flight_computer.is_external && (bench.is_lockstep() || bench.link.plain.is_some()) {
            bail!(
                "--observer: the plant of this run is outside and may have sent where the observer is, which frames do not \
                 record; take the orbit from that plant"
            );
        }
        let start = match bench.timing.start {
            StartTime::At(start) => start,
            StartTime::Now | StartTime::Plant => self.first_exposure - Span::from_ms(1000),
        };
        let params = bench_parts::run_params(bench, start)?;

        let centre = match params.observer.about() {
            Some(CentralBody::Earth) => Centre::Earth,
            Some(CentralBody::Moon) => Centre::Moon,
            Some(CentralBody::Sun) => Centre::Sun,
            None => Centre::Barycentre,
        };
        let states = self.states.iter().map(|state| {
            let relative = params.observer.relative_state(Tai::from_ns(state.t_ns))?;
            let (position_km, velocity_km_s) = (relative.position_km, relative.velocity_km_s);
            anyhow::Ok(OrbitState { t_ns: state.t_ns, position_km, velocity_km_s })
        });
        let states = states.collect::<Result<Vec<_>>>()?;
        OrbitHistory::of_states(centre, states).context("fewer than two frames: wanted two for an orbit")
    }

    /// Writes the places of the stars of every frame; returns how many.
    pub(super) fn write_places(&self, text: &mut String) -> Result<usize> {
        let folder = self.folder.as_ref().context("--places: wanted the folder of a recorded run with truth tables")?;
        writeln!(
            text,
            "mid_exposure_utc,id,source_id,kind,apparent_ra_deg,apparent_dec_deg,catalog_ra_deg,catalog_dec_deg,mag,x_px,y_px"
        )?;
        let frames = InputFile::open(&path_in(folder), DATA_BYTES)?;
        let mut reader = csv::Reader::from_reader(frames);
        let header = reader.headers()?.clone();
        let column =
            |name: &str| header.iter().position(|column| column == name).with_context(|| format!("no column {name}"));
        let (number, time) = (column("frame")?, column("mid_exposure_utc")?);
        let mut rows = 0;
        for record in reader.records() {
            let record = record?;
            let frame: u32 = record.get(number).unwrap_or_default().parse().context("frames.csv: column frame")?;
            let path = folder.join(format!("frame_{frame:06}.truth.csv"));
            let file =
                InputFile::open(&path, DATA_BYTES).with_context(|| format!("{}: no truth table", path.display()))?;
            let stars = read_truth(file).with_context(|| path.display().to_string())?;
            for star in stars {
                let [[a, b], [c, d]] = [star.apparent_deg, star.catalog_deg];
                let name = star.source_id.map_or_else(String::new, |name| name.to_string());
                let utc = record.get(time).unwrap_or_default();
                let (kind, mag) = (star.kind.name(), star.mag);
                writeln!(
                    text,
                    "{utc},{},{name},{kind},{},{},{},{},{},{},{}",
                    star.id,
                    Known(a),
                    Known(b),
                    Known(c),
                    Known(d),
                    Known(f64::from(mag)),
                    Known(star.x_px),
                    Known(star.y_px)
                )?;
                rows += 1;
            }
        }
        Ok(rows)
    }

    fn bench(&self, option: &str) -> Result<&Bench> {
        let scenario = self.scenario.as_ref();
        let advice = "wanted the run file of this recording too: --bench FILE";
        scenario.map(|scenario| &scenario.bench).with_context(|| format!("{option}: {advice}"))
    }
}

/// Returns the folder with the frames of a head: that of the run, or below it where the run has several.
fn folder_of_head(run: &Path, head: Option<usize>) -> Result<PathBuf> {
    let is_recorded = |folder: &Path| path_in(folder).is_file();
    let heads = (0..).take_while(|&head| is_recorded(&directory_of_head(run, Some(head)))).count();
    if is_recorded(run) || heads == 0 {
        return Ok(run.into());
    }
    match head {
        Some(head) if head < heads => Ok(directory_of_head(run, Some(head))),
        Some(head) => bail!("--head: got {head}, wanted less than {heads}, the number of heads of {}", run.display()),
        None => {
            bail!("{}: recorded by {heads} heads; wanted one of them: --head 0 to --head {}", run.display(), heads - 1)
        }
    }
}

/// A number, or nothing where it is not finite.
struct Known(f64);

impl core::fmt::Display for Known {
    fn fmt(&self, f: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        if self.0.is_finite() { write!(f, "{}", self.0) } else { Ok(()) }
    }
}

fn check_head(bench: &Bench, head: usize) -> Result<()> {
    let count = bench.head_count();
    if head < count { Ok(()) } else { bail!("--head: got {head}, wanted less than {count}, the number of heads") }
}

/// Returns the lines whose time is after that of the lines before them, with the header; and how many are left out. A
/// frame that is held shows an earlier time again.
fn rising_rows(text: &str) -> (String, usize) {
    let column =
        text.lines().next().and_then(|header| header.split(',').position(|name| name == "mid_exposure_tai_ns"));
    let (mut kept, mut left_out, mut last_ns) = (String::new(), 0, i64::MIN);
    for (line, place) in text.lines().zip(0..) {
        let t_ns = column.and_then(|column| line.split(',').nth(column)?.parse::<i64>().ok());
        if place > 0 && t_ns.is_some_and(|t_ns| t_ns <= last_ns) {
            left_out += 1;
            continue;
        }
        last_ns = t_ns.unwrap_or(last_ns);
        kept.push_str(line);
        kept.push('\n');
    }
    (kept, left_out)
}

// `starloop fmu`: a run file as a co-simulation unit, for simulators that import such units.

/// Command line of `fmu`.
#[derive(Debug, Args)]
#[command(after_help = "\
Inputs: attitude, rate, acceleration, jitter, position and velocity, triggers. Outputs: frames, true attitude, star tracker.\n\
Frames and tables go to the folder that the parameter output_dir names, through the sinks of the run file. The unit contains\n\
this program, and needs nothing else where it is used.\n\n\
Examples:\n  starloop fmu configs/benches/loopback.toml --out bench.fmu\n  \
starloop fmu configs/benches/loopback.toml --fmi 2 --out bench.fmu\n  \
fmpy validate bench.fmu\n  fmpy simulate bench.fmu --interface-type CoSimulation --stop-time 1")]
pub struct FmuArgs {
    /// Bench file (TOML); without one: the built-in loopback bench
    bench: Option<PathBuf>,
    /// Unit to write; without it: the name of the bench with the ending .fmu, in this folder
    #[arg(long, value_name = "FILE")]
    out: Option<PathBuf>,
    /// Version of FMI: 3.0 has arrays, 2.0 has a variable for each number, for tools that import no FMI 3
    #[arg(long, value_name = "2|3", default_value_t = 3, value_parser = clap::value_parser!(u8).range(2..=3))]
    fmi: u8,
    /// Started by the library of a unit: resources and token; standard input is a socket
    #[arg(long, hide = true, num_args = 2, value_names = ["RESOURCES", "TOKEN"], exclusive = true)]
    worker: Option<Vec<String>>,
}

/// Runs the command.
///
/// # Errors
/// When the run file is refused, this program cannot be read, or the unit cannot be written.
pub fn run_fmu(arguments: &FmuArgs) -> Result<()> {
    if let Some(words) = &arguments.worker {
        return serve_unit(words);
    }
    let version = if arguments.fmi == 2 { FmiVersion::Two } else { FmiVersion::Three };
    let document = match &arguments.bench {
        Some(path) => Document::open(path)?,
        None => Bench::built_in_document()?,
    };
    let stem = document.name();
    let stem = Path::new(&stem).file_stem().context("a run file without a name")?;
    let out = arguments.out.clone().unwrap_or_else(|| Path::new(stem).with_extension("fmu"));
    let bytes = write_unit(&document, version, &out)?;
    let (name, megabytes) = (version.name(), bytes as f64 * 1e-6);
    println!("{}: {megabytes:.1} MB, FMI {name} co-simulation; check it with `fmpy validate`", out.display());
    print_jitter(&Scenario::from_document(&document)?.bench);
    Ok(())
}

/// Prints what becomes of the jitter of a bench in a unit, where it has some.
fn print_jitter(bench: &Bench) {
    let lines = bench.flight_computer.jitter_lines.len();
    if lines > 0 {
        println!("jitter lines of the simulated flight computer: {lines} left out; the input jitter takes their place");
    }
    if let Some(input) = &bench.jitter {
        println!("{} of [jitter] is added to every frame", input.path);
    }
}

/// Is one instance of a unit, for the library that started this program with a socket as its standard input.
fn serve_unit(words: &[String]) -> Result<()> {
    let [resources, token] = words else { bail!("--worker: wanted resources and token") };
    let socket = io::stdin().as_fd().try_clone_to_owned().context("--worker: standard input")?;
    serve(&mut UnixStream::from(socket), Path::new(resources), token)
        .context("--worker: wanted the library of a unit at the other end of standard input")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn frames_that_are_held_are_left_out_and_counted() {
        let text = "frame,mid_exposure_tai_ns\n0,5\n1,6\n2,6\n3,7\n";
        assert_eq!(rising_rows(text), ("frame,mid_exposure_tai_ns\n0,5\n1,6\n3,7\n".into(), 1));
    }

    #[test]
    fn a_run_of_several_heads_is_exported_head_by_head() {
        let folder = tempfile::tempdir().unwrap();
        for head in ["head0", "head1"] {
            std::fs::create_dir(folder.path().join(head)).unwrap();
            std::fs::write(path_in(&folder.path().join(head)), "frame\n").unwrap();
        }
        assert_eq!(folder_of_head(folder.path(), Some(1)).unwrap(), folder.path().join("head1"));
        let own = folder.path().join("head0");
        assert_eq!(folder_of_head(&own, None).unwrap(), own, "the folder of a head is one too");
        let error = folder_of_head(folder.path(), None).unwrap_err().to_string();
        assert!(error.ends_with("recorded by 2 heads; wanted one of them: --head 0 to --head 1"), "{error}");
        let error = folder_of_head(folder.path(), Some(2)).unwrap_err().to_string();
        assert!(error.contains("got 2, wanted less than 2"), "{error}");
    }

    #[test]
    fn a_bench_is_exported_as_it_would_be_flown() {
        let source = ExportSource::open(Path::new("benches/loopback.toml"), None, None).unwrap();
        let history = source.attitudes(false).unwrap();
        assert_eq!(history.rows(), 100);
        let error = ExportSource::open(Path::new("benches/closed_loop.toml"), None, Some(3)).err().unwrap().to_string();
        assert!(error.contains("--head"), "{error}");
        let error = ExportSource::open(Path::new("scenarios/acquisition.toml"), None, None).err().unwrap().to_string();
        assert!(error.contains("export the folder"), "{error}");
    }
}
