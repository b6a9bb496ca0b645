//! `starloop catalog map`: where on the sky the stars of catalogs and layers are, as a picture and a table.

use anyhow::{Context, ensure};
use clap::Args;
use frames::sink::write_file_atomically;
use imports::density_map::{DensityMap, direction_at};
use stars::layer::{Layer, is_layer};
use stars::{catalog::Catalog, galactic::galactic_rad};
use std::{io, io::Write, path::PathBuf};

/// Arguments of `starloop catalog map`.
#[derive(Debug, Args)]
pub(crate) struct MapArgs {
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
pub(crate) fn map(args: &MapArgs, out: &mut impl Write) -> anyhow::Result<()> {
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

fn write_table(map: &DensityMap, out: &mut impl Write) -> io::Result<()> {
    writeln!(out, "healpix_{},ra_deg,dec_deg,l_deg,b_deg,stars,stars_per_deg2", map.order)?;
    for (cell, ([ra, dec], stars, density)) in map.cells().enumerate() {
        let galactic = galactic_rad(base::source::direction_from_ra_dec(ra, dec));
        let [ra, dec, l, b] = [ra, dec, galactic[0], galactic[1]].map(f64::to_degrees);
        writeln!(out, "{cell},{ra:.4},{dec:.4},{l:.4},{b:.4},{stars},{density:.4}")?;
    }
    Ok(())
}

// A density map -> a PNG: the sky as an ellipse, below it the colours with their densities.

/// Size of the sky, pixels.
const SKY_PX: [usize; 2] = [1440, 720];
/// Between the sky and the edges, and the legend.
const MARGIN_PX: usize = 16;
/// Height of the legend's colours, pixels.
const BAR_PX: usize = 14;
/// Dots of letters are so many pixels wide.
const LETTER_SCALE: usize = 2;
/// Behind everything.
const PAPER: [u8; 3] = [255, 255, 255];
/// Colour of places without stars.
const EMPTY: [u8; 3] = [0, 0, 0];
/// Letters and lines.
const INK: [u8; 3] = [40, 40, 40];
/// Colours from sparse to dense, evenly apart: from black over violet and orange to light yellow, brighter all the way,
/// so that the picture reads in grey too.
const COLOURS: [[u8; 3]; 9] = [
    [4, 4, 20],
    [31, 12, 72],
    [85, 15, 109],
    [136, 34, 106],
    [186, 54, 85],
    [227, 89, 51],
    [249, 140, 10],
    [249, 201, 50],
    [252, 255, 164],
];

/// Writes the picture: `what` names the densities in its legend.
///
/// # Errors
/// When the output fails.
pub(crate) fn write_png(out: impl Write, map: &DensityMap, is_galactic: bool, what: &str) -> io::Result<()> {
    let width = SKY_PX[0] + 2 * MARGIN_PX;
    let text_px = LETTER_SCALE * LETTER_PX[1];
    let height = SKY_PX[1] + 4 * MARGIN_PX + BAR_PX + 2 * text_px;
    let mut canvas = Canvas { width, pixels: vec![PAPER; width * height] };
    let scale = Scale::of(map);
    for y in 0..SKY_PX[1] {
        for x in 0..SKY_PX[0] {
            let across = |at: usize, size: usize| (at as f64 + 0.5) / size as f64 * 2.0 - 1.0;
            if let Some(direction) = direction_at(across(x, SKY_PX[0]), -across(y, SKY_PX[1]), is_galactic) {
                canvas.set([x + MARGIN_PX, y + MARGIN_PX], scale.colour(map.density(direction)));
            }
        }
    }
    canvas.legend(&scale, SKY_PX[1] + 2 * MARGIN_PX, what);
    canvas.write(out)
}

/// Densities -> colours, by their logarithm.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Scale {
    log10: [f64; 2],
}

impl Scale {
    fn of(map: &DensityMap) -> Self {
        let [low, high] = map.range().unwrap_or([1.0, 10.0]).map(f64::log10);
        // Half a decade at least: the small noise of an even sky must not fill the range of colours.
        Self { log10: [low, high.max(low + 0.5)] }
    }

