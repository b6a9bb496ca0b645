//! Measured luminance of some greys -> luminance of every grey, and back.
//!
//! Luminance is relative and counted above black: grey 0 has 0, the highest grey 1. What grey 0 shows is the *black
//! share*, in units of the full luminance: a pedestal under every pixel that no grey takes away. Noise: repeats are
//! averaged with their weights; where noise makes a step go down, neighbours are pooled (isotonic regression by pooling
//! adjacent violators: Barlow et al., Statistical Inference under Order Restrictions, 1972). Between nodes: a monotone
//! cubic (Fritsch and Carlson 1980, SIAM J. Numer. Anal. 17, 238) through luminance^(1/gamma) over grey, gamma the
//! display's own slope of logarithms: that curve is nearly straight, so few nodes suffice. Limits: one response for all
//! places and all times; no cross-talk between neighbouring pixels. Tests below; end to end in
//! `tests/physics/display_calibration`.

use base::{least_squares::median, refused::Refused};
use serde::{Deserialize, Serialize};

/// Fewest greys that make a response, black and full among them.
pub const FEWEST_GREYS: usize = 5;
/// Nodes below this luminance do not count for gamma: noise of the black level.
const DARKEST_FOR_GAMMA: f64 = 0.01;
/// A grey below this share of full grey must be dimmer than [`FULL_LUMINANCE`].
const NEARLY_FULL_GREY: f64 = 0.95;
/// Luminance, relative to full, above which levels cannot be distinguished from full. A linear display has 0.95 at
/// [`NEARLY_FULL_GREY`].
const FULL_LUMINANCE: f64 = 0.99;
/// Bits of a display's grey.
pub const BITS: core::ops::RangeInclusive<u32> = 6..=16;

/// One grey with its luminance.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct GreyLevel {
    /// Grey as sent to the display; between two greys where neighbours were pooled.
    pub grey: f64,
    /// Luminance above black, 0 to 1.
    pub luminance: f64,
    /// Standard error of the luminance.
    pub sigma: f64,
}

/// Numbers of a response, as a calibration file holds them.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ResponseParameters {
    /// Bits of a grey: the highest is 2^bits - 1.
    pub bits: u32,
    /// Luminance of grey 0 over that of the highest grey.
    pub black_share: f64,
    /// Measured greys in order, the first and the last those of luminance 0 and 1.
    pub level: Vec<GreyLevel>,
}

/// Luminance of every grey of a display.
#[derive(Debug, Clone, PartialEq)]
pub struct Response {
    parameters: ResponseParameters,
    luminance: Vec<f64>,
}

impl Response {
    /// Checks the numbers and fills in every grey.
    ///
    /// # Errors
    /// When greys are missing or luminance does not rise.
    pub fn new(parameters: ResponseParameters) -> Result<Self, Refused> {
        if !BITS.contains(&parameters.bits) {
            return Err(Refused(format!("a display's grey: wanted 6 to 16 bits, got {got}", got = parameters.bits)));
        }
        let highest = f64::from((1_u32 << parameters.bits) - 1);
        let level = &parameters.level;
        let ends = level.first().zip(level.last()).map(|(first, last)| (*first, *last));
        let complete = ends.filter(|(first, last)| first.grey == 0.0 && last.grey == highest);
        let (Some((first, last)), true) = (complete, level.len() >= FEWEST_GREYS) else {
            let [first, last] = ends.map_or([f64::NAN; 2], |(first, last)| [first.grey, last.grey]);
            return Err(Refused(format!(
                "a display's response: wanted at least {FEWEST_GREYS} greys with 0 and {highest} among them, got {count} from {first} to {last}; measure the ramp's missing patterns",
                count = level.len()
            )));
        };
        let not_rising = |at: &GreyLevel| {
            Err(Refused(format!(
                "a display's response: wanted luminance that rises with grey, got {luminance} at grey {grey}; was the exposure changed, or the display's dynamic contrast left on?",
                luminance = at.luminance,
                grey = at.grey
            )))
        };
        if first.luminance != 0.0 || last.luminance != 1.0 || !(0.0..1.0).contains(&parameters.black_share) {
            return not_rising(if first.luminance == 0.0 { &last } else { &first });
        }
        let rises = |pair: &[GreyLevel]| pair[1].luminance > pair[0].luminance && pair[1].grey > pair[0].grey;
        if let Some(pair) = level.windows(2).find(|pair| !rises(pair)) {
            return not_rising(&pair[1]);
        }
        let luminance = every_grey(level, highest);
        match (1..luminance.len()).find(|&grey| luminance[grey] <= luminance[grey - 1]) {
            Some(grey) => Err(Refused(format!(
                "a display's response: wanted luminance that rises with grey, got {luminance} at grey {grey}; was the exposure changed, or the display's dynamic contrast left on?",
                luminance = luminance[grey],
                grey = grey as f64
            ))),
            None => Ok(Self { parameters, luminance }),
        }
    }

