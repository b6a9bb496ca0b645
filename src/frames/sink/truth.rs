//! The truth table of one frame: which stars are in it, and where.
//!
//! CSV with the columns of [`COLUMNS`]. Pixels and degrees have nine decimals (1e-9 px; 3.6 microarcsec), magnitude and
//! electrons the fewest digits that read back exactly; a value that is unknown, or not finite, is an empty field.

use crate::sink::SinkError;
use crate::sink::frame::{TruthKind, TruthStar};
use base::refused::Refused;
use core::fmt;
use std::io::{self, Read, Write};

/// Every column in order, with its meaning.
pub const COLUMNS: [(&str, &str); 13] = [
    ("id", "row of the star in the catalog; false stars, targets, bodies and tracks have ranges of their own"),
    (
        "apparent_ra_deg",
        "right ascension in which it is seen at mid-exposure, with aberration and deflection (ICRF axes)",
    ),
    ("apparent_dec_deg", "declination in which it is seen"),
    (
        "catalog_ra_deg",
        "right ascension of its catalog place: ICRS at the epoch of the frame, space motion and parallax applied, without aberration and deflection",
    ),
    ("catalog_dec_deg", "declination of its catalog place"),
    (
        "mag",
        "magnitude in the instrument's band (not G); empty where there is none, and for a target that is dark at mid-exposure",
    ),
    ("x_px", "mean column over the exposure; the first pixel's centre is 0"),
    ("y_px", "mean row over the exposure, down"),
    ("electrons", "electrons collected in the exposure, mean, before noise"),
    ("kind", "star, target, false_star, planet, moon, earth or proton_track"),
    ("smear_px", "length of its path over the image during the exposure: slew, jitter, a target's own motion"),
    ("smear_deg", "direction from the start of that path to its end, from columns towards rows"),
    (
        "source_id",
        "its name in the catalog that the star was taken from, such as Gaia DR3 4472832130942575872, HIP 87937 or TYC 1-13-1, or the number in a catalog of one's own; empty when it has none",
    ),
];

/// Contents of the last column.
const SOURCE_ID: &str = "a name such as Gaia DR3 4472832130942575872, HIP 87937 or TYC 1-13-1, a number, or nothing";

/// Returns the first line of a table.
fn header() -> String {
    COLUMNS.map(|(name, _)| name).join(",")
}

/// Nine decimals; nothing for a number that is not finite.
struct Nine(f64);

impl fmt::Display for Nine {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        if self.0.is_finite() { write!(f, "{:.9}", self.0) } else { Ok(()) }
    }
}

/// The fewest digits that read back; nothing for a number that is not finite.
struct Exact<T>(T);

impl<T: fmt::Display + Copy + Into<f64>> fmt::Display for Exact<T> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        if self.0.into().is_finite() { self.0.fmt(f) } else { Ok(()) }
    }
}

/// Writes one line per star.
///
/// # Errors
/// When the output fails.
pub fn write_truth(mut out: impl Write, stars: &[TruthStar]) -> io::Result<()> {
    writeln!(out, "{}", header())?;
    for s in stars {
        let TruthStar {
            id,
            apparent_deg,
            catalog_deg,
            mag,
            x_px,
            y_px,
            electrons,
            kind,
            smear_px,
            smear_deg,
            source_id,
        } = *s;
        let ([a, b], [c, d]) = (apparent_deg.map(Nine), catalog_deg.map(Nine));
        let (mag, electrons, kind) = (Exact(mag), Exact(electrons), kind.name());
        let [x_px, y_px, smear_px, smear_deg] = [x_px, y_px, smear_px, smear_deg].map(Nine);
        write!(out, "{id},{a},{b},{c},{d},{mag},{x_px},{y_px},{electrons},{kind},{smear_px},{smear_deg},")?;
        match source_id {
            Some(name) => writeln!(out, "{name}")?,
            None => writeln!(out)?,
        }
    }
    out.flush()
}

/// Reads a truth table back.
///
/// # Errors
/// A refusal with the line when the header or a value is not as written by [`write_truth`].
pub fn read_truth(input: impl Read) -> Result<Vec<TruthStar>, SinkError> {
    let mut reader = csv::Reader::from_reader(input);
    let header = reader.headers().map_err(|e| bad(1, "a header", &e.to_string()))?;
    if !header.iter().eq(COLUMNS.iter().map(|(name, _)| *name)) {
        return Err(bad(
            1,
            "the columns of a truth table, from id to source_id",
            &header.iter().collect::<Vec<_>>().join(","),
        ));
    }
    reader
        .into_records()
        .map(|record| read_star(&record.map_err(|e| bad(line_of(&e), "as many values as columns", &e.to_string()))?))
        .collect()
}

fn read_star(record: &csv::StringRecord) -> Result<TruthStar, SinkError> {
    let line = record.position().map_or(0, csv::Position::line);
    let number = |column: usize| -> Result<f64, SinkError> {
        let text = record.get(column).unwrap_or("");
        if text.is_empty() { Ok(f64::NAN) } else { text.parse().map_err(|_| bad(line, "a number", text)) }
    };
    let id = record.get(0).unwrap_or("");
    let mag = record.get(5).unwrap_or("");
    let kind = record.get(9).unwrap_or("");
    let name = record.get(12).unwrap_or("");
    let named = TruthKind::NAMED.iter().find(|(name, _)| *name == kind);
    Ok(TruthStar {
        id: id.parse().map_err(|_| bad(line, "a catalog identifier", id))?,
        apparent_deg: [number(1)?, number(2)?],
        catalog_deg: [number(3)?, number(4)?],
        mag: if mag.is_empty() { f32::NAN } else { mag.parse().map_err(|_| bad(line, "a magnitude", mag))? },
        x_px: number(6)?,
        y_px: number(7)?,
        electrons: number(8)?,
        kind: named.map(|(_, kind)| *kind).ok_or_else(|| bad(line, "a kind of source such as star", kind))?,
        smear_px: number(10)?,
        smear_deg: number(11)?,
        source_id: if name.is_empty() { None } else { Some(name.parse().map_err(|_| bad(line, SOURCE_ID, name))?) },
    })
}