    fn colour(&self, density: f64) -> [u8; 3] {
        if density > 0.0 {
            self.colour_at((density.log10() - self.log10[0]) / (self.log10[1] - self.log10[0]))
        } else {
            EMPTY
        }
    }

    #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "between two colours, and two places")]
    fn colour_at(&self, share: f64) -> [u8; 3] {
        let place = share.clamp(0.0, 1.0) * (COLOURS.len() - 1) as f64;
        let first = (place as usize).min(COLOURS.len() - 2);
        let part = place - first as f64;
        core::array::from_fn(|i| {
            let [a, b] = [COLOURS[first][i], COLOURS[first + 1][i]].map(f64::from);
            (a + (b - a) * part).round() as u8
        })
    }

    /// Densities to be labelled, with their share of the scale: powers of ten, with 2 and 5 between them on a short
    /// scale.
    #[allow(clippy::cast_possible_truncation, reason = "decades of densities are few")]
    fn marks(&self) -> Vec<(f64, String)> {
        let [low, high] = self.log10;
        let steps: &[f64] = if high - low < 2.5 { &[1.0, 2.0, 5.0] } else { &[1.0] };
        let decades = (low.floor() as i32)..=(high.ceil() as i32);
        let densities = decades.flat_map(|decade| steps.iter().map(move |step| step * 10.0_f64.powi(decade)));
        let inside = densities.filter(|density| (low..=high).contains(&density.log10()));
        inside.map(|density| ((density.log10() - low) / (high - low), number(density))).collect()
    }
}

/// Returns a density as text without needless digits, such as 0.05, 2 or 20000: 1, 2 or 5 times a power of ten.
#[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "a few digits")]
fn number(density: f64) -> String {
    let digits = (-density.log10().floor()).max(0.0) as usize;
    format!("{density:.digits$}")
}

struct Canvas {
    width: usize,
    pixels: Vec<[u8; 3]>,
}

impl Canvas {
    fn set(&mut self, [x, y]: [usize; 2], colour: [u8; 3]) {
        if x < self.width
            && let Some(pixel) = self.pixels.get_mut(y * self.width + x)
        {
            *pixel = colour;
        }
    }

    /// Draws the colours from `top` on over half the width, their densities below, and their name.
    #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "places within the picture")]
    fn legend(&mut self, scale: &Scale, top: usize, what: &str) {
        let (left, length) = (self.width / 4, self.width / 2);
        for x in 0..length {
            let colour = scale.colour_at(x as f64 / length as f64);
            (0..BAR_PX).for_each(|y| self.set([left + x, top + y], colour));
        }
        let below = top + BAR_PX + MARGIN_PX / 2;
        for (share, text) in scale.marks() {
            let x = left + (share * length as f64) as usize;
            (0..BAR_PX + MARGIN_PX / 4).for_each(|y| self.set([x, top + y], INK));
            self.text([x, below], &text);
        }
        self.text([self.width / 2, below + LETTER_SCALE * LETTER_PX[1] + MARGIN_PX / 2], what);
    }

    /// Draws text about the middle `x`, down from `y`.
    fn text(&mut self, [x, y]: [usize; 2], text: &str) {
        let left = x.saturating_sub(LETTER_SCALE * width_px(text) / 2);
        for [across, down] in dots(text) {
            for part in 0..LETTER_SCALE * LETTER_SCALE {
                let (dx, dy) = (part % LETTER_SCALE, part / LETTER_SCALE);
                self.set([left + across * LETTER_SCALE + dx, y + down * LETTER_SCALE + dy], INK);
            }
        }
    }

