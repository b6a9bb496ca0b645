//! Attitude, observer and camera of a frame -> its [`Wcs`]: image pixels to catalog places.
//!
//! Pixel, distorted -> tangents in sensor axes -> apparent direction -> direction without aberration and deflection:
//! this chain is the inverse of the drawing. The lens is fitted once per camera (`lens`); per frame, least squares over
//! a grid of the image find the linear part (rotation, scale) and the quadratic part of the remaining error, caused by
//! aberration (0.009 px over 20 degrees at 1024 px; left out where it is small and the lens needs no polynomials). The
//! reference point is the principal point: there the plane of the camera is that of the projection. Every frame's error
//! is measured on the grid ([`Wcs::error_px`]).
//!
//! Time: mid-exposure, without jitter. Limits: motion within the exposure moves a star's mean away from that; within a
//! degree of the Sun, deflection is not quadratic, and beyond fields of 60 degrees neither is aberration. Allocates
//! nothing after [`WcsMaker::new`]. Tests: below, and with astropy `hil_scripts/tests/test_wcs.py`.

mod lens;

use base::axes::{Icrf, Rotation, Sensor};
use base::{least_squares::Basis, source::ra_dec_rad};
use frames::sink::Wcs;
use glam::{DVec2, DVec3};
use image::detector::window::OutputGeometry;
use lens::{ImagePlane, Lens, Matrix, Pair, inverse, product, times};
use sky::astrometry::{CameraGeometry, Sight};

/// Number of places along each side of the image at which a frame's map is evaluated, edges included.
const SIDE: usize = 9;
/// Error below which an undistorted camera's frames have no polynomials, px: three quarters of the guaranteed limit. A
/// field of 20 degrees at 1024 px has 0.012 at most.
const PLAIN_PX: f64 = 0.015;
/// Error above which the user is warned, px.
pub const PROMISED_PX: f64 = 0.02;

/// Columns of the fit of a frame: x, y, x^2, x y, y^2 of tangents.
const COLUMNS: usize = 5;

/// One place of the grid.
#[derive(Debug, Clone, Copy)]
struct Place {
    /// Position from the principal point, image px.
    u: Pair,
    /// Direction in sensor axes.
    sensor: DVec3,
    /// Undistorted place by the lens's polynomials, as tangents.
    fitted: Pair,
    /// Image px by tangents.
    px_per_tangent: Matrix,
    /// Weight of its value in each coefficient, with quadratic terms and without.
    shares: [f64; COLUMNS],
    linear_shares: Pair,
}

/// Computes the WCS of one camera's frames.
#[derive(Debug)]
pub struct WcsMaker {
    lens: Lens,
    crpix: Pair,
    /// Tangents by undistorted image px.
    tangent_per_px: Matrix,
    places: Vec<Place>,
    /// Plane coordinates of the grid in the latest frame, rad.
    seen: Vec<Pair>,
}

impl WcsMaker {
    /// Fits the lens; returns `None` when a place is not imaged, or no polynomial is close enough.
    pub fn new(camera: &CameraGeometry, output: &OutputGeometry) -> Option<Self> {
        let plane = ImagePlane { camera, output };
        let lens = Lens::fitted(&plane)?;
        let [fx, fy] = plane.focal_px();
        let tangent_per_px = [[1.0 / fx, 0.0], [0.0, 1.0 / fy]];
        let grid = plane.grid(SIDE, |k| k as f64 / (SIDE - 1) as f64);
        let tangents: Vec<Pair> = grid.iter().map(|u| plane.tangent(*u)).collect::<Option<_>>()?;
        let column = |term: fn(Pair) -> f64| tangents.iter().map(|t| term(*t)).collect::<Vec<f64>>();
        let linear = [column(|[x, _]| x), column(|[_, y]| y)];
        let quadratic = [column(|[x, _]| x * x), column(|[x, y]| x * y), column(|[_, y]| y * y)];
        let alone = Basis::of(linear.to_vec())?;
        let all = Basis::of(linear.into_iter().chain(quadratic).collect())?;
        let place = |k: usize| {
            let mut one = vec![0.0; grid.len()];
            one[k] = 1.0;
            let (shares, linear_shares) = (all.solve(&one), alone.solve(&one));
            let tangent = DVec2::from_array(tangents[k]);
            let binning = f64::from(output.binning);
            Place {
                u: grid[k],
                sensor: tangent.extend(1.0).normalize(),
                fitted: times(&tangent_per_px, lens.ideal_px(grid[k])),
                px_per_tangent: camera.px_per_tangent(tangent).map(|row| row.map(|v| v / binning)),
                shares: core::array::from_fn(|i| shares[i]),
                linear_shares: core::array::from_fn(|i| linear_shares[i]),
            }
        };
        let places: Vec<Place> = (0..grid.len()).map(place).collect();
        let crpix = plane.principal_px().map(|px| px + 1.0);
        let seen = vec![[0.0; 2]; places.len()];
        Some(Self { lens, crpix, tangent_per_px, places, seen })
    }

