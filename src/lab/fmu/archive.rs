//! A run file, the library and the program -> an .fmu file: a zip archive laid out as section 2.5 of the standard says.
//!
//! ```text
//! modelDescription.xml
//! binaries/x86_64-linux/starloop.so        the library that importers load; FMI 2: binaries/linux64/starloop.so
//! resources/starloop                       this program, which the library starts
//! resources/run.json                       the run file with every configuration file that it names
//! resources/data/                          attitudes, orbits, jitter and maps that they name
//! documentation/index.html
//! ```
//!
//! The same run file and program give the same bytes.

use crate::description::{FmiVersion, MODEL_IDENTIFIER, Model, description};
use crate::{
    error::{self, FmuError},
    variables::variables,
};
use base::input_file::{DATA_BYTES, read_bytes};
use base::refused::Refused;
use config::{Document, Plant, Scenario};
use frames::{sink::replace_own_file, zip_archive::archive};
use std::path::Path;

/// The packed run file, below the resources.
pub const RUN_FILE: &str = "run.json";
/// The program, below the resources.
const PROGRAM: &str = "starloop";
/// Where the kernel has the program that runs, also when its file has been replaced.
const THIS_PROGRAM: &str = "/proc/self/exe";
/// The library, as `build.rs` compiled it; empty where it could not.
const LIBRARY: &[u8] = include_bytes!(concat!(env!("OUT_DIR"), "/library.so"));

/// Returns the folder of the library, by the standard's names of architecture and system. FMI 2 has a name for x86 alone.
const fn platform(version: FmiVersion) -> &'static str {
    match version {
        _ if cfg!(target_arch = "aarch64") => "aarch64-linux",
        FmiVersion::Two => "linux64",
        FmiVersion::Three => "x86_64-linux",
    }
}

/// Refuses a run whose spacecraft is flown inside.
pub(crate) fn check_plant(scenario: &Scenario, file: &str) -> Result<(), FmuError> {
    match scenario.plant {
        Plant::Outside | Plant::FlightComputer => Ok(()),
        Plant::File(_) | Plant::Vehicle(_) => Err(FmuError::from(Refused(format!(
            "{file}: the attitude comes from a file or a spacecraft inside this run, so a simulator outside cannot be the plant; \
         wanted plant.kind = \"outside\" or \"flight_computer\""
        )))),
    }
}

/// Returns what binds description and resources together: a checksum of both.
pub fn token(run_json: &str, heads: usize) -> String {
    let of_run = crc32fast::hash(run_json.as_bytes());
    format!("starloop-{}-{of_run:08x}-{heads}", env!("CARGO_PKG_VERSION"))
}

/// Writes the unit of a run file, whole or not at all; returns its size in bytes.
///
/// # Errors
/// When the run file is refused, flies its spacecraft inside, or a file cannot be read or written.
pub fn write_unit(document: &Document, version: FmiVersion, out: &Path) -> Result<u64, FmuError> {
    if LIBRARY.is_empty() {
        let why = "this program was built without the library for FMI units: build it again, and see the warning of that build";
        return Err(Refused::at(out, why).into());
    }
    let scenario = Scenario::from_document(document)?;
    check_plant(&scenario, &document.name())?;
    let packed = document.pack()?;
    let run_json = serde_json::to_string_pretty(&packed).map_err(|error| {
        FmuError::from(Refused::at(out, format_args!("{error}; write the unit again with `starloop fmu`")))
    })?;
    let heads = scenario.bench.head_count();
    let timing = &scenario.bench.timing;
    let model = Model {
        name: scenario.bench.name.clone(),
        token: token(&run_json, heads),
        stop_s: timing.duration_s,
        step_s: 1.0 / timing.frame_rate_hz,
    };
    let unread = |source| error::file(Path::new(THIS_PROGRAM), "read this program", source);
    let binary = read_bytes(Path::new(THIS_PROGRAM), DATA_BYTES).map_err(unread)?;
    let xml = description(&model, version, &variables(heads));
    let of_library = format!("binaries/{}/{MODEL_IDENTIFIER}.so", platform(version));
    let (of_program, of_run) = (format!("resources/{PROGRAM}"), format!("resources/{RUN_FILE}"));
    let data = packed.data().map(|(path, kept)| {
        let unread = |source| error::file(&path, "read a file that the run file names", source);
        read_bytes(&path, DATA_BYTES).map(|bytes| (format!("resources/{kept}"), bytes)).map_err(unread)
    });
    let data = data.collect::<Result<Vec<_>, _>>()?;
    let mut files: Vec<(&str, &[u8])> = vec![
        ("modelDescription.xml", xml.as_bytes()),
        (of_library.as_str(), LIBRARY),
        (of_program.as_str(), binary.as_slice()),
        (of_run.as_str(), run_json.as_bytes()),
        ("documentation/index.html", DOCUMENTATION.as_bytes()),
    ];
    files.extend(data.iter().map(|(name, bytes)| (name.as_str(), bytes.as_slice())));
    let refuse = |source| error::file(out, "make the archive", source);
    let bytes = archive(&files).map_err(refuse)?;
    Ok(replace_own_file(out, |file| file.write_all(&bytes))?)
}

const DOCUMENTATION: &str = "<!DOCTYPE html>
<html lang=\"en\"><head><meta charset=\"utf-8\"><title>starloop</title></head><body>
<h1>Star sensor stimulator</h1>
<p>Set the attitude at the start of each step; read frames, the true attitude and the star tracker after it.</p>
<p>Quaternions are scalar first, Hamilton, passive: v_body = q v_icrf q*. SPICE's m2q gives this form; most other tools give
its conjugate.</p>
<p>What a frame needs beyond the start of a step is predicted from attitude, rate and acceleration.</p>
</body></html>
";
