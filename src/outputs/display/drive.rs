//! Frames in linear luminance -> greys of one refresh: flat field, response, dither.
//!
//! Input: luminance above black relative to a full pixel at the display's brightest place, row by row, as the codes of
//! [`super::luminance_code`]. Output: one grey per pixel, and the count of pixels that wanted more than the display
//! has; the brightest code counts, as it says "as much or more". A pixel gets luminance / flat field; its grey is the
//! exact one of the measured response (a table over the root of the luminance finds the place to look), and what is
//! between two greys is dithered. So light split over pixels is split in *luminance*, and a star's centroid moves
//! linearly: a display driven as if grey were luminance moves a star by more than 1/10 px (test). After `new` nothing
//! is allocated. Tests below; `tests/physics/display_calibration` by a simulated tracker.

use super::{flat_field::FlatField, luminance_code, response::Response};
use base::random::philox;

/// Entries of the table that finds the grey to begin with.
const ENTRIES: usize = 8192;

/// The calibrated values with which a display shows luminance.
#[derive(Debug, Clone, PartialEq)]
pub struct DisplayDrive {
    /// Luminance of every code; more than any display's of the brightest.
    luminance_of_code: Vec<f32>,
    /// Luminance of every grey.
    luminance: Vec<f32>,
    /// Entry i: the highest grey whose luminance is at most (i / last)^2.
    begin: Vec<u16>,
    /// 1 over the flat field, pixel by pixel.
    gain: Vec<f32>,
    start: Vec<u8>,
    dither: Dither,
    width: usize,
    mirrored: bool,
}

impl DisplayDrive {
    /// Prepares tables and maps. `mirrored`: drawn column x is shown in column width - 1 - x.
    pub fn new(response: &Response, flat: &FlatField, size_px: [usize; 2], dither: Dither, mirrored: bool) -> Self {
        let [width, height] = size_px;
        let places = (0..height).flat_map(|y| (0..width).map(move |x| (x, y)));
        #[allow(clippy::cast_possible_truncation, reason = "single precision is enough for 16 bits of grey")]
        let narrow = |v: f64| v as f32;
        let luminance: Vec<f32> = response.luminance().iter().map(|l| narrow(*l)).collect();
        let last = ENTRIES as f64 - 1.0;
        #[allow(clippy::cast_possible_truncation, reason = "greys have at most 16 bits")]
        let begin = (0..ENTRIES).map(|i| response.grey_of((i as f64 / last).powi(2)).0 as u16).collect();
        #[allow(clippy::cast_possible_truncation, reason = "columns and rows of a display")]
        let start = places.clone().map(|(x, y)| dither.start(x as u32, y as u32)).collect();
        let gain = places.map(|(x, y)| narrow(1.0 / flat.at([x as f64, y as f64]))).collect();
        let mut luminance_of_code: Vec<f32> =
            (0..u16::MAX).map(|code| narrow(luminance_code::luminance(code))).collect();
        luminance_of_code.push(f32::INFINITY);
        Self { luminance_of_code, luminance, begin, gain, start, dither, width, mirrored }
    }

    /// Greys of one row of refresh `refresh`, whose luminances come as codes. Gives how many pixels wanted more light
    /// than there is (they show full). Rows beyond the display and pixels beyond the shorter slice are left as they
    /// are.
    pub fn row(&self, codes: &[u16], y: usize, refresh: u64, greys: &mut [u16]) -> u64 {
        self.fill(codes.iter().map(|code| self.luminance_of_code[usize::from(*code)]), y, refresh, greys)
    }

    /// Greys of a whole frame of single-precision luminances, 1 one full pixel; a value that is not a number is black.
    pub fn frame(&self, luminance: &[f32], refresh: u64, greys: &mut [u16]) -> u64 {
        let rows = luminance.chunks_exact(self.width).zip(greys.chunks_exact_mut(self.width));
        rows.enumerate().map(|(y, (luminance, greys))| self.fill(luminance.iter().copied(), y, refresh, greys)).sum()
    }