    /// Returns the largest error of the lens's polynomials over the image, px.
    pub fn lens_error_px(&self) -> f64 {
        let off = |place: &Place| {
            let wanted = place.sensor.truncate() / place.sensor.z;
            length(times(&place.px_per_tangent, [place.fitted[0] - wanted.x, place.fitted[1] - wanted.y]))
        };
        self.places.iter().map(off).fold(0.0, f64::max)
    }

    /// Returns the map of a frame with this attitude and observer; `None` for an attitude that is not finite.
    pub fn at(&mut self, sensor_from_icrf: &Rotation<Sensor, Icrf>, sight: &Sight) -> Option<Wcs> {
        let icrf_from_sensor = sensor_from_icrf.inverse();
        let natural = |sensor: DVec3| sight.natural(icrf_from_sensor.apply(sensor));
        let middle = natural(DVec3::Z);
        let [ra_rad, dec_rad] = ra_dec_rad(middle);
        let (sin, cos) = ra_rad.sin_cos();
        let east = DVec3::new(-sin, cos, 0.0);
        let north = middle.cross(east);
        let Self { places, seen, .. } = self;
        for (seen, place) in seen.iter_mut().zip(places.iter()) {
            let there = natural(place.sensor);
            let depth = there.dot(middle);
            *seen = [there.dot(east) / depth, there.dot(north) / depth];
        }
        let plain = self.plain();
        let fitted = if self.lens.sip.is_none() && self.error_px(&plain)? <= PLAIN_PX { plain } else { self.bent() };
        let error_px = self.error_px(&fitted)?;
        let plane_per_px = product(&fitted.linear, &self.tangent_per_px);
        let per_px = product(&plane_per_px, &self.lens.linear);
        Some(Wcs {
            crpix: self.crpix,
            crval_deg: [ra_rad.rem_euclid(core::f64::consts::TAU).to_degrees(), dec_rad.to_degrees()],
            cd_deg_px: per_px.map(|row| row.map(f64::to_degrees)),
            quadratic_px: self.quadratic_px(&fitted, &per_px)?,
            sip: self.lens.sip.clone(),
            error_px,
        })
    }

    /// Returns the linear part alone.
    fn plain(&self) -> Fitted {
        let mut linear = [[0.0; 2]; 2];
        for (place, seen) in self.places.iter().zip(&self.seen) {
            for axis in 0..2 {
                for (sum, share) in linear[axis].iter_mut().zip(place.linear_shares) {
                    *sum += share * seen[axis];
                }
            }
        }
        Fitted { linear, quadratic: [[0.0; 3]; 2] }
    }

    /// Returns the linear and quadratic parts.
    fn bent(&self) -> Fitted {
        let mut sums = [[0.0; COLUMNS]; 2];
        for (place, seen) in self.places.iter().zip(&self.seen) {
            for axis in 0..2 {
                for (sum, share) in sums[axis].iter_mut().zip(place.shares) {
                    *sum += share * seen[axis];
                }
            }
        }
        Fitted { linear: sums.map(|[x, y, ..]| [x, y]), quadratic: sums.map(|[_, _, xx, xy, yy]| [xx, xy, yy]) }
    }

    /// Returns the quadratic terms in image px, before the linear part: the terms that SIP adds to a pixel.
    fn quadratic_px(&self, fitted: &Fitted, per_px: &Matrix) -> Option<[[f64; 3]; 2]> {
        let [[a, b], [c, d]] = product(&self.tangent_per_px, &self.lens.linear);
        // x = a u + b v, y = c u + d v.
        let of_px = |[xx, xy, yy]: [f64; 3]| {
            [
                xx * a * a + xy * a * c + yy * c * c,
                2.0 * xx * a * b + xy * (a * d + b * c) + 2.0 * yy * c * d,
                xx * b * b + xy * b * d + yy * d * d,
            ]
        };
        let [x, y] = fitted.quadratic.map(of_px);
        let back = inverse(per_px)?;
        Some(back.map(|[p, q]| core::array::from_fn(|i| p * x[i] + q * y[i])))
    }

