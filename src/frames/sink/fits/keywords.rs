//! The truth keywords of a frame.
//!
//! `DATE-OBS` is the start of the exposure, `T-MID` its middle (the epoch of attitude and truth), both UTC; `MID_NS`
//! is the middle again, exactly. Angles are in degrees, spans in milliseconds.

use super::card::Header;
use super::image::{Pixels, write_image};
use super::wcs_cards::push_wcs;
use crate::sink::crc32::pixel_crc32;
use crate::sink::frame::{FrameMeta, SentFrame};
use base::time::Tai;
use base::units::DAY_S;
use std::io::{self, Write};

/// Modified Julian date of 1970-01-01T00:00:00.
const UNIX_EPOCH_MJD: f64 = 40_587.0;

/// Writes the DN of a frame with its truth keywords.
///
/// # Errors
/// When the output fails.
pub fn write_frame(out: impl Write, frame: &SentFrame) -> io::Result<()> {
    let mut header = Header::default();
    header.push("BUNIT", "adu", "digital numbers (DN)");
    push_meta(&mut header, &frame.meta);
    if let Some(facts) = &frame.meta.facts {
        header.push("SATURATE", facts.saturation_dn, "[DN] a pixel saturates");
        header.push("RDNOISE", facts.read_noise_e_rms, "[e-] rms of one pixel");
    }
    header.push("NSTARS", frame.truth.len(), "stars in the truth table");
    header.push("PIXCRC32", pixel_crc32(&frame.image), "CRC-32 of the DN, little-endian, row by row");
    write_image(out, frame.image.width(), frame.image.height(), Pixels::U16(frame.image.pixels()), &header)
}

/// Writes mean electrons before the detector, with the keywords of the frame they belong to.
///
/// # Errors
/// When the output fails.
pub fn write_electrons(
    out: impl Write,
    width: usize,
    height: usize,
    pixels: Pixels<'_>,
    meta: &FrameMeta,
) -> io::Result<()> {
    let mut header = Header::default();
    header.push("BUNIT", "electron", "mean electrons, before noise");
    push_meta(&mut header, meta);
    write_image(out, width, height, pixels, &header)
}

/// Adds everything that is known about a frame.
pub fn push_meta(header: &mut Header, meta: &FrameMeta) {
    header.push("CREATOR", concat!("starloop ", env!("CARGO_PKG_VERSION")), "");
    header.push("INSTRUME", &*meta.camera, "camera");
    header.push("FRAME", meta.number, "frame number in the run");
    push_time(header, meta);
    push_attitude(header, meta);
    push_origin(header, meta);
    push_optics(header, meta);
    if let Some(wcs) = &meta.wcs {
        push_wcs(header, wcs);
    }
}

fn push_time(header: &mut Header, meta: &FrameMeta) {
    let start = meta.exposure_start();
    header.push("TIMESYS", "UTC", "");
    header.push("DATE-OBS", utc_text(start), "[UTC] start of exposure");
    header.push("MJD-OBS", mjd(start), "[d] UTC, start of exposure");
    for (name, at, what) in [
        ("BEG", start, "start of exposure"),
        ("AVG", meta.mid_exposure, "mid-exposure"),
        ("END", meta.exposure_end(), "end of exposure"),
    ] {
        header.push(&format!("DATE-{name}"), utc_text(at), &format!("[UTC] {what}"));
        header.push(&format!("MJD-{name}"), mjd(at), &format!("[d] UTC, {what}"));
    }
    header.push("T-MID", utc_text(meta.mid_exposure), "[UTC] mid-exposure");
    header.push("MID_NS", meta.mid_exposure.ns(), "[ns] mid-exposure, TAI since 1970.0 TAI");
    header.push("EXPTIME", meta.exposure_s, "[s] integration time");
}

/// Modified Julian date, UTC.
fn mjd(at: Tai) -> f64 {
    UNIX_EPOCH_MJD + at.unix_s() / DAY_S
}

/// Pixels and focal length, as readers of other cameras' files look for them.
fn push_optics(header: &mut Header, meta: &FrameMeta) {
    let Some(facts) = &meta.facts else { return };
    let pitch_um = facts.pixel_pitch_um * f64::from(meta.binning);
    header.push("XPIXSZ", pitch_um, "[um] width of a pixel of the image, binned");
    header.push("YPIXSZ", pitch_um, "[um] height of a pixel of the image, binned");
    header.push("FOCALLEN", facts.focal_length_mm, "[mm] focal length");
}