fn line_of(error: &csv::Error) -> u64 {
    error.position().map_or(0, csv::Position::line)
}

fn bad(line: u64, wanted: &'static str, got: &str) -> SinkError {
    Refused(format!("truth table, line {line}: wanted {wanted}, got {got}")).into()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::sink::sample::sample_frame;
    use proptest::prelude::*;

    /// Half of the last of nine decimals, plus one rounding of a number below 1e5.
    const NINE_DECIMALS: f64 = 0.5e-9 + 1.5e-11;

    fn round_trip(stars: &[TruthStar]) -> Vec<TruthStar> {
        let mut bytes = Vec::new();
        write_truth(&mut bytes, stars).unwrap();
        read_truth(bytes.as_slice()).unwrap()
    }

    #[test]
    fn the_header_and_a_line_are_as_documented() {
        let mut bytes = Vec::new();
        write_truth(&mut bytes, &sample_frame(0).truth[..1]).unwrap();
        let text = String::from_utf8(bytes).unwrap();
        let places = "37.954560671,89.264109444,37.961234567,89.263987654";
        let line = format!("424,{places},1.98,12.345678901,-0.250000000,0.30000000000000004");
        let columns = "id,apparent_ra_deg,apparent_dec_deg,catalog_ra_deg,catalog_dec_deg,mag,x_px,y_px,electrons,kind,\
                       smear_px,smear_deg,source_id";
        assert_eq!(text, format!("{columns}\n{line},star,0.000000000,0.000000000,\n"));
    }

    #[test]
    fn numbers_that_are_not_finite_are_empty_fields() {
        let track = TruthStar { apparent_deg: [f64::NAN; 2], mag: f32::INFINITY, ..sample_frame(0).truth[0] };
        let mut bytes = Vec::new();
        write_truth(&mut bytes, &[track]).unwrap();
        assert!(String::from_utf8(bytes).unwrap().contains("\n424,,,37.961234567,89.263987654,,12.3"));
        let read = round_trip(&[track])[0];
        assert!(read.apparent_deg[0].is_nan() && read.mag.is_nan() && read.catalog_deg == track.catalog_deg);
    }

    #[test]
    fn every_column_is_documented_in_the_guide() {
        let page = include_str!("../../guide/first_frames.md");
        for (name, meaning) in COLUMNS {
            assert!(
                page.contains(&format!("| `{name}` | {meaning} |")),
                "first_frames.md lacks: | `{name}` | {meaning} |"
            );
        }
    }

    #[test]
    fn kinds_and_smears_read_back() {
        for (name, kind) in TruthKind::NAMED {
            assert_eq!(kind.name(), name);
            let star = TruthStar { kind, smear_px: 2.5, smear_deg: -53.25, ..sample_frame(0).truth[0] };
            assert_eq!(round_trip(&[star]), [star]);
        }
        for name in ["Gaia DR3 4472832130942575872", "HIP 87937", "TYC 1-13-1", "-5"] {
            let star = TruthStar { source_id: name.parse().ok(), ..sample_frame(0).truth[0] };
            assert!(star.source_id.is_some());
            assert_eq!(round_trip(&[star]), [star]);
        }
    }

    #[test]
    fn bad_tables_name_the_line() {
        let line = |text: &str| read_truth(text.as_bytes()).unwrap_err().to_string();
        assert!(line("id,ra\n1,2\n").contains("line 1"), "{}", line("id,ra\n1,2\n"));
        let header = header();
        let text = format!("{header}\n1,2,3,2,3,4,5,6,7,star,0,0,\n1,2,three,2,3,4,5,6,7,star,0,0,\n");
        assert!(line(&text).contains("line 3") && line(&text).contains("three"), "{}", line(&text));
        assert!(line(&format!("{header}\n1,2\n")).contains("line 2"));
        let comet = line(&format!("{header}\n1,2,3,2,3,4,5,6,7,comet,0,0,\n"));
        let name = line(&format!("{header}\n1,2,3,2,3,4,5,6,7,star,0,0,Barnard\n"));
        assert!(name.contains("line 2") && name.contains("HIP 87937") && name.contains("Barnard"), "{name}");
        assert!(comet.contains("line 2") && comet.contains("comet"), "{comet}");
    }

    proptest! {
        #[test]
        fn stars_read_back(id in any::<u32>(), x_px in -1e4..1e5, ra_deg in 0.0..360.0_f64, electrons in any::<f64>(), mag in any::<f32>()) {
            prop_assume!(electrons.is_finite() && mag.is_finite());
            let (apparent_deg, catalog_deg) = ([ra_deg, -ra_deg / 4.0], [ra_deg / 2.0, ra_deg / 8.0]);
            let star = TruthStar { id, apparent_deg, catalog_deg, mag, x_px, y_px: -x_px, electrons, ..TruthStar::NONE };
            let read = round_trip(&[star])[0];
            prop_assert_eq!((read.id, read.mag, read.electrons), (id, mag, electrons));
            prop_assert!((read.x_px - x_px).abs() <= NINE_DECIMALS && (read.y_px + x_px).abs() <= NINE_DECIMALS);
            for (read, wanted) in read.apparent_deg.into_iter().chain(read.catalog_deg).zip(apparent_deg.into_iter().chain(catalog_deg)) {
                prop_assert!((read - wanted).abs() <= NINE_DECIMALS);
            }
        }
    }
}
