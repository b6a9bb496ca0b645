//! `starloop catalog export --for`: the stars that are drawn, in the file that a star tracker's program reads.
//!
//! | program | file | places | magnitude |
//! |---|---|---|---|
//! | tetra3, cedar-solve, openstartracker | `hip_main.dat` (CDS I/239): 78 columns between bars | J1991.25 | V |
//! | LOST | `bright-star-catalog.tsv` | of `--epoch`: LOST moves no star | V |
//! | NASA's COTS star tracker | `starcat.tsv` (VizieR's form of CDS I/311) | J1991.25 | V, as `Hpmag` |
//!
//! Columns that the layers have no value for are blank. A star without a proper motion has one of zero: it is drawn at
//! rest, and these programs pass over stars whose motion is blank. A star has its Hipparcos number where one is known,
//! else one from 1,000,001 on, in the order of brightness.

use crate::cli::catalog::EVERY_STAR;
use anyhow::{Context, ensure};
use base::source::{CatalogSource, ra_dec_rad};
use base::source_id::SourceId;
use base::units::{DEG, MAS};
use clap::{Args, ValueEnum};
use core::f64::consts::PI;
use core::fmt::Write as _;
use frames::sink::write_file_atomically;
use glam::DVec3;
use plan::optics::radiometry::mag_v;
use sky::astrometry::at_epoch;
use stars::layer::{Layer, is_layer};
use stars::{catalog::Catalog, numbering::hipparcos_of_gaia};
use std::path::{Path, PathBuf};
use std::{collections::BTreeSet, io::Write};

/// Epoch of the places in Hipparcos files, Julian year: their readers move stars from there.
const HIPPARCOS_YR: f64 = 1991.25;
/// Numbers of stars without a Hipparcos number follow this one.
const MADE_UP: u32 = 1_000_000;
/// LOST ends when its catalog has no more stars than these.
const LEAST_OF_LOST: usize = 9_000;

/// Options of `starloop catalog export` for trackers.
#[derive(Debug, Args)]
pub(crate) struct ForTracker {
    /// Star tracker's program that reads the output, in place of --hats
    #[arg(long = "for", value_name = "PROGRAM", conflicts_with_all = ["hats", "name", "max_rows"])]
    pub(crate) program: Option<Program>,
    /// With --for: write into this file instead of standard output; one that exists is replaced
    #[arg(long, value_name = "FILE", requires = "program")]
    out: Option<PathBuf>,
    /// With --for: faintest Gaia G magnitude that is written [without it: every star]
    #[arg(long, value_name = "G", requires = "program", allow_negative_numbers = true)]
    mag: Option<f32>,
    /// With --for lost: Julian year of the places, such as that of the frames [without it: 2000]
    #[arg(long, value_name = "YEAR", requires = "program")]
    epoch: Option<f64>,
}

/// Programs whose catalogs are written.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub(crate) enum Program {
    /// hip_main.dat, also for cedar-solve
    #[value(alias = "hip")]
    Tetra3,
    /// hip_main.dat
    Openstartracker,
    /// bright-star-catalog.tsv, which LOST_BSC_PATH names
    #[value(alias = "bsc")]
    Lost,
    /// starcat.tsv of NASA's COTS star tracker
    Cots,
}

