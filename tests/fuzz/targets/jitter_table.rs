//! Tables of jitter: a series or a density whose numbers can be used, or an error that names a line of the text.

#![no_main]

use libfuzzer_sys::fuzz_target;
use plan::attitude::{JitterTableError, RecordEnd, read_density, read_series};
use starloop_fuzz::{Input, control};

/// Memory for a byte of text, and beside: a row of two bytes is a vector and a time.
const MEMORY_PER_BYTE: u64 = 100;
const MEMORY_BESIDE: u64 = 1 << 16;
/// Largest rotation that is taken, rad: 10 degrees about an axis.
const MOST_RAD: f64 = 0.175;

fuzz_target!(|bytes: &[u8]| {
    let mut input = Input::new(bytes);
    let is_series = input.u8().is_multiple_of(2);
    let text = String::from_utf8_lossy(input.rest()).into_owned();
    let memory = allocation_counter::measure(|| if is_series { series(&text) } else { density(&text) });
    let most = MEMORY_PER_BYTE * text.len() as u64 + MEMORY_BESIDE;
    assert!(memory.bytes_max < most, "{} bytes of memory for {}", memory.bytes_max, text.len());
});

fn series(text: &str) {
    match read_series(text, RecordEnd::Still) {
        Ok(record) => {
            let limit = if control::is_broken() { 1e-9 } else { MOST_RAD };
            assert!(record.samples().iter().all(|sample| sample.is_finite() && sample.length() < limit), "{text}");
            assert!(record.samples().len() >= 2 && record.period_s() > 0.0, "{text}");
        }
        Err(error) => refused(&error, text),
    }
}

fn density(text: &str) {
    match read_density(text) {
        Ok(points) => {
            let mut before_hz = 0.0;
            for point in points {
                assert!(point.frequency_hz > before_hz && point.density.is_finite(), "{text}");
                assert!(point.density.min_element() >= 0.0, "{text}");
                before_hz = point.frequency_hz;
            }
        }
        Err(error) => refused(&error, text),
    }
}

fn refused(error: &JitterTableError, text: &str) {
    assert!(error.line >= 1 && error.line <= text.lines().count().max(1), "{error}: {text}");
}
