//! Where on the sky the pixels of a frame are: plain numbers, as a FITS header holds them.
//!
//! Gnomonic projection (`TAN`) with the SIP polynomials of a distorted lens. Sources: Calabretta and Greisen 2002, A&A
//! 395, 1077; Shupe et al. 2005, ASP Conf. 347, 491. `scene::wcs` makes it; `fits` writes it; `hil_scripts/tests/test_wcs.py`
//! has astropy read it.

use std::sync::Arc;

/// One term of a pair of polynomials: `along` times `u^i v^j`.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SipTerm {
    /// Exponent of the first coordinate.
    pub i: u8,
    /// Exponent of the second coordinate.
    pub j: u8,
    /// Coefficients of both polynomials, px.
    pub along: [f64; 2],
}

/// Polynomials of one lens: from pixels to the plane of the sky, and back.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Sip {
    /// Sum of exponents at most, from pixels (`A`, `B`).
    pub order: u8,
    /// Terms from pixels, of second degree and higher.
    pub forward: Vec<SipTerm>,
    /// Sum of exponents at most, to pixels (`AP`, `BP`).
    pub inverse_order: u8,
    /// Terms to pixels.
    pub inverse: Vec<SipTerm>,
}

/// Sum of exponents at most in a FITS header.
pub const MOST_SIP_ORDER: u8 = 9;

/// Exponents of the quadratic terms of [`Wcs::quadratic_px`].
pub const QUADRATIC: [(u8, u8); 3] = [(2, 0), (1, 1), (0, 2)];

/// Map from the pixels of one frame to catalog places (ICRS, epoch of the frame, without aberration and deflection).
#[derive(Debug, Clone, PartialEq)]
pub struct Wcs {
    /// Pixel of the reference point, counted from 1 as FITS counts.
    pub crpix: [f64; 2],
    /// Its right ascension and declination, deg.
    pub crval_deg: [f64; 2],
    /// Plane coordinates (east, north) per pixel (column, row), deg.
    pub cd_deg_px: [[f64; 2]; 2],
    /// Quadratic terms of this frame on top of the lens's, from aberration, px.
    pub quadratic_px: [[f64; 3]; 2],
    /// Polynomials of the lens; `None`: it does not distort.
    pub sip: Option<Arc<Sip>>,
    /// Largest error that was found over the field, px.
    pub error_px: f64,
}

impl Wcs {
    /// Returns whether the header has polynomials.
    pub fn has_sip(&self) -> bool {
        self.sip.is_some() || self.quadratic_px != [[0.0; 3]; 2]
    }

    /// Returns the order of the polynomials from pixels and to pixels.
    pub fn orders(&self) -> [u8; 2] {
        self.sip.as_ref().map_or([2; 2], |sip| [sip.order.max(2), sip.inverse_order.max(2)])
    }

    /// Returns the coefficients of `u^i v^j` from pixels, px: those of the lens and of the frame together.
    pub fn forward(&self, i: u8, j: u8) -> [f64; 2] {
        let lens = self.sip.as_ref().map_or([0.0; 2], |sip| coefficient(&sip.forward, i, j));
        let own = self.own(i, j);
        [lens[0] + own[0], lens[1] + own[1]]
    }

    /// Returns the coefficients of `U^i V^j` to pixels, px. The terms of the frame are small enough to be subtracted.
    pub fn inverse(&self, i: u8, j: u8) -> [f64; 2] {
        let lens = self.sip.as_ref().map_or([0.0; 2], |sip| coefficient(&sip.inverse, i, j));
        let own = self.own(i, j);
        [lens[0] - own[0], lens[1] - own[1]]
    }

    fn own(&self, i: u8, j: u8) -> [f64; 2] {
        let place = QUADRATIC.iter().position(|exponents| *exponents == (i, j));
        place.map_or([0.0; 2], |place| [self.quadratic_px[0][place], self.quadratic_px[1][place]])
    }
}

fn coefficient(terms: &[SipTerm], i: u8, j: u8) -> [f64; 2] {
    terms.iter().find(|term| (term.i, term.j) == (i, j)).map_or([0.0; 2], |term| term.along)
}
