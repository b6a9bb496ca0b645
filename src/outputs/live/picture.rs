//! DN -> 8-bit grey for the page, by one of a few scales -> PNG.
//!
//! | scale | grey |
//! |---|---|
//! | `stars` | asinh, fitted to the frame ([`frames::sink::png::Stretch`]): faint and bright stars together |
//! | `faint` | linear from the median less 2 sigma to the median plus 12 sigma |
//! | `linear` | linear from the median less 1 sigma to the brightest pixel |
//! | `log` | logarithm of what is above the median less 1 sigma, up to the brightest pixel |
//! | `dn` | linear between two given DN: the only one that is the same for all frames |
//!
//! sigma: median less the 15.87 % quantile, at least 1 DN. Only for people. Tests: below.

use crate::live::kept::KeptFrame;
use base::image::DnImage;
use frames::sink::Wcs;
use frames::sink::png::{Stretch, write_grey8};
use serde_json::{Value, json};
use std::io;

/// Quantile one standard deviation below the mean of a normal distribution.
const ONE_SIGMA_BELOW: f64 = 0.158_655;
/// One grey per possible DN.
const LEVELS: usize = 1 << 16;

/// A grey scale, as requested.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Scale {
    /// Faint and bright stars together.
    Stars,
    /// The background and pixels little above it.
    Faint,
    /// In proportion to the signal.
    Linear,
    /// Logarithm of the signal.
    Log,
    /// Linear between two DN.
    Dn { black: u16, white: u16 },
}

