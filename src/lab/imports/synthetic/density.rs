//! Direction and G magnitude -> stars per square degree.
//!
//! Source: counts in Gaia DR3 (G < 10 and all sources by region, G < 15 and G < 18 interpolated between them), stars
//! per square degree brighter than 10, 15, 18 and 20.7 mag:
//!
//! | region | G < 10 | G < 15 | G < 18 | all |
//! |---|---|---|---|---|
//! | abs(b) > 60 deg | 5.2 | 194 | 1,006 | 3,366 |
//! | 40..60 | 6.5 | 286 | 1,580 | 5,556 |
//! | 20..40 | 10 | 584 | 3,755 | 15,015 |
//! | abs(b) < 5, abs(l) > 90 | 22 | 1,901 | 14,300 | 63,600 |
//! | abs(b) < 5, abs(l) 30..90 | 28 | 3,336 | 36,500 | 262,000 |
//! | abs(b) < 5, abs(l) < 30 | 23 | 3,604 | 48,000 | 432,000 |
//! | whole sky | 11.7 | 908 | 7,340 | 43,917 |
//!
//! Between regions the logarithm of the density is linear in latitude and longitude, through values at the regions'
//! middles ([`LOG10_AT_NODES`]) that were fitted to give the table's means; 5..20 deg of latitude, which the table
//! lacks, are what the mean of the whole sky leaves. Over longitude it varies at 11 deg half as much as in the plane,
//! and not at all from 29.5 deg on. North and south, and both sides of the centre, are alike: the real sky is not.
//!
//! In magnitude it is a monotone cubic (Fritsch and Carlson 1980) through the four counts. **Extrapolated**, as
//! straight lines: brighter than G = 10 with a factor of 10^0.45 a magnitude (the default catalog: 106,462 stars to 8.5
//! and 9,000 to 6.5), and fainter than 20.7 with the slope there, to [`FAINTEST_MAG`]. Tests: `tests`.

use base::units::DEG;
use glam::DVec3;
use stars::galactic::galactic_rad;

/// Faintest magnitude of a population: 1.3 mag beyond what was measured.
pub const FAINTEST_MAG: f64 = 22.0;
/// No star of a population is brighter.
pub(super) const BRIGHTEST_MAG: f64 = 0.0;
/// Magnitudes below which stars were counted; "all" is where Gaia's counts turn over.
const MAGNITUDES: [f64; 4] = [10.0, 15.0, 18.0, 20.7];
/// Slope of log10 of the counts brighter than the first of them, per magnitude.
const BRIGHT_SLOPE: f64 = 0.45;
/// Middles of the regions of latitude, deg.
const LATITUDES_DEG: [f64; 5] = [2.5, 11.0, 29.5, 49.0, 69.0];
/// Middles of the regions of longitude, deg.
const LONGITUDES_DEG: [f64; 3] = [15.0, 60.0, 135.0];
/// Shares of a circle that the regions of longitude have.
const LONGITUDE_SHARES: [f64; 3] = [1.0 / 6.0, 1.0 / 3.0, 0.5];
/// How much of the plane's variation over longitude there is at the second latitude.
const VARIATION_ABOVE_PLANE: f64 = 0.5;
/// For each magnitude log10 of stars per square degree: in the plane at the three longitudes, then at the other
/// latitudes.
const LOG10_AT_NODES: [[f64; 7]; 4] = [
    [1.3588, 1.4999, 1.3229, 1.2535, 0.9830, 0.8026, 0.7039],
    [3.5758, 3.5720, 3.2315, 3.2253, 2.7186, 2.4417, 2.2660],
    [4.7194, 4.6181, 4.0715, 4.1047, 3.5153, 3.1780, 2.9775],
    [5.6867, 5.4700, 4.6554, 4.8909, 4.0682, 3.7263, 3.4985],
];

/// Numbers of stars in one direction, brighter than any magnitude.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Density {
    log10_counts: [f64; 4],
    slopes: [f64; 4],
}

