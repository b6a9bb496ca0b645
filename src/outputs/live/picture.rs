//! DN -> 8-bit grey for the page, by one of a few scales -> PNG.
//!
//! | scale | grey |
//! |---|---|
//! | `stars` | asinh, fitted to the frame ([`frames::sink::stretch`]): faint and bright stars together |
//! | `faint` | linear from the median less 2 sigma to the median plus 12 sigma |
//! | `linear` | linear from the median less 1 sigma to the brightest pixel |
//! | `log` | logarithm of what is above the median less 1 sigma, up to the brightest pixel |
//! | `dn` | linear between two given DN: the only one that is the same for all frames |
//!
//! sigma: median less the 15.87 % quantile, at least 1 DN. Only for people. Tests: below.

use base::image::DnImage;
use frames::sink::{png::write_grey8, stretch::Stretch};
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
