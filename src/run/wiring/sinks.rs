//! Checked sinks of a bench -> the sinks that take the frames.
//!
//! On the real clock every sink, even a single one, has its own thread and queue ([`Fan`]): writing files may take
//! longer than a frame. On the virtual clock they run in step ([`OnFull::Wait`]), also with a thread, so that a sink
//! that blocks can be abandoned. Only the null sink needs no thread and is called directly ([`Alone`]).

use crate::wiring::{display_parts::open_display, sink_setting::SinkSetting};
use anyhow::{Context, Result};
use base::streams::say;
use config::{DisplaySettings, Sink as Kind, SinkSettings};
use frames::sink::{Alone, BranchParams, Fan, NullSink, OnFull, Recorder, RecorderOptions, Sink};
use frames::{camera_control::desk, sink::shared_memory::SharedMemory};
use outputs::display::MonitorChoice;
use outputs::network_camera::{self, CommandParams, NetworkCamera, SensorParams};
use std::path::{Component, Path, PathBuf};
use std::sync::Arc;

/// Returns the directory of a run: `out` if given, which then contains at least the summary, else a `stamp` below the
/// first directory that a sink names. `None` without either.
pub fn run_directory(sinks: &[SinkSettings], out: Option<&Path>, stamp: &str) -> Option<PathBuf> {
    let mut keeping = sinks.iter().filter_map(|settings| match &settings.sink {
        Kind::Recorder { directory, .. } => Some(directory.as_deref()),
        Kind::SharedMemory { .. } | Kind::Iceoryx { .. } | Kind::NetworkCamera(_) | Kind::Display(_) | Kind::Null => {
            None
        }
    });
    if let Some(out) = out {
        return Some(out.to_path_buf());
    }
    let first = keeping.next()?;
    let named = first.or_else(|| keeping.flatten().next()).unwrap_or(Path::new("out"));
    Some(named.join(stamp))
}

/// Returns the sinks of one camera head.
///
/// # Errors
/// When a sink cannot be made, with its place in the bench.
pub fn make_sinks(sinks: &[SinkSettings], setting: &SinkSetting<'_>) -> Result<Box<dyn Sink>> {
    let mut made = Vec::with_capacity(sinks.len());
    for (number, settings) in sinks.iter().enumerate() {
        let place = place(number);
        let sink = make(settings, number, setting).with_context(|| place.clone())?;
        made.push(BranchParams { place, sink, buffers: settings.queue_frames as usize });
    }
    let needs_no_thread = sinks.iter().all(|settings| settings.sink == Kind::Null);
    if made.len() <= 1 && needs_no_thread {
        let alone = |only: BranchParams| Box::new(Alone::new(only.place, only.sink)) as Box<dyn Sink>;
        return Ok(made.pop().map_or_else(|| Box::new(NullSink::new()) as Box<dyn Sink>, alone));
    }
    let on_full = if setting.is_real { OnFull::Drop } else { OnFull::Wait };
    Ok(Box::new(Fan::start(made, setting.prototype, on_full)?))
}

/// Returns the directory for the files of one head: each of several heads has its own.
pub fn directory_of_head(run: &Path, head: Option<usize>) -> PathBuf {
    head.map_or_else(|| run.to_path_buf(), |head| run.join(format!("head{head}")))
}

/// Returns the position of a sink in its bench.
fn place(number: usize) -> String {
    number.checked_sub(1).map_or_else(|| "sink".into(), |extra| format!("extra_sink[{extra}]"))
}

/// Returns one sink.
fn make(settings: &SinkSettings, number: usize, setting: &SinkSetting<'_>) -> Result<Box<dyn Sink>> {
    match &settings.sink {
        Kind::Recorder { directory, options } => {
            let directory = files_of(number, directory.as_deref(), setting);
            Ok(Box::new(Recorder::create(directory, *options)?))
        }
        Kind::SharedMemory { path, slots } => {
            let path = name_of_head(&path.display().to_string(), setting.head);
            shared_memory(Path::new(&path), *slots, setting)
        }
        Kind::Iceoryx { service, slots } => iceoryx(&name_of_head(service, setting.head), *slots, setting),
        Kind::NetworkCamera(params) => network_camera(params, setting),
        Kind::Display(settings) => display(settings, number, setting),
        Kind::Null => Ok(Box::new(NullSink::new())),
    }
}

