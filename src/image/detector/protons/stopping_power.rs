//! Electronic stopping power of silicon for protons: kinetic energy in MeV -> MeV cm^2/g.
//!
//! Table: PSTAR, NIST Standard Reference Database 124 (Berger, Coursey, Zucker and Chang), silicon, electronic part;
//! straight lines between logarithms. Domain 1 MeV to 10 GeV. Interpolation errs by less than 0.6 % at the energies of
//! PSTAR that are left out here; PSTAR states its own uncertainty as 1 to 2 % (tests below, which also compare it with
//! Bethe's formula).

/// Density of silicon, g/cm^3 (PSTAR's).
pub const DENSITY_G_CM3: f64 = 2.33;
/// Smallest and largest energy of the table, MeV.
pub const DOMAIN_MEV: [f64; 2] = [1.0, 10_000.0];

/// MeV, MeV cm^2/g.
const TABLE: [[f64; 2]; 33] = [
    [1.0, 175.3],
    [1.5, 135.4],
    [2.0, 111.7],
    [3.0, 84.28],
    [4.0, 68.56],
    [5.0, 58.24],
    [6.0, 50.88],
    [8.0, 40.99],
    [10.0, 34.58],
    [15.0, 25.28],
    [20.0, 20.19],
    [25.0, 16.95],
    [30.0, 14.69],
    [40.0, 11.72],
    [50.0, 9.852],
    [60.0, 8.561],
    [80.0, 6.883],
    [100.0, 5.836],
    [125.0, 4.972],
    [150.0, 4.382],
    [200.0, 3.627],
    [250.0, 3.164],
    [300.0, 2.852],
    [400.0, 2.462],
    [500.0, 2.230],
    [600.0, 2.079],
    [800.0, 1.899],
    [1000.0, 1.801],
    [1500.0, 1.696],
    [2000.0, 1.665],
    [3000.0, 1.668],
    [5000.0, 1.720],
    [10_000.0, 1.830],
];

/// Returns the stopping power at an energy; outside the table that of its end.
pub fn silicon_mev_cm2_g(energy_mev: f64) -> f64 {
    let after = TABLE.partition_point(|[energy, _]| *energy <= energy_mev);
    let (Some(low), Some(high)) = (TABLE.get(after.wrapping_sub(1)), TABLE.get(after)) else {
        return TABLE[if after == 0 { 0 } else { TABLE.len() - 1 }][1];
    };
    let share = libm::log(energy_mev / low[0]) / libm::log(high[0] / low[0]);
    low[1] * libm::pow(high[1] / low[1], share)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn energies_left_out_of_the_table() {
        for [energy, published] in [
            [1.25, 152.3],
            [1.75, 122.2],
            [2.5, 95.80],
            [7.0, 45.33],
            [12.5, 29.12],
            [17.5, 22.42],
            [35.0, 13.01],
            [45.0, 10.69],
            [70.0, 7.611],
            [90.0, 6.305],
            [175.0, 3.953],
            [225.0, 3.370],
            [350.0, 2.629],
            [450.0, 2.332],
            [700.0, 1.974],
            [900.0, 1.843],
            [2500.0, 1.661],
            [4000.0, 1.692],
            [7000.0, 1.770],
        ] {
            let got = silicon_mev_cm2_g(energy);
            assert!((got / published - 1.0).abs() < 0.006, "{energy} MeV: {got}, published {published}");
        }
        assert_eq!(silicon_mev_cm2_g(100.0), 5.836, "a point of the table");
        assert_eq!(silicon_mev_cm2_g(0.1), 175.3, "its end");
        assert_eq!(silicon_mev_cm2_g(1e6), 1.830, "its other end");
    }

    /// Bethe's formula with the mean excitation energy of ICRU 49, without shell and density corrections.
    fn bethe(energy_mev: f64) -> f64 {
        let (electron_mev, proton_mev, excitation_mev) = (0.510_998_95, 938.272_088, 173e-6);
        let gamma = 1.0 + energy_mev / proton_mev;
        let beta2 = 1.0 - 1.0 / (gamma * gamma);
        let ratio: f64 = electron_mev / proton_mev;
        let largest = 2.0 * electron_mev * beta2 * gamma * gamma / (1.0 + 2.0 * gamma * ratio + ratio * ratio);
        let logarithm = (2.0 * electron_mev * beta2 * gamma * gamma * largest / (excitation_mev * excitation_mev)).ln();
        0.307_075 * 14.0 / 28.085 / beta2 * (0.5 * logarithm - beta2)
    }

    #[test]
    fn bethe_agrees_where_no_correction_is_needed() {
        for energy in [20.0, 30.0, 70.0, 100.0, 200.0, 500.0] {
            let (got, wanted) = (silicon_mev_cm2_g(energy), bethe(energy));
            assert!((got / wanted - 1.0).abs() < 0.015, "{energy} MeV: {got}, {wanted}");
        }
        // The comparison sees the shell corrections where they matter.
        assert!((silicon_mev_cm2_g(1.0) / bethe(1.0) - 1.0).abs() > 0.02, "negative control");
    }
}
