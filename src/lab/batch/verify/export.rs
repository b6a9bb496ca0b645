//! Flats and darks as files for other programs: 16-bit PNG with a descriptor of EMVA 1288.
//!
//! In: a function that exposes. Out: a folder with `EMVA1288descriptor.txt` and its images. The descriptor is the text that
//! the program `emva1288` (PyPI) reads: `v` version, `n` bits width height, `b` exposure (ns) and photons per pixel, `d`
//! exposure (ns) in the dark, each followed by its images, one `i` a line. Two images are a pair for temporal noise, more
//! are a stack for patterns. A pair and a stack in the dark, pairs up to just beyond saturation, and a stack at half of it.
//! Compared with that program by `hil_scripts/tests/test_emva.py`.

use crate::verify::{DataSheet, Flat, Procedure};
use base::image::DnImage;
use frames::sink::{SinkError, png::write_dn_raw, write_new_file};
use std::path::Path;

/// Name of the descriptor in its folder.
pub const DESCRIPTOR: &str = "EMVA1288descriptor.txt";
/// Version of the standard whose linear model the images follow.
const RELEASE: &str = "4.0";
/// Brightest light, as a share of saturation: the saturation is where the variance has its maximum, and few points lie beyond.
const BRIGHTEST: f64 = 1.05;

/// Facts of the camera in the descriptor.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct About<'a> {
    /// Name of the camera.
    pub name: &'a str,
    /// Bits of a digital number.
    pub bits: u32,
    /// Electrons per photon.
    pub electrons_per_photon: f64,
}

/// Writes the images and then their descriptor into a folder that exists; returns the number of images. The levels of light
/// are shares of the saturation in `sheet`.
///
/// # Errors
/// When a file cannot be written, or its name is taken.
pub fn export(
    folder: &Path,
    size_px: [usize; 2],
    about: About<'_>,
    (procedure, sheet): (&Procedure, &DataSheet),
    expose: &mut dyn FnMut(Flat, &mut DnImage),
) -> Result<u32, SinkError> {
    let exposure_ns = 1e9 * procedure.exposure_s;
    let [width, height] = size_px;
    let mut text = format!(
        "# {}\n# exposures in ns, light in photons per pixel of {} e- each\nv {RELEASE}\nn {} {width} {height}\n",
        about.name.replace(['\n', '\r'], " "),
        about.electrons_per_photon,
        about.bits
    );
    let (mut image, mut frame) = (DnImage::new(width, height), 0);
    for (light_e, count) in levels(procedure, sheet.saturation_e) {
        let photons = light_e / about.electrons_per_photon;
        text +=
            &if light_e > 0.0 { format!("b {exposure_ns:.1} {photons:.3}\n") } else { format!("d {exposure_ns:.1}\n") };
        for _ in 0..count {
            expose(Flat { light_e, exposure_s: procedure.exposure_s, frame }, &mut image);
            let name = format!("image_{frame:04}.png");
            write_new_file(&folder.join(&name), |out| write_dn_raw(out, &image))?;
            text += &format!("i {name}\n");
            frame += 1;
        }
    }
    write_new_file(&folder.join(DESCRIPTOR), |out| out.write_all(text.as_bytes()))?;
    Ok(frame)
}