    /// Returns the largest error over the grid, px, of the map in the header.
    fn error_px(&self, fitted: &Fitted) -> Option<f64> {
        let back = inverse(&fitted.linear)?;
        let lens = product(&self.tangent_per_px, &self.lens.linear);
        let mut worst = 0.0_f64;
        for (place, seen) in self.places.iter().zip(&self.seen) {
            let [x, y] = times(&lens, place.u);
            let [east, north] = times(&fitted.linear, place.fitted);
            let bend = fitted.quadratic.map(|[xx, xy, yy]| xx * x * x + xy * x * y + yy * y * y);
            let off = times(&back, [east + bend[0] - seen[0], north + bend[1] - seen[1]]);
            worst = worst.max(length(times(&place.px_per_tangent, off)));
        }
        worst.is_finite().then_some(worst)
    }
}

/// Plane coordinates by tangents, rad.
#[derive(Debug, Clone, Copy)]
struct Fitted {
    linear: Matrix,
    quadratic: [[f64; 3]; 2],
}

fn length([x, y]: Pair) -> f64 {
    x.hypot(y)
}

#[cfg(test)]
mod tests {
    use super::*;
    use base::axes::sensor_from_ra_dec_roll;
    use base::units::{AU_KM, DEG};
    use image::detector::window::Window;
    use sky::astrometry::{BrownConrady, CameraParameters, Vantage};
    use sky::observer::BarycentricState;

    const STRONG: BrownConrady = BrownConrady { k1: -0.12, k2: 0.03, k3: 0.0, p1: 2e-3, p2: -1e-3 };
    /// Largest error with polynomials, px; the guaranteed limit is 0.02.
    const WCS_PX: f64 = 0.003;

    fn camera(distortion: BrownConrady, focal_px: f64) -> CameraGeometry {
        let parameters = CameraParameters {
            width_px: 1024,
            height_px: 768,
            focal_px: [focal_px, focal_px * 1.01],
            principal_point_px: [520.25, 371.0],
            distortion,
        };
        CameraGeometry::new(parameters).unwrap()
    }

    fn limit_px(wcs: &Wcs) -> f64 {
        if wcs.has_sip() { WCS_PX } else { PLAIN_PX }
    }

    /// Returns the observer seen from the Earth's orbit, with the Sun aside.
    fn sight() -> Sight {
        let observer = BarycentricState { position_km: DVec3::X * AU_KM, velocity_km_s: DVec3::new(3.0, 27.0, 11.7) };
        Vantage { observer, heliocentric_km: Some(observer.position_km) }.sight()
    }

    /// Returns where a reader of the header puts an image pixel (the first one's centre at 0): SIP, CD, gnomonic, all
    /// implemented independently from the papers.
    fn read(wcs: &Wcs, px: Pair) -> DVec3 {
        let (u, v) = (px[0] + 1.0 - wcs.crpix[0], px[1] + 1.0 - wcs.crpix[1]);
        let mut bent = [u, v];
        let [order, _] = wcs.orders();
        for i in 0..=order {
            for j in 0..=(order - i) {
                if i + j >= 2 {
                    let power = u.powi(i.into()) * v.powi(j.into());
                    let [a, b] = wcs.forward(i, j);
                    bent = [bent[0] + a * power, bent[1] + b * power];
                }
            }
        }
        let [xi, eta] = wcs.cd_deg_px.map(|[p, q]| (p * bent[0] + q * bent[1]) * DEG);
        let [ra, dec] = wcs.crval_deg.map(|deg| deg * DEG);
        let (sin_ra, cos_ra, sin_dec, cos_dec) = (ra.sin(), ra.cos(), dec.sin(), dec.cos());
        let middle = DVec3::new(cos_dec * cos_ra, cos_dec * sin_ra, sin_dec);
        let east = DVec3::new(-sin_ra, cos_ra, 0.0);
        let north = DVec3::new(-sin_dec * cos_ra, -sin_dec * sin_ra, cos_dec);
        (middle + east * xi + north * eta).normalize()
    }

    /// Returns the largest distance of a pixel from where the star of its catalog place is drawn, px.
    fn worst_px(camera: &CameraGeometry, output: &OutputGeometry, wcs: &Wcs, attitude: &Rotation<Sensor, Icrf>) -> f64 {
        let [width, height] = output.size_px.map(|side| side as f64 - 1.0);
        let mut worst = 0.0_f64;
        for k in 0..400_u32 {
            let share = |step: u32| f64::from(k * step % 401) / 401.0;
            let px = [share(37) * width, share(101) * height];
            let drawn = camera.project(attitude.apply(sight().apparent(read(wcs, px)))).unwrap();
            let [x, y] = output.output_from_sensor(drawn);
            worst = worst.max((x - px[0]).hypot(y - px[1]));
        }
        worst
    }

