//! SPICE kernels (feature `spice`): attitudes of CK files, orbits of SPK files, with the text kernels of their clocks.
//!
//! | kernel | taken |
//! |---|---|
//! | CK | types 2 and 3; the attitudes of one instrument or spacecraft |
//! | SPK | types 2, 3, 9 and 13; one target about the Earth, the Moon, the Sun or the barycentre |
//! | SCLK | type 1, its parallel time TDB or TT; dates count as their seconds |
//! | LSK | the constants of TDB - TT; without one those of every kernel since 1984 |
//!
//! J2000 of SPICE is ICRF (NAIF, "Frames required reading"); B1950, MARSIAU and ECLIPJ2000 (2, 16 and 17) are turned by
//! their constants. Where segments overlap, the one that is later in the file counts. Own readers, because `anise` has no CK and its licence is
//! not one of ours, and the bindings of CSPICE need its C library. Formats: NAIF's required reading "DAF", "CK", "SPK",
//! "SCLK", "Time", toolkit N0067. Kernels of either byte order; transfer files (`.xc`, `.xsp`) are refused. Tests:
//! below, and `hil_scripts/tests/test_spice.py` with CSPICE. Fuzzed: `tests/fuzz/targets/spice.rs`.

mod ck;
mod clock;
mod daf;
mod spk;
#[cfg(test)]
mod tests;
mod text_kernel;

use crate::error::{HistoryError, Source};
use crate::{attitude::AttitudeHistory, orbit::OrbitHistory};
use base::units::ARCSEC;
use clock::{EarthTime, SpacecraftClock};
use daf::Daf;
use glam::{DQuat, DVec3};
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
    ck::read(&daf, &source, instrument, |instrument| SpacecraftClock::of(&texts, instrument, earth))
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

/// Most numbers of a file that a message names.
const MOST_SHOWN: usize = 20;

/// Returns the wanted one of the numbers in a file.
fn chosen(numbers: &[i32], wanted: Option<i32>, what: &str, source: &Source<'_>) -> Result<i32, HistoryError> {
    let mut known = numbers.to_vec();
    known.sort_unstable();
    known.dedup();
    let shown = &known[..known.len().min(MOST_SHOWN)];
    let and_more = if known.len() > shown.len() { " and others" } else { "" };
    match (wanted, known.as_slice()) {
        (Some(wanted), known) if known.contains(&wanted) => Ok(wanted),
        (None, [only]) => Ok(*only),
        (Some(wanted), _) => {
            let why = format!("{what} {wanted} is not in it; wanted one of {shown:?}{and_more}: name it by its number");
            Err(source.whole(why))
        }
        (None, _) => {
            Err(source.whole(format!("it has {what}s {shown:?}{and_more}; wanted one: name it by its number")))
        }
    }
}

/// Number of SPICE's J2000.
const J2000: i32 = 1;
/// Its other inertial frames: turns of the axes of J2000, arcsec about x, y or z, the last one first (CSPICE's `chgirf`).
const FRAMES: [(i32, [(f64, DVec3); 3]); 3] = [
    (2, [(1_152.842_485_967_24, DVec3::Z), (-1_002.261_084_391_17, DVec3::Y), (1_153.040_662_003_3, DVec3::Z)]),
    (16, [(324_000.0, DVec3::Z), (133_610.4, DVec3::Y), (-152_348.4, DVec3::Z)]),
    (17, [(84_381.448, DVec3::X), (0.0, DVec3::Y), (0.0, DVec3::Z)]),
];

/// Returns the passive rotation from ICRF into the axes of this number; `None` for J2000, which needs none.
fn axes_from_icrf(number: i32, source: &Source<'_>) -> Result<Option<DQuat>, HistoryError> {
    if number == J2000 {
        return Ok(None);
    }
    let Some((_, turns)) = FRAMES.into_iter().find(|(known, _)| *known == number) else {
        let known = "1 (J2000), 2 (B1950), 16 (MARSIAU) or 17 (ECLIPJ2000)";
        return Err(source
            .whole(format!("a segment is relative to frame {number}; wanted {known}: write it relative to J2000")));
    };
    let [a, b, c] = turns.map(|(arcsec, axis)| DQuat::from_axis_angle(axis, -arcsec * ARCSEC));
    Ok(Some(a * b * c))
}
