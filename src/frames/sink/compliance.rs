//! One suite for every sink: a program with a sink of its own can call [`check_sink`] too.

use crate::sink::sample::sample_frame;
use crate::sink::{Sink, SinkError, SinkSummary};

/// Checks the promises of every sink; `make` gives a fresh sink each time.
///
/// # Errors
/// The promise that was broken.
pub fn check_sink(mut make: impl FnMut() -> Box<dyn Sink>) -> Result<(), String> {
    let numbers = [1, 2, 5];
    let first = run(&mut *make(), &numbers, 0)?;
    let again = run(&mut *make(), &numbers, 0)?;
    let perturbed = run(&mut *make(), &numbers, 1)?;
    wanted("frames counted", first.frames == 3 && first.refused == 0)?;
    wanted("equal runs have equal checksums", first.run_crc32 == again.run_crc32)?;
    wanted("one bit of one pixel changes the checksum", first.run_crc32 != perturbed.run_crc32)?;
    wanted("an empty run counts nothing", run(&mut *make(), &[], 0)?.frames == 0)?;
    check_finish(&mut *make())
}

pub(crate) fn run(sink: &mut dyn Sink, numbers: &[u32], flip: u16) -> Result<SinkSummary, String> {
    for &number in numbers {
        let mut frame = sample_frame(number);
        frame.image.pixels_mut()[100] ^= flip;
        sink.send(&frame).map_err(|e| e.to_string())?;
    }
    sink.finish().map_err(|e| e.to_string())
}

fn check_finish(sink: &mut dyn Sink) -> Result<(), String> {
    let first = run(sink, &[7], 0)?;
    let second = sink.finish().map_err(|e| e.to_string())?;
    wanted("finish may be called again", first == second)?;
    let late = sink.send(&sample_frame(8));
    wanted("a frame after finish is refused", matches!(late, Err(SinkError::Finished { frame: 8, .. })))?;
    let after = sink.finish().map_err(|e| e.to_string())?;
    wanted("a refused frame is counted as such", (after.frames, after.refused) == (1, 1))
}

fn wanted(what: &str, held: bool) -> Result<(), String> {
    if held { Ok(()) } else { Err(format!("not so: {what}")) }
}

#[cfg(test)]
#[path = "compliance_tests.rs"]
mod tests;