    #[test]
    fn pixels_are_where_stars_of_their_catalog_place_are_drawn() {
        let window = Window { left_px: 600, top_px: 40, width_px: 256, height_px: 128 };
        let outputs = [
            OutputGeometry::whole([1024, 768]),
            OutputGeometry::new([1024, 768], 2, None),
            OutputGeometry::new([1024, 768], 1, Some(window)),
            OutputGeometry::new([1024, 768], 4, Some(window)),
        ];
        for distortion in [BrownConrady::default(), STRONG] {
            for output in &outputs {
                let camera = camera(distortion, 2900.0);
                let mut maker = WcsMaker::new(&camera, output).unwrap();
                for [ra, dec, roll] in
                    [[84.0, -1.2, 33.0], [210.0, 89.99, 0.0], [0.0, -90.0, 120.0], [359.999, 45.0, 271.0]]
                {
                    let attitude = sensor_from_ra_dec_roll(ra * DEG, dec * DEG, roll * DEG);
                    let wcs = maker.at(&attitude, &sight()).unwrap();
                    let worst = worst_px(&camera, output, &wcs, &attitude);
                    let reported = wcs.error_px;
                    assert!(
                        worst < limit_px(&wcs) && reported < limit_px(&wcs),
                        "{output:?} {ra} {dec}: {worst:.1e} px, {reported:.1e}"
                    );
                    assert!(worst < 1.5 * reported + 5e-4, "the error is stated: {worst:.1e} px, {reported:.1e}");
                    assert_eq!(wcs.has_sip(), distortion == STRONG, "polynomials only where needed");
                }
            }
        }
    }

    #[test]
    fn without_its_terms_the_map_is_wrong() {
        let (camera, output) = (camera(STRONG, 2900.0), OutputGeometry::whole([1024, 768]));
        let attitude = sensor_from_ra_dec_roll(84.0 * DEG, -1.2 * DEG, 0.3);
        let wcs = WcsMaker::new(&camera, &output).unwrap().at(&attitude, &sight()).unwrap();
        let worst = |wcs: &Wcs| worst_px(&camera, &output, wcs, &attitude);
        let straight = Wcs { sip: None, ..wcs.clone() };
        assert!(worst(&straight) > 1.0, "no lens: {}", worst(&straight));
        let [ra, dec] = wcs.crval_deg;
        let shifted = Wcs { crval_deg: [ra + 20.0 / 3600.0, dec], ..wcs.clone() };
        assert!(worst(&shifted) > PROMISED_PX, "aberration left out: {}", worst(&shifted));
    }

    #[test]
    fn the_way_back_leads_to_the_pixel() {
        let (camera, output) = (camera(STRONG, 2900.0), OutputGeometry::whole([1024, 768]));
        let attitude = sensor_from_ra_dec_roll(84.0 * DEG, -1.2 * DEG, 0.3);
        let wcs = WcsMaker::new(&camera, &output).unwrap().at(&attitude, &sight()).unwrap();
        let polynomials = |[u, v]: Pair, order: u8, of: &dyn Fn(u8, u8) -> Pair, least: u8| {
            let mut sum = [u, v];
            for (i, j) in (0..=order).flat_map(|i| (0..=order - i).map(move |j| (i, j))).filter(|(i, j)| i + j >= least)
            {
                let power = u.powi(i.into()) * v.powi(j.into());
                sum = [sum[0] + of(i, j)[0] * power, sum[1] + of(i, j)[1] * power];
            }
            sum
        };
        let [forward, back] = wcs.orders();
        for u in [[-510.0, -360.0], [400.0, 20.0], [0.0, 0.0], [500.0, 390.0]] {
            let bent = polynomials(u, forward, &|i, j| wcs.forward(i, j), 2);
            let again = polynomials(bent, back, &|i, j| wcs.inverse(i, j), 1);
            assert!((again[0] - u[0]).hypot(again[1] - u[1]) < 0.01, "{u:?}: {again:?}");
        }
    }

    #[test]
    fn a_wide_field_of_a_straight_lens_gets_quadratic_terms() {
        let camera = camera(BrownConrady::default(), 1000.0);
        let output = OutputGeometry::whole([1024, 768]);
        let mut maker = WcsMaker::new(&camera, &output).unwrap();
        let attitude = sensor_from_ra_dec_roll(0.0, 0.0, 0.3);
        let wcs = maker.at(&attitude, &sight()).unwrap();
        assert!(wcs.has_sip() && wcs.error_px < PROMISED_PX, "{wcs:?}");
        assert!(worst_px(&camera, &output, &wcs, &attitude) < PROMISED_PX);
    }
}
