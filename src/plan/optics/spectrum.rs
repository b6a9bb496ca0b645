//! A quantity over wavelength: points (nm, value) -> its value at any wavelength, by straight lines.
//!
//! Wavelengths in nm, ascending; values finite and not negative. Outside the table the value is 0: a detector without a
//! stated quantum efficiency counts nothing. Validation: the tests below, both sides of every rule.
//!
//! [`SpectralWeight`]: light of one wavelength, as a share of the detector's electrons: the effect of a band and a
//! star's colour on the PSF.

use crate::optics::quadrature::{Node, gauss_legendre};

/// Reason why a spectrum, or a band made of spectra, is refused.
#[derive(Debug, Clone, Copy, PartialEq, thiserror::Error)]
pub enum SpectrumError {
    /// Fewer than two points.
    #[error("{points} points; a table over wavelength needs at least two, such as [[400, 0.6], [900, 0.5]]")]
    TooFew {
        /// Number of points.
        points: usize,
    },
    /// A wavelength outside the range of silicon detectors and infrared light.
    #[error("wavelength {nm} nm (point {point}); wavelengths are nanometres from {least} to {most}")]
    Wavelength {
        /// Index of the point.
        point: usize,
        /// Wavelength given.
        nm: f64,
        /// Shortest accepted.
        least: f64,
        /// Longest accepted.
        most: f64,
    },
    /// Wavelengths that do not ascend.
    #[error("{nm} nm follows {before} nm (point {point}); wavelengths must ascend, each once")]
    NotAscending {
        /// Index of the point.
        point: usize,
        /// Its wavelength.
        nm: f64,
        /// The wavelength before it.
        before: f64,
    },
    /// A value that is negative, not finite, or above its limit.
    #[error("value {value} at {nm} nm; values are from 0 to {most}")]
    Value {
        /// Wavelength.
        nm: f64,
        /// Value given.
        value: f64,
        /// Largest accepted.
        most: f64,
    },
    /// Transmission is stated where quantum efficiency is not.
    #[error(
        "transmission from {from_nm} to {to_nm} nm reaches outside the quantum efficiency, which is stated from \
         {least_nm} to {most_nm} nm; give QE (0 where there is none) over the whole band, or cut the transmission"
    )]
    OutsideQe {
        /// First wavelength of the transmission.
        from_nm: f64,
        /// Last wavelength of the transmission.
        to_nm: f64,
        /// First wavelength of the QE.
        least_nm: f64,
        /// Last wavelength of the QE.
        most_nm: f64,
    },
    /// Nothing passes.
    #[error("no light passes: transmission times quantum efficiency is 0 at every wavelength")]
    Dark,
}

/// Shortest and longest wavelength of a table, nm: far ultraviolet to the thermal infrared.
pub const WAVELENGTHS_NM: (f64, f64) = (100.0, 30_000.0);

/// A table over wavelength.
#[derive(Debug, Clone, PartialEq)]
pub struct Spectrum {
    points: Vec<[f64; 2]>,
}

impl Spectrum {
    /// Returns a table from `[nm, value]`, values not negative.
    ///
    /// # Errors
    /// When there are fewer than two points, wavelengths out of range or order, a value below 0 or not finite.
    pub fn new(points: Vec<[f64; 2]>) -> Result<Self, SpectrumError> {
        Self::up_to(points, f64::MAX)
    }

    /// Returns a table of a share, such as a transmission or a quantum efficiency: no value above 1.
    ///
    /// # Errors
    /// The same errors as [`Self::new`], and a value above 1.
    pub fn share(points: Vec<[f64; 2]>) -> Result<Self, SpectrumError> {
        Self::up_to(points, 1.0)
    }

    fn up_to(points: Vec<[f64; 2]>, most: f64) -> Result<Self, SpectrumError> {
        if points.len() < 2 {
            return Err(SpectrumError::TooFew { points: points.len() });
        }
        let (shortest, longest) = WAVELENGTHS_NM;
        for (point, &[nm, value]) in points.iter().enumerate() {
            if !(shortest..=longest).contains(&nm) {
                return Err(SpectrumError::Wavelength { point, nm, least: shortest, most: longest });
            }
            let before = if point > 0 { points[point - 1][0] } else { 0.0 };
            if nm <= before {
                return Err(SpectrumError::NotAscending { point, nm, before });
            }
            if !(0.0..=most).contains(&value) {
                return Err(SpectrumError::Value { nm, value, most });
            }
        }
        Ok(Self { points })
    }

    /// Returns samples at equal steps from `first_nm`; for the tables of this crate, which satisfy the rules.
    pub(super) fn sampled(first_nm: f64, step_nm: f64, values: &[f64]) -> Self {
        Self { points: values.iter().enumerate().map(|(i, value)| [first_nm + step_nm * i as f64, *value]).collect() }
    }

    /// Returns the value at a wavelength; 0 outside the table.
    pub fn at(&self, nm: f64) -> f64 {
        let above = self.points.partition_point(|point| point[0] < nm);
        match (above.checked_sub(1).and_then(|below| self.points.get(below)), self.points.get(above)) {
            (Some(&[x0, y0]), Some(&[x1, y1])) => y0 + (y1 - y0) * (nm - x0) / (x1 - x0),
            (None, Some(&[x, y])) if x == nm => y,
            _ => 0.0,
        }
    }

    /// Returns the first and last wavelength, nm.
    pub fn range_nm(&self) -> (f64, f64) {
        (self.points[0][0], self.points[self.points.len() - 1][0])
    }

    /// Returns the wavelengths at which the slope changes, nm.
    pub(super) fn knots_nm(&self) -> impl Iterator<Item = f64> {
        self.points.iter().map(|point| point[0])
    }
}