    fn write(&self, mut out: impl Write) -> io::Result<()> {
        let side = |n: usize| u32::try_from(n).map_err(|e| io::Error::new(io::ErrorKind::InvalidInput, e));
        let height = self.pixels.len() / self.width;
        let mut encoder = png::Encoder::new(&mut out, side(self.width)?, side(height)?);
        encoder.set_color(png::ColorType::Rgb);
        encoder.set_depth(png::BitDepth::Eight);
        let mut writer = encoder.write_header()?;
        writer.write_image_data(self.pixels.as_flattened())?;
        Ok(writer.finish()?)
    }
}

// A few letters of 5 x 7 dots, for legends in pictures made of pixels.

/// Dots across a letter, and down it.
pub(crate) const LETTER_PX: [usize; 2] = [5, 7];
/// Dots from one letter to the next.
const ADVANCE_PX: usize = 6;

/// Rows from the top, the leftmost dot in the highest of five bits.
const LETTERS: [(char, [u8; 7]); 26] = [
    ('0', [0x0E, 0x11, 0x13, 0x15, 0x19, 0x11, 0x0E]),
    ('1', [0x04, 0x0C, 0x04, 0x04, 0x04, 0x04, 0x0E]),
    ('2', [0x0E, 0x11, 0x01, 0x02, 0x04, 0x08, 0x1F]),
    ('3', [0x1F, 0x02, 0x04, 0x02, 0x01, 0x11, 0x0E]),
    ('4', [0x02, 0x06, 0x0A, 0x12, 0x1F, 0x02, 0x02]),
    ('5', [0x1F, 0x10, 0x1E, 0x01, 0x01, 0x11, 0x0E]),
    ('6', [0x06, 0x08, 0x10, 0x1E, 0x11, 0x11, 0x0E]),
    ('7', [0x1F, 0x01, 0x02, 0x04, 0x08, 0x08, 0x08]),
    ('8', [0x0E, 0x11, 0x11, 0x0E, 0x11, 0x11, 0x0E]),
    ('9', [0x0E, 0x11, 0x11, 0x0F, 0x01, 0x02, 0x0C]),
    ('.', [0x00, 0x00, 0x00, 0x00, 0x00, 0x0C, 0x0C]),
    (',', [0x00, 0x00, 0x00, 0x00, 0x0C, 0x04, 0x08]),
    ('-', [0x00, 0x00, 0x00, 0x1F, 0x00, 0x00, 0x00]),
    ('<', [0x02, 0x04, 0x08, 0x10, 0x08, 0x04, 0x02]),
    ('G', [0x0E, 0x11, 0x10, 0x17, 0x11, 0x11, 0x0F]),
    ('a', [0x00, 0x00, 0x0E, 0x01, 0x0F, 0x11, 0x0F]),
    ('d', [0x01, 0x01, 0x0D, 0x13, 0x11, 0x11, 0x0F]),
    ('e', [0x00, 0x00, 0x0E, 0x11, 0x1F, 0x10, 0x0E]),
    ('g', [0x00, 0x0F, 0x11, 0x11, 0x0F, 0x01, 0x0E]),
    ('p', [0x00, 0x00, 0x1E, 0x11, 0x1E, 0x10, 0x10]),
    ('q', [0x00, 0x00, 0x0D, 0x13, 0x0F, 0x01, 0x01]),
    ('r', [0x00, 0x00, 0x16, 0x19, 0x10, 0x10, 0x10]),
    ('s', [0x00, 0x00, 0x0E, 0x10, 0x0E, 0x01, 0x1E]),
    ('t', [0x08, 0x08, 0x1C, 0x08, 0x08, 0x09, 0x06]),
    ('u', [0x00, 0x00, 0x11, 0x11, 0x11, 0x13, 0x0D]),
    (' ', [0x00; 7]),
];

/// Dots of a line of text from its upper left corner: x to the right, y down. Characters that it lacks are left blank.
pub(crate) fn dots(text: &str) -> impl Iterator<Item = [usize; 2]> {
    let rows = |letter: char| LETTERS.iter().find(|(known, _)| *known == letter).map_or([0; 7], |(_, rows)| *rows);
    text.chars().enumerate().flat_map(move |(place, letter)| {
        let rows = rows(letter);
        (0..LETTER_PX[1]).flat_map(move |y| {
            let is_set = move |x: &usize| rows[y] >> (LETTER_PX[0] - 1 - x) & 1 == 1;
            (0..LETTER_PX[0]).filter(is_set).map(move |x| [place * ADVANCE_PX + x, y])
        })
    })
}

/// Returns the width of a line of text, dots.
pub(crate) fn width_px(text: &str) -> usize {
    text.chars().count() * ADVANCE_PX
}

#[cfg(test)]
mod catalog_map_tests {
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

#[cfg(test)]
mod catalog_map_picture_tests {
    use super::*;
    use stars::catalog::Catalog;

