//! A commanded displacement of the image on the detector during the exposure (`render --los`).
//!
//! Displacement is in px, the same everywhere; roll turns the image about the principal point, from +x towards +y.

/// One row of a path.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PixelPoint {
    /// Time since the exposure started, s (0 and ignored in a list of samples).
    pub t_s: f64,
    /// Displacement to the right, px.
    pub dx_px: f64,
    /// Displacement downwards, px.
    pub dy_px: f64,
    /// Roll of the image from +x towards +y, rad.
    pub roll_rad: f64,
}

/// A commanded image path.
#[derive(Debug, Clone, PartialEq)]
pub enum PixelPath {
    /// Linear between rows in time order; constant before the first and after the last.
    Line(Vec<PixelPoint>),
    /// Equal weights, in time order.
    Samples(Vec<PixelPoint>),
}

/// Error in the rows of a path.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum PixelPathError {
    /// no rows: wanted at least one
    #[error("no rows: wanted at least one")]
    Empty,
    /// a row contains a number that is not finite
    #[error("row {row}: got a number that is not finite")]
    NotFinite {
        /// Row, counted from 1.
        row: usize,
    },
    /// a displacement leads far off the detector
    #[error("row {row}: got a displacement of {px:e} px, wanted at most {LARGEST_PX:e} px")]
    TooFar {
        /// Row, counted from 1.
        row: usize,
        /// The displacement, px.
        px: f64,
    },
    /// times go backwards or leave the exposure
    #[error("row {row}: got t_s = {t_s}, wanted a time not before the row above and within 0..{exposure_s} s")]
    Time {
        /// Row, counted from 1.
        row: usize,
        /// The time given, s.
        t_s: f64,
        /// The exposure, s.
        exposure_s: f64,
    },
}

/// Largest displacement, px: no detector is as large.
const LARGEST_PX: f64 = 1e6;
/// Tolerance for rounded times in files: this share of the exposure beyond its ends is accepted.
const TIME_SLACK: f64 = 1e-9;

impl PixelPath {
    /// Returns a path that is linear between rows.
    ///
    /// # Errors
    /// When the list is empty, a number is not finite, or the times are not ascending within the exposure.
    pub fn line(points: Vec<PixelPoint>, exposure_s: f64) -> Result<Self, PixelPathError> {
        check_finite(&points)?;
        let mut earliest = -TIME_SLACK * exposure_s;
        for (i, point) in points.iter().enumerate() {
            if point.t_s < earliest || point.t_s > exposure_s * (1.0 + TIME_SLACK) {
                return Err(PixelPathError::Time { row: i + 1, t_s: point.t_s, exposure_s });
            }
            earliest = point.t_s;
        }
        Ok(Self::Line(points))
    }

    /// Returns a list of equally weighted positions.
    ///
    /// # Errors
    /// When the list is empty or a number is not finite.
    pub fn samples(points: Vec<PixelPoint>) -> Result<Self, PixelPathError> {
        check_finite(&points)?;
        Ok(Self::Samples(points))
    }

    /// Returns an upper bound of the length of the path of any star within `radius_px` of the principal point, px.
    pub fn length_px(&self, radius_px: f64) -> f64 {
        self.points().windows(2).map(|pair| pair[0].distance_px(&pair[1], radius_px)).sum()
    }

    /// Returns the rows of the path.
    pub fn points(&self) -> &[PixelPoint] {
        match self {
            Self::Line(points) | Self::Samples(points) => points,
        }
    }
}

impl PixelPoint {
    /// Returns the point at a share `s` of the distance to `next`.
    pub fn towards(&self, next: &Self, s: f64) -> Self {
        let mix = |a: f64, b: f64| a + s * (b - a);
        Self {
            t_s: mix(self.t_s, next.t_s),
            dx_px: mix(self.dx_px, next.dx_px),
            dy_px: mix(self.dy_px, next.dy_px),
            roll_rad: mix(self.roll_rad, next.roll_rad),
        }
    }

    /// Returns an upper bound of the distance that any star within `radius_px` of the principal point moves to `next`,
    /// px.
    pub fn distance_px(&self, next: &Self, radius_px: f64) -> f64 {
        let (x, y) = (next.dx_px - self.dx_px, next.dy_px - self.dy_px);
        (x * x + y * y).sqrt() + (next.roll_rad - self.roll_rad).abs() * radius_px
    }
}

fn check_finite(points: &[PixelPoint]) -> Result<(), PixelPathError> {
    let finite = |p: &PixelPoint| [p.t_s, p.dx_px, p.dy_px, p.roll_rad].iter().all(|v| v.is_finite());
    let far = |p: &PixelPoint| p.dx_px.abs().max(p.dy_px.abs());
    if let Some((i, point)) = points.iter().enumerate().find(|(_, point)| far(point) > LARGEST_PX) {
        return Err(PixelPathError::TooFar { row: i + 1, px: far(point) });
    }
    match points.iter().position(|point| !finite(point)) {
        Some(i) => Err(PixelPathError::NotFinite { row: i + 1 }),
        None if points.is_empty() => Err(PixelPathError::Empty),
        None => Ok(()),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn at(t_s: f64) -> PixelPoint {
        PixelPoint { t_s, dx_px: 0.0, dy_px: 0.0, roll_rad: 0.0 }
    }

    #[test]
    fn rows_out_of_order_or_outside_are_refused_with_their_row() {
        let error = PixelPath::line(vec![at(0.0), at(0.2), at(0.1)], 0.3).expect_err("backwards");
        assert_eq!(error, PixelPathError::Time { row: 3, t_s: 0.1, exposure_s: 0.3 });
        let error = PixelPath::line(vec![at(0.0), at(0.4)], 0.3).expect_err("too late");
        assert_eq!(error, PixelPathError::Time { row: 2, t_s: 0.4, exposure_s: 0.3 });
        assert_eq!(PixelPath::samples(vec![]), Err(PixelPathError::Empty));
        assert_eq!(PixelPath::samples(vec![at(0.0), at(f64::NAN)]), Err(PixelPathError::NotFinite { row: 2 }));
    }

    #[test]
    fn a_displacement_beyond_all_detectors_is_refused() {
        let far = PixelPoint { dx_px: 1e12, ..at(0.0) };
        assert_eq!(PixelPath::samples(vec![at(0.0), far]), Err(PixelPathError::TooFar { row: 2, px: 1e12 }));
    }
}