/// Writes the stars of layers, or of the built-in catalog, for a program.
pub(crate) fn export(options: &ForTracker, program: Program, layers: &[PathBuf]) -> anyhow::Result<()> {
    if let Some(year) = options.epoch {
        let is_lost = program == Program::Lost;
        ensure!(is_lost, "--epoch: wanted with --for lost only: other programs move stars from J1991.25 by themselves");
        ensure!((1900.0..=2100.0).contains(&year), "--epoch: wanted a Julian year in 1900..2100, got {year}");
    }
    let stars = listed(stars_of(layers, options.mag.unwrap_or(EVERY_STAR))?);
    ensure!(!stars.is_empty(), "no star to write: wanted a fainter --mag, or layers with stars");
    let text = written(program, &stars, options.epoch.unwrap_or(2000.0));
    match &options.out {
        Some(path) => write_file_atomically(path, |out| out.write_all(text.as_bytes()))
            .map(drop)
            .with_context(|| format!("--out {}", path.display()))?,
        None => base::streams::Output.write_all(text.as_bytes())?,
    }
    let numbered = stars.iter().filter(|star| star.number <= MADE_UP).count();
    eprintln!("{} stars, {numbered} of them with Hipparcos numbers", stars.len());
    if program == Program::Lost && stars.len() <= LEAST_OF_LOST {
        eprintln!("LOST wants more than {LEAST_OF_LOST} stars: give a fainter --mag");
    }
    Ok(())
}

/// A star with its number, and the epoch of its place.
struct Listed {
    star: CatalogSource,
    epoch_yr: f64,
    number: u32,
}

/// Reads all stars that are not fainter, with the epochs of their places.
fn stars_of(files: &[PathBuf], mag: f32) -> anyhow::Result<Vec<(CatalogSource, f64)>> {
    if files.is_empty() {
        return Ok(of_catalog(&Catalog::built_in()?, mag));
    }
    let mut all = Vec::new();
    for path in files {
        all.extend(of_file(path, mag).with_context(|| path.display().to_string())?);
    }
    Ok(all)
}

fn of_file(path: &Path, mag: f32) -> anyhow::Result<Vec<(CatalogSource, f64)>> {
    if !is_layer(path) {
        return Ok(of_catalog(&Catalog::open(path)?, mag));
    }
    let (layer, mut found) = (Layer::open(path)?, Vec::new());
    layer.cone(DVec3::Z, PI, mag, &mut found)?;
    let epoch_yr = layer.index().epoch_yr;
    Ok(found.into_iter().map(|star| (star, epoch_yr)).collect())
}

fn of_catalog(catalog: &Catalog, mag: f32) -> Vec<(CatalogSource, f64)> {
    let epoch_yr = catalog.index().epoch_yr;
    catalog.sources().iter().filter(|star| star.mag_g <= mag).map(|star| (*star, epoch_yr)).collect()
}

/// Puts stars in the order of brightness, and gives each a number.
fn listed(mut stars: Vec<(CatalogSource, f64)>) -> Vec<Listed> {
    stars.sort_by(|(a, _), (b, _)| a.mag_g.total_cmp(&b.mag_g).then(a.id.cmp(&b.id)));
    let (mut made_up, mut known) = (MADE_UP, BTreeSet::new());
    let mut number_of = |star: &CatalogSource| {
        let hipparcos = match star.source_id {
            Some(SourceId::Hipparcos(number)) => Some(number),
            Some(SourceId::Gaia(_, number)) => hipparcos_of_gaia(number),
            Some(SourceId::Tycho(..) | SourceId::Own(_)) | None => None,
        };
        // Of two stars with one Hipparcos number the brighter one has it.
        let own = hipparcos.filter(|number| known.insert(*number));
        own.unwrap_or_else(|| {
            made_up += 1;
            made_up
        })
    };
    stars.into_iter().map(|(star, epoch_yr)| Listed { number: number_of(&star), star, epoch_yr }).collect()
}

/// A place on the sky and the motion at it.
struct Place {
    /// Right ascension and declination, ICRS.
    deg: [f64; 2],
    /// Towards east (with cos dec) and north.
    mas_yr: [f64; 2],
}

impl Listed {
    /// Returns where the star is in a Julian year. Its motion is that of the same year: of a fast or polar star it
    /// differs from that of the catalog's epoch.
    fn at(&self, year: f64) -> Place {
        let place = |year: f64| at_epoch(self.star.direction_icrf, self.star.proper_motion, year - self.epoch_yr);
        let (here, step) = (place(year), place(year + 0.5) - place(year - 0.5));
        let east = DVec3::new(-here.y, here.x, 0.0).normalize_or_zero();
        let mas_yr = [east, here.cross(east)].map(|axis| step.dot(axis) / MAS);
        Place { deg: ra_dec_rad(here).map(|rad| rad / DEG), mas_yr }
    }

