//! Errors of a spacecraft's parameters and commands, each with the wanted and the given value.

use super::params::{MODES_MAX, WHEELS_MAX};
use base::time::{Span, Tai};
use glam::DMat3;

/// Parameters that are not physical, or a question about a time that is not kept.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum SpacecraftError {
    /// The matrix is not the inertia of a body.
    #[error(
        "inertia_kg_m2: wanted a symmetric, positive definite matrix whose principal moments obey the triangle \
         inequality, got {got}"
    )]
    Inertia {
        /// The given matrix.
        got: DMat3,
    },
    /// More wheels than allowed.
    #[error("wheels: wanted at most {WHEELS_MAX}, got {got}")]
    TooManyWheels {
        /// How many were given.
        got: usize,
    },
    /// More modes than allowed.
    #[error("modes: wanted at most {MODES_MAX}, got {got}")]
    TooManyModes {
        /// How many were given.
        got: usize,
    },
    /// One number is out of its range.
    #[error("{of} {index}: {field} = {got}, wanted {wanted}")]
    OutOfRange {
        /// The part: "wheel", "mode", "gyro axis", ...
        of: &'static str,
        /// Which one, from 0.
        index: usize,
        /// The field.
        field: &'static str,
        /// Its value.
        got: f64,
        /// Its range, in words.
        wanted: &'static str,
    },
    /// Rotors and appendages hold more inertia than the whole.
    #[error("wheels and modes couple more inertia than the whole body has: inertia without them is {got} kg m^2")]
    TooStronglyCoupled {
        /// Inertia less rotors and appendages.
        got: DMat3,
    },
    /// The step is not above zero, or too long for the dynamics it must resolve.
    #[error("step: {step_s} s, wanted at least {smallest_s} s and at most {largest_s} s for {limited_by}")]
    Step {
        /// The step.
        step_s: f64,
        /// The smallest that is taken.
        smallest_s: f64,
        /// The largest that will do.
        largest_s: f64,
        /// Why.
        limited_by: &'static str,
    },
    /// The truth of that instant is no longer, or not yet, kept.
    #[error("no truth kept for {at}: kept are {first} to {last}")]
    OutsideHistory {
        /// When it was asked for.
        at: Tai,
        /// First instant kept.
        first: Tai,
        /// Last instant kept.
        last: Tai,
    },
    /// A wheel of this number does not exist.
    #[error("wheel {got}: wanted one of the {count}, counted from 0")]
    NoSuchWheel {
        /// The index.
        got: usize,
        /// How many there are.
        count: usize,
    },
    /// The sampling period is not above zero, or too short or long.
    #[error("micro-vibration period: {} s, wanted at least {} s and at most {} s", .got.s(), .smallest.s(), .largest.s())]
    Period {
        /// The period.
        got: Span,
        /// The shortest that is taken.
        smallest: Span,
        /// The longest that is taken.
        largest: Span,
    },
}