impl Density {
    /// Returns the counts in a direction (unit vector, ICRF axes).
    pub fn towards(direction_icrf: DVec3) -> Self {
        let [longitude, latitude] = galactic_rad(direction_icrf).map(|rad| (rad / DEG).abs());
        let log10_counts = LOG10_AT_NODES.map(|nodes| at_place(&nodes, longitude, latitude));
        Self { log10_counts, slopes: slopes(&log10_counts) }
    }

    /// Returns stars per square degree brighter than `mag_g`.
    pub fn brighter_than(&self, mag_g: f64) -> f64 {
        10.0_f64.powf(self.log10_brighter_than(mag_g))
    }

    fn log10_brighter_than(&self, mag_g: f64) -> f64 {
        let (m, y, d) = (&MAGNITUDES, &self.log10_counts, &self.slopes);
        if mag_g <= m[0] {
            return y[0] + BRIGHT_SLOPE * (mag_g - m[0]);
        }
        let Some(upper) = m.iter().position(|knot| mag_g < *knot) else {
            return y[3] + d[3] * (mag_g - m[3]);
        };
        // Cubic Hermite basis.
        let (i, step) = (upper - 1, m[upper] - m[upper - 1]);
        let t = (mag_g - m[i]) / step;
        let rise = t * t * (3.0 - 2.0 * t);
        y[i] + (y[upper] - y[i]) * rise + step * t * (1.0 - t) * (d[i] * (1.0 - t) - d[upper] * t)
    }
}

/// Interpolates one magnitude's nodes at a place, by absolute longitude and latitude.
fn at_place(nodes: &[f64; 7], longitude_deg: f64, latitude_deg: f64) -> f64 {
    let in_plane = [nodes[0], nodes[1], nodes[2]];
    let mean: f64 = in_plane.iter().zip(LONGITUDE_SHARES).map(|(node, share)| node * share).sum();
    let plane = linear(&LONGITUDES_DEG, &in_plane, longitude_deg);
    let above = nodes[3] + VARIATION_ABOVE_PLANE * (plane - mean);
    linear(&LATITUDES_DEG, &[plane, above, nodes[4], nodes[5], nodes[6]], latitude_deg)
}

/// Interpolates linearly between nodes, constant beyond them.
fn linear<const N: usize>(places: &[f64; N], values: &[f64; N], at: f64) -> f64 {
    let at = at.clamp(places[0], places[N - 1]);
    let upper = places.iter().position(|place| at < *place).unwrap_or(N - 1).max(1);
    let share = (at - places[upper - 1]) / (places[upper] - places[upper - 1]);
    values[upper - 1] + share * (values[upper] - values[upper - 1])
}

/// Slopes of a monotone cubic: weighted harmonic means of the secants on both sides; at the faint end the last secant
/// continued as it bends, no steeper than it and not falling.
fn slopes(y: &[f64; 4]) -> [f64; 4] {
    let step = |i: usize| MAGNITUDES[i + 1] - MAGNITUDES[i];
    let secant = |i: usize| (y[i + 1] - y[i]) / step(i);
    let between = |before: f64, step_before: f64, after: f64, step_after: f64| {
        let weights = [2.0 * step_after + step_before, step_after + 2.0 * step_before];
        (weights[0] + weights[1]) / (weights[0] / before + weights[1] / after)
    };
    let [h, s] = [[0, 1, 2].map(step), [0, 1, 2].map(secant)];
    let end = ((2.0 * h[2] + h[1]) * s[2] - h[2] * s[1]) / (h[1] + h[2]);
    [
        between(BRIGHT_SLOPE, h[0], s[0], h[0]),
        between(s[0], h[0], s[1], h[1]),
        between(s[1], h[1], s[2], h[2]),
        end.clamp(0.0, s[2]),
    ]
}

#[cfg(test)]
mod tests {
    use super::*;
    use stars::galactic::direction_of_galactic;