/// Returns the queues to the exposures of the head, if they can be commanded.
fn commands(setting: &SinkSetting<'_>) -> Option<CommandParams> {
    let (exposing, desks) = setting.commands?;
    let (range, settings, start) = (*exposing.range()?, *exposing.next_settings(), *exposing.start());
    let (desk, end) = desk();
    desks.borrow_mut().push(end);
    Some(CommandParams {
        desk,
        range,
        settings,
        start,
        has_line: exposing.has_line(),
        clock: Arc::clone(setting.clock),
    })
}

/// Returns a camera on the network, and prints its address.
fn network_camera(params: &network_camera::Params, setting: &SinkSetting<'_>) -> Result<Box<dyn Sink>> {
    let camera = setting.camera;
    // Several heads are several cameras: each has its own address and names, counted up from the first.
    let params = setting.head.map_or_else(|| Ok(params.clone()), |head| params.of_head(head))?;
    let sensor = SensorParams {
        size_px: camera.output().size_px.map(|side| u32::try_from(side).unwrap_or(u32::MAX)),
        bits: camera.output_bits(),
        frame_rate_hz: 1.0 / setting.frame_period.s(),
        exposure_s: camera.exposure_s,
        gain_e_per_dn: camera.detector.gain_e_per_dn,
        temperature_c: camera.detector.dark_law.operating_c,
        colours: camera.detector.spatial.output_colours(),
    };
    let made = NetworkCamera::start(&params, &sensor, commands(setting), Arc::clone(setting.clock))?;
    say(format_args!("network camera: GVCP at {}\n", made.address()));
    if made.is_exposed() {
        let text = "starloop: the network camera can be reached from other machines, and asks for no password\n";
        say(format_args!("{text}"));
    }
    Ok(Box::new(made))
}

/// Returns a monitor, and prints what drives it.
fn display(settings: &DisplaySettings, number: usize, setting: &SinkSetting<'_>) -> Result<Box<dyn Sink>> {
    let directory = setting.directory.map(|_run| files_of(number, None, setting));
    let (display, notes) = open_display(settings, setting, directory.as_deref())?;
    say(format_args!("display: {}\n", display.description()));
    notes.iter().for_each(|note| say(format_args!("starloop: {note}\n")));
    Ok(Box::new(display))
}

/// Returns a head's name: heads do not share a name, so each has its number at the end.
fn name_of_head(name: &str, head: Option<usize>) -> String {
    head.map_or_else(|| name.to_owned(), |head| format!("{name}_head{head}"))
}

/// Returns the directory of a sink's files. The first sink has the run's directory. Another one has a directory below
/// the one that it names, with the names of run and head, or below the run's when it names none.
fn files_of(number: usize, own: Option<&Path>, setting: &SinkSetting<'_>) -> PathBuf {
    let run = setting.directory.unwrap_or(Path::new("out"));
    match (number.checked_sub(1), own) {
        (None, _) => run.to_path_buf(),
        (Some(extra), None) => run.join(format!("extra_sink_{extra}")),
        (Some(_), Some(own)) => {
            let names = run.components().rev().take(if setting.head.is_some() { 2 } else { 1 });
            let names = names.filter(|name| matches!(name, Component::Normal(_)));
            let below: PathBuf = names.collect::<Vec<_>>().into_iter().rev().collect();
            own.join(below)
        }
    }
}

fn shared_memory(path: &Path, slots: u32, setting: &SinkSetting<'_>) -> Result<Box<dyn Sink>> {
    Ok(Box::new(SharedMemory::create(
        path.to_path_buf(),
        [setting.prototype.image.width(), setting.prototype.image.height()],
        slots,
    )?))
}

#[cfg(feature = "iceoryx2")]
fn iceoryx(service: &str, slots: u32, setting: &SinkSetting<'_>) -> Result<Box<dyn Sink>> {
    let size_px = [setting.prototype.image.width(), setting.prototype.image.height()];
    Ok(Box::new(frames::sink::iceoryx::Iceoryx::create(service.into(), size_px, slots)?))
}

