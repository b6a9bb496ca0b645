//! Frames for tests of sinks, and the texts that outputs of them are compared with.

use crate::sink::frame::{CameraFacts, SentFrame, TruthStar};
use crate::sink::frame_fault::{ActiveFault, ActiveFaults, Amount, FaultFlags};
use crate::sink::wcs::{Sip, SipTerm, Wcs};
use base::bayer::BayerPattern;
use base::drawn::{Degradation, FrameMethod, MethodName, PathOrigin};
use base::region::{Region, Regions};
use base::time::{Span, Tai};
use std::path::{Path, PathBuf};
use std::sync::Arc;

/// Returns a small frame with something in every field, for tests of sinks.
pub fn sample_frame(number: u32) -> SentFrame {
    let mut frame = SentFrame::with_capacity(31, 17, 4, "test camera, \"A\"".into());
    for (i, pixel) in frame.image.pixels_mut().iter_mut().enumerate() {
        *pixel = (i as u16).wrapping_mul(2_477).wrapping_add(number as u16);
    }
    let star = TruthStar {
        id: 424,
        apparent_deg: [37.954_560_671, 89.264_109_444],
        catalog_deg: [37.961_234_567, 89.263_987_654],
        mag: 1.98,
        x_px: 12.345_678_901,
        y_px: -0.25,
        electrons: 0.1 + 0.2,
        ..TruthStar::NONE
    };
    frame.truth.extend([star, TruthStar { id: u32::MAX, mag: 6.5, electrons: 1e7 / 3.0, ..star }]);
    frame.meta.number = number;
    frame.meta.mid_exposure = Tai::from_ns(1_790_000_000_123_456_789) + Span::from_ms(100 * i64::from(number));
    frame.meta.exposure_s = 0.1;
    frame.meta.attitude_wxyz = [0.5, -0.5, 0.1_f64.sqrt(), -0.4_f64.sqrt()];
    (frame.meta.ra_deg, frame.meta.dec_deg, frame.meta.roll_deg) = (359.999_999_999, -1.0 / 3.0, 1e-7);
    frame.meta.rate_deg_s = [0.1, -0.02, 3.0];
    frame.meta.seed = u64::MAX - u64::from(number);
    frame.meta.noise_seed = u64::MAX / 2 - u64::from(number);
    frame.meta.lateness = Span::from_ns(-1_234_567);
    frame.meta.attitude_age = Span::from_ms(12);
    frame.meta.horizon = Span::from_ms(-38);
    (frame.meta.end_horizon, frame.meta.is_partly_extrapolated) = (Span::from_ms(62), true);
    (frame.meta.residual_arcsec, frame.meta.jitter_missing) = (0.375, Span::from_ms(14));
    (frame.meta.backend, frame.meta.method) = ("cpu", FrameMethod::Planned(MethodName::Samples));
    (frame.meta.origin, frame.meta.degradation) = (PathOrigin::Predicted, Degradation::Budget3);
    (frame.meta.left_out_stars, frame.meta.left_out_e) = (17, 12.25);
    (frame.meta.occulted_stars, frame.meta.overlap_lost_e) = (5, 6.5);
    frame.meta.faults = FaultFlags::HOT_PIXELS | FaultFlags::LINK_DROP;
    let amount = Amount { value: 31.25, unit: "e-/s" };
    frame.meta.active.push(ActiveFault { name: "hot_pixels", number: 3, amount });
    (frame.meta.gain_e_per_dn, frame.meta.black_level_dn) = (2.5, 64.0);
    let region = Region { left_px: 3, top_px: 2, width_px: 9, height_px: 5 };
    frame.meta.regions = Regions::of(&[region, Region { left_px: 20, ..region }]).unwrap_or(Regions::WHOLE);
    let facts = CameraFacts {
        pixel_pitch_um: 5.5,
        focal_length_mm: 52.25,
        saturation_dn: 4095.0,
        read_noise_e_rms: 7.5,
        temperature_c: -12.5,
        drawn_to_mag_g: 7.25,
        colours: Some(BayerPattern::Gbrg),
    };
    frame.meta.facts = Some(facts);
    let term = |i, j, a, b| SipTerm { i, j, along: [a, b] };
    let forward = vec![term(2, 0, 1e-6, -2e-6), term(1, 2, 3e-9, 4e-9)];
    let sip = Sip { order: 3, forward, inverse_order: 2, inverse: vec![term(0, 1, 5e-6, 6e-6)] };
    frame.meta.wcs = Some(Wcs {
        crpix: [16.25, 9.5],
        crval_deg: [359.987_654_321, -0.333],
        cd_deg_px: [[-0.01, 0.002], [0.002, 0.01]],
        quadratic_px: [[1e-7, 0.0, 0.0], [0.0, 2e-7, 0.0]],
        sip: Some(Arc::new(sip)),
        error_px: 0.001_25,
    });
    frame
}

