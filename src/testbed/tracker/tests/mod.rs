//! Whole frames drawn by `draw`, and each part by itself.

mod commanded;
mod draw;
mod lost;
mod parts;
mod series;
mod spots;
mod star_noise;

use super::{GuideStars, earth_beta};
use base::time::Tai;
use draw::Camera;
use glam::DVec3;
use stars::catalog::Catalog;
use std::sync::{Arc, OnceLock};

/// Returns the middle of every test exposure.
fn noon() -> Tai {
    Tai::from_rfc3339("2026-03-01T12:00:00Z").expect("a time")
}

fn catalog() -> &'static Catalog {
    static CATALOG: OnceLock<Catalog> = OnceLock::new();
    CATALOG.get_or_init(|| Catalog::built_in().expect("the built-in catalog"))
}

fn wide_guide() -> Arc<GuideStars> {
    static GUIDE: OnceLock<Arc<GuideStars>> = OnceLock::new();
    Arc::clone(GUIDE.get_or_init(|| guide_of(&Camera::wide())))
}

fn coarse_guide() -> Arc<GuideStars> {
    static GUIDE: OnceLock<Arc<GuideStars>> = OnceLock::new();
    Arc::clone(GUIDE.get_or_init(|| guide_of(&Camera::coarse())))
}

fn guide_of(camera: &Camera) -> Arc<GuideStars> {
    Arc::new(GuideStars::new(catalog(), &camera.params, noon()).expect("guide stars"))
}

/// Returns the Earth's velocity and 7.6 km/s of an orbit.
fn beta() -> DVec3 {
    earth_beta(noon()) + DVec3::new(1.0, 2.0, -1.5) * 1e-5
}
