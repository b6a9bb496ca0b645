//! Whole stars: the footprint by absolute light.
//!
//! An ordinary footprint is as wide as a share of any star's light asks for, and is drawn in single precision. Both
//! errors grow with the light of the star: a star of 2e9 e- lacks tens of electrons at the rim of its footprint, and is
//! wrong by hundreds within it. Stars from which on either is over the pixel budget are drawn whole: in double
//! precision, as far as their PSF goes, on every backend by the same code (`image::render::whole`), at the nodes of the
//! method of their class.
//!
//! Domain: exact PSF sampling, stars that cover at most [`MOST_PX`] pixels together and [`MOST_STARS`] in number, and a
//! quarter of the frame's time; where there are more, only stars of eight times the light of the first one left out.
//! Bound: light beyond the whole footprint, at most [`LARGEST_HALF_PX`] and the
//! PSF's own grid; 1e-13 of a Gaussian. Stars outside the domain are drawn as ordinary ones, and their error is named.
//! Tests below; `tests/physics/whole.rs`, `tests/gpu/whole.rs`.

use crate::exposure::{motion::Instrument, sampling::PRODUCTS_ERROR};
use crate::{optics::PsfModel, optics::psf::LARGEST_HALF_PX};

/// Error of a pixel in the wings of a star, relative to the star's peak: single-precision error functions near 1
/// (measured up to 7e-7 on a GPU).
const F32_WING: f64 = 5e-7;
/// Share by which the limit is lower, so that rounding does not put a star at the limit over the budget.
const LIMIT_MARGIN: f64 = 1e-9;
/// Largest number of stars that are drawn whole; the cells of a disc of the Moon or the Earth are more.
pub const MOST_STARS: usize = 256;
/// Where more stars are over the budget, those are drawn whole that have so many times the light of the first one left out.
pub(super) const BEYOND_A_DISC: f64 = 8.0;
/// Largest number of pixels that they cover together.
pub const MOST_PX: usize = 1 << 20;
/// Largest share of a frame's drawing time that they may take.
const TIME_SHARE: f64 = 0.25;
/// Time for one node of a whole star: for every row and column, and for every pixel, ns.
const LINE_NS: f64 = 60.0;
const PIXEL_NS: f64 = 2.0;
/// Pixels that a star covers beyond its path and footprint: it is kept in tiles of 16 x 16 px.
const TILE_PX: f64 = 32.0;

/// The limit between ordinary and whole stars, and the footprint of whole ones.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct WholeStars {
    /// Half-width of their footprints, px.
    pub half_px: usize,
    /// Electrons from which on a star is drawn whole (infinite: none is).
    pub from_e: f64,
    /// Number of such stars in sight, before any is left out for want of time.
    pub(super) stars: usize,
}

/// Errors in the wings of a star, by its electrons.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Wings {
    /// Half-width of whole footprints, px.
    pub(super) half_px: usize,
    /// Electrons from which on an ordinary star's wings are over the budget.
    pub(super) limit_e: f64,
    /// Share of a star's light in the brightest pixel outside its footprint: an ordinary one, a whole one.
    rim_share: [f64; 2],
    /// Error by single precision in the wings of an ordinary star, share of its light.
    rounding_share: f64,
    full_well_e: f64,
    read_noise_e_rms: f64,
}

impl Wings {
    /// Returns the errors of stars in ordinary footprints of `half_px`, with the limit at `most_sigma` of a pixel's noise.
    pub(super) fn new(instrument: &Instrument, half_px: usize, most_sigma: f64) -> Self {
        let Instrument { psf, full_well_e, read_noise_e_rms, sampling, .. } = instrument;
        let whole_px = psf.whole_half_px().min(LARGEST_HALF_PX).max(half_px);
        let wings = Self::of(psf, [half_px, whole_px], *full_well_e, *read_noise_e_rms);
        if sampling.is_exact() { wings.with_limit(most_sigma) } else { wings }
    }

