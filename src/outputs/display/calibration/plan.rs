//! The plan of a calibration: which display and tracker, which images in which order. A TOML file beside the images.

use super::identity::{DisplayIdentity, TrackerIdentity};
use super::pattern::{Grid, Pattern, bits_of, code, draw, ramp_greys};
use crate::display::calibration::error;
use base::input_file::{SETTINGS_BYTES, read_text};
use base::{image::Image, refused::Refused};
use frames::sink::crc32::Crc32;
use serde::{Deserialize, Serialize};
use std::path::Path;

/// Fewest steps of a ramp that make a response.
const FEWEST_STEPS: usize = 5;

/// The images to show, and the display and tracker that they are for.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Plan {
    /// Grey levels between black and full whose luminance is measured.
    pub ramp_steps: usize,
    /// The display.
    pub display: DisplayIdentity,
    /// The tracker.
    pub tracker: TrackerIdentity,
    /// The dots.
    pub grid: Grid,
    /// The images by number, for people.
    #[serde(default)]
    pub pattern: Vec<Step>,
}

/// One image of the plan, in words.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Step {
    /// Name, also that of its file.
    pub name: String,
    /// Instruction for a person while it is shown.
    pub instruction: String,
}

impl Plan {
    /// Returns a plan, checked.
    ///
    /// # Errors
    /// When the dots do not fit the display, or a number is out of range.
    pub fn new(
        display: DisplayIdentity,
        tracker: TrackerIdentity,
        grid: Grid,
        ramp_steps: usize,
    ) -> Result<Self, Refused> {
        grid.check(&display)?;
        let most = usize::from(display.full_grey()).min(1024);
        if !(FEWEST_STEPS..=most).contains(&ramp_steps) {
            let wanted = format!("{FEWEST_STEPS} to {most}");
            return Err(Refused(format!("display plan: ramp_steps wanted {wanted}, got {ramp_steps}")));
        }
        let mut plan = Self { ramp_steps, display, tracker, grid, pattern: Vec::new() };
        let step = |pattern: Pattern| Step { name: pattern.name(), instruction: pattern.instruction().into() };
        plan.pattern = plan.patterns().into_iter().map(step).collect();
        Ok(plan)
    }

    /// Returns every image in order.
    pub fn patterns(&self) -> Vec<Pattern> {
        let bits = (0..bits_of(self.grid.count())).map(Pattern::DotsBit);
        let ramp = ramp_greys(self.display.full_grey(), self.ramp_steps).into_iter().map(Pattern::Level);
        let marker = [Pattern::Marker(false), Pattern::Marker(true)];
        [Pattern::Dark, Pattern::Dots].into_iter().chain(bits).chain(ramp).chain(marker).collect()
    }

    /// Returns the greys of an image.
    pub fn draw(&self, pattern: Pattern) -> Image<u16> {
        let is_lit = |number: usize| match pattern {
            Pattern::DotsBit(bit) => code(number, self.grid.count()) >> bit & 1 == 1,
            Pattern::Dark | Pattern::Level(_) | Pattern::Dots | Pattern::Marker(_) => true,
        };
        draw(pattern, &self.display, &self.grid, is_lit)
    }

    /// Returns an image as luminances in even steps, 65535 full: `starloop display show` at gamma 1 shows its very
    /// greys.
    pub fn luminances(&self, pattern: Pattern) -> Image<u16> {
        let mut image = self.draw(pattern);
        let full = u64::from(self.display.full_grey());
        let luminance = |grey: u16| u16::try_from((u64::from(grey) * 65_535 + full / 2) / full).unwrap_or(u16::MAX);
        image.pixels_mut().iter_mut().for_each(|value| *value = luminance(*value));
        image
    }

    /// Returns the CRC-32 of everything that the measurements depend on: a new plan with other numbers has another.
    pub fn crc32(&self) -> String {
        let Grid { columns, rows, dot_px, margin_px } = &self.grid;
        let DisplayIdentity { name, width_px, height_px, bits } = &self.display;
        let text = format!(
            "{name}|{width_px}|{height_px}|{bits}|{columns}|{rows}|{dot_px}|{margin_px}|{}|{}",
            self.ramp_steps, self.tracker.geometry_crc32
        );
        let mut crc = Crc32::default();
        crc.update(text.as_bytes());
        format!("{:08x}", crc.value())
    }

    /// Returns the centre of a dot, display px.
    pub fn dot_px(&self, number: usize) -> Option<[f64; 2]> {
        self.grid.centre_px(number, &self.display).map(|px| px.map(|v| v as f64))
    }

    /// Returns the plan as the text of a file.
    ///
    /// # Errors
    /// When it cannot be written as TOML.
    pub fn to_toml(&self) -> Result<String, Refused> {
        toml::to_string(self).map_err(|error| Refused::at("plan.toml", error))
    }

    /// Reads and checks a plan.
    ///
    /// # Errors
    /// The fault of the file.
    pub fn read(path: &Path) -> Result<Self, Refused> {
        let refuse = |reason: String| error::file(path, reason);
        let text = read_text(path, SETTINGS_BYTES).map_err(|error| refuse(error.to_string()))?;
        let plan: Self = toml::from_str(&text).map_err(|error| refuse(error.message().to_owned()))?;
        Self::new(plan.display, plan.tracker, plan.grid, plan.ramp_steps)
    }
}