#[cfg(not(feature = "iceoryx2"))]
fn iceoryx(service: &str, _slots: u32, _setting: &SinkSetting<'_>) -> Result<Box<dyn Sink>> {
    anyhow::bail!(
        "{service}: this program was built without iceoryx2; install one with \
         `cargo install --locked --path . --features iceoryx2`"
    )
}

/// Describes a sink in words.
pub fn described(settings: &SinkSettings) -> String {
    let kind = settings.sink.kind();
    match &settings.sink {
        Kind::Recorder { directory, options: RecorderOptions { fits, ser, png_every, .. } } => {
            let png = if *png_every > 0 { format!("a PNG of every {png_every}. frame") } else { String::new() };
            let forms = [if *fits { "FITS" } else { "" }, if *ser { "SER" } else { "" }, &png, "truth tables"];
            let forms: Vec<&str> = forms.into_iter().filter(|form| !form.is_empty()).collect();
            let directory =
                directory.as_ref().map_or_else(|| "the run's directory".into(), |d| d.display().to_string());
            format!("{kind}: {}, below {directory}; {} frames may wait", forms.join(", "), settings.queue_frames)
        }
        Kind::SharedMemory { path, slots } => {
            format!("{kind}: {}, {slots} frames", path.display())
        }
        Kind::Iceoryx { service, slots } => format!("{kind}: service \"{service}\", {slots} frames"),
        Kind::NetworkCamera(params) => {
            let rate = params.rate_bit_s / 1e6;
            format!(
                "{kind}: GVCP at {}:{}, packets of {} B at {rate} Mbit/s",
                params.address, params.port, params.packet_bytes
            )
        }
        Kind::Display(settings) => {
            let calibration = settings.calibration.as_ref();
            let monitor = match &settings.params.monitor {
                MonitorChoice::Primary => "the primary monitor".into(),
                named @ (MonitorChoice::Index(_) | MonitorChoice::Named(_)) => format!("the monitor {named}"),
            };
            let calibration =
                calibration.map_or_else(|| "none: greys taken for luminances".into(), |c| c.display().to_string());
            format!("{kind}: {}, {} bits, calibration {calibration}", monitor, settings.params.bits.count())
        }
        Kind::Null => format!("{kind}: nothing is kept"),
    }
}

/// Returns the position and description of each sink of a bench.
pub fn described_lines(sinks: &[SinkSettings]) -> impl Iterator<Item = (String, String)> {
    sinks.iter().enumerate().map(|(number, settings)| (place(number), described(settings)))
}

#[cfg(test)]
mod tests {
    use super::*;
    use base::{clock::Clock, time::Span};
    use config::{Bench, Document};
    use frames::sink::SentFrame;
    use scene::camera::CameraParams;

    fn sinks(text: &str) -> Vec<SinkSettings> {
        Bench::from_document(&Document::from_text(text, Path::new("b.toml"))).unwrap().sinks
    }

    fn frame(number: u32) -> SentFrame {
        let mut frame = SentFrame::with_capacity(8, 6, 0, "small".into());
        frame.meta.number = number;
        frame
    }

    fn camera() -> CameraParams {
        let bench = Bench::from_document(&Document::from_text("", Path::new("b.toml"))).unwrap();
        crate::wiring::camera_parts::camera_params(&bench.camera).unwrap()
    }

    fn clock() -> Arc<dyn Clock> {
        Arc::new(base::clock::Virtual::new(base::time::Tai::from_ns(0)))
    }

