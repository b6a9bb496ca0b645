//! The modes of a monitor -> the one for frames of a size and a refresh.
//!
//! Of the modes of exactly the frames' size the one whose refresh comes nearest to what they are drawn for; for frames
//! that were drawn for no refresh the monitor's preferred one, else the first. Interlaced and doubled modes are left
//! out: a frame would not be one refresh. Tests below, on timings of the standards.

use base::time::Span;
use drm::control::{ModeFlags, ModeTypeFlags};

/// A way in which a monitor can be driven.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct Mode {
    /// Columns and rows.
    pub(super) size_px: [u32; 2],
    /// Refreshes per 1000 s.
    pub(super) refresh_mhz: u32,
    /// Whether the monitor prefers this mode.
    pub(super) is_preferred: bool,
}

impl core::fmt::Display for Mode {
    fn fmt(&self, f: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        let [w, h] = self.size_px;
        write!(f, "{w} x {h} at {:.3} Hz", f64::from(self.refresh_mhz) / 1000.0)
    }
}

impl Mode {
    /// Reads a mode of the card; `None` when a frame would not be one refresh.
    pub(super) fn of(mode: &drm::control::Mode) -> Option<Self> {
        let (width, height) = mode.size();
        let refresh_mhz = refresh_mhz(mode.clock(), [mode.hsync().2, mode.vsync().2], mode.vscan())?;
        let is_preferred = mode.mode_type().contains(ModeTypeFlags::PREFERRED);
        let is_plain = !mode.flags().intersects(ModeFlags::INTERLACE | ModeFlags::DBLSCAN);
        is_plain.then_some(Self { size_px: [width.into(), height.into()], refresh_mhz, is_preferred })
    }
}

/// Refreshes per 1000 s, rounded as drivers round them, as theirs must be the same number. `scans`: how often each row
/// is sent, 0 for once.
fn refresh_mhz(clock_khz: u32, [columns, rows]: [u16; 2], scans: u16) -> Option<u32> {
    let pixels = f64::from(columns) * f64::from(rows) * f64::from(scans.max(1));
    let mhz = (f64::from(clock_khz) * 1000.0 / pixels * 1000.0).round();
    #[allow(clippy::cast_possible_truncation, reason = "compared with the limit just before")]
    (mhz >= 1.0 && mhz <= f64::from(u32::MAX)).then_some(mhz as u32)
}

/// Returns that one of `modes` for frames of `image_px` that were drawn for a refresh of `drawn`.
pub(super) fn choose(modes: &[Mode], image_px: [u32; 2], drawn: Option<Span>) -> Option<Mode> {
    let fitting = || modes.iter().filter(|mode| mode.size_px == image_px);
    let off_hz = |mode: &Mode, drawn: Span| (f64::from(mode.refresh_mhz) * 1e-3 - 1.0 / drawn.s()).abs();
    match drawn {
        Some(drawn) => fitting().min_by(|a, b| off_hz(a, drawn).total_cmp(&off_hz(b, drawn))).copied(),
        None => fitting().find(|mode| mode.is_preferred).or_else(|| fitting().next()).copied(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const HD: [u32; 2] = [1920, 1080];

    fn mode(size_px: [u32; 2], refresh_mhz: u32, is_preferred: bool) -> Mode {
        Mode { size_px, refresh_mhz, is_preferred }
    }

    fn hz(hz: f64) -> Option<Span> {
        Some(Span::from_s(1.0 / hz))
    }

    /// Timings of CEA-861 and VESA DMT, with the rates that the standards name.
    #[test]
    fn refresh_rates_are_those_of_the_standards() {
        assert_eq!(refresh_mhz(148_500, [2200, 1125], 0), Some(60_000), "1080p60");
        assert_eq!(refresh_mhz(148_352, [2200, 1125], 1), Some(59_940), "1080p59.94");
        assert_eq!(refresh_mhz(25_175, [800, 525], 0), Some(59_940), "640 x 480");
        assert_eq!(refresh_mhz(148_500, [2200, 1125], 2), Some(30_000), "each row twice");
        assert_eq!(refresh_mhz(148_500, [0, 1125], 0), None, "a driver's nonsense");
        assert_eq!((refresh_mhz(0, [2200, 1125], 0), refresh_mhz(u32::MAX, [1, 1], 0)), (None, None));
    }

    #[test]
    fn only_modes_of_the_frames_size_are_taken() {
        let modes = [mode([2560, 1440], 60_000, true), mode(HD, 50_000, false), mode(HD, 60_000, false)];
        assert_eq!(choose(&modes, HD, None), Some(modes[1]), "none of this size is preferred: the first");
        assert_eq!(choose(&modes, [2560, 1440], None), Some(modes[0]));
        for image_px in [[1919, 1080], [1920, 1081], [1080, 1920]] {
            assert_eq!(choose(&modes, image_px, hz(60.0)), None, "nothing is scaled");
        }
        assert_eq!(choose(&[], HD, None), None);
    }

    #[test]
    fn the_refresh_that_frames_are_drawn_for_comes_before_the_preferred_one() {
        let modes = [mode(HD, 60_000, true), mode(HD, 59_940, false), mode(HD, 144_000, false)];
        assert_eq!(choose(&modes, HD, None), Some(modes[0]));
        assert_eq!(choose(&modes, HD, hz(59.94)), Some(modes[1]));
        assert_eq!(choose(&modes, HD, hz(120.0)), Some(modes[2]));
        // Both sides of the middle between 60 and 144 Hz.
        assert_eq!(choose(&modes, HD, hz(101.9)), Some(modes[0]));
        assert_eq!(choose(&modes, HD, hz(102.1)), Some(modes[2]));
    }
}