/// Returns the light of each series, e-, and the number of its images.
fn levels(procedure: &Procedure, saturation_e: f64) -> impl Iterator<Item = (f64, u32)> {
    let (levels, stacked) = (procedure.levels, procedure.stacked);
    let pair = move |i: u32| (BRIGHTEST * saturation_e * f64::from(i) / f64::from(levels), 2);
    (0..=levels).map(pair).chain([(0.0, stacked), (0.5 * saturation_e, stacked)])
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::{collections::BTreeMap, fs};

    const PROCEDURE: Procedure =
        Procedure { exposure_s: 0.1, longest_dark_s: 1.0, levels: 4, darks: 2, stacked: 3, fitted: 0.7 };

    fn sheet(saturation_e: f64) -> DataSheet {
        DataSheet {
            gain_e_per_dn: 1.0,
            black_level_dn: 0.0,
            read_noise_e_rms: 0.0,
            dark_e_per_s: 0.0,
            dsnu_e_rms: 0.0,
            dsnu2_se: 0.0,
            prnu: 0.0,
            saturation_e,
            responsivity: 1.0,
            linearity_error: 0.0,
            points: Vec::new(),
        }
    }

    fn exported(folder: &Path, saturation_e: f64) -> Result<u32, SinkError> {
        let about = About { name: "two\nlines", bits: 12, electrons_per_photon: 0.5 };
        export(folder, [5, 3], about, (&PROCEDURE, &sheet(saturation_e)), &mut |flat, image| {
            assert_eq!(flat.exposure_s, 0.1);
            image.pixels_mut().fill(flat.light_e.round() as u16 + u16::try_from(flat.frame).unwrap());
        })
    }

    /// Numbers of images, by their line of light and how many there are.
    type Series = BTreeMap<(String, usize), Vec<u16>>;

    /// Returns the images of each line of light, as the readers of such files take them.
    fn read(folder: &Path) -> (Vec<String>, Series) {
        let (mut head, mut images, mut light) = (Vec::new(), Vec::new(), String::new());
        let mut series = BTreeMap::new();
        let text = fs::read_to_string(folder.join(DESCRIPTOR)).unwrap();
        for line in text.lines().chain(["d end"]) {
            match line.split_once(' ').unwrap() {
                ("i", name) => images.push(number(&folder.join(name))),
                ("b" | "d", _) => {
                    let count = images.len();
                    if count > 0 {
                        let before = series.insert((light, count), core::mem::take(&mut images));
                        assert_eq!(before, None, "one series of a kind for each light");
                    }
                    light = line.into();
                }
                _ => head.push(line.into()),
            }
        }
        (head, series)
    }

    /// Returns the number of an image, whose header is checked.
    fn number(path: &Path) -> u16 {
        let bytes = fs::read(path).unwrap();
        // The header of a PNG: width, height, depth and kind of colour.
        assert_eq!(bytes[16..26], [0, 0, 0, 5, 0, 0, 0, 3, 16, 0], "{}", path.display());
        path.file_stem().unwrap().to_str().unwrap().trim_start_matches("image_").parse().unwrap()
    }

    #[test]
    fn pairs_and_stacks_are_listed_with_their_light() {
        let folder = tempfile::tempdir().unwrap();
        assert_eq!(exported(folder.path(), 1000.0).unwrap(), 16);
        let (head, series) = read(folder.path());
        assert_eq!(head[0], "# two lines");
        assert_eq!(head[2..], ["v 4.0", "n 12 5 3"]);
        let of = |line: &str, count| series.get(&(line.to_owned(), count)).cloned();
        assert_eq!(of("d 100000000.0", 2), Some(vec![0, 1]));
        assert_eq!(of("b 100000000.0 2100.000", 2), Some(vec![8, 9]), "beyond saturation, in photons");
        assert_eq!(of("d 100000000.0", 3), Some(vec![10, 11, 12]));
        assert_eq!(of("b 100000000.0 1000.000", 3), Some(vec![13, 14, 15]), "half of saturation");
        assert_eq!(of("b 100000000.0 1000.000", 2), None, "control");
        assert_eq!(series.len(), 7);
    }

    #[test]
    fn names_that_are_taken_stay() {
        let folder = tempfile::tempdir().unwrap();
        let taken = folder.path().join("image_0003.png");
        fs::write(&taken, "mine").unwrap();
        assert!(exported(folder.path(), 1000.0).unwrap_err().to_string().contains("image_0003.png"));
        assert_eq!(fs::read_to_string(&taken).unwrap(), "mine");
        assert!(!folder.path().join(DESCRIPTOR).exists(), "no descriptor without all of its images");
    }
}
