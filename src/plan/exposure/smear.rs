//! Probes -> the motion of each star of the field during the exposure: length of its path, and direction from start to
//! end.
//!
//! Both are exact at the nine probes and quadratic between them; of the length, its square: for a constant rate that is
//! a polynomial of the place, and a roll about a star leaves it a length of zero. A path is the polyline through the
//! dense nodes of its probe, its two ends and its corners (samples of jitter). Limits: 24 nodes per period of the
//! fastest jitter line, fewer where [`dense::MOST_DENSE_NODES`](crate::exposure::line::MOST_DENSE_NODES) are too few
//! (8 per period leave out 3 % of the length); under a rolling shutter the exposure is that of the row where the star
//! is. Tests: below, by brute force.

use crate::exposure::probes::{Probe, Probes, SIDE};
use crate::exposure::{mean_field::Correction, motion::Motion, pose::PixelPath};

/// Times closer than this share of the exposure are treated as equal.
const SAME_TIME: f64 = 1e-9;

/// Motion of the whole field during one exposure.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SmearField {
    /// Square of the path's length, px^2 (second number unused).
    squared: Correction,
    /// Displacement from the start of the exposure to its end, px.
    net: Correction,
}

impl SmearField {
    /// Returns the field of an image that does not move.
    pub fn still() -> Self {
        Self { squared: Correction::none(), net: Correction::none() }
    }

    /// Computes the field from measured probes.
    pub fn measured(motion: &Motion, probes: &Probes) -> Self {
        if motion.is_still() {
            return Self::still();
        }
        let camera = &probes.camera;
        let size_px = [camera.width_px(), camera.height_px()].map(|side| (side as f64 - 1.0).max(1.0));
        let (mut squared, mut net) = ([[0.0; 2]; SIDE * SIDE], [[0.0; 2]; SIDE * SIDE]);
        for (i, probe) in probes.probes.iter().enumerate().take(SIDE * SIDE) {
            let delay_s = probes.delay_s(i / SIDE);
            let at = |tau: f64| {
                let [x, y] = probe.track.exact_px(camera, &motion.pose_at(tau, delay_s));
                [x - probe.mean_px[0], y - probe.mean_px[1]]
            };
            let [begin, end] = [at(-0.5), at(0.5)];
            let (ends_s, longer) = probes.path_ends(i / SIDE);
            let corner = |corner| corner_tau(motion, ends_s, corner, delay_s);
            let length_px = longer * path_px(probe, [begin, end], corner, at);
            squared[i] = [length_px * length_px, 0.0];
            net[i] = [end[0] - begin[0], end[1] - begin[1]];
        }
        Self { squared: Correction::through(size_px, squared), net: Correction::through(size_px, net) }
    }

    /// Returns the length of the path of a star that is at `px` at mid-exposure, px.
    #[inline]
    pub fn length_px(&self, px: [f64; 2]) -> f64 {
        self.squared.at(px)[0].max(0.0).sqrt()
    }

    /// Returns the direction from such a star's place at the start to its place at the end, from x towards y, rad; 0
    /// for a star that comes back.
    pub fn angle_rad(&self, px: [f64; 2]) -> f64 {
        let [x, y] = self.net.at(px);
        y.atan2(x)
    }
}

/// Returns the length of a probe's path, px: its dense nodes in order of time and the corners between them. `corner`
/// returns the times of the corners one after another, as shares of the exposure from its middle; `at` the place at a
/// time.
fn path_px(
    probe: &Probe,
    [begin, end]: [[f64; 2]; 2],
    corner: impl Fn(usize) -> Option<f64>,
    at: impl Fn(f64) -> [f64; 2],
) -> f64 {
    let (mut length_px, mut from) = (0.0, begin);
    let mut go = |to: [f64; 2]| {
        length_px += (to[0] - from[0]).hypot(to[1] - from[1]);
        from = to;
    };
    // Corners are at the ends of the nodes' stretches.
    let (mut passed, mut next) = (-0.5, 0);
    for [weight, x, y] in &probe.trace {
        while let Some(tau) = corner(next).filter(|tau| *tau <= passed + SAME_TIME) {
            next += 1;
            if tau > -0.5 {
                go(at(tau));
            }
        }
        go([*x, *y]);
        passed += weight;
    }
    go(end);
    length_px
}