    #[test]
    fn colours_brighten_with_density_and_marks_are_round() {
        let scale = Scale { log10: [-0.5, 3.2] };
        let light = |density: f64| scale.colour(density).iter().map(|c| u32::from(*c)).sum::<u32>();
        assert!(
            (0..37)
                .all(|i| light(10.0_f64.powf(-0.5 + 0.1 * f64::from(i)))
                    < light(10.0_f64.powf(-0.4 + 0.1 * f64::from(i))))
        );
        assert_eq!((scale.colour(0.0), scale.colour(1e9), scale.colour(1e-9)), (EMPTY, COLOURS[8], COLOURS[0]));
        let names = |scale: &Scale| scale.marks().into_iter().map(|(_, name)| name).collect::<Vec<_>>();
        assert_eq!(names(&scale), ["1", "10", "100", "1000"]);
        assert_eq!(names(&Scale { log10: [-1.4, 0.5] }), ["0.05", "0.1", "0.2", "0.5", "1", "2"]);
        assert!((scale.marks()[1].0 - 1.5 / 3.7).abs() < 1e-9);
    }

    #[test]
    fn the_picture_is_a_png_of_the_sky() {
        let mut map = DensityMap::default();
        map.add_catalog(&Catalog::built_in().unwrap(), 99.0);
        let mut bytes = Vec::new();
        write_png(&mut bytes, &map.coarsened(), true, "stars per square degree").unwrap();
        let mut reader = png::Decoder::new(io::Cursor::new(&bytes)).read_info().unwrap();
        let mut pixels = vec![0; reader.output_buffer_size().unwrap()];
        let info = reader.next_frame(&mut pixels).unwrap();
        let (width, at) = (info.width as usize, |x: usize, y: usize, width: usize| {
            [0, 1, 2].map(|i| pixels[3 * (y * width + x) + i])
        });
        assert_eq!(at(2, 2, width), PAPER, "beside the ellipse");
        let light = |pixel: [u8; 3]| pixel.iter().map(|c| u32::from(*c)).sum::<u32>();
        let mean = |y: usize| (300..1100).map(|x| light(at(x, y, width))).sum::<u32>() / 800;
        assert!(mean(MARGIN_PX + 360) > mean(MARGIN_PX + 100) + 60, "the Milky Way lies across it");
        write_png(&mut Vec::new(), &DensityMap::default(), false, "none").unwrap();
    }
}

#[cfg(test)]
mod lettering_tests {
    use super::*;

    #[test]
    fn letters_are_where_they_are_read() {
        let mut rows = vec![vec![b' '; width_px("1<")]; LETTER_PX[1]];
        dots("1<").for_each(|[x, y]| rows[y][x] = b'#');
        let text: Vec<String> = rows.iter().map(|row| String::from_utf8(row.clone()).unwrap()).collect();
        let wanted = [
            "  #      #  ",
            " ##     #   ",
            "  #    #    ",
            "  #   #     ",
            "  #    #    ",
            "  #     #   ",
            " ###     #  ",
        ];
        assert_eq!(text, wanted);
        assert_eq!(dots("\u{e9}").count(), 0, "unknown letters are blank");
    }
}
