//! The truth keywords of a frame: the cards of [`crate::sink::facts`], and the map to the sky.
//!
//! `DATE-OBS` is the start of the exposure, `T-MID` its middle (the epoch of attitude and truth), both UTC; `MID_NS`
//! is the middle again, exactly. Angles are in degrees, spans in milliseconds.

use super::card::{Header, Value};
use super::image::{Pixels, write_image};
use crate::sink::facts::{Card, Fact, FactSource, Form, Part, Scalar, TABLE};
use crate::sink::frame::{FrameMeta, SentFrame};
use crate::sink::{crc32::pixel_crc32, frame_fault::ActiveFaults, wcs::Wcs};
use base::region::Regions;
use std::borrow::Cow;
use std::io::{self, Write};

/// Writes the DN of a frame with its truth keywords.
///
/// # Errors
/// When the output fails.
pub fn write_frame(out: impl Write, frame: &SentFrame) -> io::Result<()> {
    let pixels = Pixels::U16(frame.image.pixels());
    write_image(out, frame.image.width(), frame.image.height(), pixels, &frame_header(frame))
}

/// Returns the cards of a frame of DN, with the checksum of its pixels.
pub(super) fn frame_header(frame: &SentFrame) -> Header {
    let mut header = Header::default();
    header.push("BUNIT", "adu", "digital numbers (DN)");
    push_meta(&mut header, &frame.meta);
    push_part(&mut header, &FactSource::of_frame(frame, Some(pixel_crc32(&frame.image))), Part::Detector);
    header
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

/// Adds everything that is known about a frame without its pixels.
pub fn push_meta(header: &mut Header, meta: &FrameMeta) {
    header.push("CREATOR", concat!("starloop ", env!("CARGO_PKG_VERSION")), "");
    for part in Part::OF_EVERY_FILE {
        if part == Part::Attitude {
            header.comment("Attitude at mid-exposure, sensor_from_icrf: Hamilton, scalar first,");
            header.comment("passive: v_sensor = q v_icrf conj(q). +Z boresight, +X right, +Y down.");
        }
        push_part(header, &FactSource::of_meta(meta), part);
    }
    if let Some(wcs) = &meta.wcs {
        push_wcs(header, wcs);
    }
}

fn push_part(header: &mut Header, source: &FactSource<'_>, part: Part) {
    for row in TABLE.iter().filter(|row| row.part == part) {
        let fact = (row.value)(source);
        for (element, card) in row.fits.iter().enumerate() {
            if let (Fact::Active(active), Form::Plain) = (fact, card.1) {
                push_active(header, card, active);
            } else if let (Fact::Regions(regions), Form::Plain) = (fact, card.1) {
                push_regions(header, card, regions);
            } else {
                push_card(header, card, fact, element);
            }
        }
    }
}

fn push_card(header: &mut Header, Card(keyword, form, comment): &Card, fact: Fact<'_>, element: usize) {
    let value = match fact.element(element, *form) {
        Scalar::Absent => return,
        Scalar::Flag(is_so) => Value::Logical(is_so),
        Scalar::Whole(number) => Value::Integer(number),
        Scalar::Real(number) => Value::Real(number),
        Scalar::Text(text) => Value::Text(without_zone(text, fact)),
    };
    header.push(keyword, value, comment);
}

/// Returns UTC as FITS writes it: without a zone letter.
fn without_zone<'a>(text: Cow<'a, str>, fact: Fact<'_>) -> Cow<'a, str> {
    if matches!(fact, Fact::Time(_)) { text.trim_end_matches('Z').to_owned().into() } else { text }
}

/// Adds the name, the number and the amount of each fault.
fn push_active(header: &mut Header, Card(keyword, _, comment): &Card, active: &ActiveFaults) {
    for (place, fault) in (1..).zip(active.named()) {
        header.push(&format!("{keyword}{place}"), fault.name, comment);
        header.push(&format!("{keyword}{place}NUM"), u32::from(fault.number), "its number in the run's list");
        header.push(&format!("{keyword}{place}VAL"), fault.amount.value, fault.amount.unit);
    }
}

/// Adds a card for each region.
fn push_regions(header: &mut Header, Card(keyword, _, comment): &Card, regions: &Regions) {
    for (place, region) in (1..).zip(regions.as_slice()) {
        header.push(&format!("{keyword}{place}"), region.to_string(), comment);
    }
}

// The cards of a frame's [`Wcs`].
//
// Sources: FITS standard 4.0, section 8; the SIP convention (Shupe et al. 2005): `A_p_q`, `B_p_q` from pixels,
// `AP_p_q`, `BP_p_q` back. Read by astropy in `hil_scripts/tests/test_wcs.py`.

/// Adds the map from pixels to catalog places.
pub(super) fn push_wcs(header: &mut Header, wcs: &Wcs) {
    header.comment("WCS: pixels to ICRS catalog places at the epoch of the frame (mid-exposure).");
    header.comment("Space motion and parallax are in those places, aberration and deflection of");
    header.comment("light are in the map. Motion within the exposure is not.");
    let projection = if wcs.has_sip() { "TAN-SIP" } else { "TAN" };
    header.push("WCSAXES", 2_u32, "axes of the sky");
    for (axis, name, what) in [(1, "RA---", "right ascension"), (2, "DEC--", "declination")] {
        header.push(&format!("CTYPE{axis}"), format!("{name}{projection}"), what);
        header.push(&format!("CUNIT{axis}"), "deg", "");
        header.push(&format!("CRPIX{axis}"), wcs.crpix[axis - 1], "[px] reference point, from 1");
        header.push(&format!("CRVAL{axis}"), wcs.crval_deg[axis - 1], "[deg] its catalog place");
        for pixel in [1, 2] {
            header.push(&format!("CD{axis}_{pixel}"), wcs.cd_deg_px[axis - 1][pixel - 1], "[deg/px]");
        }
    }
    header.push("LONPOLE", 180.0, "[deg] north is up in the plane of the sky");
    header.push("RADESYS", "ICRS", "");
    header.push("EQUINOX", 2000.0, "axes, not epoch: the epoch is DATE-AVG");
    header.push("WCSERR", wcs.error_px, "[px] largest error found over the image");
    if wcs.has_sip() {
        push_sip(header, wcs);
    }
}

fn push_sip(header: &mut Header, wcs: &Wcs) {
    let [order, inverse_order] = wcs.orders();
    push_polynomials(header, ["A", "B"], 2..=order, |i, j| wcs.forward(i, j));
    push_polynomials(header, ["AP", "BP"], 1..=inverse_order, |i, j| wcs.inverse(i, j));
}

/// Writes the terms of these degrees of two polynomials, one for each axis; zeros are left out.
fn push_polynomials(
    header: &mut Header,
    names: [&str; 2],
    degrees: core::ops::RangeInclusive<u8>,
    coefficients: impl Fn(u8, u8) -> [f64; 2],
) {
    for (axis, name) in names.into_iter().enumerate() {
        header.push(&format!("{name}_ORDER"), u32::from(*degrees.end()), "SIP polynomial");
        for (i, j) in degrees.clone().flat_map(|degree| (0..=degree).map(move |j| (degree - j, j))) {
            let value = coefficients(i, j)[axis];
            if value != 0.0 {
                header.push(&format!("{name}_{i}_{j}"), value, "");
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::{super::image::OwnedPixels, super::read_image, *};
    use crate::sink::sample::sample_frame;
    use base::{image::ElectronImage, time::Tai, units::DAY_S};

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
