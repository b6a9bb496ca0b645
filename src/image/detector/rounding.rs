//! Rounding of the ADC: to the nearest number, or to the next below.

/// Rounding of digital numbers.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Rounding {
    /// The nearest.
    #[default]
    Nearest,
    /// The next below.
    Truncate,
}

impl Rounding {
    /// Returns the number that is added before the fraction is cut off, DN.
    pub const fn dn(self) -> f32 {
        match self {
            Self::Nearest => 0.5,
            Self::Truncate => 0.0,
        }
    }
}