    fn setting<'a>(
        directory: Option<&'a Path>,
        is_real: bool,
        (prototype, camera, clock): (&'a SentFrame, &'a CameraParams, &'a Arc<dyn Clock>),
    ) -> SinkSetting<'a> {
        let frame_period = Span::from_ms(100);
        let calibration = None;
        SinkSetting {
            directory,
            prototype,
            head: None,
            is_real,
            camera,
            frame_period,
            clock,
            calibration,
            commands: None,
        }
    }

    const THREE: &str = "[sink]\nkind = \"null\"\n[[extra_sink]]\nkind = \"recorder\"\n[[extra_sink]]\nkind = \
                         \"recorder\"\nfits = false\nser = true\n";

    #[test]
    fn each_recorder_has_a_directory_and_each_sink_a_line_on_both_clocks() {
        let folder = tempfile::tempdir().unwrap();
        let settings = sinks(THREE);
        for is_real in [true, false] {
            let out = folder.path().join(format!("run {is_real}"));
            let directory = run_directory(&settings, Some(&out), "stamp").unwrap();
            let (first, camera, clock) = (frame(0), camera(), clock());
            let setting = setting(Some(&directory), is_real, (&first, &camera, &clock));
            let mut sink = make_sinks(&settings, &setting).unwrap();
            (1..4).for_each(|number| sink.send(&frame(number)).unwrap());
            sink.finish().unwrap();
            let lines = sink.lines();
            let places: Vec<&str> = lines.iter().map(|line| line.place.as_str()).collect();
            assert_eq!(places, ["sink", "extra_sink[0]", "extra_sink[1]"]);
            assert!(lines.iter().all(|line| line.frames == 3 && line.run_crc32 == lines[0].run_crc32));
            assert!(out.join("extra_sink_0/frame_000003.fits").exists());
            assert!(out.join("extra_sink_1/frames.ser").exists());
            assert!(!out.join("extra_sink_1/frame_000003.fits").exists());
        }
    }

    #[test]
    fn a_recorder_beside_the_first_sink_writes_where_it_says() {
        let folder = tempfile::tempdir().unwrap();
        let disk = folder.path().join("other disk");
        let named = THREE.replace("fits = false", &format!("directory = {disk:?}"));
        let settings = sinks(&named);
        let (first, camera, clock) = (frame(0), camera(), clock());
        for (head, below) in [(None, "now"), (Some(1), "later/head1")] {
            let out = folder.path().join("runs").join(below);
            let setting = SinkSetting { head, ..setting(Some(&out), false, (&first, &camera, &clock)) };
            let mut sink = make_sinks(&settings, &setting).unwrap();
            sink.send(&frame(1)).unwrap();
            sink.finish().unwrap();
            let place = disk.join(below);
            assert!(place.join("frames.ser").exists() && place.join("frame_000001.fits").exists());
            assert!(
                out.join("extra_sink_0").exists() && !out.join("extra_sink_1").exists(),
                "the other one names none"
            );
            assert_eq!(sink.lines()[2].output.as_deref(), place.to_str(), "and says so");
        }
    }

    #[test]
    fn directories_are_those_that_are_named() {
        let of = |text: &str, out: Option<&str>| run_directory(&sinks(text), out.map(Path::new), "now");
        assert_eq!(of("", None), Some("out/b/now".into()));
        assert_eq!(of("", Some("here")), Some("here".into()));
        assert_eq!(of("[sink]\nkind = \"null\"", Some("here")), Some("here".into()), "the summary");
        assert_eq!(of("[sink]\nkind = \"null\"", None), None, "nothing to keep");
        if cfg!(feature = "display") {
            assert_eq!(of("[sink]\nkind = \"display\"", Some("here")), Some("here".into()), "submit times");
            assert_eq!(of("[sink]\nkind = \"display\"", None), None, "which are kept only when asked for");
        }
        assert_eq!(of(THREE, None), Some("out/now".into()));
        assert_eq!(of(&THREE.replace("fits = false", "directory = \"disk\""), None), Some("disk/now".into()));
    }

    #[test]
    fn failed_sink_is_named_in_the_error() {
        let folder = tempfile::tempdir().unwrap();
        std::fs::write(folder.path().join("extra_sink_0"), "in the way").unwrap();
        let (first, camera, clock) = (frame(0), camera(), clock());
        let setting = setting(Some(folder.path()), true, (&first, &camera, &clock));
        let error = make_sinks(&sinks(THREE), &setting).err().unwrap();
        let error = format!("{error:#}");
        assert!(
            error.starts_with("extra_sink[0]") && error.contains("in the way") | error.contains("cannot be made"),
            "{error}"
        );
    }

    #[test]
    fn sinks_are_described_in_words() {
        let reported: Vec<String> =
            described_lines(&sinks(THREE)).map(|(place, words)| format!("{place} {words}")).collect();
        assert_eq!(reported[0], "sink null: nothing is kept");
        assert!(
            reported[2].contains("extra_sink[1] recorder: SER, truth tables, below the run's directory; 8"),
            "{reported:?}"
        );
    }
}
