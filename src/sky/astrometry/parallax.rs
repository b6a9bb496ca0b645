//! Barycentric direction -> direction from the observer's position.
//!
//! u' = normalise(u - parallax r), r the observer's barycentric position in au, parallax in rad (Urban and Seidelmann,
//! Explanatory Supplement, 3rd ed., sec. 7.2.3.1; exact for the distance 1 au / parallax up to the third order of the
//! parallax, 1e-17 rad). A source of unknown parallax is taken as infinitely far, parallax zero: wrong by its true
//! parallax, which for a blank in the built-in catalog is typically below 10 mas. Test: `a_year_draws_the_parallax`.

use base::units::{AU_KM, MAS};
use glam::DVec3;

/// Returns the direction of a source from the barycentric position `observer_km`; unit vector. `direction_icrf` has the
/// length of its distance in units of that at which it has `parallax_mas`.
pub fn parallax_shifted(direction_icrf: DVec3, parallax_mas: f32, observer_km: DVec3) -> DVec3 {
    (direction_icrf - observer_km * (f64::from(parallax_mas) * MAS / AU_KM)).normalize()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_year_draws_the_parallax() {
        let star = DVec3::Z;
        let shift = parallax_shifted(star, 750.0, DVec3::X * AU_KM) - star;
        assert!((shift.x / MAS + 750.0).abs() < 1e-6, "towards -x by one parallax for 1 au towards +x: {shift}");
        assert_eq!(parallax_shifted(star, 0.0, DVec3::X * AU_KM), star);
        assert_eq!(parallax_shifted(star, 750.0, DVec3::ZERO), star);
    }
}