    fn of(psf: &PsfModel, half_px: [usize; 2], full_well_e: f64, read_noise_e_rms: f64) -> Self {
        let products = if psf.is_gaussian() { 0.0 } else { PRODUCTS_ERROR };
        Self {
            half_px: half_px[1],
            limit_e: f64::INFINITY,
            rim_share: half_px.map(|half_px| rim_share(psf, half_px)),
            rounding_share: (F32_WING + products) * psf.peak(),
            full_well_e,
            read_noise_e_rms,
        }
    }

    fn with_limit(self, most_sigma: f64) -> Self {
        Self { limit_e: self.smallest_over(most_sigma), ..self }
    }

    /// Returns the errors where every star is drawn whole, in footprints of `half_px`.
    pub(super) fn all_whole(self, half_px: usize) -> Self {
        Self { half_px, limit_e: f64::INFINITY, ..self }
    }

    /// Returns the largest error in the wings of stars of up to `brightest_e`, sigma of a pixel's noise, when those from
    /// `from_e` on are drawn whole.
    pub(super) fn sigma(&self, brightest_e: f64, from_e: f64) -> f64 {
        let ordinary_e = brightest_e.min(from_e);
        let rounding_sigma = self.rounding_share * ordinary_e / self.read_noise_e_rms.max(1.0);
        let ordinary = self.rim_sigma(ordinary_e * self.rim_share[0]).max(rounding_sigma);
        let whole = if brightest_e < from_e { 0.0 } else { self.rim_sigma(brightest_e * self.rim_share[1]) };
        ordinary.max(whole)
    }

    /// Returns light in one pixel in units of its noise.
    fn rim_sigma(&self, rim_e: f64) -> f64 {
        let rim_e = rim_e.min(self.full_well_e);
        rim_e / rim_e.sqrt().hypot(self.read_noise_e_rms).max(1.0)
    }

    /// Returns the electrons of the faintest star with an error of `most_sigma`.
    fn smallest_over(&self, most_sigma: f64) -> f64 {
        let rounding_e = most_sigma * self.read_noise_e_rms.max(1.0) / self.rounding_share;
        // The light r for which r^2 = most_sigma^2 (r + noise^2).
        let (square, noise_e) = (most_sigma * most_sigma, self.read_noise_e_rms);
        let rim_e = 0.5 * (square + (square * square + 4.0 * square * noise_e * noise_e).sqrt());
        (1.0 - LIMIT_MARGIN) * rounding_e.min(rim_e.max(most_sigma) / self.rim_share[0])
    }
}

/// Returns the share of a star's light in the brightest pixel outside a footprint of `half_px`, for the worst position
/// of the star in its pixel.
fn rim_share(psf: &PsfModel, half_px: usize) -> f64 {
    psf.nodes().iter().map(|psf| psf.pixel(half_px as f64 + 0.5, 0.0)).fold(0.0, f64::max)
}

/// Limits of drawing stars whole in an exposure.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct WholeDomain {
    /// Half-width of the footprints, px.
    pub(super) half_px: usize,
    /// Electrons from which on the wings of an ordinary star are over the budget.
    pub(super) limit_e: f64,
    /// Time to draw the frame, ms.
    pub(super) limit_ms: f64,
}

impl WholeDomain {
    /// Returns how many stars whose path is `reach_px` long may be drawn whole, at `nodes` nodes each.
    pub(super) fn most_stars(&self, reach_px: f64, nodes: usize) -> usize {
        let side_px = (2 * self.half_px + 1) as f64 + TILE_PX;
        let by_px = MOST_PX as f64 / (side_px * (side_px + reach_px));
        let by_time = TIME_SHARE * self.limit_ms / cost_ms(self.half_px, nodes, 1);
        #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "clamped to a small number")]
        let most = by_px.min(by_time).clamp(0.0, MOST_STARS as f64) as usize;
        most
    }