/// Returns the time of the path's corner number `corner` in an exposure that is `delay_s` late: share of the exposure
/// from its middle. Those of a commanded path in time are the ends of its stretches.
fn corner_tau(motion: &Motion, ends_s: &[f64], corner: usize, delay_s: f64) -> Option<f64> {
    let exposure_s = motion.los.exposure_s;
    let after_mid_s = match &motion.image_path {
        None => (motion.los.jitter.points.get(corner)?.at - motion.los.mid_exposure()).s(),
        Some(PixelPath::Line(_)) => ends_s.get(corner)? - 0.5 * exposure_s,
        Some(PixelPath::Samples(_)) => return None,
    };
    Some((after_mid_s - delay_s) / exposure_s)
}

/// Returns the length of a polyline, px.
pub fn polyline_px(mut points: impl Iterator<Item = [f64; 2]>) -> f64 {
    let Some(mut from) = points.next() else { return 0.0 };
    points.fold(0.0, |length, to| {
        let step = (to[0] - from[0]).hypot(to[1] - from[1]);
        from = to;
        length + step
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::attitude::{JitterLine, JitterPoint, LosPath};
    use crate::exposure::motion::Shutter;
    use crate::exposure::track::{StarPlace, StarTrack, turned};
    use base::axes::Rotation;
    use base::time::{Span, Tai};
    use base::units::{ARCSEC, DEG};
    use glam::{DQuat, DVec3};
    use sky::astrometry::{BrownConrady, CameraGeometry, CameraParameters};

    const SIGMA_PX: f64 = 0.8;
    /// Places of stars as shares of the detector's sides.
    const PLACES: [[f64; 2]; 6] = [[0.02, 0.03], [0.5, 0.5], [0.31, 0.77], [0.93, 0.12], [0.66, 0.4], [0.99, 0.98]];
    /// Number of steps of the brute-force path.
    const STEPS: u32 = 20_000;

    fn camera(distortion: BrownConrady) -> CameraGeometry {
        let parameters = CameraParameters {
            width_px: 1024,
            height_px: 1024,
            focal_px: [2900.0; 2],
            principal_point_px: [511.5, 511.5],
            distortion,
        };
        CameraGeometry::new(parameters).unwrap()
    }

    fn los(rate_deg_s: [f64; 3], exposure_s: f64) -> LosPath {
        let mut los = LosPath::commanded(Rotation::IDENTITY, Tai::from_ns(1_000_000_000), exposure_s);
        los.rate_rad_s = DVec3::from_array(rate_deg_s) * DEG;
        los
    }

    /// Returns the length and the angle of the path of a star: its direction is turned and projected at many instants.
    fn brute_force(camera: &CameraGeometry, los: &LosPath, mid_px: [f64; 2]) -> (f64, f64) {
        let mid = camera.unproject(mid_px).unwrap();
        let at = |step: u32| {
            let t_s = (f64::from(step) / f64::from(STEPS) - 0.5) * los.exposure_s;
            let smooth = turned(mid, los.smooth_rotation_rad(t_s));
            camera.project(DQuat::from_scaled_axis(-los.jitter_rotation_rad(t_s)) * smooth).unwrap()
        };
        let ([ax, ay], [bx, by]) = (at(0), at(STEPS));
        (polyline_px((0..=STEPS).map(at)), (by - ay).atan2(bx - ax))
    }

    /// Returns the largest error of the length, share of the longest in the field, and largest error of the direction,
    /// rad.
    fn errors(camera: &CameraGeometry, los: &LosPath) -> [f64; 2] {
        let motion = Motion { los: los.clone(), image_path: None };
        let mut probes = Probes::new(camera, Shutter::Global);
        probes.measure(&motion, SIGMA_PX);
        let field = SmearField::measured(&motion, &probes);
        let places = PLACES.map(|place| place.map(|share| share * 1023.0));
        let wanted = places.map(|px| brute_force(camera, los, px));
        let longest_px = wanted.iter().fold(0.0, |longest: f64, (length_px, _)| longest.max(*length_px));
        let mut worst = [0.0_f64; 2];
        for (px, (length_px, angle_rad)) in places.into_iter().zip(wanted) {
            assert!(length_px > 1.0, "control: it moves by {length_px} px");
            worst[0] = worst[0].max((field.length_px(px) - length_px).abs() / longest_px);
            let turn = (field.angle_rad(px) - angle_rad + core::f64::consts::PI).rem_euclid(core::f64::consts::TAU);
            worst[1] = worst[1].max((turn - core::f64::consts::PI).abs());
        }
        worst
    }

    #[test]
    fn slews_have_the_length_and_direction_of_their_path() {
        let lens = BrownConrady { k1: -0.08, k2: 0.02, k3: 0.0, p1: 1e-3, p2: -5e-4 };
        for distortion in [BrownConrady::default(), lens] {
            let camera = camera(distortion);
            for (rate_deg_s, exposure_s) in [([0.0, 5.0, 0.0], 0.1), ([3.0, -4.0, 0.0], 0.2), ([0.3, 0.2, 20.0], 0.1)] {
                let mut los = los(rate_deg_s, exposure_s);
                let [length, angle] = errors(&camera, &los);
                assert!(length < 3e-3 && angle < 3e-3, "{rate_deg_s:?}: {length:.1e}, {angle:.1e} rad");
                los.acceleration_rad_s2 = DVec3::new(2.0, -1.0, 3.0) * DEG;
                let [length, _] = errors(&camera, &los);
                assert!(length < 3e-3, "accelerated, {rate_deg_s:?}: {length:.1e}");
            }
        }
    }

    #[test]
    fn jitter_adds_the_length_of_its_path() {
        let camera = camera(BrownConrady::default());
        let mut los = los([0.0, 0.2, 0.0], 0.2);
        let slew_alone = los.clone();
        let line = |frequency_hz, x, y, phase_rad| JitterLine {
            frequency_hz,
            amplitude_rad: DVec3::new(x, y, 0.0) * ARCSEC,
            phase_rad,
        };
        los.jitter.lines = vec![line(37.0, 60.0, 10.0, 0.3), line(120.0, -15.0, 40.0, 1.0)];
        let [length, _] = errors(&camera, &los);
        assert!(length < 0.01, "lines: {length:.1e}");
        let mid_px = [511.5; 2];
        let (with, without) = (brute_force(&camera, &los, mid_px).0, brute_force(&camera, &slew_alone, mid_px).0);
        assert!(with > 2.0 * without, "control: jitter is most of it: {with} px, {without} px");
        los.jitter.lines.clear();
        let start = los.exposure_start;
        los.jitter.points = (0..41_u32)
            .map(|i| JitterPoint {
                at: start + Span::from_ms(5 * i64::from(i)),
                rotation_rad: DVec3::new(f64::from(i * 7919 % 83) - 41.0, f64::from(i * 104_729 % 79) - 39.0, 0.0)
                    * ARCSEC,
            })
            .collect();
        let [length, _] = errors(&camera, &los);
        assert!(length < 0.01, "samples: {length:.1e}");
    }

    #[test]
    fn a_roll_leaves_the_middle_where_it_is() {
        let camera = camera(BrownConrady::default());
        let motion = Motion { los: los([0.0, 0.0, 10.0], 0.5), image_path: None };
        let mut probes = Probes::new(&camera, Shutter::Global);
        probes.measure(&motion, SIGMA_PX);
        let field = SmearField::measured(&motion, &probes);
        assert!(field.length_px([511.5; 2]) < 1e-3, "{}", field.length_px([511.5; 2]));
        let radius_px = 300.0;
        let wanted = radius_px * 5.0 * DEG;
        let got = field.length_px([511.5 + radius_px, 511.5]);
        assert!((got / wanted - 1.0).abs() < 1e-3, "{got} px, wanted {wanted}");
        let still = Motion { los: los([0.0; 3], 0.5), image_path: None };
        assert_eq!(SmearField::measured(&still, &probes), SmearField::still());
        let track = StarTrack::new(&camera, StarPlace::of_pixel(&camera, [10.0, 10.0]).unwrap());
        assert_eq!(SmearField::still().length_px(track.place.mid_px), 0.0);
    }
}
