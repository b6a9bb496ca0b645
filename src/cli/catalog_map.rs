//! `starloop catalog map`: where on the sky the stars of catalogs and layers are, as a picture and a table.

use crate::cli::catalog_map_picture::write_png;
use anyhow::{Context, ensure};
use clap::Args;
use frames::sink::write_file_atomically;
use imports::density_map::DensityMap;
use stars::layer::{Layer, is_layer};
use stars::{catalog::Catalog, galactic::galactic_rad};
use std::{io::Write, path::PathBuf};

/// Arguments of `starloop catalog map`.
#[derive(Debug, Args)]
pub(super) struct MapArgs {
    /// Packed catalogs and layers, taken together; the built-in catalog when left out
    files: Vec<PathBuf>,
    /// Picture to write, PNG: the whole sky with equal areas equal (Mollweide), densities in colours on a log scale
    #[arg(long)]
    out: PathBuf,
    /// Faintest Gaia G magnitude counted; layers that end below it are not read but for their tables
    #[arg(long, allow_negative_numbers = true)]
    mag: Option<f32>,
    /// Galactic coordinates, the centre in the middle, instead of equatorial ones
    #[arg(long)]
    galactic: bool,
    /// Table to write: the cells of the map with their places, stars and densities
    #[arg(long)]
    csv: Option<PathBuf>,
}

/// Counts stars, draws the map and prints the numbers.
pub(super) fn map(args: &MapArgs, out: &mut impl Write) -> anyhow::Result<()> {
    ensure!(args.mag.is_none_or(f32::is_finite), "--mag: wanted a magnitude, got {:?}", args.mag);
    let is_png = args.out.extension().is_some_and(|end| end.eq_ignore_ascii_case("png"));
    ensure!(is_png, "--out {}: wanted a name that ends in .png: maps are PNG files", args.out.display());
    let map = counted(&args.files, args.mag.unwrap_or(f32::INFINITY))?.coarsened();
    let what = match args.mag {
        Some(mag) => format!("stars per square degree, G < {mag}"),
        None => "stars per square degree".to_owned(),
    };
    write_file_atomically(&args.out, |file| write_png(file, &map, args.galactic, &what))?;
    if let Some(path) = &args.csv {
        write_file_atomically(path, |mut file| write_table(&map, &mut file))?;
    }
    let [least, most] = map.range().unwrap_or([0.0; 2]);
    writeln!(
        out,
        "{}: {} stars in cells of order {}, {least:.3} to {most:.1} per square degree where there are any",
        args.out.display(),
        map.stars(),
        map.order
    )?;
    Ok(())
}

fn counted(files: &[PathBuf], limiting_mag: f32) -> anyhow::Result<DensityMap> {
    let mut map = DensityMap::default();
    if files.is_empty() {
        map.add_catalog(&Catalog::built_in()?, limiting_mag);
    }
    for path in files {
        if is_layer(path) {
            map.add_layer(&Layer::open(path)?, limiting_mag)?;
        } else {
            let catalog = Catalog::open(path).with_context(|| format!("cannot use catalog {}", path.display()))?;
            map.add_catalog(&catalog, limiting_mag);
        }
    }
    Ok(map)
}

fn write_table(map: &DensityMap, out: &mut impl Write) -> std::io::Result<()> {
    writeln!(out, "healpix_{},ra_deg,dec_deg,l_deg,b_deg,stars,stars_per_deg2", map.order)?;
    for (cell, ([ra, dec], stars, density)) in map.cells().enumerate() {
        let galactic = galactic_rad(base::source::direction_from_ra_dec(ra, dec));
        let [ra, dec, l, b] = [ra, dec, galactic[0], galactic[1]].map(f64::to_degrees);
        writeln!(out, "{cell},{ra:.4},{dec:.4},{l:.4},{b:.4},{stars},{density:.4}")?;
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;
    use clap::Parser;

    #[derive(Debug, Parser)]
    struct Program {
        #[command(flatten)]
        map: MapArgs,
    }

    fn mapped(line: &[&str]) -> anyhow::Result<String> {
        let mut out = Vec::new();
        map(&Program::try_parse_from([&["x"], line].concat()).expect("a valid command line").map, &mut out)?;
        Ok(String::from_utf8(out)?)
    }

    #[test]
    fn writes_the_picture_and_the_table() {
        let folder = tempfile::tempdir().unwrap();
        let path = |name: &str| folder.path().join(name).to_str().unwrap().to_owned();
        let (picture, table) = (path("map.png"), path("map.csv"));
        let reported = mapped(&["--out", &picture, "--csv", &table, "--galactic"]).unwrap();
        assert!(reported.contains("106462 stars in cells of order 4"), "{reported}");
        let text = std::fs::read_to_string(&table).unwrap();
        let counts = text.lines().skip(1).map(|line| line.split(',').nth(5).unwrap().parse::<u64>().unwrap());
        assert_eq!((text.lines().count(), counts.sum::<u64>()), (3073, 106_462));
        assert!(std::fs::read(&picture).unwrap().starts_with(b"\x89PNG"));
        let bright = mapped(&["--out", &picture, "--mag", "6"]).unwrap();
        assert!(bright.contains("cells of order 3"), "{bright}");
        let none = mapped(&["--out", &picture, "no/such.starcat"]).unwrap_err();
        assert!(format!("{none:#}").contains("no/such.starcat"));
        let nowhere = mapped(&["--out", "/no/such/map.png"]).unwrap_err();
        assert!(format!("{nowhere:#}").contains("/no/such/map.png"), "{nowhere:#}");
    }
}