#[cfg(test)]
pub(super) mod tests {
    use super::*;

    pub(in crate::display::calibration) fn sample() -> Plan {
        let display = DisplayIdentity { name: "test".into(), width_px: 320, height_px: 200, bits: 8 };
        let tracker = TrackerIdentity { name: "t".into(), width_px: 9, height_px: 9, geometry_crc32: "0".into() };
        Plan::new(display, tracker, Grid { columns: 8, rows: 5, dot_px: 5, margin_px: 12 }, 16).unwrap()
    }

    #[test]
    fn dots_are_centred_where_the_plan_says() {
        let plan = sample();
        let image = plan.draw(Pattern::Dots);
        let lit: u64 = image.pixels().iter().map(|p| u64::from(*p > 0)).sum();
        assert_eq!(lit, 40 * 25);
        for number in [1, 8, 33, 40] {
            let [x, y] = plan.dot_px(number).unwrap().map(|v| v as usize);
            assert_eq!(image.get(x, y), Some(255), "dot {number}");
            assert_eq!((image.get(x + 3, y), image.get(x, y - 3)), (Some(0), Some(0)), "and ends there");
        }
        assert_eq!(plan.dot_px(1), Some([12.0, 12.0]));
        assert_eq!(plan.dot_px(40), Some([307.0, 187.0]));
        assert_eq!((plan.dot_px(0), plan.dot_px(41)), (None, None));
    }

    #[test]
    fn bits_show_their_dots_and_names_read_back() {
        let plan = sample();
        for pattern in plan.patterns() {
            assert_eq!(Pattern::of_name(&pattern.name()), Some(pattern));
            let image = plan.draw(pattern);
            if let Pattern::DotsBit(bit) = pattern {
                let [x, y] = plan.dot_px(11).unwrap().map(|v| v as usize);
                assert_eq!(image.get(x, y) == Some(255), code(11, 40) >> bit & 1 == 1, "bit {bit} of dot 11");
            }
        }
        assert_eq!(Pattern::of_name("level_x"), None);
        assert_eq!(plan.draw(Pattern::Level(17)).get(3, 3), Some(17));
        let greys = ramp_greys(255, 16);
        assert_eq!((greys[0], greys[1], *greys.last().unwrap(), greys.len()), (0, 2, 255, 17));
    }

    #[test]
    fn luminances_show_the_very_greys() {
        use crate::display::grey::GreyTable;
        for bits in [8, 10] {
            let plan = Plan { display: DisplayIdentity { bits, ..sample().display }, ..sample() };
            let table = GreyTable::by_gamma(bits, 1.0).unwrap();
            for grey in 0..=plan.display.full_grey() {
                let shown = plan.luminances(Pattern::Level(grey));
                assert_eq!(shown.get(9, 9).map(|luminance| table.nearest(luminance)), Some(grey), "{bits} bits");
                let raw = plan.draw(Pattern::Level(grey)).get(9, 9).map(|luminance| table.nearest(luminance));
                assert!(grey < 64 || raw != Some(grey), "greys taken for luminances: the comparison can fail");
            }
        }
    }

    #[test]
    fn another_plan_has_another_sum() {
        let other = Plan { grid: Grid { margin_px: 13, ..sample().grid }, ..sample() };
        assert_eq!(sample().crc32(), sample().crc32());
        assert_ne!(sample().crc32(), other.crc32());
    }

    #[test]
    fn a_plan_reads_back_and_a_bad_one_is_refused() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("plan.toml");
        std::fs::write(&path, sample().to_toml().unwrap()).unwrap();
        assert_eq!(Plan::read(&path).unwrap(), sample());
        for (from, to, reported) in [
            ("dot_px = 5", "dot_px = 4", "odd"),
            ("columns = 8", "columns = 80", "grid.columns"),
            ("bits = 8", "bits = 33", "display.bits"),
            ("bits = 8", "bits = 9", "8 or 10"),
            ("bits = 8", "bits = 12", "8 or 10"),
            ("margin_px = 12", "margin_px = 2", "margin_px"),
            ("margin_px = 12", "margin_px = 9223372036854775807", "less than half the display"),
            ("ramp_steps = 16", "ramp_steps = 1", "ramp_steps"),
            ("[grid]", "[gird]", "gird"),
        ] {
            let text = sample().to_toml().unwrap().replace(from, to);
            std::fs::write(&path, text).unwrap();
            let error = Plan::read(&path).unwrap_err().to_string();
            assert!(error.contains(reported), "{error}");
        }
        // Twice this is zero in 64 bits.
        let wide = Grid { margin_px: 1 << 63, ..sample().grid };
        let error = Plan::new(sample().display, sample().tracker, wide, 16).unwrap_err().to_string();
        assert!(error.contains("grid.margin_px") && error.contains("9223372036854775808"), "{error}");
        assert!(Plan::read(&folder.path().join("none.toml")).unwrap_err().to_string().contains("none.toml"));
    }
}
