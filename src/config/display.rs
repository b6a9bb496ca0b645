//! `[sink] kind = "display"`: a monitor in front of a tracker.

use crate::check::{Checker, Rule};
use crate::error::ConfigError;
use base::time::Span;
use outputs::display::{Bits, CardChoice, Corner, Marker, MonitorChoice, Params};
use serde::Deserialize;
use std::path::PathBuf;

/// Longest side of a frame that a graphics driver must take.
const LONGEST_PX: u32 = 8192;

/// A display, checked.
#[derive(Debug, Clone, PartialEq)]
pub struct DisplaySettings {
    /// What the display is opened with.
    pub params: Params,
    /// Its calibration file; `None`: greys are taken for luminances, which no monitor's are, and the program says so.
    pub calibration: Option<PathBuf>,
    /// What the calibration must call the display; `None`: there is no calibration.
    pub name: Option<String>,
    /// Refreshes over which light between two greys is spread; 1: the nearer grey.
    pub dither: u32,
    /// Share of a refresh during which the display shines; `None`: not known.
    pub duty: Option<f64>,
    /// Frames per second of the tracker that looks at it, for the beat of its shutter against the refresh.
    pub tracker_hz: f64,
}

/// Keys of a display, beside those that every sink has.
#[derive(Debug, Default, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct DisplayKeys {
    monitor: Option<MonitorKey>,
    window: Option<[i64; 2]>,
    bits: Option<i64>,
    marker_px: Option<i64>,
    marker_corner: Option<String>,
    calibration: Option<String>,
    name: Option<String>,
    dither: Option<i64>,
    tracker_hz: Option<f64>,
    duty: Option<f64>,
    latency_ms: Option<f64>,
    direct_scanout: Option<bool>,
    card: Option<String>,
}

/// A monitor by number or by name.
#[derive(Debug, Clone, Deserialize)]
#[serde(untagged, expecting = "invalid type: expected a monitor's name or its number, from 0")]
enum MonitorKey {
    Index(i64),
    Name(String),
}

impl DisplaySettings {
    /// Reads the keys of the sink `table` (`sink`, `extra_sink[0]`) for a camera's frames of `image_px`, columns and rows.
    pub(super) fn check(
        keys: &DisplayKeys,
        table: &str,
        image_px: [u32; 2],
        check: &mut Checker<'_>,
    ) -> Result<Self, ConfigError> {
        let key = |name: &str| format!("{table}.{name}");
        let is_calibrated = keys.calibration.is_some();
        if is_calibrated && table != "sink" {
            let advice = "frames are drawn for one display: name it in [sink], and what keeps its frames beside it";
            return Err(check.invalid(&key("calibration"), "given", "a calibrated display in [sink] only", advice));
        }
        let monitor = monitor(keys.monitor.as_ref(), &key("monitor"), check)?;
        // What is drawn for a calibrated display has the size that the calibration says.
        let image_px = (!is_calibrated).then_some(image_px);
        let window_px = window(keys.window, &key("window"), image_px, check)?;
        let most = "10 where driver, server and monitor agree on it";
        let bits = match check.whole(&key("bits"), keys.bits, Some(8), 8..=10, most)? {
            8 => Bits::Eight,
            10 => Bits::Ten,
            other => return Err(check.invalid(&key("bits"), other, "8 or 10", most)),
        };
        let marker = marker(keys, &key, image_px, check)?;
        let advice = "from submit to light in the middle of the display, as `starloop display latency` tells it";
        let latency = keys.latency_ms.map(|ms| check.meets(&key("latency_ms"), ms, Rule::Within(0.0, 1000.0), advice));
        let latency = latency.transpose()?.map(|ms| Span::from_s(ms * 1e-3));
        let direct_scanout = direct_scanout(keys, &key, check)?;
        let params = Params { monitor, window_px, bits, marker, latency, direct_scanout, refresh: None };
        let plain = Self { params, calibration: None, name: None, dither: 1, duty: None, tracker_hz: 0.0 };
        if is_calibrated { plain.calibrated(keys, &key, check) } else { plain.uncalibrated(keys, &key, check) }
    }

    /// With the keys that only a calibrated display has.
    fn calibrated(
        self,
        keys: &DisplayKeys,
        key: &impl Fn(&str) -> String,
        check: &mut Checker<'_>,
    ) -> Result<Self, ConfigError> {
        let path = keys.calibration.as_deref().filter(|path| !path.trim().is_empty());
        let Some(path) = path else {
            let advice = "as `starloop calibrate display` writes it, beside this file";
            return Err(check.invalid(&key("calibration"), "empty", "a calibration file", advice));
        };
        let Some(name) = keys.name.clone().filter(|name| !name.trim().is_empty()) else {
            let advice = "model and serial number: a calibration of another display of the same size is refused by it";
            return Err(check.invalid(&key("name"), "missing", "what the calibration calls the display", advice));
        };
        let advice = "refreshes, a power of two: over so many the mean light of a pixel is right";
        let dither = check.whole(&key("dither"), keys.dither, Some(16), 1..=256, advice)?;
        let advice = "frames per second of the tracker in front of the display";
        let tracker_hz = check.number(&key("tracker_hz"), keys.tracker_hz, 10.0, Rule::PositiveUpTo(1e4), advice)?;
        let advice =
            "share of a refresh during which the display shines: 1 holds its light, 0 flashes, which beats most";
        let duty = keys.duty.map(|duty| check.meets(&key("duty"), duty, Rule::Within(0.0, 1.0), advice)).transpose()?;
        let calibration = Some(check.document.file_beside(path));
        Ok(Self { calibration, name: Some(name), dither, duty, tracker_hz, ..self })
    }

