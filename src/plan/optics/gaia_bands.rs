//! Gaia's passbands G, BP and RP, and their zero points.
//!
//! Source: Gaia EDR3 passbands and Vega-system zero points (Riello et al. 2021, A&A 649, A3; ESA, "Gaia EDR3
//! passbands"; unchanged in DR3). Values are the published ones at every tenth nanometre (published: every one),
//! rounded to four digits, with straight lines between: against the full table, G of black bodies from 1500 to 100 000
//! K errs by at most 0.9 mmag, BP-RP by 3.5 mmag; Vega's by 0.4 and 1.3 mmag. The zero points' own uncertainties are 3
//! to 4 mmag. With these zero points Vega's spectrum (CALSPEC, alpha_lyr_stis_011) has G = 0.013, BP-RP = -0.017.
//!
//! `mag = ZP - 2.5 log10(P * integral of n(lambda) S(lambda) d lambda)`, `n` photons s^-1 m^-2 nm^-1, `P` the area of
//! the telescope's pupil.

use crate::optics::spectrum::Spectrum;

/// Area of Gaia's pupil, m^2 (Riello et al. 2021).
pub const PUPIL_M2: f64 = 0.7278;
/// Wavelength step of the tables, nm.
const STEP_NM: f64 = 10.0;

/// One of Gaia's bands.
#[derive(Debug, Clone, PartialEq)]
pub struct GaiaBand {
    /// Electrons per photon at the pupil.
    pub response: Spectrum,
    /// Magnitude of one electron per second, Vega system.
    pub zero_point_mag: f64,
}

impl GaiaBand {
    /// Returns the G band.
    pub fn g() -> Self {
        Self { response: Spectrum::sampled(320.0, STEP_NM, &G), zero_point_mag: 25.687_366_867_1 }
    }

    /// Returns the BP band.
    pub fn bp() -> Self {
        Self { response: Spectrum::sampled(320.0, STEP_NM, &BP), zero_point_mag: 25.338_542_215_8 }
    }

    /// Returns the RP band.
    pub fn rp() -> Self {
        Self { response: Spectrum::sampled(600.0, STEP_NM, &RP), zero_point_mag: 24.747_895_501_2 }
    }

    /// Returns the magnitude of a source from which the telescope would count this many electrons s^-1 m^-2.
    pub fn mag(&self, e_per_s_m2: f64) -> f64 {
        self.zero_point_mag - 2.5 * (PUPIL_M2 * e_per_s_m2).log10()
    }

    /// Returns the electrons s^-1 m^-2 that the telescope counts from a source of magnitude 0.
    pub fn zero_magnitude_e_per_s_m2(&self) -> f64 {
        10_f64.powf(0.4 * self.zero_point_mag) / PUPIL_M2
    }
}

/// Response of G from 320 nm.
const G: [f64; 75] = [
    0.0, 0.0098, 0.0869, 0.1259, 0.1214, 0.1093, 0.1163, 0.2046, 0.3408, 0.4332, 0.4929, 0.5325, 0.5601, 0.5819,
    0.5989, 0.6127, 0.6245, 0.6346, 0.6429, 0.6514, 0.6592, 0.6652, 0.6726, 0.6779, 0.6834, 0.6882, 0.6929, 0.6984,
    0.7013, 0.7059, 0.7099, 0.7123, 0.7149, 0.7169, 0.7181, 0.7174, 0.7164, 0.7130, 0.7095, 0.7023, 0.6949, 0.6829,
    0.6709, 0.6544, 0.6361, 0.6155, 0.5924, 0.5674, 0.5396, 0.5101, 0.4791, 0.4474, 0.4148, 0.3804, 0.3473, 0.3140,
    0.2805, 0.2495, 0.2183, 0.1896, 0.1621, 0.1371, 0.1138, 0.0932, 0.0750, 0.0588, 0.0452, 0.0339, 0.0245, 0.0171,
    0.0114, 0.0073, 0.0044, 0.0024, 0.0,
];

/// Response of BP from 320 nm.
const BP: [f64; 39] = [
    0.0, 0.0109, 0.2098, 0.1846, 0.2353, 0.2044, 0.1621, 0.2544, 0.4322, 0.5335, 0.5783, 0.5990, 0.6153, 0.6270,
    0.6270, 0.6292, 0.6346, 0.6353, 0.6315, 0.6301, 0.6300, 0.6233, 0.6202, 0.6227, 0.6193, 0.6086, 0.6133, 0.6432,
    0.6279, 0.6132, 0.6495, 0.6669, 0.6207, 0.5284, 0.3412, 0.0352, 0.0007, 0.0003, 0.0,
];

/// Response of RP from 600 nm.
const RP: [f64; 50] = [
    0.0, 0.0001, 0.0090, 0.3945, 0.7285, 0.6932, 0.7068, 0.7259, 0.7318, 0.7311, 0.7376, 0.7352, 0.7322, 0.7396,
    0.7434, 0.7384, 0.7392, 0.7300, 0.7148, 0.7045, 0.7038, 0.7012, 0.6905, 0.6750, 0.6552, 0.6279, 0.5985, 0.5664,
    0.5321, 0.4998, 0.4632, 0.4237, 0.3837, 0.3410, 0.2992, 0.2555, 0.2165, 0.1788, 0.1454, 0.1143, 0.0815, 0.0522,
    0.0302, 0.0166, 0.0086, 0.0042, 0.0019, 0.0008, 0.0003, 0.0,
];