    /// Means as they were measured: latitudes, longitudes, stars per square degree.
    const MEASURED: [([f64; 2], [f64; 2], [f64; 4]); 7] = [
        ([60.0, 90.0], [0.0, 180.0], [5.2, 194.0, 1006.0, 3366.0]),
        ([40.0, 60.0], [0.0, 180.0], [6.5, 286.0, 1580.0, 5556.0]),
        ([20.0, 40.0], [0.0, 180.0], [10.0, 584.0, 3755.0, 15_015.0]),
        ([0.0, 5.0], [90.0, 180.0], [22.0, 1901.0, 14_300.0, 63_600.0]),
        ([0.0, 5.0], [30.0, 90.0], [28.0, 3336.0, 36_500.0, 262_000.0]),
        ([0.0, 5.0], [0.0, 30.0], [23.0, 3604.0, 48_000.0, 432_000.0]),
        ([0.0, 90.0], [0.0, 180.0], [11.7, 908.0, 7340.0, 43_917.0]),
    ];

    /// Returns the mean over a region, by steps of equal size in longitude and latitude weighted with their area.
    fn mean(latitudes: [f64; 2], longitudes: [f64; 2], mag_g: f64) -> f64 {
        let (steps, mut sums) = (60, [0.0; 2]);
        let middle = |range: [f64; 2], i: usize| range[0] + (range[1] - range[0]) * (i as f64 + 0.5) / f64::from(steps);
        for i in 0..60 {
            let b = middle(latitudes, i) * DEG;
            for j in 0..60 {
                let density = Density::towards(direction_of_galactic(middle(longitudes, j) * DEG, b));
                sums[0] += density.brighter_than(mag_g) * b.cos();
                sums[1] += b.cos();
            }
        }
        sums[0] / sums[1]
    }

    /// Nodes of four decimals, and steps of the mean.
    const MEAN_SHARE: f64 = 0.004;

    #[test]
    fn means_of_regions_are_the_measured_ones() {
        for (latitudes, longitudes, counts) in MEASURED {
            for (mag_g, wanted) in MAGNITUDES.into_iter().zip(counts) {
                let got = mean(latitudes, longitudes, mag_g);
                assert!((got / wanted - 1.0).abs() < MEAN_SHARE, "{latitudes:?} {longitudes:?} {mag_g}: {got}");
            }
        }
        let other = mean([40.0, 60.0], [0.0, 180.0], 15.0) / mean([20.0, 40.0], [0.0, 180.0], 15.0);
        assert!((other - 1.0).abs() > 0.3, "control: regions differ");
    }

    #[test]
    fn counts_rise_with_magnitude_everywhere_and_bend_softly() {
        for i in 0..500_i32 {
            let b = f64::from(i % 50) * 1.8 * DEG;
            let density = Density::towards(direction_of_galactic(f64::from(i) * 0.72 * DEG, b));
            let slope = |mag: f64| (density.log10_brighter_than(mag + 1e-4) - density.log10_brighter_than(mag)) / 1e-4;
            let mut before = slope(BRIGHTEST_MAG);
            for step in 1..2200 {
                let now = slope(f64::from(step) * 0.01);
                assert!(now > 0.02 && now < 0.75, "{i} {step}: {now}");
                assert!((now - before).abs() < 0.12, "{i} {step}: {before} {now}");
                before = now;
            }
        }
    }

    #[test]
    fn both_ends_are_straight() {
        let density = Density::towards(DVec3::Z);
        for (from, to, slope) in [(8.0, 9.999, BRIGHT_SLOPE), (20.7, FAINTEST_MAG, density.slopes[3])] {
            let rise = density.log10_brighter_than(to) - density.log10_brighter_than(from);
            assert!((rise - slope * (to - from)).abs() < 1e-9, "{from}");
        }
        let inside = density.log10_brighter_than(20.699) - density.log10_brighter_than(18.5);
        assert!((inside - density.slopes[3] * 2.199).abs() > 1e-3, "control: bent between counts");
    }

    #[test]
    fn there_is_no_step_between_regions() {
        for mag_g in MAGNITUDES {
            for i in 0..18_000_i32 {
                let at = |i: i32| {
                    let angle = f64::from(i) * 0.01 * DEG;
                    let along = Density::towards(direction_of_galactic(angle, 0.05)).brighter_than(mag_g);
                    [along, Density::towards(direction_of_galactic(0.3, angle / 2.0)).brighter_than(mag_g)]
                };
                let [before, after] = [at(i), at(i + 1)];
                assert!(before.iter().zip(after).all(|(a, b)| (b / a - 1.0).abs() < 0.004), "{mag_g} {i}");
            }
        }
    }
}