    /// Without them: a key that would do nothing is refused.
    fn uncalibrated(
        self,
        keys: &DisplayKeys,
        key: &impl Fn(&str) -> String,
        check: &Checker<'_>,
    ) -> Result<Self, ConfigError> {
        let given = [
            ("name", keys.name.is_some()),
            ("dither", keys.dither.is_some()),
            ("tracker_hz", keys.tracker_hz.is_some()),
            ("duty", keys.duty.is_some()),
        ];
        for (name, is_given) in given {
            check.unused(&key(name), is_given, "a display with a calibration")?;
        }
        Ok(self)
    }
}

fn monitor(given: Option<&MonitorKey>, key: &str, check: &mut Checker<'_>) -> Result<MonitorChoice, ConfigError> {
    let advice = "`starloop display monitors` lists them";
    match given {
        None => {
            check.given_or(key, None, "primary");
            Ok(MonitorChoice::Primary)
        }
        Some(MonitorKey::Name(name)) if name == "primary" => Ok(MonitorChoice::Primary),
        Some(MonitorKey::Name(name)) if name.trim().is_empty() => {
            Err(check.invalid(key, "empty", "a name, a number, or \"primary\"", advice))
        }
        Some(MonitorKey::Name(name)) => Ok(MonitorChoice::Named(name.clone())),
        Some(MonitorKey::Index(index)) => {
            Ok(MonitorChoice::Index(check.whole(key, Some(*index), None, 0..=255, advice).map(|index| index as usize)?))
        }
    }
}

fn direct_scanout(
    keys: &DisplayKeys,
    key: &impl Fn(&str) -> String,
    check: &mut Checker<'_>,
) -> Result<Option<CardChoice>, ConfigError> {
    if !check.given_or(&key("direct_scanout"), keys.direct_scanout, false) {
        check.unused(&key("card"), keys.card.is_some(), "direct_scanout = true")?;
        return Ok(None);
    }
    check.unused(&key("window"), keys.window.is_some(), "a display without direct_scanout, which has no windows")?;
    match keys.card.as_deref().map(str::trim) {
        None => Ok(Some(CardChoice::First)),
        Some("") => Err(check.invalid(&key("card"), "empty", "a card's file", "such as \"/dev/dri/card0\"")),
        Some(path) => Ok(Some(CardChoice::At(path.into()))),
    }
}

fn window(
    given: Option<[i64; 2]>,
    key: &str,
    image_px: Option<[u32; 2]>,
    check: &mut Checker<'_>,
) -> Result<Option<[u32; 2]>, ConfigError> {
    let Some(sides) = given else { return Ok(None) };
    let mut window_px = [0; 2];
    for (side, given) in window_px.iter_mut().zip(sides) {
        *side = check.whole(key, Some(given), None, 1..=LONGEST_PX, "columns and rows of the window")?;
    }
    if let Some(image_px) = image_px.filter(|image_px| *image_px != window_px) {
        let wanted = format!("{image_px:?}, the camera's columns and rows");
        return Err(check.invalid(key, format!("{window_px:?}"), wanted, "frames are never scaled"));
    }
    Ok(Some(window_px))
}