    fn fill(&self, luminance: impl Iterator<Item = f32>, y: usize, refresh: u64, greys: &mut [u16]) -> u64 {
        let first = y * self.width;
        let Some(gain) = self.gain.get(first..first + self.width) else { return 0 };
        let start = &self.start[first..first + self.width];
        let mut clipped = 0;
        for (x, wanted) in luminance.take(self.width).enumerate() {
            let x = if self.mirrored { self.width - 1 - x } else { x };
            let wanted = wanted * gain[x];
            clipped += u64::from(wanted > 1.0 + 1e-6);
            if let Some(grey) = greys.get_mut(x) {
                *grey = self.grey(wanted, refresh, start[x]);
            }
        }
        clipped
    }

    fn grey(&self, wanted: f32, refresh: u64, start: u8) -> u16 {
        if wanted.is_nan() || wanted <= 0.0 {
            return 0;
        }
        let root = wanted.min(1.0).sqrt() * (ENTRIES as f32 - 1.0);
        #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "0 to the last entry")]
        let mut grey = usize::from(self.begin[root as usize]);
        // The table begins at or just below; rounding may have begun one above.
        while grey > 0 && self.luminance[grey] > wanted {
            grey -= 1;
        }
        while grey + 1 < self.luminance.len() && self.luminance[grey + 1] <= wanted {
            grey += 1;
        }
        let here = self.luminance[grey];
        let next = self.luminance.get(grey + 1).copied().unwrap_or(f32::INFINITY);
        let is_brighter = self.dither.is_brighter((wanted - here) / (next - here), refresh, start);
        #[allow(clippy::cast_possible_truncation, reason = "greys have at most 16 bits")]
        let grey = grey as u16 + u16::from(is_brighter);
        grey
    }
}

// Light between two greys by time: which refreshes show the brighter one.
//
// Of N refreshes (N a power of two) a pixel whose wanted luminance lies at `share` of the step between two greys shows
// the brighter grey in round(share N): the refreshes whose threshold lies below the share. Thresholds are (b + 1/2) /
// N, b the bit-reversed number of the refresh (van der Corput 1935), so that bright refreshes lie as evenly in time as
// can be. Each pixel begins elsewhere in the cycle (Philox of its place): neighbours do not flicker together, and the
// light of a star, which several pixels share, is steadier than that of each. The same refresh shows the same.
//
// Bounds, in units of the luminance step between the two greys (`tests` below, all shares and starts): the mean of any
// N consecutive refreshes is off by at most 1 / (2 N); that of any M < N by at most (log2(N) + 2) / (2 M) and never
// more than 1. In luminance, not in grey: the two greys are those of the measured response.

/// Longest cycle, refreshes: a pixel's place in it is one byte.
pub const LONGEST_CYCLE: u32 = 256;

/// A cycle that there is not.
#[derive(Debug, Clone, Copy, PartialEq, Eq, thiserror::Error)]
#[error("dither over {got} refreshes: wanted 1 (none), 2, 4, 8, 16, 32, 64, 128 or {LONGEST_CYCLE}")]
pub struct CycleError {
    /// Refreshes asked for.
    pub got: u32,
}

/// Key of the pixels' starts; any will do, but it must stay.
const KEY: [u32; 2] = [0x6469_7468, 0x6572_0001];

/// A cycle of refreshes.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Dither {
    cycle: u32,
}

impl Dither {
    /// Returns the cycle of so many refreshes: a power of two, 1 (none: the nearer grey) to [`LONGEST_CYCLE`].
    ///
    /// # Errors
    /// When the length is not a power of two within these limits.
    pub fn over(refreshes: u32) -> Result<Self, CycleError> {
        let is_cycle = refreshes.is_power_of_two() && refreshes <= LONGEST_CYCLE;
        if is_cycle { Ok(Self { cycle: refreshes }) } else { Err(CycleError { got: refreshes }) }
    }

    /// Refreshes of one cycle.
    pub fn cycle(self) -> u32 {
        self.cycle
    }

    /// Returns the largest error of the mean over one cycle, steps between greys.
    pub fn bound(self) -> f64 {
        0.5 / f64::from(self.cycle)
    }

