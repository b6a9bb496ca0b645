//! Name of a star -> its velocity along the line of sight, for the stars whose places it changes most.
//!
//! A star that comes nearer moves faster across the sky: neglect of its radial velocity v_r errs by v_r parallax pm t^2
//! / 4.74 (perspective acceleration; Schlesinger 1917, AJ 30, 137). Catalogs of places seldom list v_r; `FASTEST` has
//! it for the fast and near stars where neglect would come to 10 mas and more in 34 years. Values: Nidever et al. 2002,
//! ApJS 141, 503, and Gaia DR3, good to 0.5 km/s: 3 mas for Barnard's star by 2050, 1 mas or less for the others. Left
//! out: alpha Centauri and Sirius, whose orbital motion, which no catalog here has, is larger by far. Tests: below, and
//! `tests/physics/space_motion.rs`.

use base::source_id::SourceId;

/// Kilometres per second in one astronomical unit per Julian year.
pub const KM_S_PER_AU_YR: f64 = 4.740_470_463;
/// Stars slower than all of [`FASTEST`] are not looked up, mas/yr.
const LEAST_MAS_YR: f64 = 1000.0;

/// A star whose radial velocity is known.
struct Measured {
    hipparcos: u32,
    gaia_dr3: u64,
    km_s: f64,
}

const fn measured(hipparcos: u32, gaia_dr3: u64, km_s: f64) -> Measured {
    Measured { hipparcos, gaia_dr3, km_s }
}

/// Radial velocities, from the barycentre of the solar system, positive when the distance grows.
#[rustfmt::skip]
const FASTEST: [Measured; 17] = [
    measured( 87_937, 4_472_832_130_942_575_872, -110.5), // Barnard's star
    measured( 24_186, 4_810_594_479_418_041_856,  245.0), // Kapteyn's star
    measured( 54_035,   762_815_470_562_110_464,  -84.7), // Lalande 21185
    measured(104_214, 1_872_046_609_345_556_480,  -65.7), // 61 Cygni A
    measured(104_217, 1_872_046_574_983_497_216,  -64.3), // 61 Cygni B
    measured( 57_939, 4_034_171_629_042_489_088,  -98.0), // Groombridge 1830
    measured( 70_890, 5_853_498_713_190_525_696,  -22.2), // Proxima Centauri
    measured( 54_211,   778_947_814_402_602_752,   68.9), // GJ 412 A
    measured(108_870, 6_412_595_290_592_307_840,  -40.4), // epsilon Indi
    measured(  5_336,   411_413_822_074_322_432,  -97.2), // mu Cassiopeiae
    measured( 15_510, 4_847_957_293_278_177_024,   87.4), // 82 Eridani
    measured(    439, 2_306_965_202_564_744_064,   25.5), // GJ 1
    measured( 19_849, 3_195_919_528_989_223_040,  -42.3), // 40 Eridani A
    measured(114_046, 6_553_614_253_923_452_800,    8.8), // Lacaille 9352
    measured(105_090, 6_583_272_171_336_048_640,   20.6), // Lacaille 8760
    measured(  1_475,   385_334_230_892_516_480,   11.7), // Groombridge 34 A
    measured(  8_102, 2_452_378_776_434_477_184,  -16.6), // tau Ceti
];

/// Returns the radial velocity of a star, km/s, where it is known.
pub fn radial_velocity_km_s(id: SourceId) -> Option<f64> {
    let is_it = |star: &&Measured| match id {
        SourceId::Gaia(_, number) => star.gaia_dr3 == number,
        SourceId::Hipparcos(number) => star.hipparcos == number,
        SourceId::Tycho(..) | SourceId::Own(_) => false,
    };
    FASTEST.iter().find(is_it).map(|star| star.km_s)
}

/// Returns the share of its distance by which a star recedes in a year, in units of a milliarcsecond, as proper motions
/// are; zero when its radial velocity or its parallax is not known. `speed_mas_yr`: its proper motion.
#[allow(clippy::cast_possible_truncation, reason = "an f32 holds it to 1e-7 of itself")]
pub fn radial_mas_yr(id: Option<SourceId>, speed_mas_yr: f32, parallax_mas: Option<f32>) -> f32 {
    let (Some(id), Some(parallax_mas)) = (id, parallax_mas) else { return 0.0 };
    if f64::from(speed_mas_yr) < LEAST_MAS_YR {
        return 0.0;
    }
    radial_velocity_km_s(id).map_or(0.0, |km_s| (km_s * f64::from(parallax_mas) / KM_S_PER_AU_YR) as f32)
}

#[cfg(test)]
mod tests {
    use super::*;
    use base::source_id::GaiaRelease;

    #[test]
    fn stars_are_found_by_either_name_and_no_other() {
        let gaia = SourceId::Gaia(GaiaRelease::Dr3, 4_472_832_130_942_575_872);
        assert_eq!(radial_velocity_km_s(gaia), Some(-110.5));
        assert_eq!(radial_velocity_km_s(SourceId::Hipparcos(87_937)), Some(-110.5));
        assert_eq!(radial_velocity_km_s(SourceId::Own(87_937)), None, "a user's own number is not of Hipparcos");
        // 110.5 km/s is 23.31 au a year; a distance of 1.826 pc is 376,600 au: 6.19e-5, or 12.77 arcsec.
        assert!((radial_mas_yr(Some(gaia), 10_377.0, Some(547.45)) + 12_761.0).abs() < 2.0);
        for (id, speed, parallax) in
            [(None, 1e4, Some(547.0)), (Some(gaia), 999.0, Some(547.0)), (Some(gaia), 1e4, None)]
        {
            assert_eq!(radial_mas_yr(id, speed, parallax), 0.0);
        }
    }
}