    /// Returns a response of luminance = (grey / highest)^gamma without black: what a display is taken for before it is
    /// measured.
    ///
    /// # Errors
    /// When the bits are out of range or gamma does not rise.
    pub fn of_gamma(bits: u32, gamma: f64) -> Result<Self, Refused> {
        if !BITS.contains(&bits) {
            return Err(Refused(format!("a display's grey: wanted 6 to 16 bits, got {bits}")));
        }
        let highest = (1_u32 << bits) - 1;
        let node = |i: u32| {
            let grey = (f64::from(i) * f64::from(highest) / 32.0).round();
            GreyLevel { grey, luminance: (grey / f64::from(highest)).powf(gamma), sigma: 0.0 }
        };
        Self::new(ResponseParameters { bits, black_share: 0.0, level: (0..=32).map(node).collect() })
    }

    /// Returns the numbers as given.
    pub fn parameters(&self) -> &ResponseParameters {
        &self.parameters
    }

    /// Returns the luminance above black of every grey, 0 to 1, rising.
    pub fn luminance(&self) -> &[f64] {
        &self.luminance
    }

    /// Returns the grey, and the share of the step to the next one, whose luminance is `luminance`; beyond 0 to 1 the
    /// ends.
    pub fn grey_of(&self, luminance: f64) -> (usize, f64) {
        let above = self.luminance.partition_point(|l| *l <= luminance);
        let grey = above.saturating_sub(1);
        match self.luminance.get(grey + 1) {
            None => (grey, 0.0),
            Some(next) => {
                let here = self.luminance[grey];
                (grey, ((luminance - here) / (next - here)).clamp(0.0, 1.0))
            }
        }
    }

    /// Returns the standard error of the measured greys above 1 % of full, magnitudes, their median.
    pub fn sigma_mag(&self) -> f64 {
        let bright = self.parameters.level.iter().filter(|level| level.luminance > DARKEST_FOR_GAMMA);
        let mut sigmas: Vec<f64> =
            bright.map(|level| 2.5 / core::f64::consts::LN_10 * level.sigma / level.luminance).collect();
        median(&mut sigmas)
    }
}

/// Greys with raw luminances (any unit, above darkness) and standard errors, in order of grey -> numbers of a response.
///
/// # Errors
/// When greys are missing or the luminance does not rise.
pub fn response_of(bits: u32, measured: &[GreyLevel]) -> Result<ResponseParameters, Refused> {
    if !BITS.contains(&bits) {
        return Err(Refused(format!("a display's grey: wanted 6 to 16 bits, got {bits}")));
    }
    let highest = f64::from((1_u32 << bits) - 1);
    let ends = measured.first().zip(measured.last()).filter(|(black, full)| black.grey == 0.0 && full.grey == highest);
    let Some((black, full)) = ends.filter(|_| measured.len() >= FEWEST_GREYS) else {
        let [first, last] = [measured.first(), measured.last()].map(|end| end.map_or(f64::NAN, |end| end.grey));
        return Err(Refused(format!(
            "a display's response: wanted at least {FEWEST_GREYS} greys with 0 and {highest} among them, got {count} from {first} to {last}; measure the ramp's missing patterns",
            count = measured.len()
        )));
    };
    let range = full.luminance - black.luminance;
    if !(range > 0.0 && range.is_finite()) {
        return Err(Refused(format!(
            "a display's response: wanted luminance that rises with grey, got {luminance} at grey {highest}; was the exposure changed, or the display's dynamic contrast left on?",
            luminance = full.luminance
        )));
    }
    let share_of = |level: &GreyLevel| (level.luminance - black.luminance) / range;
    let is_too_soon = |level: &&GreyLevel| level.grey <= NEARLY_FULL_GREY * highest && share_of(level) > FULL_LUMINANCE;
    if let Some(level) = measured.iter().find(is_too_soon) {
        return Err(Refused(format!(
            "a display's response: grey {grey} is as bright as full grey, {highest} ({:.1} % of it); did the camera saturate (expose shorter), or does a picture mode of the display lift its whites (switch it off)?",
            100.0 * share_of(level),
            grey = level.grey
        )));
    }
    let relative = |level: &GreyLevel| GreyLevel {
        luminance: share_of(level),
        sigma: level.sigma.hypot(black.sigma) / range,
        ..*level
    };
    let mut level = pooled(measured.iter().map(relative));
    // A pool that holds an end is that end: black is 0 and full is 1 by definition.
    level.retain(|node| node.luminance > 0.0 && node.luminance < 1.0);
    level.insert(0, GreyLevel { grey: 0.0, luminance: 0.0, sigma: black.sigma / range });
    level.push(GreyLevel { grey: highest, luminance: 1.0, sigma: full.sigma / range });
    let black_share = (black.luminance / full.luminance).max(0.0);
    Ok(ResponseParameters { bits, black_share, level })
}

