//! The C interface of a co-simulation unit, called as an importer calls it: what is wrong is an error and a message,
//! never a crash. FMPy flies whole units in `hil_scripts/tests/test_fmu.py`.

#![allow(unsafe_code, reason = "the importer's side of a C interface")]
#![allow(clippy::unwrap_used, reason = "a test may stop at the first surprise")]

use core::ffi::{CStr, c_char, c_void};
use core::ptr::{null, null_mut};
use fmu::variables::reference;
use fmu_library::fmi3::{calls::*, denied::*};
use fmu_library::{fmi2::*, protocol::Status};
use std::{ffi::CString, path::Path};

/// Keeps what is logged in the strings behind the environment.
unsafe extern "C" fn keep(environment: *mut c_void, _status: Status, _category: *const c_char, message: *const c_char) {
    // SAFETY: the environment is the list that the test handed over, and the message ends with a zero.
    let (said, message) = unsafe { (&mut *environment.cast::<Vec<String>>(), CStr::from_ptr(message)) };
    said.push(message.to_str().unwrap().to_owned());
}

fn instantiate(token: &str, resources: &Path, said: &mut Vec<String>) -> *mut c_void {
    let (token, resources) = (CString::new(token).unwrap(), CString::new(resources.to_str().unwrap()).unwrap());
    let environment = core::ptr::from_mut(said).cast();
    let (name, log) = (c"one".as_ptr(), Some(keep as _));
    let (token, resources) = (token.as_ptr(), resources.as_ptr());
    fmi3InstantiateCoSimulation(name, token, resources, false, true, false, false, null(), 0, environment, log, None)
}

/// Resources of a small bench, and the token that belongs to them.
fn resources() -> (tempfile::TempDir, String) {
    let folder = tempfile::tempdir().unwrap();
    std::fs::write(folder.path().join("camera.toml"), CAMERA).unwrap();
    std::fs::write(folder.path().join("bench.toml"), BENCH).unwrap();
    let document = config::Document::open(&folder.path().join("bench.toml")).unwrap();
    let text = serde_json::to_string_pretty(&document.pack().unwrap()).unwrap();
    std::fs::write(folder.path().join(fmu::archive::RUN_FILE), &text).unwrap();
    std::os::unix::fs::symlink(env!("CARGO_BIN_EXE_starloop"), folder.path().join("starloop")).unwrap();
    let token = fmu::archive::token(&text, 1);
    (folder, token)
}

const CAMERA: &str = "[detector]\nwidth_px = 64\nheight_px = 64\n[optics]\nfocal_length_mm = 25\n";
const BENCH: &str = "camera = \"camera.toml\"\n[timing]\nframe_rate_hz = 10\nduration_s = 1\n\
                     start_utc = \"2026-03-01T12:00:00Z\"\n[link]\nkind = \"simulated\"\nwire = \"can_fd\"\n";

#[test]
fn each_interface_has_its_version() {
    // SAFETY: a text that ends with a zero, as the standard promises.
    let said = |text| unsafe { CStr::from_ptr(text) };
    assert_eq!((said(fmi3GetVersion()), said(fmi2GetVersion())), (c"3.0", c"2.0"));
}

#[test]
fn null_is_refused_everywhere() {
    let none = null_mut();
    assert_eq!(fmi3ExitInitializationMode(none), Status::Error);
    assert_eq!(fmi3GetFloat64(none, null(), 0, null_mut(), 0), Status::Error);
    assert_eq!(fmi3GetFMUState(none, null_mut()), Status::Error);
    assert_eq!(fmi3Terminate(none), Status::Error);
    fmi3FreeInstance(none);
    assert_eq!(fmi2DoStep(none, 0.0, 0.1, 0), Status::Error);
    assert!(fmi2Instantiate(null(), 1, null(), null(), null(), 0, 0).is_null());
    let mut said = Vec::<String>::new();
    let environment = core::ptr::from_mut(&mut said).cast();
    let log = Some(keep as _);
    let made = fmi3InstantiateCoSimulation(
        null(),
        null(),
        null(),
        false,
        false,
        false,
        false,
        null(),
        0,
        environment,
        log,
        None,
    );
    assert!(made.is_null() && said[0].contains("got null"), "{said:?}");
}

#[test]
fn resources_that_are_not_those_of_the_description_are_refused() {
    let (folder, token) = resources();
    let mut said = Vec::new();
    assert!(instantiate("another", folder.path(), &mut said).is_null());
    assert!(said[0].contains(&token) && said[0].contains("another"), "{said:?}");
    assert!(instantiate(&token, Path::new("/nonexistent"), &mut said).is_null());
    assert!(said[1].contains("/nonexistent"), "{said:?}");
}

