//! How much of the display's visible part lies among the dots that the map was fitted to.
//!
//! Places in even steps over the display that the map sends into the tracker's image are the part that the tracker
//! sees; those of them within the outermost dots are covered. Too low a share is refused: beyond its dots a polynomial
//! takes any value. Limit: the visible part is computed from the map itself, which is a guess beyond the dots and wrong
//! far away from them. Tests below.

use crate::display::geometry::DisplayGeometry;
use base::refused::Refused;
use sky::astrometry::CameraGeometry;

/// Least share of what the tracker sees of the display that must lie within the outermost dots. A grid that fills a
/// field misses up to one spacing on each side: with 6 x 6 dots in view half of it is left.
pub const LEAST_COVERAGE: f64 = 0.5;
/// Places along each side of the display.
const PLACES: usize = 48;

/// Returns the share of what `tracker` sees of the display that lies within the outermost dots; 0 when it sees nothing.
pub fn coverage(geometry: &DisplayGeometry, tracker: &CameraGeometry) -> f64 {
    let camera = geometry.camera();
    let along = |i: usize, side: usize| (i as f64 + 0.5) * side as f64 / PLACES as f64 - 0.5;
    let place = |i: usize, j: usize| [along(i, camera.width_px()), along(j, camera.height_px())];
    let [right, bottom] = [tracker.width_px(), tracker.height_px()].map(|side| side as f64 - 0.5);
    let is_seen = |px: &[f64; 2]| {
        let seen = geometry.unproject(*px).and_then(|v_sensor| tracker.project(v_sensor));
        seen.is_some_and(|[x, y]| x >= -0.5 && y >= -0.5 && x <= right && y <= bottom)
    };
    let all = (0..PLACES).flat_map(|i| (0..PLACES).map(move |j| place(i, j)));
    let [seen, covered] = all
        .filter(is_seen)
        .fold([0_u32; 2], |[seen, covered], px| [seen + 1, covered + u32::from(geometry.covered().contains(px))]);
    f64::from(covered) / f64::from(seen.max(1))
}

/// Returns the coverage, when it will do.
///
/// # Errors
/// When it is below [`LEAST_COVERAGE`].
pub(super) fn enough(geometry: &DisplayGeometry, tracker: &CameraGeometry) -> Result<f64, Refused> {
    let got = coverage(geometry, tracker);
    if got >= LEAST_COVERAGE {
        Ok(got)
    } else {
        Err(Refused(format!(
            "the dots fitted to enclose {:.0} % of what the tracker sees of the display: wanted at least {:.0} %, as the map is a guess beyond them; measure the dots of the other parts too, or plan more of them with a smaller margin",
            100.0 * got,
            100.0 * LEAST_COVERAGE
        )))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::display::geometry::GeometryParameters;
    use sky::astrometry::CameraParameters;

    const SIZE_PX: [usize; 2] = [960, 480];

    fn tracker(side_px: usize) -> CameraGeometry {
        let middle = 0.5 * (side_px as f64 - 1.0);
        CameraGeometry::new(CameraParameters {
            width_px: side_px,
            height_px: side_px,
            focal_px: [1000.0; 2],
            principal_point_px: [middle; 2],
            distortion: Default::default(),
        })
        .unwrap()
    }

    /// Returns a geometry with display pixels as large as the tracker's, about the same middle.
    fn geometry([left, right, top, bottom]: [f64; 4]) -> DisplayGeometry {
        let parameters = GeometryParameters {
            mirrored: false,
            drawn_from_sensor: [1.0, 0.0, 0.0, 0.0],
            focal_px: [1000.0; 2],
            principal_point_px: SIZE_PX.map(|side| 0.5 * (side as f64 - 1.0)),
            degree: 1,
            terms: Vec::new(),
            covered_px: vec![[left, top], [right, top], [right, bottom], [left, bottom]],
        };
        DisplayGeometry::new(&parameters, SIZE_PX).unwrap()
    }

    #[test]
    fn the_share_is_that_of_the_display_or_of_the_field() {
        let whole = geometry([20.0, 939.0, 20.0, 459.0]);
        let share = coverage(&whole, &tracker(2000));
        assert!((share - 920.0 * 440.0 / (960.0 * 480.0)).abs() < 0.05, "a field larger than the display: {share}");
        let quarter = geometry([20.0, 480.0, 20.0, 240.0]);
        let share = coverage(&quarter, &tracker(2000));
        assert!((share - 0.22).abs() < 0.02, "one corner: {share}");
        // A field of 480 px sees columns 240 to 720 of the display.
        let in_field = geometry([260.0, 700.0, 20.0, 459.0]);
        let [large, small] = [2000, 480].map(|side| coverage(&in_field, &tracker(side)));
        assert!((small - (440.0_f64 / 480.0).powi(2)).abs() < 0.06, "a field within the display: {small}");
        assert!(large < 0.5, "{large}");
        let beyond = coverage(&geometry([20.0, 200.0, 20.0, 459.0]), &tracker(480));
        assert_eq!(beyond, 0.0, "dots where the tracker does not see");
    }

    #[test]
    fn both_sides_of_enough() {
        let of = |right: f64| enough(&geometry([-1.0, right, -1.0, 480.0]), &tracker(2000));
        assert!(of(485.0).is_ok());
        let reported = of(465.0).unwrap_err().to_string();
        assert!(reported.contains("enclose 48 %"), "{reported}");
        assert!(reported.contains("at least 50 %"), "{reported}");
    }
}
