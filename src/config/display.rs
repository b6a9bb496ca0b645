//! `[sink] kind = "display"`: a monitor in front of a tracker.

use crate::key::{Given, Section, section, taken};
use crate::key_type::{Raw, Shape, Whole, Word};
use crate::{check::Checker, error::Result};
use base::time::Span;
use outputs::display::{Bits, Corner, Marker, MonitorChoice, Params};
use serde::Deserialize;
use std::path::PathBuf;

/// Longest side of a frame that a graphics driver must take.
const LONGEST_PX: i64 = 8192;

/// A display, checked.
#[derive(Debug, Clone, PartialEq)]
pub struct DisplaySettings {
    /// Parameters that the display is opened with.
    pub params: Params,
    /// Its calibration file; `None`: greys are taken for luminances, which no monitor's are, and the program says so.
    pub calibration: Option<PathBuf>,
    /// Name of the display that the calibration must have; `None`: without a calibration.
    pub name: Option<String>,
    /// Refreshes over which light between two greys is spread; 1: the nearer grey.
    pub dither: u32,
    /// Share of a refresh during which the display shines; `None`: not known.
    pub duty: Option<f64>,
    /// Frames per second of the tracker that looks at it, for the beat of its shutter against the refresh.
    pub tracker_hz: f64,
}

section! {
    /// A monitor in front of a tracker.
    DisplayKeys at "sink" {
        /// Number or name of the monitor; `starloop display monitors` lists them.
        monitor: Raw<MonitorKey> = Computed("\"primary\""),
            Shape::either(Shape::Whole(0..=255), Shape::Text("name"));
        /// Columns and rows of the window; left out, the whole monitor.
        window: Raw<[i64; 2]> = Optional, Shape::Row(2, Box::new(Shape::Whole(1..=LONGEST_PX)));
        /// Bits of a colour: 8, or 10 where driver, server and monitor agree on it.
        bits: Whole = 8, 8..=10;
        /// Side of a square for a photodiode; 0 for none.
        marker_px: Whole = 0, 0..=LONGEST_PX;
        /// Corner of that square: where no star of interest falls.
        marker_corner: Word<Corner> = "top_left", [
            ("top_left", Corner::TopLeft), ("top_right", Corner::TopRight),
            ("bottom_left", Corner::BottomLeft), ("bottom_right", Corner::BottomRight),
        ];
        /// Calibration as `starloop calibrate display` writes it, beside this file.
        calibration: String = Optional, "path";
        /// Name of the display in its calibration, model and serial number: a calibration of another display is
        /// refused.
        name: String = Optional, "text";
        /// Refreshes, a power of two: over so many the mean light of a pixel is right.
        dither: Whole = 16, 1..=256;
        /// Frames per second of the tracker in front of the display.
        tracker_hz: f64 = 10.0, PositiveUpTo(1e4);
        /// Share of a refresh during which the display shines: 1 holds its light, 0 flashes, which beats most.
        duty: f64 = Optional, Within(0.0, 1.0);
        /// From submit to light in the middle of the display, as measured by `starloop display latency`.
        latency_ms: f64 = Optional, Within(0.0, 1000.0);
    }
}

/// A monitor by number or by name.
#[derive(Debug, Clone, Deserialize)]
#[serde(untagged, expecting = "invalid type: expected a monitor's name or its number, from 0")]
pub(super) enum MonitorKey {
    Index(i64),
    Name(String),
}

impl DisplaySettings {
    /// Reads the keys of a sink for a camera's frames of `image_px`, columns and rows.
    pub(super) fn check(keys: &DisplayKeys, image_px: [u32; 2], check: &mut Checker<'_>) -> Result<Self> {
        let is_calibrated = keys.calibration().is_given();
        if is_calibrated && keys.table() != "sink" {
            let advice = "frames are drawn for one display: name it in [sink], and what keeps its frames beside it";
            return Err(keys.calibration().advised(advice).invalid(
                "given",
                "a calibrated display in [sink] only",
                check,
            ));
        }
        let monitor = monitor(&keys.monitor(), check)?;
        // Images for a calibrated display have the size given by the calibration.
        let image_px = (!is_calibrated).then_some(image_px);
        let window_px = window(&keys.window(), image_px, check)?;
        let bits = match keys.bits().check(check)? {
            8 => Bits::Eight,
            10 => Bits::Ten,
            other => return Err(keys.bits().invalid(other, "8 or 10", check)),
        };
        let marker = marker(keys, image_px, check)?;
        let latency = keys.latency_ms().optional(check)?.map(|ms| Span::from_s(ms * 1e-3));
        let params = Params { monitor, window_px, bits, marker, latency, refresh: None };
        let plain = Self { params, calibration: None, name: None, dither: 1, duty: None, tracker_hz: 0.0 };
        if is_calibrated {
            return plain.calibrated(keys, check);
        }
        keys.refuse(&["name", "dither", "tracker_hz", "duty"], "a display with a calibration", check)?;
        Ok(plain)
    }

