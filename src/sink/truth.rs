//! The truth table of one frame: which stars are in it, and where.
//!
//! CSV with the header [`HEADER`]. Pixels and degrees have nine decimals (1e-9 px; 3.6 microarcsec), magnitude and
//! electrons the fewest digits that read back exactly.

use crate::sink::SinkError;
use crate::sink::frame::{TruthKind, TruthStar};
use std::io::{self, Read, Write};

/// Names of the columns, in order.
pub const HEADER: &str = "id,ra_deg,dec_deg,mag,x_px,y_px,electrons,kind,smear_px,smear_deg";

/// Writes one line per star.
///
/// # Errors
/// When the output fails.
pub fn write_truth(mut out: impl Write, stars: &[TruthStar]) -> io::Result<()> {
    writeln!(out, "{HEADER}")?;
    for s in stars {
        let TruthStar { id, ra_deg, dec_deg, mag, x_px, y_px, electrons, kind, smear_px, smear_deg } = s;
        let kind = kind.name();
        write!(out, "{id},{ra_deg:.9},{dec_deg:.9},{mag},{x_px:.9},{y_px:.9},{electrons},{kind},")?;
        writeln!(out, "{smear_px:.9},{smear_deg:.9}")?;
    }
    out.flush()
}

/// Reads a truth table back.
///
/// # Errors
/// [`SinkError::BadTable`] with the line when the header or a value is not as written by [`write_truth`].
pub fn read_truth(input: impl Read) -> Result<Vec<TruthStar>, SinkError> {
    let mut reader = csv::Reader::from_reader(input);
    let header = reader.headers().map_err(|e| bad(1, "a header", &e.to_string()))?;
    let header = header.iter().collect::<Vec<_>>().join(",");
    if header != HEADER {
        return Err(bad(1, HEADER, &header));
    }
    reader
        .into_records()
        .map(|record| read_star(&record.map_err(|e| bad(line_of(&e), "ten values", &e.to_string()))?))
        .collect()
}

fn read_star(record: &csv::StringRecord) -> Result<TruthStar, SinkError> {
    let line = record.position().map_or(0, csv::Position::line);
    let number = |column: usize| -> Result<f64, SinkError> {
        let text = record.get(column).unwrap_or("");
        text.parse().map_err(|_| bad(line, "a number", text))
    };
    let id = record.get(0).unwrap_or("");
    let mag = record.get(3).unwrap_or("");
    let kind = record.get(7).unwrap_or("");
    let named = TruthKind::NAMED.iter().find(|(_, name)| *name == kind);
    Ok(TruthStar {
        id: id.parse().map_err(|_| bad(line, "a catalog identifier", id))?,
        ra_deg: number(1)?,
        dec_deg: number(2)?,
        mag: mag.parse().map_err(|_| bad(line, "a magnitude", mag))?,
        x_px: number(4)?,
        y_px: number(5)?,
        electrons: number(6)?,
        kind: named.map(|(kind, _)| *kind).ok_or_else(|| bad(line, "a kind of source such as star", kind))?,
        smear_px: number(8)?,
        smear_deg: number(9)?,
    })
}

fn line_of(error: &csv::Error) -> u64 {
    error.position().map_or(0, csv::Position::line)
}

fn bad(line: u64, wanted: &'static str, got: &str) -> SinkError {
    SinkError::BadTable { table: "truth table", line, wanted, got: got.into() }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::sink::frame::sample_frame;
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
        let line = "424,37.954560671,89.264109444,1.98,12.345678901,-0.250000000,0.30000000000000004";
        let columns = "id,ra_deg,dec_deg,mag,x_px,y_px,electrons,kind,smear_px,smear_deg";
        assert_eq!(text, format!("{columns}\n{line},star,0.000000000,0.000000000\n"));
    }

    #[test]
    fn kinds_and_smears_read_back() {
        for (kind, name) in TruthKind::NAMED {
            assert_eq!(kind.name(), name);
            let star = TruthStar { kind, smear_px: 2.5, smear_deg: -53.25, ..sample_frame(0).truth[0] };
            assert_eq!(round_trip(&[star]), [star]);
        }
    }

    #[test]
    fn bad_tables_name_the_line() {
        let line = |text: &str| read_truth(text.as_bytes()).unwrap_err().to_string();
        assert!(line("id,ra\n1,2\n").contains("line 1"), "{}", line("id,ra\n1,2\n"));
        let text = format!("{HEADER}\n1,2,3,4,5,6,7,star,0,0\n1,2,three,4,5,6,7,star,0,0\n");
        assert!(line(&text).contains("line 3") && line(&text).contains("three"), "{}", line(&text));
        assert!(line(&format!("{HEADER}\n1,2\n")).contains("line 2"));
        let comet = line(&format!("{HEADER}\n1,2,3,4,5,6,7,comet,0,0\n"));
        assert!(comet.contains("line 2") && comet.contains("comet"), "{comet}");
    }

    proptest! {
        #[test]
        fn stars_read_back(id in any::<u32>(), x_px in -1e4..1e5, ra_deg in 0.0..360.0, electrons in any::<f64>(), mag in any::<f32>()) {
            prop_assume!(electrons.is_finite() && mag.is_finite());
            let star = TruthStar { id, ra_deg, dec_deg: -ra_deg / 4.0, mag, x_px, y_px: -x_px, electrons, ..TruthStar::NONE };
            let read = round_trip(&[star])[0];
            prop_assert_eq!((read.id, read.mag, read.electrons), (id, mag, electrons));
            prop_assert!((read.x_px - x_px).abs() <= NINE_DECIMALS && (read.y_px + x_px).abs() <= NINE_DECIMALS);
            prop_assert!((read.ra_deg - ra_deg).abs() <= NINE_DECIMALS && (read.dec_deg + ra_deg / 4.0).abs() <= NINE_DECIMALS);
        }
    }
}