    /// Returns where in the cycle a pixel begins.
    pub fn start(self, x: u32, y: u32) -> u8 {
        #[allow(clippy::cast_possible_truncation, reason = "below the cycle, which is 256 at most")]
        let start = (philox([x, y, 0, 0], KEY)[0] & (self.cycle - 1)) as u8;
        start
    }

    /// Returns the threshold of a refresh for a pixel that begins at `start`: the brighter grey where the share is
    /// above it.
    pub fn threshold(self, refresh: u64, start: u8) -> f32 {
        let mask = u64::from(self.cycle - 1);
        #[allow(clippy::cast_possible_truncation, reason = "masked to 8 bits")]
        let place = ((refresh & mask) + u64::from(start)) as u32 & (self.cycle - 1);
        let bits = self.cycle.trailing_zeros();
        let reversed = if bits == 0 { 0 } else { place.reverse_bits() >> (32 - bits) };
        (reversed as f32 + 0.5) / self.cycle as f32
    }

    /// Returns whether a refresh shows the brighter of the two greys.
    pub fn is_brighter(self, share: f32, refresh: u64, start: u8) -> bool {
        share > self.threshold(refresh, start)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const SIZE_PX: [usize; 2] = [9, 1];

    fn drive(response: &Response, cycle: u32) -> DisplayDrive {
        DisplayDrive::new(response, &FlatField::uniform(SIZE_PX), SIZE_PX, Dither::over(cycle).unwrap(), false)
    }

    /// Returns the mean light that a display of the true response shows over a cycle, pixel by pixel.
    fn shown(drive: &DisplayDrive, truth: &Response, wanted: &[f32; 9], refreshes: u64) -> [f64; 9] {
        let mut light = [0.0; 9];
        let mut greys = [0; 9];
        for refresh in 0..refreshes {
            drive.frame(wanted, refresh, &mut greys);
            for (light, grey) in light.iter_mut().zip(greys) {
                *light += truth.luminance()[usize::from(grey)] / refreshes as f64;
            }
        }
        light
    }

    /// Returns the light of a point at 4 + `fraction`, split over its two pixels.
    fn split(fraction: f32) -> [f32; 9] {
        let mut wanted = [0.0; 9];
        wanted[4] = 0.5 * (1.0 - fraction);
        wanted[5] = 0.5 * fraction;
        wanted
    }

    fn centroid(light: &[f64; 9]) -> f64 {
        let sum: f64 = light.iter().sum();
        light.iter().enumerate().map(|(x, l)| x as f64 * l).sum::<f64>() / sum - 4.0
    }

    #[test]
    fn a_split_point_moves_linearly_in_luminance() {
        let truth = Response::of_gamma(8, 2.2).unwrap();
        let linear = Response::of_gamma(8, 1.0).unwrap();
        let mut worst_linear = 0.0_f64;
        for k in 0..=50 {
            let fraction = k as f32 / 50.0;
            let error =
                |drive: &DisplayDrive| centroid(&shown(drive, &truth, &split(fraction), 64)) - f64::from(fraction);
            // 1/128 of the largest step (0.0086 of full) over half of full: 1.4e-4 px.
            assert!(error(&drive(&truth, 64)).abs() < 2e-4, "fraction {fraction}: {}", error(&drive(&truth, 64)));
            worst_linear = worst_linear.max(error(&drive(&linear, 64)).abs());
        }
        assert!(worst_linear > 0.1, "grey taken for luminance: {worst_linear} px");
    }

    #[test]
    fn dimmer_than_one_grey_is_shown_in_time() {
        let truth = Response::of_gamma(8, 1.0).unwrap();
        let wanted = [0.3 / 255.0; 9];
        let mean = shown(&drive(&truth, 256), &truth, &wanted, 256);
        let step = 1.0 / 255.0;
        assert!(mean.iter().all(|l| (l - 0.3 * step).abs() <= step / 512.0 + 1e-9), "{mean:?}");
        assert_eq!(shown(&drive(&truth, 1), &truth, &wanted, 256), [0.0; 9], "without dither it is black");
    }

    #[test]
    fn the_flat_field_is_made_up_for_and_too_much_is_counted() {
        let truth = Response::of_gamma(8, 2.2).unwrap();
        let parameters = super::super::flat_field::FlatParameters { degree: 1, coefficient: vec![0.75, 0.25, 0.0] };
        let flat = FlatField::new(parameters, SIZE_PX).unwrap();
        let drive = DisplayDrive::new(&truth, &flat, SIZE_PX, Dither::over(256).unwrap(), false);
        let light = shown(&drive, &truth, &[0.4; 9], 256);
        for (x, l) in light.iter().enumerate() {
            assert!((l * flat.at([x as f64, 0.0]) - 0.4).abs() < 1e-4, "column {x}: {l}");
        }
        let mut greys = [7; 9];
        assert_eq!(drive.frame(&[0.8; 9], 0, &mut greys), 5, "what has less than 0.8 of the light");
        assert_eq!((greys[0], greys[8] < 255), (255, true));
        assert_eq!(drive.frame(&[f32::NAN, -1.0, f32::INFINITY, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0], 0, &mut greys), 1);
        assert_eq!(greys, [0, 0, 255, 0, 0, 0, 0, 0, 0]);
    }

    #[test]
    fn every_grey_is_reached_exactly() {
        for truth in [Response::of_gamma(10, 2.4).unwrap(), Response::of_gamma(8, 1.0).unwrap()] {
            let drive = drive(&truth, 1);
            for (grey, l) in truth.luminance().iter().enumerate() {
                let mut greys = [0; 9];
                #[allow(clippy::cast_possible_truncation, reason = "single precision frames")]
                drive.frame(&[*l as f32; 9], 0, &mut greys);
                assert_eq!(usize::from(greys[0]), grey);
            }
        }
    }

    #[test]
    fn rows_are_frames_and_mirrors_turn_them() {
        let truth = Response::of_gamma(8, 2.2).unwrap();
        let flat = FlatField::uniform(SIZE_PX);
        let [plain, mirrored] =
            [false, true].map(|mirrored| DisplayDrive::new(&truth, &flat, SIZE_PX, Dither::over(1).unwrap(), mirrored));
        let light: [u16; 9] = core::array::from_fn(|x| 7000 * x as u16);
        let (mut row, mut turned, mut frame) = ([0; 9], [0; 9], [0; 9]);
        plain.row(&light, 0, 5, &mut row);
        mirrored.row(&light, 0, 5, &mut turned);
        #[allow(clippy::cast_possible_truncation, reason = "single precision frames")]
        let luminances = light.map(|code| luminance_code::luminance(code) as f32);
        plain.frame(&luminances, 5, &mut frame);
        assert_eq!(row, frame);
        turned.reverse();
        assert_eq!(row, turned);
        assert!(row[8] > row[1], "and not all alike");
        assert_eq!(plain.row(&light, 1, 5, &mut row), 0, "no such row");
        assert_eq!(row, frame, "left as it was");
        assert_eq!(plain.row(&[u16::MAX, u16::MAX - 1], 0, 5, &mut row), 1, "as much or more is too much");
    }

    /// Codes of a star as its light is rounded to them, and to even steps.
    fn star(peak: f64) -> ([f64; 9], [u16; 9], [u16; 9]) {
        let light: [f64; 9] = core::array::from_fn(|x| peak * (-0.5 * ((x as f64 - 4.2) / 0.7).powi(2)).exp());
        #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "0 to 65535")]
        let even = light.map(|l| luminance_code::code((l * 65_535.0).round() / 65_535.0));
        (light, light.map(luminance_code::code), even)
    }

    #[test]
    fn the_mean_light_of_a_faint_star_is_right_to_a_hundredth() {
        let truth = Response::of_gamma(8, 2.2).unwrap();
        let drive = drive(&truth, 256);
        let mean = |codes: &[u16; 9]| {
            let mut greys = [0; 9];
            let of_refresh = |refresh| {
                drive.row(codes, 0, refresh, &mut greys);
                greys.iter().map(|grey| truth.luminance()[usize::from(*grey)]).sum::<f64>() / 256.0
            };
            (0..256).map(of_refresh).sum::<f64>()
        };
        // The brightest pixel has 1/4 to 64 times the light of grey 1, 5e-6 of full.
        for peak in [1.3e-6, 5e-6, 2e-5, 7e-5, 3e-4] {
            let (light, codes, even) = star(peak);
            let wanted: f64 = light.iter().sum();
            let off = mean(&codes) / wanted - 1.0;
            println!("peak {peak}: {off:.4}; by even steps {:.4}", mean(&even) / wanted - 1.0);
            assert!(off.abs() < 0.01, "peak {peak}: {off}");
            if peak < 1e-5 {
                assert!(mean(&even) < 0.01 * wanted, "even steps lose it: the comparison can fail");
            }
        }
    }
}

#[cfg(test)]
mod dither_tests {
    use super::*;

