//! The table: one row per fact, in the order of FITS headers and of the columns of `frames.csv`.
//!
//! A new row goes where its columns belong; readers find columns and cards by name. In shared memory it takes reserved
//! bytes, in the chunk data the next place.

use super::row::FeatureKind::{Bits as BitField, Float, Integer, Text};
use super::row::Part::{Attitude, Camera, Detector, Frame, Optics, Time};
use super::row::Stored::{F64, I64, U32, U64};
use super::row::{Card, Column, Key, Part, Row, feature, row};
use super::value::Form::{Bits, Finite, Hex, Mjd, Ms, Names, Ns, Number, Plain, Us};
use super::value::{Fact, FactSource, Kind};
use crate::sink::frame::{CameraFacts, SentFrame};
use base::bayer::BayerPattern;

/// Every fact of a frame.
#[rustfmt::skip] // One line per output.
pub const TABLE: &[Row] = &[
    row("number", Kind::U32, "", "Frame number in the run", |f| Fact::U32(f.meta.number))
        .fits(Frame, &[Card("FRAME", Plain, "frame number in the run")])
        .csv(&[Column("frame", Plain)])
        .memory(32, U32, Plain)
        .chunk(&[feature(0, "ChunkFrameID", Integer, Plain, "", "Frame number in the run")])
        .live(&[Key("number", Plain)])
        .control(&[Key("number", Plain)]),
    row("time_system", Kind::Text, "", "Time scale of the times as text and as dates", |_| Fact::Text("UTC"))
        .fits(Time, &[Card("TIMESYS", Plain, "")]),
    row("exposure_start", Kind::Time, "", "Start of the exposure", |f| Fact::Time(f.meta.exposure_start()))
        .fits(Time, &[
            Card("DATE-OBS", Plain, "[UTC] start of exposure"), Card("MJD-OBS", Mjd, "[d] UTC, start of exposure"),
            Card("DATE-BEG", Plain, "[UTC] start of exposure"), Card("MJD-BEG", Mjd, "[d] UTC, start of exposure"),
        ]),
    row("mid_exposure_date", Kind::Time, "", "Middle of the exposure, by the names of FITS 4.0", |f| Fact::Time(f.meta.mid_exposure))
        .fits(Time, &[Card("DATE-AVG", Plain, "[UTC] mid-exposure"), Card("MJD-AVG", Mjd, "[d] UTC, mid-exposure")]),
    row("exposure_end", Kind::Time, "", "End of the exposure", |f| Fact::Time(f.meta.exposure_end()))
        .fits(Time, &[Card("DATE-END", Plain, "[UTC] end of exposure"), Card("MJD-END", Mjd, "[d] UTC, end of exposure")]),
    row("mid_exposure", Kind::Time, "", "Middle of the exposure: the epoch of attitude and truth; UTC text, or ns TAI since 1970-01-01T00:00:00 TAI", |f| Fact::Time(f.meta.mid_exposure))
        .fits(Time, &[Card("T-MID", Plain, "[UTC] mid-exposure"), Card("MID_NS", Ns, "[ns] mid-exposure, TAI since 1970.0 TAI")])
        .csv(&[Column("mid_exposure_utc", Plain), Column("mid_exposure_tai_ns", Ns)])
        .memory(8, I64, Ns)
        .chunk(&[feature(1, "ChunkTimestamp", Integer, Ns, "ns", "Middle of the exposure, TAI since 1970")])
        .live(&[Key("utc", Plain)])
        .control_meta(&[Key("mid_exposure_utc", Plain)]),
    row("exposure_s", Kind::Real, "s", "Integration time", |f| Fact::Real(f.meta.exposure_s))
        .fits(Time, &[Card("EXPTIME", Plain, "[s] integration time")])
        .csv(&[Column("exposure_s", Plain)])
        .memory(48, F64, Plain)
        .chunk(&[feature(2, "ChunkExposureTime", Float, Us, "us", "Integration time")])
        .live(&[Key("exposure_s", Plain)])
        .control_meta(&[Key("exposure_s", Plain)]),
    row("started_by", Kind::Text, "", "What started the exposure: rate, or the source of its trigger", |f| Fact::Text(f.meta.started_by))
        .fits(Time, &[Card("STARTBY", Plain, "what started the exposure")])
        .chunk(&[feature(24, "ChunkStartedBy", Text, Plain, "", "What started the exposure: rate, or the source of its trigger")])
        .control_meta(&[Key("started_by", Plain)]),
    row("trigger_delay", Kind::Span, "s", "Trigger to the start of the exposure; 0 without a trigger", |f| Fact::Span(f.meta.trigger_delay))
        .fits(Time, &[Card("TRIGDLY", Ms, "[ms] trigger to start of exposure")])
        .chunk(&[feature(25, "ChunkTriggerDelay", Float, Us, "us", "Trigger to the start of the exposure; 0 without a trigger")])
        .control_meta(&[Key("trigger_delay_s", Plain)]),
    row("gain_db", Kind::Real, "dB", "Gain beyond that of the camera's file", |f| Fact::Real(f.meta.gain_db))
        .fits(Detector, &[Card("GAIN_DB", Plain, "[dB] gain beyond that of the camera file")])
        .chunk(&[feature(26, "ChunkGain", Float, Plain, "dB", "Gain beyond that of the camera's file")])
        .control_meta(&[Key("gain_db", Plain)]),
    row("attitude_wxyz", Kind::Reals(4), "", "Attitude at mid-exposure, `sensor_from_icrf`: Hamilton, passive, scalar first", |f| Fact::Reals(&f.meta.attitude_wxyz))
        .fits(Attitude, &[
            Card("QW", Plain, "sensor_from_icrf"), Card("QX", Plain, "sensor_from_icrf"),
            Card("QY", Plain, "sensor_from_icrf"), Card("QZ", Plain, "sensor_from_icrf"),
        ])
        .csv(&[Column("qw", Plain), Column("qx", Plain), Column("qy", Plain), Column("qz", Plain)])
        .memory(56, F64, Plain)
        .chunk(&[
            feature(3, "ChunkAttitudeW", Float, Plain, "", "Quaternion sensor from ICRF, Hamilton, passive: scalar part"),
            feature(4, "ChunkAttitudeX", Float, Plain, "", "Quaternion: x"),
            feature(5, "ChunkAttitudeY", Float, Plain, "", "Quaternion: y"),
            feature(6, "ChunkAttitudeZ", Float, Plain, "", "Quaternion: z"),
        ])
        .live(&[Key("attitude_wxyz", Plain)])
        .control_meta(&[Key("attitude_wxyz", Plain)]),
    row("ra_deg", Kind::Real, "deg", "Right ascension of the boresight, ICRF", |f| Fact::Real(f.meta.ra_deg))
        .fits(Attitude, &[Card("RA_DEG", Plain, "[deg] boresight, ICRF")])
        .csv(&[Column("ra_deg", Plain)])
        .memory(88, F64, Plain)
        .chunk(&[feature(7, "ChunkRightAscension", Float, Plain, "deg", "Right ascension of the boresight")])
        .live(&[Key("ra_deg", Plain)])
        .control_meta(&[Key("ra_deg", Plain)]),
    row("dec_deg", Kind::Real, "deg", "Declination of the boresight, ICRF", |f| Fact::Real(f.meta.dec_deg))
        .fits(Attitude, &[Card("DEC_DEG", Plain, "[deg] boresight, ICRF")])
        .csv(&[Column("dec_deg", Plain)])
        .memory(96, F64, Plain)
        .chunk(&[feature(8, "ChunkDeclination", Float, Plain, "deg", "Declination of the boresight")])
        .live(&[Key("dec_deg", Plain)])
        .control_meta(&[Key("dec_deg", Plain)]),
    row("roll_deg", Kind::Real, "deg", "Position angle of image up, east of north", |f| Fact::Real(f.meta.roll_deg))
        .fits(Attitude, &[Card("ROLL_DEG", Plain, "[deg] image up, east of north")])
        .csv(&[Column("roll_deg", Plain)])
        .memory(104, F64, Plain)
        .chunk(&[feature(9, "ChunkRoll", Float, Plain, "deg", "Position angle of image up, east of north")])
        .live(&[Key("roll_deg", Plain)])
        .control_meta(&[Key("roll_deg", Plain)]),
    row("rate_deg_s", Kind::Reals(3), "deg/s", "Angular rate with respect to ICRF in sensor axes", |f| Fact::Reals(&f.meta.rate_deg_s))
        .fits(Attitude, &[
            Card("RATE_X", Plain, "[deg/s] sensor axes, w.r.t. ICRF"), Card("RATE_Y", Plain, "[deg/s] sensor axes, w.r.t. ICRF"),
            Card("RATE_Z", Plain, "[deg/s] sensor axes, w.r.t. ICRF"),
        ])
        .csv(&[Column("rate_x_deg_s", Plain), Column("rate_y_deg_s", Plain), Column("rate_z_deg_s", Plain)])
        .memory(112, F64, Plain)
        .chunk(&[
            feature(10, "ChunkRateX", Float, Plain, "deg/s", "Angular rate about image right"),
            feature(11, "ChunkRateY", Float, Plain, "deg/s", "Angular rate about image down"),
            feature(12, "ChunkRateZ", Float, Plain, "deg/s", "Angular rate about the boresight"),
        ])
        .live(&[Key("rate_deg_s", Plain)])
        .control_meta(&[Key("rate_deg_s", Plain)]),
    row("seed", Kind::U64, "", "Seed of the sensor's patterns and of faults", |f| Fact::U64(f.meta.seed))
        .fits(Part::Making, &[Card("SEED", Plain, "of the sensor's patterns and of faults")])
        .csv(&[Column("seed", Plain)])
        .chunk(&[feature(18, "ChunkSeed", BitField, Plain, "", "Seed of the sensor's patterns and of faults")]),
    row("noise_seed", Kind::U64, "", "Seed of the exposure's noise, with the frame number", |f| Fact::U64(f.meta.noise_seed))
        .fits(Part::Making, &[Card("NOISSEED", Plain, "of the exposure's noise, with FRAME")])
        .csv(&[Column("noise_seed", Plain)])
        .memory(160, U64, Plain)
        .chunk(&[feature(22, "ChunkNoiseSeed", BitField, Plain, "", "Seed of the exposure's noise, with the frame number")]),
    row("lateness", Kind::Span, "s", "Completion minus deadline; negative when early", |f| Fact::Span(f.meta.lateness))
        .fits(Part::Making, &[Card("LATE_MS", Ms, "[ms] completion - deadline")])
        .csv(&[Column("lateness_ns", Ns)])
        .memory(16, I64, Ns)
        .chunk(&[feature(13, "ChunkLateness", Integer, Ns, "ns", "Completion minus deadline; negative when early")])
        .live(&[Key("lateness_ms", Ms)]),
    row("attitude_age", Kind::Span, "s", "Age of the newest attitude when the frame was planned", |f| Fact::Span(f.meta.attitude_age))
        .fits(Part::Making, &[Card("AGE_MS", Ms, "[ms] age of the newest attitude")])
        .csv(&[Column("attitude_age_ns", Ns)])
        .chunk(&[feature(14, "ChunkAttitudeAge", Integer, Ns, "ns", "Age of the newest attitude when the frame was planned")])
        .live(&[Key("attitude_age_ms", Ms)])
        .control_meta(&[Key("attitude_age_s", Plain)]),
    row("horizon", Kind::Span, "s", "Newest attitude to mid-exposure; negative when interpolated", |f| Fact::Span(f.meta.horizon))
        .fits(Part::Making, &[Card("HORIZ_MS", Ms, "[ms] newest attitude to mid-exposure")])
        .csv(&[Column("horizon_ns", Ns)])
        .memory(24, I64, Ns)
        .chunk(&[feature(15, "ChunkHorizon", Integer, Ns, "ns", "Newest attitude to mid-exposure; negative when interpolated")])
        .live(&[Key("horizon_ms", Ms)])
        .control_meta(&[Key("horizon_s", Plain)]),
    row("end_horizon", Kind::Span, "s", "Newest attitude to the end of the exposure; negative when interpolated", |f| Fact::Span(f.meta.end_horizon))
        .fits(Part::Making, &[Card("ENDHZ_MS", Ms, "[ms] newest attitude to end of exposure")])
        .csv(&[Column("end_horizon_ns", Ns)]),
    row("is_partly_extrapolated", Kind::Flag, "", "Two or more attitudes were missing at an end of the exposure, whose middle was interpolated", |f| Fact::Flag(f.meta.is_partly_extrapolated))
        .fits(Part::Making, &[Card("PARTEXTR", Plain, "an end of the exposure is extrapolated")])
        .csv(&[Column("partly_extrapolated", Plain)]),
    row("residual_arcsec", Kind::Real, "arcsec", "Largest motion in the exposure beyond rate and acceleration", |f| Fact::Real(f.meta.residual_arcsec))
        .fits(Part::Making, &[Card("RESIDAS", Plain, "[arcsec] motion beyond rate, acceleration")])
        .csv(&[Column("residual_arcsec", Plain)]),
    row("jitter_missing", Kind::Span, "s", "Part of the exposure without jitter samples", |f| Fact::Span(f.meta.jitter_missing))
        .fits(Part::Making, &[Card("JITMIS", Ms, "[ms] of exposure without jitter samples")])
        .csv(&[Column("jitter_missing_ns", Ns)])
        .memory(168, I64, Ns)
        .chunk(&[feature(23, "ChunkJitterMissing", Integer, Ns, "ns", "Part of the exposure without jitter samples")]),
    row("backend", Kind::Text, "", "Render backend", |f| Fact::Text(f.meta.backend))
        .fits(Part::Making, &[Card("BACKEND", Plain, "render backend")])
        .csv(&[Column("backend", Plain)])
        .live(&[Key("backend", Plain)])
        .control_meta(&[Key("backend", Plain)]),
    row("method", Kind::Text, "", "Smear method", |f| Fact::Text(f.meta.method.name()))
        .fits(Part::Making, &[Card("METHOD", Plain, "smear method")])
        .csv(&[Column("method", Plain)])
        .live(&[Key("method", Plain)])
        .control_meta(&[Key("method", Plain)]),
    row("rung", Kind::Text, "", "How far the frame was degraded to be ready in time; `full`: not at all", |f| Fact::Text(f.meta.degradation.name()))
        .fits(Part::Making, &[Card("RUNG", Plain, "degraded so far to be in time")])
        .csv(&[Column("rung", Plain)])
        .chunk(&[feature(21, "ChunkRung", Text, Plain, "", "How far the frame was degraded to be ready in time; full: not at all")])
        .live(&[Key("rung", Plain)])
        .control_meta(&[Key("rung", Plain)]),
    row("left_out_stars", Kind::Count, "", "Stars left out: too faint, or for want of time", |f| Fact::Count(f.meta.left_out_stars))
        .fits(Part::Making, &[Card("NLEFTOUT", Plain, "stars left out")])
        .csv(&[Column("left_out_stars", Plain)])
        .chunk(&[feature(19, "ChunkLeftOutStars", Integer, Plain, "", "Stars left out: too faint, or for want of time")])
        .live(&[Key("left_out_stars", Plain)]),
    row("left_out_e", Kind::Real, "e-", "Electrons of the stars left out", |f| Fact::Real(f.meta.left_out_e))
        .fits(Part::Making, &[Card("LEFTOUTE", Plain, "[e-] of the stars left out")])
        .csv(&[Column("left_out_e", Plain)]),
    row("occulted_stars", Kind::Count, "", "Stars behind the Earth or the Moon", |f| Fact::Count(f.meta.occulted_stars))
        .fits(Part::Making, &[Card("NOCCULT", Plain, "stars behind Earth or Moon")])
        .csv(&[Column("occulted_stars", Plain)]),
    row("overlap_lost_e", Kind::Real, "e-", "Electrons lost where targets cover stars", |f| Fact::Real(f.meta.overlap_lost_e))
        .fits(Part::Making, &[Card("OVLOSTE", Plain, "[e-] lost where targets cover stars")])
        .csv(&[Column("overlap_lost_e", Plain)]),
    row("origin", Kind::Text, "", "Where the attitude came from: measured, predicted, held", |f| Fact::Text(f.meta.origin.name()))
        .fits(Part::Making, &[Card("ORIGIN", Plain, "of the attitude")])
        .csv(&[Column("origin", Plain)])
        .chunk(&[feature(20, "ChunkAttitudeOrigin", Text, Plain, "", "Where the attitude came from: measured, predicted, held")])
        .live(&[Key("origin", Plain)])
        .control_meta(&[Key("origin", Plain)]),
    row("faults", Kind::Faults, "", "Commanded faults active in the frame: names joined by `+`, or one bit each", |f| Fact::Faults(f.meta.faults))
        .fits(Part::Making, &[Card("FAULTS", Plain, "active faults"), Card("FAULTBIT", Bits, "active faults as bits")])
        .csv(&[Column("faults", Plain)])
        .memory(40, U32, Bits)
        .chunk(&[feature(16, "ChunkFaults", BitField, Bits, "", "Commanded faults, one bit each, as in frames.csv")])
        .live(&[Key("fault_flags", Names)])
        .control(&[Key("faults", Names)]),
    row("active", Kind::Active, "", "Faults of frames and of the imaging chain, each with its number in the run's list and its amount; or how many", |f| Fact::Active(&f.meta.active))
        .fits(Part::Making, &[Card("NFAULTS", Number, "faults of frames and imaging, numbers below"), Card("FLT", Plain, "commanded fault")])
        .csv(&[Column("active_faults", Plain)])
        .chunk(&[feature(17, "ChunkFaultCount", Integer, Number, "", "Faults of frames and of the imaging chain in this frame")])
        .live(&[Key("faults", Plain), Key("fault_count", Number)]),
    row("camera", Kind::Text, "", "Camera name", |f| Fact::Text(&f.meta.camera))
        .fits(Camera, &[Card("INSTRUME", Plain, "camera")])
        .csv(&[Column("camera", Plain)])
        .live(&[Key("camera", Plain)])
        .control_meta(&[Key("camera", Plain)]),
    row("gain_e_per_dn", Kind::Real, "e-/DN", "Detector gain; no number where the image is codes of luminance for a display", |f| Fact::Real(f.meta.gain_e_per_dn))
        .fits(Part::Making, &[Card("GAIN", Finite, "[e-/DN]")])
        .csv(&[Column("gain_e_per_dn", Plain)])
        .memory(136, F64, Plain)
        .control_meta(&[Key("gain_e_per_dn", Plain)]),
    row("dn_kind", Kind::Text, "", "`LUMCODE` where the image is codes of luminance", |f| if f.meta.gain_e_per_dn.is_finite() { Fact::Absent } else { Fact::Text("LUMCODE") })
        .fits(Part::Making, &[Card("DNKIND", Plain, "codes of luminance, not in proportion to light")]),
    row("black_level_dn", Kind::Real, "DN", "Black level", |f| Fact::Real(f.meta.black_level_dn))
        .fits(Part::Making, &[Card("BLACKLVL", Plain, "[DN] black level")])
        .csv(&[Column("black_level_dn", Plain)])
        .memory(144, F64, Plain)
        .chunk(&[feature(27, "ChunkBlackLevel", Float, Plain, "DN", "Black level")])
        .control_meta(&[Key("black_level_dn", Plain)]),
    row("binning", Kind::U32, "", "Sensor pixels of one image pixel along each side, where there are several", |f| if f.meta.binning > 1 { Fact::U32(f.meta.binning) } else { Fact::Absent })
        .fits(Part::Making, &[
            Card("XBINNING", Plain, "sensor pixels per pixel, along rows"), Card("YBINNING", Plain, "sensor pixels per pixel, along columns"),
        ]),
    row("window_px", Kind::Wholes(2), "px", "First sensor column and row of the image, where it is not the corner", |f| if f.meta.window_px == [0; 2] { Fact::Absent } else { Fact::Wholes(&f.meta.window_px) })
        .fits(Part::Making, &[Card("WINDOW_X", Plain, "[px] first sensor column, from 0"), Card("WINDOW_Y", Plain, "[px] first sensor row, from 0")]),
    row("regions", Kind::Regions, "px", "Parts of the image that were read out, each as left, top, width, height, from 0: all other pixels are 0; none: all of it was", |f| Fact::Regions(&f.meta.regions))
        .fits(Part::Making, &[Card("NREGIONS", Number, "parts of the image that were read out"), Card("REGION", Plain, "[px] left,top,width,height, from 0")])
        .live(&[Key("regions", Plain)])
        .control_meta(&[Key("regions", Plain)]),
    row("row_order", Kind::Text, "", "Order of the rows", |_| Fact::Text("TOP-DOWN"))
        .fits(Part::Making, &[Card("ROWORDER", Plain, "first row is the top; FITS pixel = px + 1")]),
    row("pixel_pitch_um", Kind::Real, "um", "Width and height of a pixel of the image, binned", |f| of_camera(f, |facts| facts.pixel_pitch_um * f64::from(f.meta.binning)))
        .fits(Optics, &[Card("XPIXSZ", Plain, "[um] width of a pixel of the image, binned"), Card("YPIXSZ", Plain, "[um] height of a pixel of the image, binned")]),
    row("focal_length_mm", Kind::Real, "mm", "Focal length", |f| of_camera(f, |facts| facts.focal_length_mm))
        .fits(Optics, &[Card("FOCALLEN", Plain, "[mm] focal length")]),
    row("drawn_to_mag_g", Kind::Real, "mag", "Gaia G magnitude of the faintest stars that are drawn", |f| of_camera(f, |facts| facts.drawn_to_mag_g))
        .fits(Optics, &[Card("MAGLIM", Plain, "[mag] Gaia G of the faintest stars drawn")]),
    row("saturation_dn", Kind::Real, "DN", "Number at which a pixel saturates", |f| of_camera(f, |facts| facts.saturation_dn))
        .fits(Detector, &[Card("SATURATE", Plain, "[DN] a pixel saturates")]),
    row("read_noise_e_rms", Kind::Real, "e-", "Read noise of one pixel of the image, rms", |f| of_camera(f, |facts| facts.read_noise_e_rms))
        .fits(Detector, &[Card("RDNOISE", Plain, "[e-] rms of one pixel")]),
    row("detector_temperature_c", Kind::Real, "Celsius", "Temperature of the detector", |f| of_camera(f, |facts| facts.temperature_c))
        .fits(Detector, &[Card("CCD-TEMP", Plain, "[Celsius] temperature of the detector")])
        .chunk(&[feature(28, "ChunkDetectorTemperature", Float, Plain, "C", "Temperature of the detector")]),
    row("test_pattern", Kind::Text, "", "Test pattern in place of the image, as a client of the network camera chose it; `Off`: the image is the detector's", |f| Fact::Text(f.meta.test_pattern))
        .chunk(&[feature(29, "ChunkTestPattern", Text, Plain, "", "Test pattern in place of the image; Off: the image is that of the detector")]),
    row("colours", Kind::Text, "", "Colours of the image's first two rows from its first pixel, where its pixels have filters: `RGGB`, `GRBG`, `GBRG`, `BGGR`", |f| colours(f).map_or(Fact::Absent, |pattern| Fact::Text(pattern.name())))
        .fits(Detector, &[Card("BAYERPAT", Plain, "colours from the first pixel of the image")])
        .control_meta(&[Key("colours", Plain)]),
    row("colours_offset_px", Kind::Wholes(2), "px", "Column and row of the image at which its colours begin: always the first", |f| colours(f).map_or(Fact::Absent, |_| Fact::Wholes(&[0; 2])))
        .fits(Detector, &[Card("XBAYROFF", Plain, "[px] column where BAYERPAT begins"), Card("YBAYROFF", Plain, "[px] row where BAYERPAT begins")]),
    row("width_px", Kind::Count, "px", "Columns of the image", |f| of_frame(f, |frame| frame.image.width()))
        .csv(&[Column("width_px", Plain)])
        .memory(152, U32, Plain)
        .control(&[Key("width", Plain)]),
    row("height_px", Kind::Count, "px", "Rows of the image", |f| of_frame(f, |frame| frame.image.height()))
        .csv(&[Column("height_px", Plain)])
        .memory(156, U32, Plain)
        .control(&[Key("height", Plain)]),
    row("stars", Kind::Count, "", "Rows of the truth table", |f| of_frame(f, |frame| frame.truth.len()))
        .fits(Detector, &[Card("NSTARS", Plain, "stars in the truth table")])
        .csv(&[Column("stars", Plain)])
        .memory(44, U32, Plain)
        .live(&[Key("stars", Plain)])
        .control_meta(&[Key("stars", Plain)]),
    row("pixel_crc32", Kind::U32, "", "CRC-32 of the pixels, DN as little-endian 16-bit words, row by row", |f| f.pixel_crc32.map_or(Fact::Absent, Fact::U32))
        .fits(Detector, &[Card("PIXCRC32", Plain, "CRC-32 of the DN, little-endian, row by row")])
        .csv(&[Column("pixel_crc32", Hex)])
        .memory(36, U32, Plain)
        .control(&[Key("crc32", Hex)]),
];

/// Returns a number of the camera, where the image is that of its own detector.
fn of_camera<'a>(source: &FactSource<'a>, number: impl Fn(&CameraFacts) -> f64) -> Fact<'a> {
    source.meta.facts.as_ref().map_or(Fact::Absent, |facts| Fact::Real(number(facts)))
}

/// Returns the colours of the image's pixels, where they have any.
fn colours(source: &FactSource<'_>) -> Option<BayerPattern> {
    source.meta.facts.as_ref().and_then(|facts| facts.colours)
}

/// Returns a number of the whole frame, where it is there.
fn of_frame<'a>(source: &FactSource<'a>, count: impl Fn(&SentFrame) -> usize) -> Fact<'a> {
    source.frame.map_or(Fact::Absent, |frame| Fact::Count(count(frame)))
}