/// Number of nodes in each cell of an integral.
const NODES: usize = 3;
/// Widest cell of an integral, nm: three nodes integrate a black body over it to 1e-9 (`cells_are_fine_enough`).
const WIDEST_CELL_NM: f64 = 10.0;

/// Integrals over wavelength of products of tables with smooth functions: cut where a table has a knot, so that three
/// Gauss-Legendre nodes per cell integrate smooth functions only.
#[derive(Debug, Clone)]
pub(super) struct Cells {
    pub(super) edges_nm: Vec<f64>,
    nodes: Vec<Node>,
}

impl Cells {
    /// Returns the cells from the first to the last wavelength, cut at all `knots_nm` in between.
    pub(super) fn new(from_nm: f64, to_nm: f64, knots_nm: impl Iterator<Item = f64>) -> Self {
        Self::no_wider_than(WIDEST_CELL_NM, from_nm, to_nm, knots_nm)
    }

    fn no_wider_than(widest_nm: f64, from_nm: f64, to_nm: f64, knots_nm: impl Iterator<Item = f64>) -> Self {
        let mut knots: Vec<f64> = knots_nm.filter(|nm| *nm > from_nm && *nm < to_nm).collect();
        knots.extend([from_nm, to_nm]);
        knots.sort_by(f64::total_cmp);
        let mut edges_nm = vec![from_nm];
        for pair in knots.windows(2) {
            let parts = ((pair[1] - pair[0]) / widest_nm).ceil();
            let step = (pair[1] - pair[0]) / parts.max(1.0);
            edges_nm.extend((1..parts as usize).map(|i| pair[0] + step * i as f64));
            edges_nm.push(pair[1]);
        }
        Self { edges_nm, nodes: gauss_legendre(NODES) }
    }

    /// Returns the integral of `f(nm)`, per nm of its unit.
    pub(super) fn integral(&self, f: impl Fn(f64) -> f64) -> f64 {
        self.edges_nm.windows(2).map(|cell| self.cell_integral(cell[0], cell[1], &f)).sum()
    }

    fn cell_integral(&self, from_nm: f64, to_nm: f64, f: impl Fn(f64) -> f64) -> f64 {
        let (width, middle) = (to_nm - from_nm, 0.5 * (from_nm + to_nm));
        width * self.nodes.iter().map(|node| node.weight * f(middle + width * node.x)).sum::<f64>()
    }
}

/// One wavelength of a band.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SpectralWeight {
    /// Wavelength, nm.
    pub wavelength_nm: f64,
    /// Share of the electrons that light near this wavelength makes; the shares of a band sum to 1.
    pub weight: f64,
}

#[cfg(test)]
mod tests {
    use super::*;

    fn ramp() -> Spectrum {
        Spectrum::share(vec![[400.0, 0.2], [500.0, 1.0], [700.0, 0.0]]).unwrap()
    }

    #[test]
    fn straight_lines_between_the_points_and_nothing_outside() {
        for (nm, value) in
            [(400.0, 0.2), (450.0, 0.6), (500.0, 1.0), (600.0, 0.5), (700.0, 0.0), (399.9, 0.0), (700.1, 0.0)]
        {
            assert!((ramp().at(nm) - value).abs() < 1e-15, "{nm}: {}", ramp().at(nm));
        }
        assert_eq!(ramp().range_nm(), (400.0, 700.0));
    }

    #[test]
    fn each_rule_refuses_and_its_edge_is_taken() {
        let two = |a: [f64; 2], b: [f64; 2]| Spectrum::share(vec![a, b]);
        assert!(matches!(Spectrum::share(vec![[400.0, 0.5]]), Err(SpectrumError::TooFew { points: 1 })));
        assert!(matches!(two([400.0, 0.5], [400.0, 0.6]), Err(SpectrumError::NotAscending { point: 1, .. })));
        assert!(matches!(two([500.0, 0.5], [400.0, 0.6]), Err(SpectrumError::NotAscending { point: 1, .. })));
        assert!(matches!(two([400.0, -0.1], [500.0, 0.6]), Err(SpectrumError::Value { .. })));
        assert!(matches!(two([400.0, 0.1], [500.0, 1.01]), Err(SpectrumError::Value { .. })));
        assert!(matches!(two([400.0, 0.1], [500.0, f64::NAN]), Err(SpectrumError::Value { .. })));
        assert!(matches!(two([0.4, 0.1], [0.5, 0.1]), Err(SpectrumError::Wavelength { point: 0, .. })));
        assert!(matches!(two([400.0, 0.1], [f64::NAN, 0.1]), Err(SpectrumError::Wavelength { point: 1, .. })));
        assert!(two([100.0, 0.0], [30_000.0, 1.0]).is_ok(), "the edges themselves");
        assert!(Spectrum::new(vec![[400.0, 5.0], [500.0, 7.0]]).is_ok(), "no share, so above 1 is allowed");
        assert!(Spectrum::new(vec![[400.0, f64::INFINITY], [500.0, 7.0]]).is_err());
    }

    #[test]
    fn cells_are_fine_enough() {
        let planck = |nm: f64| nm.powi(-4) / (1.438_776_877e7 / (nm * 1500.0)).exp_m1();
        let f = |nm: f64| planck(nm) * ramp().at(nm);
        let with = |widest| Cells::no_wider_than(widest, 400.0, 700.0, ramp().knots_nm()).integral(f);
        let (ours, finest) = (with(WIDEST_CELL_NM), with(0.1));
        assert!((ours / finest - 1.0).abs() < 1e-9, "{}", ours / finest - 1.0);
        assert!((with(300.0) / finest - 1.0).abs() > 1e-6, "the comparison can fail");
    }
}
