//! Time -> nutation in longitude and in obliquity, rad.
//!
//! Source: the 21 largest luni-solar terms of IAU 2000B (McCarthy and Luzum 2003, Celest. Mech. 85, 37, table 1), their
//! sine in longitude and cosine in obliquity at J2000; arguments of Delaunay, linear (Simon et al. 1994, A&A 282, 663).
//! Limit: against IAU 2006/2000A, 1991-2050, the pole is within 11 mas (28 in longitude, 10 in obliquity). Test:
//! `agrees_with_the_whole_series`.

use base::units::{ARCSEC, MAS};

/// Largest error of the pole against the whole series, 1991-2050, mas.
#[cfg(test)]
pub(super) const POLE_MAS: f64 = 12.0;

/// Arguments at J2000 and their rates per Julian century, arcsec: l, l', F, D, Omega.
const DELAUNAY: [[f64; 2]; 5] = [
    [485_868.249_036, 1_717_915_923.217_8],
    [1_287_104.793_05, 129_596_581.048_1],
    [335_779.526_232, 1_739_527_262.847_8],
    [1_072_260.703_69, 1_602_961_601.209_0],
    [450_160.398_036, -6_962_890.543_1],
];

/// Multiples of the arguments; sine in longitude, cosine in obliquity, 0.1 microarcsec.
#[rustfmt::skip]
const TERMS: [([i8; 5], f64, f64); 21] = [
    ([0, 0, 0, 0, 1], -172_064_161.0, 92_052_331.0), ([0, 0, 2, -2, 2], -13_170_906.0, 5_730_336.0),
    ([0, 0, 2, 0, 2], -2_276_413.0, 978_459.0), ([0, 0, 0, 0, 2], 2_074_554.0, -897_492.0),
    ([0, 1, 0, 0, 0], 1_475_877.0, 73_871.0), ([0, 1, 2, -2, 2], -516_821.0, 224_386.0),
    ([1, 0, 0, 0, 0], 711_159.0, -6_750.0), ([0, 0, 2, 0, 1], -387_298.0, 200_728.0),
    ([1, 0, 2, 0, 2], -301_461.0, 129_025.0), ([0, -1, 2, -2, 2], 215_829.0, -95_929.0),
    ([0, 0, 2, -2, 1], 128_227.0, -68_982.0), ([-1, 0, 2, 0, 2], 123_457.0, -53_311.0),
    ([-1, 0, 0, 2, 0], 156_994.0, -1_235.0), ([1, 0, 0, 0, 1], 63_110.0, -33_228.0),
    ([-1, 0, 0, 0, 1], -57_976.0, 31_429.0), ([-1, 0, 2, 2, 2], -59_641.0, 25_543.0),
    ([1, 0, 2, 0, 1], -51_613.0, 26_366.0), ([-2, 0, 2, 0, 1], 45_893.0, -24_236.0),
    ([0, 0, 0, 2, 0], 63_384.0, -1_220.0), ([0, 0, 2, 2, 2], -38_571.0, 16_452.0),
    ([-2, 0, 0, 2, 0], -47_722.0, 477.0),
];

/// Returns the nutation in longitude and in obliquity, rad, `t` Julian centuries (TDB) after J2000.
pub(super) fn nutation_rad(t: f64) -> [f64; 2] {
    let arguments = DELAUNAY.map(|[at_j2000, rate]| (at_j2000 + t * rate) * ARCSEC);
    let mut sums = [0.0; 2];
    for (multiples, sine, cosine) in TERMS {
        let phase: f64 = multiples.iter().zip(arguments).map(|(n, argument)| f64::from(*n) * argument).sum();
        let (sin, cos) = phase.sin_cos();
        sums[0] += sine * sin;
        sums[1] += cosine * cos;
    }
    sums.map(|sum| sum * 1e-4 * MAS)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Julian centuries after J2000; nutation in longitude and obliquity, mas, by erfa.nut06a (pyerfa 2.0.1.5).
    const NUT06A: [[f64; 3]; 6] = [
        [-0.09, 15534.396, 3895.587],
        [0.0, -13932.003, -5769.398],
        [0.091, 14604.496, 5749.839],
        [0.263, 5627.896, 8542.470],
        [0.3555, -5553.095, -8911.968],
        [0.5099, 11451.270, -7831.794],
    ];

    #[test]
    fn agrees_with_the_whole_series() {
        for [t, longitude_mas, obliquity_mas] in NUT06A {
            let [longitude, obliquity] = nutation_rad(t).map(|angle_rad| angle_rad / MAS);
            let off_mas = ((longitude - longitude_mas) * 0.3978).hypot(obliquity - obliquity_mas);
            println!("{t}: {off_mas:.1} mas");
            assert!(off_mas < POLE_MAS, "{t}: {longitude} {obliquity}");
            let later = nutation_rad(t + 0.002).map(|angle_rad| angle_rad / MAS);
            let moved_mas = ((later[0] - longitude) * 0.3978).hypot(later[1] - obliquity);
            assert!(moved_mas > 3.0 * POLE_MAS, "control: 73 days move the pole by {moved_mas} mas");
        }
    }
}