    fn mag_v(&self) -> f64 {
        mag_v(f64::from(self.star.mag_g), f64::from(self.star.bp_rp))
    }
}

fn written(program: Program, stars: &[Listed], lost_epoch_yr: f64) -> String {
    let mut text = if program == Program::Cots { head_of_cots() } else { String::new() };
    for star in stars {
        text += &match program {
            Program::Tetra3 | Program::Openstartracker => hipparcos_line(star),
            Program::Lost => lost_line(star, lost_epoch_yr),
            Program::Cots => cots_line(star),
        };
    }
    text
}

/// Widths of the columns of `hip_main.dat`.
const WIDTHS: [usize; 78] = [
    1, 12, 1, 11, 11, 5, 1, 1, 12, 12, 1, 7, 8, 8, 6, 6, 6, 6, 6, 5, 5, 5, 5, 5, 5, 5, 5, 5, 5, 3, 5, 6, 6, 5, 6, 5, 1,
    6, 5, 1, 4, 4, 1, 1, 7, 6, 5, 3, 1, 5, 5, 7, 1, 1, 1, 10, 1, 2, 2, 1, 1, 1, 2, 3, 7, 5, 5, 4, 1, 1, 1, 6, 10, 10,
    10, 4, 12, 2,
];

/// A line of `hip_main.dat`. No column is empty: openstartracker takes bars without a blank between them for one.
fn hipparcos_line(star: &Listed) -> String {
    let Place { deg: [ra, dec], mas_yr: [east, north] } = star.at(HIPPARCOS_YR);
    let parallax = star.star.parallax_mas.map_or_else(String::new, |mas| format!("{mas:.2}"));
    let value = |column: usize| -> String {
        match column {
            0 => "H".into(),
            1 => star.number.to_string(),
            5 => format!("{:.2}", star.mag_v()),
            8 => format!("{ra:012.8}"),
            9 => format!("{dec:+012.8}"),
            11 => parallax.clone(),
            12 => format!("{east:.2}"),
            13 => format!("{north:.2}"),
            29 => "0".into(), // share of rejected data: by it openstartracker finds a star unreliable
            _ => String::new(),
        }
    };
    let columns: Vec<String> = WIDTHS.iter().enumerate().map(|(i, &width)| format!("{:>width$}", value(i))).collect();
    columns.join("|") + "\n"
}

fn lost_line(star: &Listed, epoch_yr: f64) -> String {
    let [ra, dec] = star.at(epoch_yr).deg;
    format!("{ra:010.6}|{dec:+010.6}|{:>4}| |{:5.2}\n", star.number, star.mag_v())
}

/// The lines above the rows. The program takes the 53rd for the names and passes over the two below it.
fn head_of_cots() -> String {
    let mut head = "# The stars of a simulated sky, in the form of VizieR's I/311/hip2. Hpmag is V.\n".to_owned();
    head.extend(core::iter::repeat_n("#\n", 51));
    head += "_RAJ2000\t_DEJ2000\tHIP\tRArad\tDErad\tPlx\tpmRA\tpmDE\tHpmag\tB-V\n";
    head += "deg\tdeg\t\tdeg\tdeg\tmas\tmas/yr\tmas/yr\tmag\tmag\n";
    head + "----------\t----------\t------\t------------\t------------\t-------\t--------\t--------\t-------\t------\n"
}

