//! `starloop check`, numbers of cameras that no camera has: most are of another unit.
//!
//! Impossible values are refused where a file is read. These are possible, and no hardware has them: each limit is that of
//! hardware that exists, which is named beside it.

use anyhow::Result;
use config::{Bench, Camera};
use core::{fmt::Write, ops::RangeInclusive};

/// A number of a camera, and the values of real ones.
struct Usual {
    key: &'static str,
    value: fn(&Camera) -> f64,
    range: RangeInclusive<f64>,
    unit: &'static str,
}

const USUAL: [Usual; 6] = [
    // Sensors of telephones; detectors for X-rays.
    Usual {
        key: "detector.pixel_pitch_um",
        value: |camera| camera.detector.pixel_pitch_um,
        range: 0.5..=1000.0,
        unit: "um",
    },
    // Endoscopes; the Extremely Large Telescope has 743 m.
    Usual {
        key: "optics.focal_length_mm",
        value: |camera| camera.optics.focal_length_mm,
        range: 0.5..=800_000.0,
        unit: "mm",
    },
    // Cameras of telephones stopped down; the Extremely Large Telescope has 39 m.
    Usual { key: "optics.aperture_mm", value: |camera| camera.optics.aperture_mm, range: 0.3..=40_000.0, unit: "mm" },
    // Nothing in air is faster than f/0.5; beyond f/128 are pinholes.
    Usual { key: "focal length / aperture", value: f_number, range: 0.5..=128.0, unit: "" },
    // Electronic shutters of machine vision; an hour is the most that a file may give.
    Usual { key: "exposure.exposure_s", value: |camera| camera.exposure.exposure_s, range: 1e-6..=3600.0, unit: "s" },
    // A detector at the edge of its band still counts a photon in a hundred.
    Usual {
        key: "detector.quantum_efficiency",
        value: |camera| camera.detector.quantum_efficiency,
        range: 0.01..=1.0,
        unit: "",
    },
];

fn f_number(camera: &Camera) -> f64 {
    camera.optics.focal_length_mm / camera.optics.aperture_mm
}

/// Writes a warning for each number of a head's camera that no real camera has.
pub(super) fn write_cameras(text: &mut String, bench: &Bench) -> Result<()> {
    let mut cameras = vec![&bench.camera];
    for head in &bench.extra_heads {
        if !cameras.contains(&&head.camera) {
            cameras.push(&head.camera);
        }
    }
    for camera in cameras {
        for Usual { key, value, range, unit } in &USUAL {
            let got = value(camera);
            if !range.contains(&got) {
                let (least, most) = (range.start(), range.end());
                let wanted = format!("{least} to {most} {unit}");
                let wanted = wanted.trim_end();
                writeln!(
                    text,
                    "  WARNING      camera \"{}\": {key} is {got}; real cameras have {wanted}: is it in another unit?",
                    camera.name
                )?;
            }
        }
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    fn warned(change: impl Fn(&mut Camera)) -> String {
        let mut bench = Bench::built_in().unwrap();
        change(&mut bench.camera);
        let mut text = String::new();
        write_cameras(&mut text, &bench).unwrap();
        text
    }

    #[test]
    fn numbers_outside_of_what_exists_are_warned_of_on_both_sides() {
        assert_eq!(warned(|_| {}), "", "control");
        type Change = fn(&mut Camera, f64);
        let cases: [(&str, Change, [f64; 4]); 4] = [
            ("pixel_pitch_um", |camera, um| camera.detector.pixel_pitch_um = um, [0.49, 0.5, 1000.0, 1001.0]),
            ("exposure_s", |camera, s| camera.exposure.exposure_s = s, [0.9e-6, 1e-6, 3600.0, 3601.0]),
            ("quantum_efficiency", |camera, share| camera.detector.quantum_efficiency = share, [0.009, 0.01, 1.0, 1.1]),
            (
                "focal length / aperture",
                |camera, ratio| camera.optics.focal_length_mm = ratio * camera.optics.aperture_mm,
                [0.49, 0.5, 128.0, 129.0],
            ),
        ];
        for (key, change, [below, least, most, above]) in cases {
            for (value, warns) in [(below, true), (least, false), (most, false), (above, true)] {
                let text = warned(|camera| change(camera, value));
                assert_eq!(text.contains(&format!("{key} is ")), warns, "{key} = {value}: {text}");
            }
        }
    }

    #[test]
    fn an_aperture_in_metres_is_warned_of_with_its_number_and_limit() {
        let text = warned(|camera| camera.optics.aperture_mm = 0.011_43);
        assert!(text.contains("optics.aperture_mm is 0.01143; real cameras have 0.3 to 40000 mm"), "{text}");
    }

    #[test]
    fn every_head_is_looked_at_and_a_camera_once() {
        let mut bench = Bench::built_in().unwrap();
        let mut head = bench.first_head();
        head.camera.detector.pixel_pitch_um = 2000.0;
        bench.extra_heads = vec![head; 2];
        let mut text = String::new();
        write_cameras(&mut text, &bench).unwrap();
        assert_eq!(text.matches("WARNING").count(), 1, "{text}");
    }
}
