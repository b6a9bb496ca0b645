//! A frame's truth as chunk data: one chunk of fixed layout, behind the image, described in the XML by name.
//!
//! ```text
//! image bytes, id 1, length | truth bytes, id 2, length        all big-endian; read from the end
//! ```
//!
//! [`FIELDS`] is the layout, taken from [`frames::sink::facts`]: the XML is written from it and so are the bytes. Times
//! are TAI since 1970, ns.

use frames::sink::FrameMeta;
use frames::sink::facts::{FactSource, Feature, FeatureKind, Row, TABLE};

/// Chunk of the image.
pub(super) const IMAGE_ID: u32 = 1;
/// Chunk of the truth.
pub(super) const TRUTH_ID: u32 = 2;
/// Identifier and length behind each chunk's data.
pub(super) const TAG_BYTES: usize = 8;
/// Bytes of a text field.
const TEXT_BYTES: usize = 24;

/// One field of the truth.
#[derive(Clone, Copy)]
pub(super) struct Field {
    /// Its name, storage, unit and meaning.
    pub(super) feature: Feature,
    /// Which element of the row's value it is.
    element: usize,
    row: &'static Row,
}

impl Field {
    /// Returns the bytes that it takes.
    pub(super) const fn bytes(&self) -> usize {
        match self.feature.kind {
            FeatureKind::Text => TEXT_BYTES,
            FeatureKind::Integer | FeatureKind::Bits | FeatureKind::Float => 8,
        }
    }

    fn append(&self, source: &FactSource<'_>, out: &mut Vec<u8>) {
        let value = (self.row.value)(source).element(self.element, self.feature.form);
        match self.feature.kind {
            FeatureKind::Integer => out.extend(i64::try_from(value.whole()).unwrap_or(i64::MAX).to_be_bytes()),
            FeatureKind::Bits => out.extend(u64::try_from(value.whole()).unwrap_or(u64::MAX).to_be_bytes()),
            FeatureKind::Float => out.extend(value.real().to_be_bytes()),
            FeatureKind::Text => append_text(value.text(), out),
        }
    }
}

/// The truth, by place.
pub(super) const FIELDS: [Field; field_count()] = fields();

const fn field_count() -> usize {
    let (mut count, mut row) = (0, 0);
    while row < TABLE.len() {
        count += TABLE[row].chunk.len();
        row += 1;
    }
    count
}

/// Returns every field of the table. A wrong number of fields does not compile; a test of the table finds a gap.
const fn fields() -> [Field; field_count()] {
    let first = Field { feature: TABLE[0].chunk[0], element: 0, row: &TABLE[0] };
    let mut fields = [first; field_count()];
    let mut at = 0;
    while at < TABLE.len() {
        let row: &'static Row = &TABLE[at];
        let mut element = 0;
        while element < row.chunk.len() {
            let feature = row.chunk[element];
            fields[feature.place] = Field { feature, element, row };
            element += 1;
        }
        at += 1;
    }
    fields
}

/// Returns bytes of the truth without its tag.
pub(super) fn truth_bytes() -> usize {
    FIELDS.iter().map(Field::bytes).sum()
}

/// Returns the number of bytes that chunk data adds to the image: the image's tag, the truth and its tag.
pub(super) fn added_bytes() -> usize {
    TAG_BYTES + truth_bytes() + TAG_BYTES
}

/// Appends the chunks behind an image of so many bytes.
pub(super) fn append_chunks(meta: &FrameMeta, image_bytes: usize, out: &mut Vec<u8>) {
    append_tag(IMAGE_ID, image_bytes, out);
    let start = out.len();
    let source = FactSource::of_meta(meta);
    for field in &FIELDS {
        field.append(&source, out);
    }
    append_tag(TRUTH_ID, out.len() - start, out);
}

fn append_tag(id: u32, length: usize, out: &mut Vec<u8>) {
    out.extend(id.to_be_bytes());
    out.extend(u32::try_from(length).unwrap_or(u32::MAX).to_be_bytes());
}

/// Appends at most [`TEXT_BYTES`], filled up with zeros.
fn append_text(text: &str, out: &mut Vec<u8>) {
    let end = out.len() + TEXT_BYTES;
    out.extend(text.bytes().take(TEXT_BYTES));
    out.resize(end, 0);
}

#[cfg(test)]
mod tests {
    use super::*;
    use frames::sink::sample::sample_frame;

    #[test]
    fn the_truth_reads_back_at_the_places_of_the_table() {
        let meta = sample_frame(77).meta;
        let mut out = vec![9; 5];
        append_chunks(&meta, 5, &mut out);
        assert_eq!(out.len(), 5 + added_bytes());
        let truth = &out[5 + TAG_BYTES..][..truth_bytes()];
        let at = |name: &str| {
            let before = FIELDS.iter().take_while(|field| field.feature.name != name);
            before.map(Field::bytes).sum::<usize>()
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
