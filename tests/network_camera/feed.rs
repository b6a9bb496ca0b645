//! A network camera without a bench: frames of arithmetic at a steady rate, for clients and for measurements.
//!
//! `camera_feed KEY=VALUE ...` starts a camera, prints its address as one line of JSON, and feeds it until its input
//! ends or its frames are over; then it prints the camera's counts. `record=FOLDER` writes the same frames as FITS.
//! Used by `hil_scripts/tests/test_network_camera.py`.

use anyhow::Context;
use base::bayer::{BayerPattern, Colour};
use base::clock::{Clock, Monotonic};
use base::drawn::{Degradation, PathOrigin};
use base::time::Span;
use core::sync::atomic::{AtomicBool, Ordering};
use frames::sink::{FaultFlags, Recorder, RecorderOptions, SentFrame, Sink};
use starloop_outputs::network_camera::{Identity, NetworkCamera, Params, PixelFormat, SensorParams, XmlForm};
use std::{collections::BTreeMap, sync::Arc};

/// Words of the command line.
struct Words(BTreeMap<String, String>);

impl Words {
    fn read() -> Self {
        let split = |word: String| word.split_once('=').map(|(key, value)| (key.to_owned(), value.to_owned()));
        Self(std::env::args().skip(1).filter_map(split).collect())
    }

    fn number(&self, key: &str, default: f64) -> anyhow::Result<f64> {
        let given =
            self.0.get(key).map(|text| text.parse().with_context(|| format!("{key} is {text}, wanted a number")));
        given.unwrap_or(Ok(default))
    }

    #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "float-to-int casts saturate")]
    fn whole(&self, key: &str, default: u32) -> anyhow::Result<u32> {
        Ok(self.number(key, f64::from(default))? as u32)
    }
}

fn main() -> anyhow::Result<()> {
    let words = Words::read();
    let sensor = SensorParams {
        size_px: [words.whole("width", 64)?, words.whole("height", 48)?],
        bits: words.whole("bits", 12)?,
        frame_rate_hz: words.number("rate_hz", 20.0)?,
        exposure_s: 0.02,
        gain_e_per_dn: 2.5,
        temperature_c: 21.5,
        colours: words
            .0
            .get("colours")
            .and_then(|name| BayerPattern::NAMED.iter().find(|(known, _)| known == name))
            .map(|(_, pattern)| *pattern),
    };
    let clock: Arc<dyn Clock> = Arc::new(Monotonic::start());
    let mut camera = NetworkCamera::start(&params(&words)?, &sensor, None, Arc::clone(&clock))?;
    println!("{}", serde_json::json!({ "address": camera.address().to_string() }));
    let recorder = words
        .0
        .get("record")
        .map(|folder| Recorder::create(folder, RecorderOptions { png_every: 0, ..RecorderOptions::default() }));
    let mut recorder = recorder.transpose()?;
    let is_over = Arc::new(AtomicBool::new(false));
    let reported = Arc::clone(&is_over);
    std::thread::Builder::new().name("input".into()).spawn(move || {
        let _ = std::io::read_to_string(std::io::stdin()); // any input, or none
        reported.store(true, Ordering::Release);
    })?;
    let mut frame = SentFrame::with_capacity(sensor.size_px[0] as usize, sensor.size_px[1] as usize, 0, "feed".into());
    let start = clock.now();
    let frames = words.whole("frames", u32::MAX)?;
    for number in 1..=frames {
        if is_over.load(Ordering::Acquire) {
            break;
        }
        fill(&mut frame, number, &sensor);
        frame.meta.mid_exposure = start + Span::from_s(f64::from(number) / sensor.frame_rate_hz);
        clock.sleep_until(frame.meta.mid_exposure);
        camera.send(&frame)?;
        if let Some(recorder) = &mut recorder {
            recorder.send(&frame)?;
        }
    }
    let summary = camera.finish()?;
    if let Some(recorder) = &mut recorder {
        recorder.finish()?;
    }
    println!("{}", serde_json::json!({ "frames": summary.frames, "counters": camera.counters() }));
    Ok(())
}

fn params(words: &Words) -> anyhow::Result<Params> {
    let text = |key: &str| words.0.get(key).map(String::as_str);
    let format = text("pixel_format").and_then(|name| PixelFormat::NAMED.iter().find(|(known, _)| *known == name));
    let lose = words.whole("lose_one_in", 0)?;
    Ok(Params {
        address: text("address").unwrap_or("127.0.0.1").parse()?,
        port: u16::try_from(words.whole("port", 3956)?)?,
        pixel_format: format.map(|(_, format)| *format),
        packet_bytes: words.whole("packet_bytes", 1500)?,
        rate_bit_s: words.number("rate_mbit_s", 1000.0)? * 1e6,
        frames_kept: words.whole("frames_kept", 4)?,
        frames_queued: words.whole("frames_queued", 2)?,
        identity: identity(words),
        mac: None,
        allow_other_receivers: text("allow_other_receivers").is_some(),
        ptp_socket: text("ptp_socket").map_or_else(|| Params::default().ptp_socket, Into::into),
        xml: if text("xml") == Some("plain") { XmlForm::Plain } else { XmlForm::Zip },
        lose_one_in: (lose > 0).then_some(lose),
    })
}

fn identity(words: &Words) -> Identity {
    let (given, usual) = (|key: &str| words.0.get(key).cloned(), Identity::default());
    let serial = given("serial").unwrap_or_else(|| "feed".into());
    Identity { model: given("model").unwrap_or(usual.model), serial, ..Identity::default() }
}

/// Fills pixels and truth that differ in every frame; all of them follow from the frame's number.
#[allow(clippy::cast_possible_truncation, reason = "the low bits of a pattern")]
fn fill(frame: &mut SentFrame, number: u32, sensor: &SensorParams) {
    let mask = ((1_u32 << sensor.bits) - 1) as u16;
    let mut value = number.wrapping_mul(2_654_435_761) as u16;
    for pixel in frame.image.pixels_mut() {
        value = value.wrapping_mul(25_173).wrapping_add(13_849);
        *pixel = value & mask;
    }
    if let Some(pattern) = sensor.colours {
        fill_colours(frame, number, pattern);
    }
    let turn = f64::from(number) * 0.01;
    let meta = &mut frame.meta;
    meta.number = number;
    meta.exposure_s = sensor.exposure_s;
    meta.attitude_wxyz = [turn.cos(), turn.sin(), 0.0, 0.0];
    (meta.ra_deg, meta.dec_deg, meta.roll_deg) = (turn, -turn, 2.0 * turn);
    meta.rate_deg_s = [turn, 0.5, -0.25];
    meta.seed = u64::MAX - u64::from(number);
    (meta.lateness, meta.attitude_age, meta.horizon) = (Span::from_ms(-3), Span::from_ms(7), Span::from_ms(-11));
    (meta.origin, meta.degradation) = (PathOrigin::Predicted, Degradation::Full);
    meta.faults = FaultFlags::HOT_PIXELS;
}

/// Fills all pixels of a colour with the same number, and with another one in each frame.
fn fill_colours(frame: &mut SentFrame, number: u32, pattern: BayerPattern) {
    let width = frame.image.width();
    let more = u16::try_from(number % 16).unwrap_or_default();
    for (place, pixel) in frame.image.pixels_mut().iter_mut().enumerate() {
        let own = match pattern.colour_at(place % width, place / width) {
            Colour::Red => 3200,
            Colour::Green => 1600,
            Colour::Blue => 800,
        };
        *pixel = own + more;
    }
}