/// A line of `starcat.tsv`. `RArad` and `DErad` are degrees, as in VizieR's tables. A blank parallax would make the
/// place no number.
fn cots_line(star: &Listed) -> String {
    let ([ra_2000, dec_2000], here) = (star.at(2000.0).deg, star.at(HIPPARCOS_YR));
    let ([ra, dec], [east, north]) = (here.deg, here.mas_yr);
    let mut line = format!("{ra_2000:.6}\t{dec_2000:+.6}\t{}\t{ra:.8}\t{dec:+.8}\t", star.number);
    let parallax_mas = star.star.parallax_mas.unwrap_or(0.0);
    let _ = writeln!(line, "{parallax_mas:.2}\t{east:.2}\t{north:.2}\t{:.4}\t", star.mag_v()); // a string does not fail
    line
}

#[cfg(test)]
mod tests {
    use super::*;
    use base::source::{ProperMotion, direction_from_ra_dec};

    /// The first line of the published `hip_main.dat`.
    const PUBLISHED: &str = "H|           1| |00 00 00.22|+01 05 20.4| 9.10| |H|000.00091185|+01.08901332| |   3.54|   \
        -5.20|   -1.88|  1.32|  0.74|  1.39|  1.36|  0.81| 0.32|-0.07|-0.11|-0.24| 0.09|-0.01| 0.10|-0.01| 0.01| 0.34|  0\
        | 0.74|     1| 9.643|0.020| 9.130|0.019| | 0.482|0.025|T|0.55|0.03|L| | 9.2043|0.0020|0.017| 87| | 9.17| 9.24\
        |       | | | |          | |  | 1| | | |  |   |       |     |     |    |S| | |224700|B+00 5077 |          \
        |          |0.66|F5          |S ";

    fn star(number: u32, [ra, dec]: [f64; 2], motion: Option<[f32; 2]>) -> (CatalogSource, f64) {
        let proper_motion = motion.map(|[east, north]| ProperMotion {
            pm_ra_cosdec_mas_yr: east,
            pm_dec_mas_yr: north,
            radial_mas_yr: 0.0,
        });
        let star = CatalogSource {
            id: number,
            source_id: (number > 0).then_some(SourceId::Hipparcos(number)),
            direction_icrf: direction_from_ra_dec(ra * DEG, dec * DEG),
            proper_motion,
            parallax_mas: motion.map(|_| 3.54),
            mag_g: 9.0,
            bp_rp: 0.7,
        };
        (star, 2016.0)
    }

    /// Reads bytes `from..=to` of a line, counted from 1 as the catalog's description counts them.
    fn number_at(line: &str, from: usize, to: usize) -> f64 {
        line[from - 1..to].trim().parse().unwrap_or_else(|_| panic!("bytes {from}-{to} of {line}"))
    }

    #[test]
    fn hipparcos_lines_have_the_published_bytes_and_give_the_place_back() {
        let [ra, dec] = [0.000_911_85, 1.089_013_32];
        let text = written(Program::Tetra3, &listed(vec![star(1, [ra, dec], Some([-5.2, -1.88]))]), 2000.0);
        let line = text.trim_end_matches('\n');
        let bars = |line: &str| -> Vec<usize> { line.match_indices('|').map(|(at, _)| at).collect() };
        assert_eq!((bars(line), line.len()), (bars(PUBLISHED), PUBLISHED.len()));
        assert!(line.split('|').all(|column| !column.is_empty()), "{line}");
        assert_eq!([number_at(line, 9, 14), number_at(line, 201, 203)], [1.0, 0.0]);
        assert_eq!([number_at(line, 88, 95), number_at(line, 97, 104)], [-5.2, -1.88]);
        assert!((number_at(line, 42, 46) - mag_v(9.0, f64::from(0.7_f32))).abs() < 0.006, "{line}");
        // Moved as the readers do, the star is where the catalog of 2016 has it, and before that it is not.
        let moved = |years: f64| {
            let dec_now = number_at(line, 65, 76) + years * number_at(line, 97, 104) / 3.6e6;
            let ra_now = number_at(line, 52, 63) + years * number_at(line, 88, 95) / 3.6e6 / dec_now.to_radians().cos();
            direction_from_ra_dec((ra_now - 360.0 * f64::from(ra_now > 180.0)) * DEG, dec_now * DEG)
        };
        let off_mas = |years: f64| moved(years).distance(direction_from_ra_dec(ra * DEG, dec * DEG)) / MAS;
        assert!(off_mas(2016.0 - HIPPARCOS_YR) < 0.2, "{}", off_mas(2016.0 - HIPPARCOS_YR));
        assert!((off_mas(0.0) - 24.75 * 5.53).abs() < 0.5, "control: {}", off_mas(0.0));
    }