/// Returns [`sample_frame`] as other outputs see it: without a camera's numbers and a map of the sky, with codes of
/// luminance in place of DN, binned, windowed, read out as a whole, and with no fault.
pub fn bare_sample_frame(number: u32) -> SentFrame {
    let mut frame = sample_frame(number);
    (frame.meta.facts, frame.meta.wcs, frame.meta.gain_e_per_dn) = (None, None, f64::NAN);
    (frame.meta.binning, frame.meta.window_px) = (2, [3, 5]);
    (frame.meta.faults, frame.meta.active) = (FaultFlags::NONE, ActiveFaults::NONE);
    frame.meta.regions = Regions::WHOLE;
    frame
}

/// Compares the text of an output with the one that is kept in `tests/golden/frame_facts`. Readers of other programs
/// depend on these bytes: a new fact adds to them, nothing else changes them.
///
/// # Errors
/// With the first line that differs. The whole text is then in `target/frame_facts`, to be looked at and copied.
pub fn compare_with_pinned(name: &str, got: &str) -> Result<(), String> {
    compare_with_file(&pinned(name), got)
}

/// Returns true when the text of an output is not the one that is kept: for negative controls.
pub fn differs_from_pinned(name: &str, got: &str) -> bool {
    std::fs::read_to_string(pinned(name)).is_ok_and(|wanted| wanted != got)
}

fn pinned(name: &str) -> PathBuf {
    Path::new(concat!(env!("CARGO_MANIFEST_DIR"), "/../../tests/golden/frame_facts")).join(name)
}

/// Compares a text with a file of the source tree.
///
/// # Errors
/// Compares as [`compare_with_pinned`] does.
pub fn compare_with_file(path: &Path, got: &str) -> Result<(), String> {
    let wanted = std::fs::read_to_string(path).unwrap_or_default();
    if wanted == got {
        return Ok(());
    }
    let line = got.lines().zip(wanted.lines()).take_while(|(got, wanted)| got == wanted).count();
    let [wanted, found] = [&*wanted, got].map(|text| text.lines().nth(line).unwrap_or("(end)"));
    let folder = Path::new(concat!(env!("CARGO_MANIFEST_DIR"), "/../../target/frame_facts"));
    let kept = folder.join(path.file_name().unwrap_or_default());
    let keep = std::fs::create_dir_all(folder).and_then(|()| std::fs::write(&kept, got));
    let place = keep.map_or_else(|error| error.to_string(), |()| kept.display().to_string());
    let path = path.display();
    Err(format!("{path}, line {}: wanted {wanted:?}, got {found:?}; all of it: {place}", line + 1))
}

/// Returns bytes as text, 16 of them in a line after their place.
pub fn hex_lines(bytes: &[u8]) -> String {
    let line = |(i, part): (usize, &[u8])| {
        let bytes: Vec<String> = part.iter().map(|byte| format!("{byte:02x}")).collect();
        format!("{:4} {}\n", 16 * i, bytes.join(" "))
    };
    bytes.chunks(16).enumerate().map(line).collect()
}