fn push_attitude(header: &mut Header, meta: &FrameMeta) {
    header.comment("Attitude at mid-exposure, sensor_from_icrf: Hamilton, scalar first,");
    header.comment("passive: v_sensor = q v_icrf conj(q). +Z boresight, +X right, +Y down.");
    for (keyword, q) in ["QW", "QX", "QY", "QZ"].into_iter().zip(meta.attitude_wxyz) {
        header.push(keyword, q, "sensor_from_icrf");
    }
    header.push("RA_DEG", meta.ra_deg, "[deg] boresight, ICRF");
    header.push("DEC_DEG", meta.dec_deg, "[deg] boresight, ICRF");
    header.push("ROLL_DEG", meta.roll_deg, "[deg] image up, east of north");
    for (keyword, rate) in ["RATE_X", "RATE_Y", "RATE_Z"].into_iter().zip(meta.rate_deg_s) {
        header.push(keyword, rate, "[deg/s] sensor axes, w.r.t. ICRF");
    }
}

fn push_origin(header: &mut Header, meta: &FrameMeta) {
    header.push("SEED", meta.seed, "of the sensor's patterns and of faults");
    header.push("NOISSEED", meta.noise_seed, "of the exposure's noise, with FRAME");
    header.push("LATE_MS", meta.lateness.ms(), "[ms] completion - deadline");
    header.push("AGE_MS", meta.attitude_age.ms(), "[ms] age of the newest attitude");
    header.push("HORIZ_MS", meta.horizon.ms(), "[ms] newest attitude to mid-exposure");
    header.push("ENDHZ_MS", meta.end_horizon.ms(), "[ms] newest attitude to end of exposure");
    header.push("PARTEXTR", meta.is_partly_extrapolated, "an end of the exposure is extrapolated");
    header.push("RESIDAS", meta.residual_arcsec, "[arcsec] motion beyond rate, acceleration");
    header.push("JITMIS", meta.jitter_missing.ms(), "[ms] of exposure without jitter samples");
    header.push("BACKEND", meta.backend, "render backend");
    header.push("METHOD", meta.method, "smear method");
    header.push("RUNG", meta.rung, "degraded so far to be in time");
    header.push("NLEFTOUT", meta.left_out_stars, "stars left out");
    header.push("LEFTOUTE", meta.left_out_e, "[e-] of the stars left out");
    header.push("NOCCULT", meta.occulted_stars, "stars behind Earth or Moon");
    header.push("OVLOSTE", meta.overlap_lost_e, "[e-] lost where targets cover stars");
    header.push("ORIGIN", meta.origin, "of the attitude");
    header.push("FAULTS", meta.faults.to_string(), "active faults");
    header.push("FAULTBIT", meta.faults.bits(), "active faults as bits");
    header.push("NFAULTS", meta.active.count(), "faults of frames and imaging, numbers below");
    for (place, fault) in (1..).zip(meta.active.named()) {
        let (value, unit) = (fault.amount.value, fault.amount.unit);
        header.push(&format!("FLT{place}"), fault.name, "commanded fault");
        header.push(&format!("FLT{place}NUM"), u32::from(fault.number), "its number in the run's list");
        header.push(&format!("FLT{place}VAL"), value, unit);
    }
    if meta.gain_e_per_dn.is_finite() {
        header.push("GAIN", meta.gain_e_per_dn, "[e-/DN]");
    } else {
        header.push("DNKIND", "LUMCODE", "codes of luminance, not in proportion to light");
    }
    header.push("BLACKLVL", meta.black_level_dn, "[DN] black level");
    if meta.binning > 1 {
        header.push("XBINNING", meta.binning, "sensor pixels per pixel, along rows");
        header.push("YBINNING", meta.binning, "sensor pixels per pixel, along columns");
    }
    if meta.window_px != [0; 2] {
        header.push("WINDOW_X", meta.window_px[0], "[px] first sensor column, from 0");
        header.push("WINDOW_Y", meta.window_px[1], "[px] first sensor row, from 0");
    }
    header.push("ROWORDER", "TOP-DOWN", "first row is the top; FITS pixel = px + 1");
}

/// UTC as FITS writes it: no zone letter.
fn utc_text(at: Tai) -> String {
    at.to_rfc3339().trim_end_matches('Z').to_owned()
}

#[cfg(test)]
mod tests {
    use super::super::card::Value;
    use super::super::read::OwnedPixels;
    use super::super::read_image;
    use super::*;
    use crate::sink::sample::sample_frame;
    use base::image::ElectronImage;

    fn round_trip(frame: &SentFrame) -> super::super::FitsImage {
        let mut bytes = Vec::new();
        write_frame(&mut bytes, frame).unwrap();
        read_image(bytes.as_slice()).unwrap()
    }