fn marker(
    keys: &DisplayKeys,
    key: &impl Fn(&str) -> String,
    image_px: Option<[u32; 2]>,
    check: &mut Checker<'_>,
) -> Result<Option<Marker>, ConfigError> {
    // Of a calibrated display the size is not known here: its marker is held against it when it is opened.
    let longest = image_px.map_or(LONGEST_PX, |[columns, rows]| columns.min(rows));
    let advice = "side of a square for a photodiode; 0 for none";
    let size_px = check.whole(&key("marker_px"), keys.marker_px, Some(0), 0..=longest, advice)?;
    if size_px == 0 {
        check.unused(&key("marker_corner"), keys.marker_corner.is_some(), "marker_px > 0")?;
        return Ok(None);
    }
    let corners = [
        ("top_left", Corner::TopLeft),
        ("top_right", Corner::TopRight),
        ("bottom_left", Corner::BottomLeft),
        ("bottom_right", Corner::BottomRight),
    ];
    let advice = "where no star of interest falls";
    let corner = check.choice(&key("marker_corner"), keys.marker_corner.as_deref(), &corners, advice)?;
    Ok(Some(Marker { size_px, corner }))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::document::Document;
    use std::path::Path;

    const IMAGE_PX: [u32; 2] = [640, 480];

    fn read(text: &str) -> Result<DisplaySettings, ConfigError> {
        read_as("sink", text)
    }

    fn read_as(table: &str, text: &str) -> Result<DisplaySettings, ConfigError> {
        #[derive(Deserialize)]
        struct File {
            sink: DisplayKeys,
        }
        let document = Document::from_text(&format!("[sink]\n{text}"), Path::new("benches/a.toml"));
        let File { sink } = document.read_as()?;
        DisplaySettings::check(&sink, table, IMAGE_PX, &mut Checker::new(&document))
    }

    #[test]
    fn without_a_key_it_fills_the_primary_monitor() {
        let settings = read("").unwrap();
        let params = Params::full_screen();
        let wanted = DisplaySettings { params, calibration: None, name: None, dither: 1, duty: None, tracker_hz: 0.0 };
        assert_eq!(settings, wanted);
    }

    #[test]
    fn every_key_is_read() {
        let settings = read(
            "monitor = 1\nwindow = [800, 600]\nbits = 10\nmarker_px = 600\nmarker_corner = \"bottom_left\"\n\
             calibration = \"panel.toml\"\nname = \"EV27\"\nlatency_ms = 21.5\nduty = 0.25\ntracker_hz = 5.0\n\
             dither = 4",
        )
        .unwrap();
        let params = Params {
            monitor: MonitorChoice::Index(1),
            window_px: Some([800, 600]),
            bits: Bits::Ten,
            marker: Some(Marker { size_px: 600, corner: Corner::BottomLeft }),
            latency: Some(Span::from_ns(21_500_000)),
            ..Params::full_screen()
        };
        let (calibration, name) = (Some("benches/panel.toml".into()), Some("EV27".into()));
        let wanted = DisplaySettings { params, calibration, name, dither: 4, duty: Some(0.25), tracker_hz: 5.0 };
        assert_eq!(settings, wanted);
        let first = read("direct_scanout = true").unwrap();
        assert_eq!(first.params.direct_scanout, Some(CardChoice::First));
        let second = read("direct_scanout = true\ncard = \"/dev/dri/card1\"").unwrap();
        assert_eq!(second.params.direct_scanout, Some(CardChoice::At("/dev/dri/card1".into())));
        assert_eq!(read("direct_scanout = false").unwrap().params.direct_scanout, None);
        let named = read("monitor = \"HDMI-1\"").unwrap();
        assert_eq!(named.params.monitor, MonitorChoice::Named("HDMI-1".into()));
    }

    #[test]
    fn what_cannot_be_is_refused_with_the_key() {
        for (text, part) in [
            ("monitr = 1", "did you mean `monitor`"),
            ("monitor = -1", "sink.monitor"),
            ("monitor = \" \"", "sink.monitor"),
            ("monitor = 1.5", "name or its number"),
            ("window = [640, 481]", "[640, 480]"),
            ("window = [0, 480]", "sink.window"),
            ("bits = 9", "8 or 10"),
            ("bits = 12", "sink.bits"),
            ("marker_px = 481", "sink.marker_px"),
            ("marker_corner = \"top_left\"", "marker_px"),
            ("marker_px = 8\nmarker_corner = \"top\"", "top_left"),
            ("latency_ms = -1.0", "sink.latency_ms"),
            ("calibration = \"\"", "sink.calibration"),
            ("calibration = \"a.toml\"", "sink.name"),
            ("calibration = \"a.toml\"\nname = \" \"", "sink.name"),
            ("calibration = \"a.toml\"\nname = \"a\"\nduty = 1.01", "sink.duty"),
            ("card = \"/dev/dri/card0\"", "direct_scanout"),
            ("direct_scanout = true\ncard = \" \"", "sink.card"),
            ("direct_scanout = true\nwindow = [640, 480]", "sink.window"),
            ("name = \"a\"", "sink.name"),
            ("dither = 4", "sink.dither"),
            ("duty = 1.0", "sink.duty"),
            ("tracker_hz = 10.0", "sink.tracker_hz"),
        ] {
            let error = read(text).unwrap_err().to_string();
            assert!(error.contains(part), "{text}: {error}");
        }
        assert!(read("marker_px = 480").is_ok(), "the other side of the edge");
    }

    #[test]
    fn only_the_first_sink_may_be_a_calibrated_display() {
        let text = "calibration = \"a.toml\"\nname = \"a\"";
        assert!(read_as("sink", text).is_ok());
        let error = read_as("extra_sink[1]", text).unwrap_err().to_string();
        assert!(error.contains("extra_sink[1].calibration") && error.contains("[sink]"), "{error}");
        assert!(read_as("extra_sink[1]", "bits = 10").is_ok(), "as it is, it may stand beside another");
    }
}
