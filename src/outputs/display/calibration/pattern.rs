//! The images that a display shows while it is measured: plan -> grey images.
//!
//! Dots are squares of an odd number of pixels, full grey on black, centred on a pixel: their centroid is that pixel's
//! centre whatever the response is. More images identify the dots: in `dots_bit_k` only the dots are lit whose code has
//! bit k, so mirrors, rolls and parts of the field need no guessing (below).

use super::identity::DisplayIdentity;
use crate::display::calibration::error;
use crate::display::geometry::{DisplayGeometry, LARGEST_SIDE_PX};
use base::{image::Image, refused::Refused};
use serde::{Deserialize, Serialize};
use sky::astrometry::CameraGeometry;

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

// How much of the display's visible part lies among the dots that the map was fitted to.
//
// Places in even steps over the display that the map sends into the tracker's image are the part that the tracker
// sees; those of them within the outermost dots are covered. Too low a share is refused: beyond its dots a polynomial
// takes any value. Limit: the visible part is computed from the map itself, which is a guess beyond the dots and wrong
// far away from them. Tests below.

/// Least share of what the tracker sees of the display that must lie within the outermost dots. A grid that fills a
/// field misses up to one spacing on each side: with 6 x 6 dots in view half of it is left.
pub const LEAST_COVERAGE: f64 = 0.5;
/// Places along each side of the display.
const PLACES: usize = 48;

/// Returns the share of what `tracker` sees of the display that lies within the outermost dots; 0 when it sees nothing.
pub fn coverage(geometry: &DisplayGeometry, tracker: &CameraGeometry) -> f64 {
    let camera = geometry.camera();
    let along = |i: usize, side: usize| (i as f64 + 0.5) * side as f64 / PLACES as f64 - 0.5;
    let place = |i: usize, j: usize| [along(i, camera.width_px()), along(j, camera.height_px())];
    let [right, bottom] = [tracker.width_px(), tracker.height_px()].map(|side| side as f64 - 0.5);
    let is_seen = |px: &[f64; 2]| {
        let seen = geometry.unproject(*px).and_then(|v_sensor| tracker.project(v_sensor));
        seen.is_some_and(|[x, y]| x >= -0.5 && y >= -0.5 && x <= right && y <= bottom)
    };
    let all = (0..PLACES).flat_map(|i| (0..PLACES).map(move |j| place(i, j)));
    let [seen, covered] = all
        .filter(is_seen)
        .fold([0_u32; 2], |[seen, covered], px| [seen + 1, covered + u32::from(geometry.covered().contains(px))]);
    f64::from(covered) / f64::from(seen.max(1))
}

/// Returns the coverage, when it will do.
///
/// # Errors
/// When it is below [`LEAST_COVERAGE`].
pub(super) fn enough(geometry: &DisplayGeometry, tracker: &CameraGeometry) -> Result<f64, Refused> {
    let got = coverage(geometry, tracker);
    if got >= LEAST_COVERAGE {
        Ok(got)
    } else {
        Err(Refused(format!(
            "the dots fitted to enclose {:.0} % of what the tracker sees of the display: wanted at least {:.0} %, as the map is a guess beyond them; measure the dots of the other parts too, or plan more of them with a smaller margin",
            100.0 * got,
            100.0 * LEAST_COVERAGE
        )))
    }
}

// Which dot is which: centroids of all dots and of those with each bit -> numbers.
//
// A dot's code is its number, counted from 1, and above it a bit that makes the count of ones even. A centroid of the
// image with all dots carries bit k when the image of bit k has a centroid at the same place. One bit read wrong
// spoils the parity, and a number read twice names neither: such centroids are left out and counted. Tests below.

/// Share of the median distance between neighbours within which two centroids are the same dot.
const SAME_PLACE: f64 = 0.25;

/// Returns the number of images that identify `count` dots.
pub fn bits_of(count: usize) -> u32 {
    usize::BITS - count.leading_zeros() + 1
}

/// Returns the code of dot `number` of `count`.
pub fn code(number: usize, count: usize) -> usize {
    number | (number.count_ones() as usize % 2) << (bits_of(count) - 1)
}

/// Returns the number of a code; `None` for one that no dot has.
fn number(code: usize, count: usize) -> Option<usize> {
    let number = code & !(1 << (bits_of(count) - 1));
    (code.count_ones().is_multiple_of(2) && (1..=count).contains(&number)).then_some(number)
}

/// Reads the codes: for each centroid of `all`, its dot's number. `bits[k]` holds the centroids of the image of bit k.
///
/// # Errors
/// When an image is missing.
pub fn numbers(all: &[[f64; 2]], bits: &[Vec<[f64; 2]>], count: usize) -> Result<Vec<Option<usize>>, Refused> {
    let wanted = bits_of(count) as usize;
    if let Some(bit) = (0..wanted).find(|bit| bits.get(*bit).is_none_or(Vec::is_empty)) {
        let got = format!("no centroid of dots_bit_{bit}");
        return Err(error::not_a_map("centroids of every image of dots", got));
    }
    let near = SAME_PLACE * neighbour_distance(all);
    let is_at = |places: &[[f64; 2]], at: &[f64; 2]| places.iter().any(|place| distance(place, at) <= near);
    let read = |at: &[f64; 2]| {
        let code = (0..wanted).filter(|bit| is_at(&bits[*bit], at)).map(|bit| 1 << bit).sum();
        number(code, count)
    };
    let mut numbers: Vec<Option<usize>> = all.iter().map(read).collect();
    let mut times = vec![0_u32; count + 1];
    numbers.iter().flatten().for_each(|number| times[*number] += 1);
    numbers.iter_mut().for_each(|number| *number = number.filter(|number| times[*number] == 1));
    Ok(numbers)
}

