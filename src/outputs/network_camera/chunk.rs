//! A frame's truth as chunk data: one chunk of fixed layout, behind the image, described in the XML by name.
//!
//! ```text
//! image bytes, id 1, length | truth bytes, id 2, length        all big-endian; read from the end
//! ```
//!
//! [`FIELDS`] is the layout: the XML is written from it and so are the bytes. Times are TAI since 1970, ns.

use frames::sink::FrameMeta;

/// Chunk of the image.
pub(super) const IMAGE_ID: u32 = 1;
/// Chunk of the truth.
pub(super) const TRUTH_ID: u32 = 2;
/// Identifier and length behind each chunk's data.
pub(super) const TAG_BYTES: usize = 8;
/// Bytes of a text field.
const TEXT_BYTES: usize = 24;

/// How a field is stored.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum FieldKind {
    /// Whole number, signed, 8 bytes.
    Integer,
    /// Whole number without sign, 8 bytes; clients show it as GenICam's signed integer of the same bits.
    Bits,
    /// Number, double precision.
    Float,
    /// Text, padded with zeros.
    Text,
}

impl FieldKind {
    /// Bytes that it takes.
    pub(super) const fn bytes(self) -> usize {
        match self {
            Self::Text => TEXT_BYTES,
            Self::Integer | Self::Bits | Self::Float => 8,
        }
    }
}

/// A field's value.
enum Value<'a> {
    Integer(i64),
    Bits(u64),
    Float(f64),
    Text(&'a str),
}

/// One field of the truth.
pub(super) struct Field {
    /// Name of the feature.
    pub(super) name: &'static str,
    /// How it is stored.
    pub(super) kind: FieldKind,
    /// Unit; empty for none.
    pub(super) unit: &'static str,
    /// What it is.
    pub(super) about: &'static str,
    value: fn(&FrameMeta) -> Value<'_>,
}

macro_rules! fields {
    ($($name:literal $kind:ident $unit:literal $about:literal = $value:expr;)*) => {
        /// The truth, in order.
        pub(super) const FIELDS: &[Field] = &[$(Field {
            name: $name, kind: FieldKind::$kind, unit: $unit, about: $about, value: |meta| Value::$kind($value(meta)),
        }),*];
    };
}

fields! {
    "ChunkFrameID" Integer "" "Frame number in the run" = |m: &FrameMeta| i64::from(m.number);
    "ChunkTimestamp" Integer "ns" "Middle of the exposure, TAI since 1970" = |m: &FrameMeta| m.mid_exposure.ns();
    "ChunkExposureTime" Float "us" "Integration time" = |m: &FrameMeta| m.exposure_s * 1e6;
    "ChunkAttitudeW" Float "" "Quaternion sensor from ICRF, Hamilton, passive: scalar part" = |m: &FrameMeta| m.attitude_wxyz[0];
    "ChunkAttitudeX" Float "" "Quaternion: x" = |m: &FrameMeta| m.attitude_wxyz[1];
    "ChunkAttitudeY" Float "" "Quaternion: y" = |m: &FrameMeta| m.attitude_wxyz[2];
    "ChunkAttitudeZ" Float "" "Quaternion: z" = |m: &FrameMeta| m.attitude_wxyz[3];
    "ChunkRightAscension" Float "deg" "Right ascension of the boresight" = |m: &FrameMeta| m.ra_deg;
    "ChunkDeclination" Float "deg" "Declination of the boresight" = |m: &FrameMeta| m.dec_deg;
    "ChunkRoll" Float "deg" "Position angle of image up, east of north" = |m: &FrameMeta| m.roll_deg;
    "ChunkRateX" Float "deg/s" "Angular rate about image right" = |m: &FrameMeta| m.rate_deg_s[0];
    "ChunkRateY" Float "deg/s" "Angular rate about image down" = |m: &FrameMeta| m.rate_deg_s[1];
    "ChunkRateZ" Float "deg/s" "Angular rate about the boresight" = |m: &FrameMeta| m.rate_deg_s[2];
    "ChunkLateness" Integer "ns" "Completion minus deadline; negative when early" = |m: &FrameMeta| m.lateness.ns();
    "ChunkAttitudeAge" Integer "ns" "Age of the newest attitude when the frame was planned" = |m: &FrameMeta| m.attitude_age.ns();
    "ChunkHorizon" Integer "ns" "Newest attitude to mid-exposure; negative when interpolated" = |m: &FrameMeta| m.horizon.ns();
    "ChunkFaults" Bits "" "Commanded faults, one bit each, as in frames.csv" = |m: &FrameMeta| u64::from(m.faults.bits());
    "ChunkFaultCount" Integer "" "Faults of frames and of the imaging chain in this frame" = |m: &FrameMeta| count(m.active.count());
    "ChunkSeed" Bits "" "Seed of the sensor's patterns and of faults" = |m: &FrameMeta| m.seed;
    "ChunkLeftOutStars" Integer "" "Stars left out: too faint, or for want of time" = |m: &FrameMeta| count(m.left_out_stars);
    "ChunkAttitudeOrigin" Text "" "Where the attitude came from: measured, predicted, held" = |m: &FrameMeta| m.origin;
    "ChunkRung" Text "" "How far the frame was degraded to be ready in time; full: not at all" = |m: &FrameMeta| m.rung;
    "ChunkNoiseSeed" Bits "" "Seed of the exposure's noise, with the frame number" = |m: &FrameMeta| m.noise_seed;
    "ChunkJitterMissing" Integer "ns" "Part of the exposure without jitter samples" = |m: &FrameMeta| m.jitter_missing.ns();
}

