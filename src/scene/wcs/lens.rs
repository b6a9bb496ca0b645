//! A lens's distortion -> the polynomials of a FITS header.
//!
//! In: the camera and the part of the sensor that is read out. Out: for image pixels (u, v) from the principal point,
//! the undistorted place `L (u + f)` with a linear part `L` and [SIP](frames::sink::Sip) polynomials `f`, and the
//! inverse. Least squares over a grid that is denser towards the edges (Chebyshev's), of the lowest order with an error
//! below [`GOOD_PX`], or of the best one. Computed once per camera. Test: `crate::wcs`.

use base::least_squares::Basis;
use frames::sink::{MOST_SIP_ORDER, Sip, SipTerm};
use image::detector::window::OutputGeometry;
use sky::astrometry::CameraGeometry;
use std::sync::Arc;

/// Number of places along each side from which polynomials are fitted.
const FIT_SIDE: usize = 20;
/// Error below which no higher order is tried, image px: a tenth of the guaranteed limit.
const GOOD_PX: f64 = 0.002;
/// Smallest order.
const LEAST_ORDER: u8 = 2;

/// Two numbers along columns and rows.
pub(super) type Pair = [f64; 2];
/// Rows of a two by two matrix.
pub(super) type Matrix = [[f64; 2]; 2];

/// A lens's polynomials.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Lens {
    /// Undistorted image px per image px at the principal point, as fitted.
    pub(super) linear: Matrix,
    /// The polynomials; `None` without distortion.
    pub(super) sip: Option<Arc<Sip>>,
}

/// Conversion between image pixels and places of a lens.
#[derive(Debug, Clone, Copy)]
pub(super) struct ImagePlane<'a> {
    pub(super) camera: &'a CameraGeometry,
    pub(super) output: &'a OutputGeometry,
}

impl ImagePlane<'_> {
    /// Returns the principal point in image pixels, the first one's centre at 0.
    pub(super) fn principal_px(&self) -> Pair {
        self.output.output_from_sensor(self.camera.parameters().principal_point_px)
    }

    /// Returns the focal lengths in image pixels.
    pub(super) fn focal_px(&self) -> Pair {
        self.camera.parameters().focal_px.map(|focal_px| focal_px / f64::from(self.output.binning))
    }

    /// Returns the tangents of a place `u` from the principal point, image px; `None` where nothing is imaged.
    pub(super) fn tangent(&self, u: Pair) -> Option<Pair> {
        let [cx, cy] = self.principal_px();
        let sensor_px = self.output.sensor_from_output([u[0] + cx, u[1] + cy]);
        self.camera.tangent_of_pixel(sensor_px).map(|tangent| tangent.to_array())
    }

    /// Returns places of a grid over the image, from the principal point: `share` (0 to 1) of its width and height.
    pub(super) fn grid(&self, side: usize, share: impl Fn(usize) -> f64) -> Vec<Pair> {
        let [cx, cy] = self.principal_px();
        let [width, height] = self.output.size_px.map(|side| side as f64);
        let at = |k: usize| [share(k % side) * width - 0.5 - cx, share(k / side) * height - 0.5 - cy];
        (0..side * side).map(at).collect()
    }
}

impl Lens {
    /// Fits the lens of `plane`; `None` when no order can be fitted.
    pub(super) fn fitted(plane: &ImagePlane<'_>) -> Option<Self> {
        if !plane.camera.is_distorted() {
            return Some(Self { linear: [[1.0, 0.0], [0.0, 1.0]], sip: None });
        }
        let chebyshev = |k: usize| 0.5 - 0.5 * ((k as f64 + 0.5) / FIT_SIDE as f64 * core::f64::consts::PI).cos();
        let places = plane.grid(FIT_SIDE, chebyshev);
        let focal_px = plane.focal_px();
        let ideal = places.iter().map(|u| plane.tangent(*u).map(|t| [t[0] * focal_px[0], t[1] * focal_px[1]]));
        let ideal: Vec<Pair> = ideal.collect::<Option<_>>()?;
        let (order, terms) = best(&places, &ideal)?;
        let linear = linear_of(&terms)?;
        let back = inverse(&linear)?;
        let forward = terms
            .iter()
            .filter(|term| term.i + term.j > 1)
            .map(|term| SipTerm { along: times(&back, term.along), ..*term });
        let straight: Vec<Pair> = ideal.iter().map(|ideal| times(&back, *ideal)).collect();
        let off: Vec<Pair> = places.iter().zip(&straight).map(|(u, s)| [u[0] - s[0], u[1] - s[1]]).collect();
        let (inverse_order, inverse) = best(&straight, &off)?;
        let sip = Sip { order, forward: forward.collect(), inverse_order, inverse };
        Some(Self { linear, sip: Some(Arc::new(sip)) })
    }

