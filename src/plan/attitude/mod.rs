//! Attitude samples -> history -> interpolation or prediction -> [`LosPath`] of one exposure.
//!
//! Input: `(AttitudeSample, received_at)` and jitter points, stamped at the link; remote tick counts. Output: the line
//! of sight of one exposure, with the origin and age of its data. Units: rad, s, TAI.
//!
//! ```text u32 ticks -> RemoteClock -> Tai                        (remote_clock) sample -> AttitudeHistory ->
//! interpolate | predict | hold -> estimate burst | lines | PSD | wheels -> JitterHistory -> JitterTrack
//! (jitter) estimate + JitterTrack + mounting -> LosPath            (exposure_path, residual) MotionScale + Reach +
//! budget -> which method is enough  (method, method_bound, motion_scale) AnalyticMotion -> errors found beside their
//! bounds      (measured) ```
//!
//! After construction nothing here allocates: rings have a fixed capacity and the caller's buffers are reused. Refused
//! input gives a typed [`HistoryReject`], counted by reason.

mod error;
mod estimate;
mod exposure_path;
pub mod history;
mod interpolate;
mod jitter;
pub mod los;
mod measured;
mod method;
mod method_bound;
mod predict;
mod remote_clock;
mod ring;

pub use error::{AttitudeError, HistoryReject, JitterReject};
pub use estimate::{Decision, EstimateLimits, EstimatedAttitude, StalePolicy, decide, state_at};
pub use exposure_path::{PathOutcome, PathReport, compose};
pub use history::{AttitudeHistory, AttitudeSample, MOST_ACCELERATION_RAD_S2, MOST_RATE_RAD_S};
pub use interpolate::{hermite_error_bound_rad, interpolate};
pub use jitter::{
    BUS_LINES_MAX, DENSITY_ROWS_MAX, HARMONICS_MAX, JitterCoverage, JitterHistory, JitterRecord, JitterTableError,
    LINES_PER_AXIS, PSD_POINTS_MAX, PsdPoint, RECORD_SAMPLES_MAX, RecordEnd, RecordedJitter, SpectrumBin,
    UPLOADED_LINES_MAX, WHEELS, WheelHarmonic, band_power_rad2, psd_variance, read_density, read_series,
    smear_power_rad2,
};
pub use los::{JitterLine, JitterPoint, JitterTrack, LosPath, PathOrigin};
pub use measured::{AnalyticMotion, MeasuredError, SinusoidTurn, measured_prediction_errors};
pub use method::{AttitudeAssessment, AttitudeMethod, AttitudeVerdict, Reach, assess_methods, cheapest, state_by};
pub use method_bound::{MotionScale, Sinusoid};
pub use predict::{AttitudeState, PredictionErrors, held_state, predict};
pub use remote_clock::{ClockEstimate, MeasuredDelay, Observed, ObservedPps, RemoteClock, RemoteClockLimits};
pub use ring::{HistoryCounts, HistoryLimits};