    fn mean(dither: Dither, share: f32, first: u64, count: u64, start: u8) -> f64 {
        let lit = (first..first + count).filter(|refresh| dither.is_brighter(share, *refresh, start)).count();
        lit as f64 / count as f64
    }

    #[test]
    fn the_mean_of_a_cycle_is_what_was_wanted() {
        for cycle in [1, 2, 4, 16, 64, 256] {
            let dither = Dither::over(cycle).unwrap();
            for k in 0..=200 {
                let share = k as f32 / 200.0;
                for first in [0, 1, 7, 1_000_003] {
                    let found = mean(dither, share, first, u64::from(cycle), dither.start(9, 4));
                    let error = (found - f64::from(share)).abs();
                    assert!(error <= dither.bound() + 1e-6, "cycle {cycle}, share {share}: {found}");
                }
            }
        }
        let short = (mean(Dither::over(4).unwrap(), 0.4, 0, 4, 0) - 0.4).abs();
        assert!(short > Dither::over(64).unwrap().bound(), "a short cycle is coarser: {short}");
    }

    #[test]
    fn part_of_a_cycle_is_bounded_too() {
        let dither = Dither::over(64).unwrap();
        let mut worst = 0.0_f64;
        for count in 1..64 {
            for first in 0..64 {
                for k in 0..=64 {
                    let share = (k as f32 + 0.3) / 65.0;
                    let error = (mean(dither, share, first, count, 0) - f64::from(share)).abs();
                    let bound = ((64_f64.log2() + 2.0) / (2.0 * count as f64)).min(1.0);
                    assert!(error <= bound, "{count} refreshes from {first}, share {share}: {error} > {bound}");
                    worst = worst.max(error * count as f64);
                }
            }
        }
        assert!(worst > 1.0, "the bound is not idle: {worst}");
    }