fn count(count: usize) -> i64 {
    i64::try_from(count).unwrap_or(i64::MAX)
}

/// Bytes of the truth without its tag.
pub(super) fn truth_bytes() -> usize {
    FIELDS.iter().map(|field| field.kind.bytes()).sum()
}

/// Bytes that chunk data adds to the image: the image's tag, the truth and its tag.
pub(super) fn added_bytes() -> usize {
    TAG_BYTES + truth_bytes() + TAG_BYTES
}

/// Appends what stands behind an image of so many bytes.
pub(super) fn append_chunks(meta: &FrameMeta, image_bytes: usize, out: &mut Vec<u8>) {
    append_tag(IMAGE_ID, image_bytes, out);
    let start = out.len();
    for field in FIELDS {
        match (field.value)(meta) {
            Value::Integer(value) => out.extend(value.to_be_bytes()),
            Value::Bits(value) => out.extend(value.to_be_bytes()),
            Value::Float(value) => out.extend(value.to_be_bytes()),
            Value::Text(text) => append_text(text, out),
        }
    }
    append_tag(TRUTH_ID, out.len() - start, out);
}

fn append_tag(id: u32, length: usize, out: &mut Vec<u8>) {
    out.extend(id.to_be_bytes());
    out.extend(u32::try_from(length).unwrap_or(u32::MAX).to_be_bytes());
}

/// At most [`TEXT_BYTES`] less a closing zero.
fn append_text(text: &str, out: &mut Vec<u8>) {
    let end = out.len() + TEXT_BYTES;
    out.extend(text.bytes().take(TEXT_BYTES - 1));
    out.resize(end, 0);
}

#[cfg(test)]
mod tests {
    use super::*;
    use frames::sink::sample::sample_frame;

    #[test]
    fn the_truth_reads_back_at_the_places_the_table_tells() {
        let meta = sample_frame(77).meta;
        let mut out = vec![9; 5];
        append_chunks(&meta, 5, &mut out);
        assert_eq!(out.len(), 5 + added_bytes());
        let truth = &out[5 + TAG_BYTES..][..truth_bytes()];
        let at = |name: &str| {
            let before = FIELDS.iter().take_while(|field| field.name != name);
            before.map(|field| field.kind.bytes()).sum::<usize>()
        };
        let float = |name| f64::from_be_bytes(truth[at(name)..][..8].try_into().unwrap());
        let integer = |name| i64::from_be_bytes(truth[at(name)..][..8].try_into().unwrap());
        assert_eq!((integer("ChunkFrameID"), integer("ChunkTimestamp")), (77, meta.mid_exposure.ns()));
        assert_eq!((float("ChunkAttitudeZ"), float("ChunkRateZ")), (meta.attitude_wxyz[3], meta.rate_deg_s[2]));
        assert_eq!(integer("ChunkSeed"), -78, "the bits of the largest numbers");
        assert_eq!(&truth[at("ChunkRung")..][..10], b"budget-x3\0");
        assert_eq!(integer("ChunkNoiseSeed"), i64::MAX - 77, "the seed of the exposure, which FITS calls NOISSEED");
        assert_eq!(integer("ChunkJitterMissing"), 14_000_000);
        assert_eq!(&out[5..13], [0, 0, 0, 1, 0, 0, 0, 5]);
        assert_eq!(out[out.len() - 4..], u32::try_from(truth_bytes()).unwrap().to_be_bytes());
    }
}