    #[test]
    fn lost_gets_the_place_of_the_year_that_is_asked_for() {
        let stars = listed(vec![star(2, [10.0, -20.0], Some([1000.0, 0.0]))]);
        let read = |epoch_yr: f64| -> Vec<f64> {
            let text = written(Program::Lost, &stars, epoch_yr);
            let columns: Vec<&str> = text.trim_end().split('|').collect();
            assert_eq!((columns.len(), columns[3].len(), columns[4].len()), (5, 1, 5), "{text}");
            let decimals = columns[4].split_once('.').unwrap().1;
            assert_eq!(decimals.len(), 2, "LOST reads hundredths as a whole number");
            [0, 1, 2, 4].map(|column: usize| columns[column].trim().parse().unwrap()).into()
        };
        let (now, before) = (read(2016.0), read(2000.0));
        assert_eq!(now[..3], [10.0, -20.0, 2.0]);
        let wanted = 10.0 - 16.0 / 3600.0 / 20_f64.to_radians().cos();
        assert!((before[0] - wanted).abs() < 1e-6 && (before[0] - now[0]).abs() > 1e-3, "{before:?}");
    }

    #[test]
    fn cots_reads_names_in_line_53_and_degrees() {
        let stars = listed(vec![star(3, [200.0, 30.0], None), star(0, [201.0, 30.0], None)]);
        let text = written(Program::Cots, &stars, 2000.0);
        let lines: Vec<&str> = text.lines().collect();
        assert!(lines[..52].iter().all(|line| line.starts_with('#')) && lines.len() == 57);
        let names: Vec<&str> = lines[52].split('\t').collect();
        let value = |row: usize, name: &str| -> f64 {
            let column = names.iter().position(|known| *known == name).unwrap();
            lines[row].split('\t').nth(column).unwrap().parse().unwrap()
        };
        let rows: Vec<usize> = (55..57).collect();
        assert!(rows.iter().all(|row| lines[*row].split('\t').count() == names.len()));
        // The star without a number, which sorts first among equals, has one that is made up.
        assert_eq!(rows.iter().map(|row| value(*row, "HIP")).collect::<Vec<_>>(), [1_000_001.0, 3.0]);
        assert_eq!(
            [value(56, "RArad"), value(56, "DErad"), value(56, "Plx"), value(56, "pmRA")],
            [200.0, 30.0, 0.0, 0.0]
        );
        assert!((value(55, "RArad") - 200.0).abs() > 0.5, "control: the other star");
    }

    #[test]
    fn every_star_of_the_built_in_catalog_has_a_number_of_its_own() {
        let stars = listed(stars_of(&[], EVERY_STAR).unwrap());
        let numbers: BTreeSet<u32> = stars.iter().map(|star| star.number).collect();
        assert_eq!(numbers.len(), stars.len());
        let sirius = &stars[0];
        assert_eq!(sirius.number, 32_349);
        let bright = listed(stars_of(&[], 6.5).unwrap()).len();
        assert!(bright > LEAST_OF_LOST && bright < stars.len(), "{bright}");
        let wrong = [Program::Tetra3, Program::Cots].map(|program| {
            let options = ForTracker { program: Some(program), out: None, mag: None, epoch: Some(2026.0) };
            export(&options, program, &[]).unwrap_err().to_string()
        });
        assert!(wrong.iter().all(|error| error.starts_with("--epoch: wanted with --for lost")), "{wrong:?}");
    }
}
