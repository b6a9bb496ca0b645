//! All metrics of a set of cases.

use crate::availability::{acquisition, tracking, tracking_of_case};
use crate::bandwidth::{bandwidth, ratio_of_case};
use crate::metric::{Interval, Kind, Metric, Reading};
use crate::noise::{noise_of_case, temporal_noise};
use crate::record::{Case, JudgedCase, Use};
use crate::slopes::{aberration_residual, date_error, drift};
use crate::{
    attitude_error::directional, bias::bias, exclusion::exclusion_angles, settings::Settings, spatial::spatial_errors,
    statistics::quantile, thermo_elastic::thermo_elastic,
};
use base::units::ARCSEC;

pub(crate) const AME: Kind = Kind {
    id: "absolute_measurement_error",
    unit: "arcsec",
    reading: Reading::Mixed,
    how: "AME: quantile of the error at the report's probability; order statistics",
    parts: &["directional", "rotational"],
    uses: &[Use::Run, Use::Inertial, Use::FovGrid, Use::Drift],
    interval: Interval::Quantile,
    counted: "attitudes",
    ..Kind::USUAL
};

/// Cases and what they say together.
#[derive(Debug, Clone, PartialEq)]
pub struct Assessment {
    /// With what it is said.
    pub settings: Settings,
    /// All frames.
    pub cases: Vec<JudgedCase>,
    /// All numbers: first those of all cases, then those of each that is flown for itself.
    pub metrics: Vec<Metric>,
}

/// Returns everything that the cases say.
pub fn assess(cases: &[Case], settings: &Settings) -> Assessment {
    let Settings { confidence, probability, false_limit, .. } = *settings;
    let judged: Vec<JudgedCase> = cases.iter().map(|case| case.judged(&false_limit)).collect();
    let mut metrics = bias(&judged, confidence);
    metrics.extend(spatial_errors(&judged, confidence));
    metrics.extend(temporal_noise(&judged, confidence, probability));
    metrics.extend(absolute_error(&judged, settings));
    metrics.extend(date_error(&judged, confidence));
    metrics.extend(aberration_residual(&judged, confidence));
    metrics.extend(drift(&judged, confidence));
    metrics.extend(thermo_elastic(&judged, confidence));
    metrics.extend(bandwidth(&judged, confidence));
    metrics.extend(exclusion_angles(&judged, settings));
    metrics.extend(acquisition(&judged, confidence, probability));
    metrics.extend(tracking(&judged, confidence));
    for case in judged.iter().filter(|case| Use::EACH_FOR_ITSELF.contains(&case.purpose)) {
        metrics.extend(tracking_of_case(case, confidence));
        metrics.extend(noise_of_case(case, confidence));
    }
    metrics.extend(judged.iter().filter_map(|case| ratio_of_case(case, confidence)));
    Assessment { settings: *settings, cases: judged, metrics }
}

fn absolute_error(cases: &[JudgedCase], settings: &Settings) -> Vec<Metric> {
    let wanted = |case: &&JudgedCase| matches!(case.purpose, Use::Run | Use::Inertial | Use::FovGrid | Use::Drift);
    let frames = cases.iter().filter(wanted).flat_map(|case| &case.frames);
    let errors: Vec<_> = frames.filter_map(|frame| frame.error_rad()).collect();
    let of = |name: &str, values: Vec<f64>| {
        let found = quantile(&values, settings.probability, settings.confidence);
        found.map(|found| AME.of(name, None, found.scaled(1.0 / ARCSEC)))
    };
    let across = of("directional", errors.iter().map(|error| directional(*error)).collect());
    let about = of("rotational", errors.iter().map(|error| error.z.abs()).collect());
    across.into_iter().chain(about).collect()
}