    #[test]
    fn pixels_begin_everywhere_and_always_there() {
        let dither = Dither::over(16).unwrap();
        let mut counts = [0_u32; 16];
        for (x, y) in (0..64).flat_map(|x| (0..64).map(move |y| (x, y))) {
            counts[usize::from(dither.start(x, y))] += 1;
            assert_eq!(dither.start(x, y), dither.start(x, y));
        }
        // 256 expected, standard deviation 15.5; the numbers are fixed.
        assert!(counts.iter().all(|count| (180..330).contains(count)), "{counts:?}");
    }

    #[test]
    fn no_dither_is_the_nearer_grey() {
        let none = Dither::over(1).unwrap();
        assert_eq!((none.cycle(), none.is_brighter(0.49, 3, 0), none.is_brighter(0.51, 3, 0)), (1, false, true));
    }

    #[test]
    fn a_cycle_that_there_is_not_is_refused() {
        for got in [0, 3, 5, 255, 257, 512] {
            let reported = Dither::over(got).unwrap_err().to_string();
            assert!(
                reported.contains(&format!("over {got} refreshes")) && reported.contains("64, 128 or 256"),
                "{reported}"
            );
        }
        assert_eq!([1, 256].map(|cycle| Dither::over(cycle).unwrap().cycle()), [1, 256], "both ends");
    }
}
