//! The images that a display shows while it is measured: plan -> grey images.
//!
//! Dots are squares of an odd number of pixels, full grey on black, centred on a pixel: their centroid is that pixel's
//! centre whatever the response is. More images identify the dots: in `dots_bit_k` only the dots are lit whose code has
//! bit k, so mirrors, rolls and parts of the field need no guessing ([`super::dot_code`]).

use super::identity::DisplayIdentity;
use crate::display::geometry::LARGEST_SIDE_PX;
use base::{image::Image, refused::Refused};
use serde::{Deserialize, Serialize};

/// Least distance of dots, in sides of a dot: their images stay apart.
const APART: usize = 3;
/// Greys of a ramp lie at the steps to this power: closer together near black, where a display's curve bends.
const RAMP_POWER: f64 = 1.7;
/// Bits of a grey that a window can show.
const BITS: [u32; 2] = [8, 10];

/// Places of the dots.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Grid {
    /// Dots in a row.
    pub columns: usize,
    /// Dots in a column.
    pub rows: usize,
    /// Side of a dot, display px, odd.
    pub dot_px: usize,
    /// From the display's edge to the centre of the first dot, display px.
    pub margin_px: usize,
}

/// One image to be shown.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Pattern {
    /// A black image: the display off, or the lens covered.
    Dark,
    /// One grey everywhere.
    Level(u16),
    /// All dots.
    Dots,
    /// The dots whose code has this bit.
    DotsBit(u32),
    /// The latency marker: a full square in the first corner, or none.
    Marker(bool),
}

impl Pattern {
    /// Returns the name in files and tables.
    pub fn name(self) -> String {
        match self {
            Self::Dark => "dark".into(),
            Self::Level(grey) => format!("level_{grey}"),
            Self::Dots => "dots".into(),
            Self::DotsBit(bit) => format!("dots_bit_{bit}"),
            Self::Marker(true) => "marker_on".into(),
            Self::Marker(false) => "marker_off".into(),
        }
    }

    /// Returns the pattern of a name.
    pub fn of_name(name: &str) -> Option<Self> {
        match name.trim() {
            "dark" => Some(Self::Dark),
            "dots" => Some(Self::Dots),
            "marker_on" => Some(Self::Marker(true)),
            "marker_off" => Some(Self::Marker(false)),
            other => match other.strip_prefix("dots_bit_") {
                Some(bit) => bit.parse().ok().filter(|bit| *bit < 32).map(Self::DotsBit),
                None => other.strip_prefix("level_")?.parse().ok().map(Self::Level),
            },
        }
    }

    /// Returns the instruction for a person while the pattern is shown.
    pub fn instruction(self) -> &'static str {
        match self {
            Self::Dark => "switch the display off (or cover the lens); measure the level",
            Self::Level(0) => "measure the level: the display's black",
            Self::Level(_) => "measure the level; one exposure for all levels, at which full grey does not saturate",
            Self::Dots => "measure centroid and flux of every dot; expose so that none saturates",
            Self::DotsBit(_) => "measure the centroids of the dots that are left",
            Self::Marker(_) => "only for a photodiode: `starloop display flip` turns it over; no frame needed",
        }
    }
}

impl Grid {
    /// Dots in all.
    pub fn count(&self) -> usize {
        self.columns * self.rows
    }

    /// Returns the display px of the centre of dot `number`, counted from 1 row by row.
    pub fn centre_px(&self, number: usize, display: &DisplayIdentity) -> Option<[usize; 2]> {
        let index = number.checked_sub(1).filter(|index| *index < self.count())?;
        let along = |i: usize, count: usize, side: usize| {
            let space = side - 1 - 2 * self.margin_px;
            self.margin_px + (i * space + (count - 1) / 2) / (count - 1)
        };
        let column = along(index % self.columns, self.columns, display.width_px);
        let row = along(index / self.columns, self.rows, display.height_px);
        Some([column, row])
    }

    pub(super) fn check(&self, display: &DisplayIdentity) -> Result<(), Refused> {
        let refuse = |name, wanted: String, got: String| {
            Err(Refused(format!("display plan: {name} wanted {wanted}, got {got}")))
        };
        if display.name.trim().is_empty() {
            return refuse("display.name", "a name".into(), "none".into());
        }
        for (name, side) in [("display.width_px", display.width_px), ("display.height_px", display.height_px)] {
            if !(64..=LARGEST_SIDE_PX).contains(&side) {
                return refuse(name, format!("64 to {LARGEST_SIDE_PX}"), side.to_string());
            }
        }
        if !BITS.contains(&display.bits) {
            return refuse("display.bits", "8 or 10, as windows can show".into(), display.bits.to_string());
        }
        if self.dot_px.is_multiple_of(2) || self.dot_px > 99 {
            return refuse(
                "grid.dot_px",
                "an odd number up to 99: a dot has a middle pixel".into(),
                self.dot_px.to_string(),
            );
        }
        let half_px = display.width_px.min(display.height_px) / 2;
        if !(self.dot_px..half_px).contains(&self.margin_px) {
            let wanted = format!("at least a dot, {} px, and less than half the display, {half_px} px", self.dot_px);
            return refuse("grid.margin_px", wanted, self.margin_px.to_string());
        }
        let sides = [("grid.columns", self.columns, display.width_px), ("grid.rows", self.rows, display.height_px)];
        for (name, count, side) in sides {
            let space = side.saturating_sub(1 + 2 * self.margin_px);
            let most = (space / (APART * self.dot_px) + 1).min(100);
            if !(3..=most).contains(&count) {
                return refuse(name, format!("3 to {most} (dots at least {APART} sides apart)"), count.to_string());
            }
        }
        Ok(())
    }
}

/// Greys of a ramp from black to full in so many steps, closer together near black.
pub fn ramp_greys(full: u16, steps: usize) -> Vec<u16> {
    let steps = steps.max(1);
    let grey = |i: usize| {
        #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "0 to the full grey")]
        let grey = (f64::from(full) * (i as f64 / steps as f64).powf(RAMP_POWER)).round() as u16;
        grey
    };
    let mut greys: Vec<u16> = (0..=steps).map(grey).collect();
    greys.dedup();
    greys
}

/// Draws a pattern. `is_lit` says which dots shine.
pub(super) fn draw(
    pattern: Pattern,
    display: &DisplayIdentity,
    grid: &Grid,
    is_lit: impl Fn(usize) -> bool,
) -> Image<u16> {
    let mut image = Image::new(display.width_px, display.height_px);
    let full = display.full_grey();
    match pattern {
        Pattern::Dark | Pattern::Marker(false) => {}
        Pattern::Level(grey) => image.pixels_mut().fill(grey.min(full)),
        Pattern::Marker(true) => {
            let side = display.width_px.min(display.height_px) / 16;
            square(&mut image, [side / 2; 2], side / 2, full);
        }
        Pattern::Dots | Pattern::DotsBit(_) => {
            let lit = (1..=grid.count()).filter(|number| is_lit(*number));
            for centre in lit.filter_map(|number| grid.centre_px(number, display)) {
                square(&mut image, centre, grid.dot_px / 2, full);
            }
        }
    }
    image
}

/// Draws a square of `half` pixels to each side of its centre.
fn square(image: &mut Image<u16>, [x, y]: [usize; 2], half: usize, grey: u16) {
    let width = image.width();
    let rows = image.pixels_mut().chunks_exact_mut(width).skip(y.saturating_sub(half)).take(2 * half + 1);
    rows.for_each(|row| row.iter_mut().skip(x.saturating_sub(half)).take(2 * half + 1).for_each(|p| *p = grey));
}