    /// Returns true for a target that is drawn whole: the light of its path within a footprint is that of such a star.
    pub(super) fn takes(&self, electrons: f64, length_px: f64, nodes: usize) -> bool {
        let side_px = (2 * self.half_px + 1) as f64;
        electrons * (side_px / length_px).min(1.0) >= self.limit_e && self.most_stars(length_px, nodes) > 0
    }
}

/// Returns the time to draw `stars` whole stars at `nodes` nodes each, ms.
pub(super) fn cost_ms(half_px: usize, nodes: usize, stars: usize) -> f64 {
    let side = (2 * half_px + 1) as f64;
    (stars * nodes.max(1)) as f64 * side * (2.0 * LINE_NS + side * PIXEL_NS) * 1e-6
}

#[cfg(test)]
mod tests {
    use super::*;

    fn wings(psf: &PsfModel, read_noise_e_rms: f64) -> Wings {
        let half_px = psf.half_px(5e-5);
        Wings::of(psf, [half_px, psf.whole_half_px()], 1e5, read_noise_e_rms).with_limit(0.1)
    }

    #[test]
    fn the_limit_is_where_an_ordinary_star_is_over_the_budget() {
        // A rim that decides, and single precision that does.
        for (psf, noise_e) in [
            (PsfModel::gaussian(0.75), 4.0),
            (PsfModel::gaussian(0.85), 5.0),
            (PsfModel::gaussian(1.3), 0.0),
            (PsfModel::moffat(1.5, 4.765), 10.0),
        ] {
            let wings = wings(&psf, noise_e);
            let e = wings.limit_e;
            let (below, above) = (wings.sigma(0.999 * e, f64::INFINITY), wings.sigma(1.001 * e, f64::INFINITY));
            assert!(below <= 0.1 && above >= 0.1, "{psf:?}: {below} and {above} sigma beside {e:e} e-");
            assert!(wings.sigma(1e3 * e, f64::INFINITY) > 0.5, "control: {}", wings.sigma(1e3 * e, f64::INFINITY));
        }
    }

    #[test]
    fn gaussians_that_are_drawn_whole_lack_nothing() {
        let wings = wings(&PsfModel::gaussian(0.75), 4.0);
        let e = wings.limit_e;
        assert!(wings.sigma(1e6 * e, e) <= 0.1, "{}", wings.sigma(1e6 * e, e));
        assert!(wings.half_px > PsfModel::gaussian(0.75).half_px(5e-5), "control: further than an ordinary star");
    }

    #[test]
    fn a_psf_that_ends_too_early_is_over_the_budget_all_the_same() {
        let wings = wings(&PsfModel::moffat(1.5, 2.0), 4.0);
        assert_eq!(wings.half_px, LARGEST_HALF_PX);
        assert!(wings.sigma(1e9, wings.limit_e) > 0.1, "its wings go on beyond 48 px");
    }

    #[test]
    fn the_domain_ends_with_pixels_time_and_number() {
        let domain = |limit_ms| WholeDomain { half_px: 7, limit_e: 1e6, limit_ms };
        assert_eq!(domain(f64::INFINITY).most_stars(0.0, 1), MOST_STARS);
        let long = domain(f64::INFINITY).most_stars(1000.0, 1);
        assert!((1..MOST_STARS).contains(&long), "{long} long paths");
        assert_eq!(domain(f64::INFINITY).most_stars(1e6, 1), 0, "a path across many detectors");
        assert!((1..MOST_STARS).contains(&domain(10.0).most_stars(0.0, 64)), "{}", domain(10.0).most_stars(0.0, 64));
        assert_eq!(domain(1e-3).most_stars(0.0, 64), 0, "no time");
        assert!(domain(f64::INFINITY).takes(1e6, 0.0, 5) && !domain(f64::INFINITY).takes(0.99e6, 0.0, 5));
        assert!(!domain(f64::INFINITY).takes(1e6, 100.0, 50), "spread over a long path");
    }
}
