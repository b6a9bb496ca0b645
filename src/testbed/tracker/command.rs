//! Commands of a tracker to its camera for the next exposures: windows around the stars that it follows, and an
//! exposure time from their signal.
//!
//! Acquisition needs the whole image. From the first attitude on the stars are predicted to the middle of the exposure
//! that a command can still reach, and each of the brightest gets a window that has all that tracking looks at: its
//! search radius, its spot and the ring of its background. After a frame without an attitude the whole image is asked
//! for again. The exposure time brings the third-brightest star's highest pixel to half of the range, by a factor of
//! two at most from frame to frame; one or two stars may saturate, as they do in trackers. Tests: `tests::commanded`,
//! `tests/closed_loop/commanding_tracker.rs`.

use super::{adjust::MatchedStar, params::TrackerParams};
use base::image::DnImage;
use base::region::{Region, Regions};
use base::time::{Span, Tai};
use glam::DVec2;

/// Pixels of a window beyond what tracking looks at: the error of its prediction.
const SLACK_PX: f64 = 3.0;
/// Which star sets the exposure time, from the brightest.
const SIGNAL_RANK: usize = 2;
/// Where its highest pixel is to be, as a share of the range between background and saturation.
const SIGNAL_TARGET: f64 = 0.5;
/// Nearer than this share of the target nothing is changed: the place of a star on its pixel changes its highest pixel
/// by more.
const SIGNAL_NEAR: f64 = 0.25;
/// The exposure time changes by this factor at most from frame to frame, both ways.
const EXPOSURE_STEP: f64 = 2.0;

/// Limits of the commands of a tracker to its camera.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct CameraOrders {
    /// Windows.
    pub windows: bool,
    /// The exposure time, within these limits, s.
    pub exposure_s: Option<[f64; 2]>,
    /// From one exposure's start to the next.
    pub period: Span,
}

/// Windows and exposure time requested for the exposures from an instant on.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct CameraWish {
    /// From when on.
    pub from: Tai,
    /// Exposure time; `None`: as it is.
    pub exposure: Option<Span>,
    /// Parts of the image; `None`: as they are.
    pub regions: Option<Regions>,
}

/// How the image in hand was exposed, as the camera says.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Exposed {
    /// Exposure time, s.
    pub exposure_s: f64,
    /// Parts of the image that were read out.
    pub regions: Regions,
}

/// Returns the middle of the first exposure that a command at `from` still reaches, of a camera that has exposed one so
/// long around `mid` and exposes the next for `next_s`.
pub(super) fn reached_mid(orders: &CameraOrders, mid: Tai, exposed_s: f64, from: Tai, next_s: f64) -> Tai {
    let start = mid - Span::from_s(0.5 * exposed_s);
    let period_ns = orders.period.ns().max(1);
    let periods = ((from - start).ns().max(0) + period_ns - 1) / period_ns;
    start + Span::from_ns(period_ns * periods.max(1)) + Span::from_s(0.5 * next_s)
}

/// Returns the window of a star at a place, `reach_px` to each side for tracking; `None` outside the image.
#[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "clamped to the image")]
pub(super) fn window(params: &TrackerParams, place_px: DVec2, reach_px: f64) -> Option<Region> {
    let size = [params.geometry.width_px, params.geometry.height_px].map(|side| side as f64);
    let reach = reach_px + SLACK_PX;
    let ends = [place_px.x, place_px.y].map(|place| [place.round() - reach, place.round() + reach + 1.0]);
    let [[left, right], [top, bottom]] = [0, 1].map(|axis| ends[axis].map(|end| end.clamp(0.0, size[axis]) as u32));
    let region = Region { left_px: left, top_px: top, width_px: right - left, height_px: bottom - top };
    (region.pixels() > 0).then_some(region)
}

/// Returns true when all that tracking looks at around a place was read out.
pub(super) fn is_read(params: &TrackerParams, regions: &Regions, place_px: DVec2, reach_px: f64) -> bool {
    let size = [params.geometry.width_px, params.geometry.height_px].map(|side| side as f64);
    let inside = |region: &Region| {
        let within = |axis: usize, first: u32, count: u32| {
            let place = [place_px.x, place_px.y][axis].round();
            let [low, high] = [(place - reach_px).max(0.0), (place + reach_px).min(size[axis] - 1.0)];
            low >= f64::from(first) && high < f64::from(first) + f64::from(count)
        };
        within(0, region.left_px, region.width_px) && within(1, region.top_px, region.height_px)
    };
    regions.is_whole() || regions.as_slice().iter().any(inside)
}

/// Returns the exposure time that brings the stars' signal to its target; `None` when it is near enough, or there are
/// too few stars.
pub(super) fn better_exposure(
    params: &TrackerParams,
    image: &DnImage,
    stars: &[MatchedStar],
    background_dn: f64,
    limits_s: [f64; 2],
) -> Option<Span> {
    let star = stars.iter().filter(|star| star.used).nth(SIGNAL_RANK)?;
    let range_dn = f64::from(params.detector.saturation_dn) - background_dn;
    let signal = (highest_dn(image, star.spot.place_px)? - background_dn) / range_dn;
    let wanted = SIGNAL_TARGET / signal.max(1e-3);
    if (wanted - 1.0).abs() < SIGNAL_NEAR {
        return None;
    }
    let exposure_s = params.exposure_s * wanted.clamp(1.0 / EXPOSURE_STEP, EXPOSURE_STEP);
    Some(Span::from_s(exposure_s.clamp(limits_s[0], limits_s[1])))
}

/// The highest of the nine pixels around a place, DN.
#[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "places are on the image")]
fn highest_dn(image: &DnImage, place_px: DVec2) -> Option<f64> {
    let [x, y] = [place_px.x.round(), place_px.y.round()].map(|place| place.max(0.0) as usize);
    let columns = |row: usize| (x.saturating_sub(1)..=x + 1).filter_map(move |column| image.get(column, row));
    (y.saturating_sub(1)..=y + 1).flat_map(columns).max().map(f64::from)
}