/// Neighbours that do not rise become one node at their weighted mean.
fn pooled(levels: impl Iterator<Item = GreyLevel>) -> Vec<GreyLevel> {
    let mut pools: Vec<(GreyLevel, f64)> = Vec::new();
    for level in levels {
        let mut pool = (level, 1.0 / level.sigma.max(1e-9).powi(2));
        while let Some((before, weight)) = pools.pop_if(|(before, _)| before.luminance >= pool.0.luminance) {
            let sum = weight + pool.1;
            let mean = |a: f64, b: f64| (weight * a + pool.1 * b) / sum;
            let grey = mean(before.grey, pool.0.grey);
            let luminance = mean(before.luminance, pool.0.luminance);
            pool = (GreyLevel { grey, luminance, sigma: sum.sqrt().recip() }, sum);
        }
        pools.push(pool);
    }
    pools.into_iter().map(|(level, _)| level).collect()
}

/// Returns the slope of log luminance over log grey, least squares; 1 when it cannot be computed.
fn gamma(level: &[GreyLevel], highest: f64) -> f64 {
    let bright = level.iter().filter(|l| l.luminance > DARKEST_FOR_GAMMA && l.luminance < 1.0);
    let logs = bright.map(|l| [(l.grey / highest).ln(), l.luminance.ln()]);
    let [xx, xy] = logs.fold([0.0; 2], |[xx, xy], [x, y]| [xx + x * x, xy + x * y]);
    if xx > 0.0 { (xy / xx).clamp(0.2, 6.0) } else { 1.0 }
}

fn every_grey(level: &[GreyLevel], highest: f64) -> Vec<f64> {
    let gamma = gamma(level, highest);
    let x: Vec<f64> = level.iter().map(|l| l.grey).collect();
    let y: Vec<f64> = level.iter().map(|l| l.luminance.powf(1.0 / gamma)).collect();
    let slopes = monotone_slopes(&x, &y);
    #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "the highest grey has at most 16 bits")]
    let count = highest as usize + 1;
    let mut node = 0;
    let luminance = |grey: usize| {
        let at = grey as f64;
        while node + 2 < x.len() && x[node + 1] <= at {
            node += 1;
        }
        let width = x[node + 1] - x[node];
        let t = (at - x[node]) / width;
        let (s, t2) = (1.0 - t, t * t);
        let ends = y[node] * s * s * (1.0 + 2.0 * t) + y[node + 1] * t2 * (3.0 - 2.0 * t);
        (ends + width * (slopes[node] * t * s * s - slopes[node + 1] * t2 * s)).max(0.0).powf(gamma)
    };
    (0..count).map(luminance).collect()
}