    /// Returns the undistorted place of `u` by the polynomials, image px.
    pub(super) fn ideal_px(&self, u: Pair) -> Pair {
        let forward = self.sip.as_ref().map_or(&[][..], |sip| &sip.forward);
        let bent = sum(forward, u);
        times(&self.linear, [u[0] + bent[0], u[1] + bent[1]])
    }
}

/// Returns polynomials without a constant through `values` at `places`: the lowest order that is good, or the best one.
fn best(places: &[Pair], values: &[Pair]) -> Option<(u8, Vec<SipTerm>)> {
    let mut found: Option<(f64, u8, Vec<SipTerm>)> = None;
    for order in LEAST_ORDER..=MOST_SIP_ORDER {
        let Some(terms) = fit(places, values, order) else { continue };
        let error_px = worst_px(places, values, &terms);
        if found.as_ref().is_none_or(|(least_px, ..)| error_px < *least_px) {
            found = Some((error_px, order, terms));
        }
        if error_px <= GOOD_PX {
            break;
        }
    }
    found.map(|(_, order, terms)| (order, terms))
}

fn fit(places: &[Pair], values: &[Pair], order: u8) -> Option<Vec<SipTerm>> {
    let exponents = || (1..=order).flat_map(|degree| (0..=degree).map(move |j| (degree - j, j)));
    let column = |(i, j): (u8, u8)| places.iter().map(|[u, v]| u.powi(i.into()) * v.powi(j.into())).collect();
    let basis = Basis::of(exponents().map(column).collect())?;
    let along = |axis: usize| basis.solve(&values.iter().map(|value| value[axis]).collect::<Vec<_>>());
    let terms = exponents().zip(along(0)).zip(along(1)).map(|(((i, j), x), y)| SipTerm { i, j, along: [x, y] });
    Some(terms.collect())
}

fn worst_px(places: &[Pair], values: &[Pair], terms: &[SipTerm]) -> f64 {
    let off = |(place, value): (&Pair, &Pair)| {
        let got = sum(terms, *place);
        (got[0] - value[0]).hypot(got[1] - value[1])
    };
    places.iter().zip(values).map(off).fold(0.0, f64::max)
}

fn sum(terms: &[SipTerm], [u, v]: Pair) -> Pair {
    terms.iter().fold([0.0; 2], |[x, y], term| {
        let power = u.powi(term.i.into()) * v.powi(term.j.into());
        [x + term.along[0] * power, y + term.along[1] * power]
    })
}

fn linear_of(terms: &[SipTerm]) -> Option<Matrix> {
    let of = |i, j| terms.iter().find(|term| (term.i, term.j) == (i, j)).map(|term| term.along);
    let ([xx, yx], [xy, yy]) = (of(1, 0)?, of(0, 1)?);
    Some([[xx, xy], [yx, yy]])
}

/// Returns the product of a matrix and a vector.
pub(super) fn times(m: &Matrix, v: Pair) -> Pair {
    m.map(|[a, b]| a * v[0] + b * v[1])
}

/// Returns the product of two matrices.
pub(super) fn product(a: &Matrix, b: &Matrix) -> Matrix {
    a.map(|[x, y]| [x * b[0][0] + y * b[1][0], x * b[0][1] + y * b[1][1]])
}

/// Returns the inverse of a matrix; `None` when it has none.
pub(super) fn inverse([[a, b], [c, d]]: &Matrix) -> Option<Matrix> {
    let determinant = a * d - b * c;
    let is_good = determinant.is_finite() && determinant != 0.0;
    is_good.then(|| [[d / determinant, -b / determinant], [-c / determinant, a / determinant]])
}