    /// Adds the keys that only a calibrated display has.
    fn calibrated(self, keys: &DisplayKeys, check: &mut Checker<'_>) -> Result<Self> {
        let path = keys.calibration().raw().filter(|path| !path.trim().is_empty());
        let path = path.ok_or_else(|| keys.calibration().invalid("empty", "a calibration file", check))?;
        let name = keys.name().raw().filter(|name| !name.trim().is_empty());
        let name = name.ok_or_else(|| keys.name().missing("what the calibration calls the display", check))?;
        taken!(check, keys => dither, tracker_hz);
        let duty = keys.duty().optional(check)?;
        let calibration = Some(check.document.file_beside(path));
        Ok(Self { calibration, name: Some(name.clone()), dither, duty, tracker_hz, ..self })
    }
}

fn monitor(given: &Given<'_, Raw<MonitorKey>>, check: &mut Checker<'_>) -> Result<MonitorChoice> {
    match given.raw() {
        None => {
            check.note(&given.key(), "primary");
            Ok(MonitorChoice::Primary)
        }
        Some(MonitorKey::Name(name)) if name == "primary" => Ok(MonitorChoice::Primary),
        Some(MonitorKey::Name(name)) if name.trim().is_empty() => {
            Err(given.invalid("empty", "a name, a number, or \"primary\"", check))
        }
        Some(MonitorKey::Name(name)) => Ok(MonitorChoice::Named(name.clone())),
        Some(MonitorKey::Index(index)) => {
            let index = check.whole(&given.key(), Some(*index), None, 0..=255, &given.advice)?;
            Ok(MonitorChoice::Index(index as usize))
        }
    }
}

fn window(
    given: &Given<'_, Raw<[i64; 2]>>,
    image_px: Option<[u32; 2]>,
    check: &mut Checker<'_>,
) -> Result<Option<[u32; 2]>> {
    let Some(sides) = given.raw() else { return Ok(None) };
    let mut window_px = [0; 2];
    for (side, length) in window_px.iter_mut().zip(sides) {
        *side = check.whole(&given.key(), Some(*length), None, 1..=8192, &given.advice)?;
    }
    if let Some(image_px) = image_px.filter(|image_px| *image_px != window_px) {
        let wanted = format!("{image_px:?}, the camera's columns and rows");
        return Err(check.invalid(&given.key(), format!("{window_px:?}"), wanted, "frames are never scaled"));
    }
    Ok(Some(window_px))
}

fn marker(keys: &DisplayKeys, image_px: Option<[u32; 2]>, check: &mut Checker<'_>) -> Result<Option<Marker>> {
    // Of a calibrated display the size is not known here: its marker is compared with it when it is opened.
    let longest = image_px.map_or(LONGEST_PX, |[columns, rows]| i64::from(columns.min(rows)));
    let size_px = keys.marker_px().within(0..=longest).check(check)?;
    if size_px == 0 {
        keys.refuse(&["marker_corner"], "marker_px > 0", check)?;
        return Ok(None);
    }
    Ok(Some(Marker { size_px, corner: keys.marker_corner().check(check)? }))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::document::Document;
    use std::path::Path;

    const IMAGE_PX: [u32; 2] = [640, 480];

    fn read(text: &str) -> Result<DisplaySettings> {
        read_as("sink", text)
    }

    fn read_as(table: &str, text: &str) -> Result<DisplaySettings> {
        #[derive(Deserialize)]
        struct File {
            sink: DisplayKeys,
        }
        let document = Document::from_text(&format!("[sink]\n{text}"), Path::new("benches/a.toml"));
        let File { sink } = document.read_as()?;
        DisplaySettings::check(&sink.at(table), IMAGE_PX, &mut Checker::new(&document))
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
        let named = read("monitor = \"HDMI-1\"").unwrap();
        assert_eq!(named.params.monitor, MonitorChoice::Named("HDMI-1".into()));
    }

    #[test]
    fn impossible_values_are_refused_with_the_key() {
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
            ("direct_scanout = true", "direct_scanout"),
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
        assert!(read_as("extra_sink[1]", "bits = 10").is_ok(), "the list accepts it as a second display");
    }
}