/// Slopes at the nodes that keep the cubic monotone: weighted harmonic means of the neighbouring steps.
fn monotone_slopes(x: &[f64], y: &[f64]) -> Vec<f64> {
    let step = |i: usize| (y[i + 1] - y[i]) / (x[i + 1] - x[i]);
    let last = x.len() - 1;
    let slope = |i: usize| match i {
        0 => step(0),
        _ if i == last => step(last - 1),
        _ => {
            let (before, after) = (x[i] - x[i - 1], x[i + 1] - x[i]);
            let (w1, w2) = (2.0 * after + before, after + 2.0 * before);
            (w1 + w2) / (w1 / step(i - 1) + w2 / step(i))
        }
    };
    (0..=last).map(slope).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Returns sRGB's piecewise curve (IEC 61966-2-1), which is not a power of grey.
    fn srgb(grey: f64) -> f64 {
        let v = grey / 255.0;
        if v <= 0.04045 { v / 12.92 } else { ((v + 0.055) / 1.055).powf(2.4) }
    }

    fn measured(greys: impl Iterator<Item = u32>, noise: impl Fn(u32) -> f64) -> Vec<GreyLevel> {
        let luminance = |grey| 30.0 + 970.0 * srgb(f64::from(grey)) + noise(grey);
        greys.map(|grey| GreyLevel { grey: f64::from(grey), luminance: luminance(grey), sigma: 0.5 }).collect()
    }

    /// Returns the sixteen greys after black, closer together near black.
    fn ramp() -> Vec<GreyLevel> {
        measured([0, 2, 7, 15, 24, 35, 48, 62, 78, 95, 114, 135, 157, 180, 204, 229, 255].into_iter(), |_| 0.0)
    }

    /// Error of interpolation, relative to full, for 17 nodes of a curve that is not a power: a sixth of the step
    /// between neighbouring bright greys.
    const INTERPOLATION: f64 = 3e-4;

    #[test]
    fn a_curve_and_its_black_level_are_recovered() {
        let response = Response::new(response_of(8, &ramp()).unwrap()).unwrap();
        assert!((response.parameters().black_share - 0.03).abs() < 1e-12);
        for (grey, found) in response.luminance().iter().enumerate() {
            assert!((found - srgb(grey as f64)).abs() < INTERPOLATION, "grey {grey}: {found}");
        }
        let linear = Response::of_gamma(8, 1.0).unwrap();
        let worst = (0..256).map(|g| (linear.luminance()[g] - srgb(g as f64)).abs()).fold(0.0, f64::max);
        assert!(worst > 100.0 * INTERPOLATION, "the comparison can fail: {worst}");
    }

    #[test]
    fn noise_that_goes_down_is_pooled() {
        let wild = |grey: u32| if grey.is_multiple_of(2) { 4.0 } else { -4.0 };
        let parameters = response_of(8, &measured(0..=255, wild)).unwrap();
        assert!(parameters.level.len() < 250, "some are pooled: {}", parameters.level.len());
        let response = Response::new(parameters).unwrap();
        assert!(response.luminance().windows(2).all(|pair| pair[1] > pair[0]));
        for (grey, found) in response.luminance().iter().enumerate() {
            assert!((found - srgb(grey as f64)).abs() < 0.01, "grey {grey}: {found}");
        }
    }

    #[test]
    fn luminance_to_grey_and_back() {
        let response = Response::new(response_of(8, &ramp()).unwrap()).unwrap();
        for i in 0..=1000 {
            let wanted = f64::from(i) / 1000.0;
            let (grey, share) = response.grey_of(wanted);
            let l = response.luminance();
            let next = l.get(grey + 1).copied().unwrap_or(l[grey]);
            assert!((l[grey] + share * (next - l[grey]) - wanted).abs() < 1e-12, "{wanted}");
        }
        assert_eq!(response.grey_of(-1.0), (0, 0.0));
        assert_eq!(response.grey_of(7.0), (255, 0.0));
    }

    #[test]
    fn invalid_responses_are_refused() {
        let good = ramp();
        assert!(response_of(8, &good[1..]).unwrap_err().to_string().contains("with 0 and 255 among them"));
        assert!(response_of(5, &good).is_err());
        let falling: Vec<_> = good.iter().map(|l| GreyLevel { luminance: -l.luminance, ..*l }).collect();
        assert!(response_of(8, &falling).unwrap_err().to_string().contains("rises"));
        let clipped: Vec<_> = good.iter().map(|l| GreyLevel { luminance: l.luminance.min(700.0), ..*l }).collect();
        let reported = response_of(8, &clipped).unwrap_err().to_string();
        assert!(
            reported.contains("grey 229 is as bright as full grey") && reported.contains("expose shorter"),
            "{reported}"
        );
        let linear: Vec<_> = good.iter().map(|l| GreyLevel { luminance: 30.0 + l.grey, ..*l }).collect();
        assert!(response_of(8, &linear).is_ok(), "the other side");
        let mut parameters = response_of(8, &good).unwrap();
        parameters.level[3].luminance = parameters.level[2].luminance;
        assert!(Response::new(parameters).is_err());
    }
}