#[test]
fn an_instance_is_set_stepped_read_and_freed() {
    let (folder, token) = resources();
    let mut said = Vec::new();
    let unit = instantiate(&token, folder.path(), &mut said);
    assert!(!unit.is_null(), "{said:?}");
    let empty = c"".as_ptr();
    assert_eq!(fmi3SetString(unit, &raw const OUTPUT_DIR, 1, &raw const empty, 1), Status::Ok);
    assert_eq!(fmi3EnterInitializationMode(unit, false, 0.0, 0.0, false, 0.0), Status::Ok);
    assert_eq!(fmi3ExitInitializationMode(unit), Status::Ok, "{said:?}");
    let q = [1.0, 0.0, 0.0, 0.0];
    assert_eq!(fmi3SetFloat64(unit, &raw const Q, 1, q.as_ptr(), 4), Status::Ok);
    assert_eq!(fmi3SetFloat64(unit, &raw const Q, 1, q.as_ptr(), 3), Status::Error, "three of four numbers");
    let (mut flags, mut until_s) = ([false; 3], 0.0);
    let [a, b, c] = &mut flags;
    for step in 0..8 {
        let status = fmi3DoStep(unit, 0.1 * f64::from(step), 0.1, true, a, b, c, &raw mut until_s);
        assert_eq!(status, Status::Ok, "{said:?}");
    }
    assert!((until_s - 0.8).abs() < 1e-12);
    let mut frames = 0_u64;
    assert_eq!(fmi3GetUInt64(unit, &raw const FRAMES, 1, &raw mut frames, 1), Status::Ok);
    assert!(frames > 3, "{frames}");
    let mut small = 0_u8;
    assert_eq!(fmi3GetUInt8(unit, &raw const Q, 1, &raw mut small, 1), Status::Error, "a quaternion is not a UInt8");
    assert_eq!(fmi3GetFMUState(unit, null_mut()), Status::Error);
    assert!(said.last().unwrap().contains("fmi3GetFMUState"), "{said:?}");
    assert_eq!(fmi3Terminate(unit), Status::Ok, "{said:?}");
    assert_eq!(fmi3DoStep(unit, 0.8, 0.1, true, a, b, c, &raw mut until_s), Status::Error, "after the end");
    fmi3FreeInstance(unit);
}

#[test]
fn numbers_of_fmi_2_are_elements_of_arrays() {
    let (folder, token) = resources();
    let (token, place) = (CString::new(token).unwrap(), format!("file://{}", folder.path().display()));
    let place = CString::new(place).unwrap();
    let unit = fmi2Instantiate(c"two".as_ptr(), 1, token.as_ptr(), place.as_ptr(), null(), 0, 0);
    assert!(!unit.is_null());
    assert_eq!(fmi2SetupExperiment(unit, 0, 0.0, 0.0, 0, 0.0), Status::Ok);
    assert_eq!(fmi2EnterInitializationMode(unit), Status::Ok);
    let empty = c"".as_ptr();
    assert_eq!(fmi2SetString(unit, &raw const OUTPUT_DIR, 1, &raw const empty), Status::Ok);
    assert_eq!(fmi2ExitInitializationMode(unit), Status::Ok);
    let element = |number: u32| RATE + 1_000_000 * number;
    let (rates, set, mut got) = ([1, 2, 3].map(element), [0.0, 0.001, 0.002], [9.0; 3]);
    assert_eq!(fmi2SetReal(unit, rates.as_ptr(), 3, set.as_ptr()), Status::Ok);
    assert_eq!(fmi2GetReal(unit, rates.as_ptr(), 3, got.as_mut_ptr()), Status::Ok);
    assert_eq!(got, set);
    let no_such = element(4);
    assert_eq!(fmi2GetReal(unit, &raw const no_such, 1, got.as_mut_ptr()), Status::Error, "a fourth of three");
    for step in 0..8 {
        assert_eq!(fmi2DoStep(unit, 0.1 * f64::from(step), 0.1, 1), Status::Ok);
    }
    let mut frames = 0;
    assert_eq!(fmi2GetInteger(unit, &raw const FRAMES, 1, &raw mut frames), Status::Ok);
    assert!(frames > 3, "{frames}");
    assert_eq!(fmi2GetFMUstate(unit, null_mut()), Status::Error);
    assert_eq!(fmi2Terminate(unit), Status::Ok);
    fmi2FreeInstance(unit);
}

static OUTPUT_DIR: u32 = reference::OUTPUT_DIR;
static Q: u32 = reference::Q_BODY_FROM_ICRF;
static FRAMES: u32 = reference::HEADS + reference::FRAMES;
const RATE: u32 = reference::RATE;