    #[test]
    fn a_frame_reads_back_with_every_number_exact() {
        let frame = sample_frame(12);
        let image = round_trip(&frame);
        assert_eq!(image.pixels, OwnedPixels::U16(frame.image.pixels().to_vec()));
        let (header, meta) = (&image.header, &frame.meta);
        for (keyword, q) in ["QW", "QX", "QY", "QZ"].into_iter().zip(meta.attitude_wxyz) {
            assert_eq!(header.real(keyword), Some(q), "{keyword}");
        }
        assert_eq!(header.integer("SEED"), Some(meta.seed.into()));
        assert_eq!(header.integer("NOISSEED"), Some(meta.noise_seed.into()));
        assert_eq!(header.integer("MID_NS"), Some(meta.mid_exposure.ns().into()));
        assert_eq!(header.real("LATE_MS"), Some(meta.lateness.ms()));
        assert_eq!(header.real("ENDHZ_MS"), Some(62.0));
        assert_eq!((header.get("PARTEXTR"), header.real("RESIDAS")), (Some(Value::Logical(true)), Some(0.375)));
        assert_eq!(header.real("JITMIS"), Some(14.0));
        assert_eq!(header.text("INSTRUME").as_deref(), Some(&*meta.camera));
        assert_eq!(header.text("FAULTS").as_deref(), Some("link_drop+hot_pixels"));
        assert_eq!((header.integer("NFAULTS"), header.text("FLT1").as_deref()), (Some(1), Some("hot_pixels")));
        assert_eq!((header.integer("FLT1NUM"), header.real("FLT1VAL")), (Some(3), Some(31.25)));
        assert_eq!(header.text("RUNG").as_deref(), Some("budget-x3"));
        assert_eq!((header.integer("NLEFTOUT"), header.real("LEFTOUTE")), (Some(17), Some(12.25)));
        assert_ne!(header.real("RATE_X"), header.real("RATE_Y"), "axes are not swapped for one another");
    }

    #[test]
    fn date_obs_is_the_start_and_t_mid_the_middle() {
        let mut frame = sample_frame(0);
        frame.meta.mid_exposure = Tai::from_rfc3339("2026-03-01T12:00:00Z").unwrap();
        frame.meta.exposure_s = 0.5;
        let header = round_trip(&frame).header;
        assert_eq!(header.text("DATE-OBS").as_deref(), Some("2026-03-01T11:59:59.750000"));
        assert_eq!(header.text("T-MID").as_deref(), Some("2026-03-01T12:00:00.000000"));
        assert_eq!(header.text("DATE-BEG"), header.text("DATE-OBS"));
        assert_eq!(header.text("DATE-AVG"), header.text("T-MID"));
        assert_eq!(header.text("DATE-END").as_deref(), Some("2026-03-01T12:00:00.250000"));
        // f64 resolves 0.6 us at MJD 61100.
        const MJD_D: f64 = 1e-6 / DAY_S;
        let mjd = header.real("MJD-OBS").unwrap();
        assert!((mjd - (61_100.5 - 0.25 / DAY_S)).abs() < MJD_D, "{mjd}");
    }

    #[test]
    fn the_camera_and_the_sky_are_in_the_header() {
        let mut frame = sample_frame(1);
        frame.meta.binning = 2;
        let header = round_trip(&frame).header;
        assert_eq!((header.real("XPIXSZ"), header.real("FOCALLEN")), (Some(11.0), Some(52.25)), "binned pixels");
        assert_eq!((header.real("SATURATE"), header.real("RDNOISE")), (Some(4095.0), Some(7.5)));
        assert_eq!(header.text("CTYPE1").as_deref(), Some("RA---TAN-SIP"));
        assert_eq!((header.real("CRPIX1"), header.real("CD1_2")), (Some(16.25), Some(0.002)));
        assert_eq!((header.integer("A_ORDER"), header.integer("AP_ORDER")), (Some(3), Some(2)));
        // The lens's terms and the frame's own together; to the sky added, back subtracted.
        assert_eq!((header.real("A_2_0"), header.real("B_2_0")), (Some(1e-6 + 1e-7), Some(-2e-6)));
        assert_eq!((header.real("B_1_2"), header.real("A_0_3")), (Some(4e-9), None));
        assert_eq!((header.real("AP_0_1"), header.real("BP_1_1")), (Some(5e-6), Some(-2e-7)));
        (frame.meta.wcs, frame.meta.facts) = (None, None);
        let header = round_trip(&frame).header;
        assert_eq!((header.text("CTYPE1"), header.real("FOCALLEN")), (None, None), "nothing where nothing is known");
    }

    #[test]
    fn electrons_read_back_in_single_precision() {
        let mut image = ElectronImage::new(3, 2);
        image.pixels_mut().copy_from_slice(&[0.0, 0.1, -1.5, 1e6, f32::MIN_POSITIVE, 7.0]);
        let mut bytes = Vec::new();
        write_electrons(&mut bytes, image.width(), image.height(), Pixels::F32(image.pixels()), &sample_frame(1).meta)
            .unwrap();
        let read = read_image(bytes.as_slice()).unwrap();
        assert_eq!(read.pixels, OwnedPixels::F32(image.pixels().to_vec()));
        assert_eq!(read.header.text("BUNIT").as_deref(), Some("electron"));
    }
}