impl Scale {
    /// Those that need no numbers, with their words.
    pub(super) const NAMED: [(Self, &'static str); 4] =
        [(Self::Stars, "stars"), (Self::Faint, "faint"), (Self::Linear, "linear"), (Self::Log, "log")];

    /// Returns the grey of every DN, fitted to these pixels.
    fn greys(self, pixels: &[u16]) -> Vec<u8> {
        if self == Self::Stars {
            let stretch = Stretch::of_dn(pixels);
            return every_dn(|dn| f64::from(stretch.grey(dn)) / 255.0);
        }
        let [below, median, white] = quantiles(pixels);
        let sigma = (median - below).max(1.0);
        let linear = |black: f64, white: f64| every_dn(move |dn| (dn - black) / (white - black).max(1.0));
        match self {
            Self::Faint => linear(median - 2.0 * sigma, median + 12.0 * sigma),
            Self::Dn { black, white } => linear(f64::from(black), f64::from(white)),
            Self::Log => {
                let black = median - sigma;
                let whole = (white - black).max(1.0).ln_1p();
                every_dn(|dn| (dn - black).max(0.0).ln_1p() / whole)
            }
            Self::Stars | Self::Linear => linear(median - sigma, white),
        }
    }
}

/// Returns the grey of every DN, by its share of white.
fn every_dn(share: impl Fn(f64) -> f64) -> Vec<u8> {
    // A float-to-int cast saturates.
    (0..LEVELS).map(|dn| (share(dn as f64) * 255.0).round() as u8).collect()
}

/// Returns one sigma below, median, maximum, DN; zeros without pixels.
fn quantiles(pixels: &[u16]) -> [f64; 3] {
    let mut counts = vec![0_usize; LEVELS];
    pixels.iter().for_each(|&dn| counts[usize::from(dn)] += 1);
    [ONE_SIGMA_BELOW, 0.5, 1.0].map(|q| {
        let rank = (q * pixels.len().saturating_sub(1) as f64).round() as usize;
        let mut below = 0;
        let reached = |count: &usize| {
            below += count;
            below > rank
        };
        counts.iter().position(reached).unwrap_or(0) as f64
    })
}

/// Returns the image as a PNG, 8-bit grey.
///
/// # Errors
/// When the image has no pixels.
pub(super) fn png_of(image: &DnImage, scale: Scale) -> io::Result<Vec<u8>> {
    let greys = scale.greys(image.pixels());
    let bytes: Vec<u8> = image.pixels().iter().map(|&dn| greys[usize::from(dn)]).collect();
    let mut out = Vec::with_capacity(bytes.len() / 2 + 1024);
    write_grey8(&mut out, [image.width(), image.height()], &bytes)?;
    Ok(out)
}

// One pixel of a kept frame as JSON: its value, and its direction where the frame has a map of the sky.
//
// Directions are catalog places (ICRS at the frame's epoch, without aberration and deflection), as in the header of a
// FITS file of the frame. Gnomonic projection with polynomials: Calabretta and Greisen 2002, A&A 395, 1077; Shupe et
// al. 2005, ASP Conf. 347, 491. Tests: below; `hil_scripts/tests/test_live.py` compares values with those of a FITS file.

/// Returns number, place, value and direction of a pixel; `None` outside of the frame.
pub(super) fn pixel_of(frame: &KeptFrame, [x, y]: [usize; 2]) -> Option<Value> {
    let dn = frame.image.get(x, y)?;
    let there = frame.wcs.as_ref().map(|wcs| direction_deg(wcs, [x as f64, y as f64]));
    let [ra_deg, dec_deg] = [0, 1].map(|axis| there.map(|there| there[axis]));
    Some(json!({ "frame": frame.number, "x_px": x, "y_px": y, "dn": dn, "ra_deg": ra_deg, "dec_deg": dec_deg }))
}

/// Returns right ascension (0 to 360) and declination of a place in the frame whose first pixel's centre is (0, 0),
/// deg.
fn direction_deg(wcs: &Wcs, place_px: [f64; 2]) -> [f64; 2] {
    // FITS counts pixels from 1.
    let [u, v] = [0, 1].map(|axis| place_px[axis] + 1.0 - wcs.crpix[axis]);
    let order = wcs.orders()[0];
    let mut flat = [u, v];
    for i in 0..=order {
        for j in 0..=order - i {
            let terms = wcs.forward(i, j);
            let power = libm::pow(u, f64::from(i)) * libm::pow(v, f64::from(j));
            flat = [flat[0] + terms[0] * power, flat[1] + terms[1] * power];
        }
    }
    let [east, north] = wcs.cd_deg_px.map(|row| (row[0] * flat[0] + row[1] * flat[1]).to_radians());
    let [ra, dec] = wcs.crval_deg.map(f64::to_radians);
    let (sin, cos) = (libm::sin(dec), libm::cos(dec));
    let outwards = cos - north * sin;
    let found_ra = ra + libm::atan2(east, outwards);
    let found_dec = libm::atan2(sin + north * cos, libm::hypot(east, outwards));
    [found_ra.to_degrees().rem_euclid(360.0), found_dec.to_degrees()]
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Returns the background of 60 to 67 DN, a star of 160 DN and one of 4000 DN.
    fn field() -> DnImage {
        let mut image = DnImage::new(100, 50);
        image.pixels_mut().iter_mut().enumerate().for_each(|(i, dn)| *dn = 60 + (i * 7_919 % 8) as u16);
        (image.pixels_mut()[700], image.pixels_mut()[900]) = (160, 4_000);
        image
    }

    fn decoded(scale: Scale) -> Vec<u8> {
        let bytes = png_of(&field(), scale).unwrap();
        let mut reader = png::Decoder::new(io::Cursor::new(bytes)).read_info().unwrap();
        let mut pixels = vec![0; reader.output_buffer_size().unwrap()];
        let info = reader.next_frame(&mut pixels).unwrap();
        assert_eq!((info.width, info.height, info.bit_depth), (100, 50, png::BitDepth::Eight));
        pixels
    }

    #[test]
    fn every_scale_has_the_stars_where_they_are_and_greys_in_the_order_of_dn() {
        let image = field();
        let scales = Scale::NAMED.map(|(scale, _)| scale).into_iter().chain([Scale::Dn { black: 50, white: 200 }]);
        for scale in scales {
            let grey = decoded(scale);
            assert_eq!(grey[900], 255, "{scale:?}");
            assert!(grey[700] > grey[701] || scale == Scale::Linear, "{scale:?}");
            let mut pairs: Vec<_> = image.pixels().iter().zip(&grey).collect();
            pairs.sort();
            assert!(pairs.windows(2).all(|two| two[0].1 <= two[1].1), "{scale:?}");
        }
    }

    #[test]
    fn given_dn_are_black_and_white() {
        let grey = decoded(Scale::Dn { black: 60, white: 160 });
        assert_eq!((grey[0], grey[700], grey[900]), (0, 255, 255), "60, 160 and 4000 DN");
        assert_eq!(decoded(Scale::Dn { black: 0, white: 320 })[700], 128, "half of the way");
        assert_eq!(decoded(Scale::Dn { black: 200, white: 100 })[700], 0, "no range: a step");
    }

    #[test]
    fn an_image_without_pixels_is_an_error_and_a_flat_one_is_not() {
        let mut flat = DnImage::new(8, 8);
        flat.pixels_mut().fill(u16::MAX);
        for (scale, _) in Scale::NAMED {
            png_of(&DnImage::new(0, 0), scale).unwrap_err();
            png_of(&flat, scale).unwrap();
        }
    }
}

#[cfg(test)]
mod pixel_tests {
    use super::*;
    use frames::sink::{Sip, SipTerm};
    use std::sync::Arc;

    fn map() -> Wcs {
        Wcs {
            crpix: [16.0, 9.0],
            crval_deg: [359.99, 60.0],
            cd_deg_px: [[-0.01, 0.0], [0.0, -0.01]],
            quadratic_px: [[0.0; 3]; 2],
            sip: None,
            error_px: 0.0,
        }
    }

    fn near(got: [f64; 2], wanted: [f64; 2]) -> bool {
        (0..2).all(|axis| (got[axis] - wanted[axis]).abs() < 1e-9)
    }

    #[test]
    fn reference_pixel_and_its_neighbours_are_where_the_projection_puts_them() {
        assert!(near(direction_deg(&map(), [15.0, 8.0]), [359.99, 60.0]), "counted from 0");
        let north = direction_deg(&map(), [15.0, -92.0]);
        assert!(
            near(north, [359.99, 60.0 + 0.01_f64.mul_add(100.0, 0.0).to_radians().atan().to_degrees()]),
            "{north:?}"
        );
        // A tangent of 0.01 deg per pixel to the east: beyond 24 h the right ascension begins again.
        let east = direction_deg(&map(), [-85.0, 8.0]);
        let tangent = 1.0_f64.to_radians();
        assert!(
            (east[0] - (359.99 + (tangent / 60.0_f64.to_radians().cos()).atan().to_degrees() - 360.0)).abs() < 1e-9
        );
        assert!(east[1] < 60.0, "a great circle: {east:?}");
    }

    #[test]
    fn polynomials_of_lens_and_frame_are_added() {
        let term = SipTerm { i: 2, j: 0, along: [1e-3, 0.0] };
        let sip = Sip { order: 2, forward: vec![term], ..Sip::default() };
        let bent = Wcs { sip: Some(Arc::new(sip)), quadratic_px: [[0.0, 0.0, 2e-3], [0.0; 3]], ..map() };
        // u = 10 and v = 10: the column is 0.1 px and 0.2 px farther.
        let wanted = direction_deg(&map(), [25.3, 18.0]);
        assert!(near(direction_deg(&bent, [25.0, 18.0]), wanted));
        assert!(!near(direction_deg(&map(), [25.0, 18.0]), wanted), "control: without the polynomials");
    }
}