fn distance(a: &[f64; 2], b: &[f64; 2]) -> f64 {
    (a[0] - b[0]).hypot(a[1] - b[1])
}

/// Returns the median distance to the nearest other dot.
fn neighbour_distance(places: &[[f64; 2]]) -> f64 {
    let nearest = |(i, at): (usize, &[f64; 2])| {
        let others = places.iter().enumerate().filter(|(j, _)| *j != i);
        others.map(|(_, place)| distance(place, at)).fold(f64::INFINITY, f64::min)
    };
    let mut distances: Vec<f64> = places.iter().enumerate().map(nearest).collect();
    base::least_squares::median(&mut distances)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::display::geometry::GeometryParameters;
    use sky::astrometry::CameraParameters;

    const SIZE_PX: [usize; 2] = [960, 480];

    fn tracker(side_px: usize) -> CameraGeometry {
        let middle = 0.5 * (side_px as f64 - 1.0);
        CameraGeometry::new(CameraParameters {
            width_px: side_px,
            height_px: side_px,
            focal_px: [1000.0; 2],
            principal_point_px: [middle; 2],
            distortion: Default::default(),
        })
        .unwrap()
    }

    /// Returns a geometry with display pixels as large as the tracker's, about the same middle.
    fn geometry([left, right, top, bottom]: [f64; 4]) -> DisplayGeometry {
        let parameters = GeometryParameters {
            mirrored: false,
            drawn_from_sensor: [1.0, 0.0, 0.0, 0.0],
            focal_px: [1000.0; 2],
            principal_point_px: SIZE_PX.map(|side| 0.5 * (side as f64 - 1.0)),
            degree: 1,
            terms: Vec::new(),
            covered_px: vec![[left, top], [right, top], [right, bottom], [left, bottom]],
        };
        DisplayGeometry::new(&parameters, SIZE_PX).unwrap()
    }

    #[test]
    fn the_share_is_that_of_the_display_or_of_the_field() {
        let whole = geometry([20.0, 939.0, 20.0, 459.0]);
        let share = coverage(&whole, &tracker(2000));
        assert!((share - 920.0 * 440.0 / (960.0 * 480.0)).abs() < 0.05, "a field larger than the display: {share}");
        let quarter = geometry([20.0, 480.0, 20.0, 240.0]);
        let share = coverage(&quarter, &tracker(2000));
        assert!((share - 0.22).abs() < 0.02, "one corner: {share}");
        // A field of 480 px sees columns 240 to 720 of the display.
        let in_field = geometry([260.0, 700.0, 20.0, 459.0]);
        let [large, small] = [2000, 480].map(|side| coverage(&in_field, &tracker(side)));
        assert!((small - (440.0_f64 / 480.0).powi(2)).abs() < 0.06, "a field within the display: {small}");
        assert!(large < 0.5, "{large}");
        let beyond = coverage(&geometry([20.0, 200.0, 20.0, 459.0]), &tracker(480));
        assert_eq!(beyond, 0.0, "dots where the tracker does not see");
    }

    #[test]
    fn both_sides_of_enough() {
        let of = |right: f64| enough(&geometry([-1.0, right, -1.0, 480.0]), &tracker(2000));
        assert!(of(485.0).is_ok());
        let reported = of(465.0).unwrap_err().to_string();
        assert!(reported.contains("enclose 48 %"), "{reported}");
        assert!(reported.contains("at least 50 %"), "{reported}");
    }
}

#[cfg(test)]
mod dot_code_tests {
    use super::*;

    const COUNT: usize = 35;

    fn place(number: usize) -> [f64; 2] {
        // Rolled and mirrored: codes do not care.
        let (column, row) = ((number - 1) % 7, (number - 1) / 7);
        [300.0 - 20.0 * row as f64 - 3.0 * column as f64, 100.0 + 21.0 * column as f64]
    }

    fn shown() -> (Vec<[f64; 2]>, Vec<Vec<[f64; 2]>>) {
        let with_bit = |bit: u32| (1..=COUNT).filter(|n| code(*n, COUNT) >> bit & 1 == 1).map(place).collect();
        ((1..=COUNT).map(place).collect(), (0..bits_of(COUNT)).map(with_bit).collect())
    }

    #[test]
    fn every_dot_is_named() {
        let (all, bits) = shown();
        assert_eq!(bits_of(COUNT), 7, "six bits and the parity");
        let found = numbers(&all, &bits, COUNT).unwrap();
        assert_eq!(found, (1..=COUNT).map(Some).collect::<Vec<_>>());
    }

    #[test]
    fn a_bit_read_wrong_leaves_the_dot_out() {
        let (mut all, mut bits) = shown();
        bits[1].remove(3);
        bits[0].push([1000.0, 1000.0]);
        all.push([500.0, 500.0]);
        let found = numbers(&all, &bits, COUNT).unwrap();
        assert_eq!(found.iter().flatten().count(), COUNT - 1, "the others are named: {found:?}");
        assert!((0..COUNT).all(|i| found[i].is_none_or(|n| n == i + 1)), "none is named wrongly");
        assert_eq!(found[COUNT], None, "stray light has no code");
    }

    #[test]
    fn missing_images_are_reported() {
        let (all, mut bits) = shown();
        bits.pop();
        assert!(numbers(&all, &bits, COUNT).unwrap_err().to_string().contains("dots_bit_6"));
    }
}
