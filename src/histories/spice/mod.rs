//! SPICE kernels (feature `spice`): attitudes of CK files, orbits of SPK files, with the text kernels of their clocks.
//!
//! | kernel | taken |
//! |---|---|
//! | CK | types 2 and 3, relative to J2000; the attitudes of one instrument or spacecraft |
//! | SPK | types 2, 3, 9 and 13, relative to J2000; one target about the Earth, the Moon, the Sun or the barycentre |
//! | SCLK | type 1, its parallel time TDB or TT |
//! | LSK | the constants of TDB - TT; without one those of every kernel since 1984 |
//!
//! J2000 of SPICE is ICRF (NAIF, "Frames required reading"). Own readers, because `anise` has no CK and its licence is
//! not one of ours, and the bindings of CSPICE need its C library. Formats: NAIF's required reading "DAF", "CK", "SPK",
//! "SCLK", "Time", toolkit N0067. Kernels of either byte order; transfer files (`.xc`, `.xsp`) are refused. Tests:
//! below, and `hil_scripts/test_spice.py` with CSPICE. Fuzzed: `tests/fuzz/targets/spice.rs`.

mod ck;
mod clock;
mod daf;
mod spk;
#[cfg(test)]
mod tests;
mod text_kernel;

use crate::attitude::AttitudeHistory;
use crate::error::{HistoryError, Source};
use crate::orbit::OrbitHistory;
use clock::{EarthTime, SpacecraftClock};
use daf::Daf;
use text_kernel::TextKernel;

/// A file by its name and its bytes.
#[derive(Debug, Clone, Copy)]
pub struct KernelFile<'a> {
    /// Name, for error messages.
    pub file: &'a str,
    /// All of it.
    pub bytes: &'a [u8],
}

impl<'a> KernelFile<'a> {
    fn source(self) -> Source<'a> {
        Source { file: self.file, text: "" }
    }
}

/// Reads the attitudes of a CK file. `text_kernels` are its clock (SCLK) and leap seconds (LSK); `instrument` is its
/// number, which may be left out where the file has one.
///
/// # Errors
/// With the file, what was got and what was wanted.
pub fn attitudes(
    ck: KernelFile<'_>,
    text_kernels: &[KernelFile<'_>],
    instrument: Option<i32>,
) -> Result<AttitudeHistory, HistoryError> {
    let source = ck.source();
    let daf = Daf::read(ck.bytes, "DAF/CK", &source)?;
    let texts = texts(text_kernels)?;
    let earth = EarthTime::of(&texts);
    ck::read(&daf, &source, instrument, |instrument| SpacecraftClock::of(&texts, instrument, earth, &source))
}

/// Reads the orbit of an SPK file. `text_kernels` may hold leap seconds (LSK); `target` is its number, which may be
/// left out where the file has one.
///
/// # Errors
/// With the file, what was got and what was wanted.
pub fn orbit(
    spk: KernelFile<'_>,
    text_kernels: &[KernelFile<'_>],
    target: Option<i32>,
) -> Result<OrbitHistory, HistoryError> {
    let source = spk.source();
    let daf = Daf::read(spk.bytes, "DAF/SPK", &source)?;
    spk::read(&daf, &source, target, EarthTime::of(&texts(text_kernels)?))
}

fn texts(kernels: &[KernelFile<'_>]) -> Result<Vec<TextKernel>, HistoryError> {
    kernels.iter().map(|kernel| TextKernel::read(kernel.bytes, &kernel.source())).collect()
}

/// Returns the wanted one of the numbers in a file.
fn chosen(numbers: &[i32], wanted: Option<i32>, what: &str, source: &Source<'_>) -> Result<i32, HistoryError> {
    let mut known = numbers.to_vec();
    known.sort_unstable();
    known.dedup();
    known.truncate(20);
    match (wanted, known.as_slice()) {
        (Some(wanted), known) if known.contains(&wanted) => Ok(wanted),
        (None, [only]) => Ok(*only),
        (Some(wanted), known) => {
            Err(source.whole(format!("{what} {wanted} is not in it; wanted one of {known:?}: name it by its number")))
        }
        (None, known) => Err(source.whole(format!("it has {what}s {known:?}; wanted one: name it by its number"))),
    }
}

/// Number of SPICE's J2000.
const J2000: i32 = 1;

/// Refuses other axes than ICRF.
fn check_axes(axes: i32, source: &Source<'_>) -> Result<(), HistoryError> {
    if axes == J2000 {
        return Ok(());
    }
    Err(source.whole(format!("a segment is relative to frame {axes}; wanted 1, J2000: write it relative to J2000")))
}
