//! Comparisons -> one HTML page with everything in it (tables, charts as SVG, pictures as data), and the files beside it.

use crate::picture::{Picture, robust};
use crate::report::{self, verdict};
use crate::result::{Comparison, MOST_CENTROID_PX, MOST_ENERGY, MOST_MAG, MOST_NOISE};
use crate::{compare::Compared, figures::ring_px};
use frames::report::Page;
use frames::report::plot::{Axis, Chart, Series, Style, to_svg};
use frames::sink::png::write_grey8;
use std::{io, path::Path};

/// Pixels of the images that are one pixel of the page's pictures, along each side.
const SHRINK: usize = 2;
/// How much a star's distance is enlarged in the chart of the field.
const ENLARGED: f64 = 400.0;

/// Returns the page.
fn page(compared: &[Compared], camera: &str) -> io::Result<String> {
    let class = if compared.iter().all(|one| one.result.agrees) { "met" } else { "broken" };
    let mut page = Page::begun(&verdict(compared), class, "");
    page.paragraph(&format!(
        "Real frames and drawn frames. Camera at the start: {camera}. starloop {}.",
        env!("CARGO_PKG_VERSION")
    ));
    overview(&mut page, compared);
    for one in compared {
        section(&mut page, one)?;
    }
    Ok(page.end())
}

/// Returns the files of a report, by name: the page, and for each image the fitted camera, pictures and star table.
///
/// # Errors
/// When a picture cannot be encoded.
pub fn files(compared: &[Compared], camera: &Path) -> io::Result<Vec<(String, Vec<u8>)>> {
    let mut files = vec![("report.html".to_owned(), page(compared, &camera.display().to_string())?.into_bytes())];
    let mut stems: Vec<String> = Vec::new();
    for one in compared {
        let stem = stem_of(&one.result.image, &stems);
        files.push((format!("{stem}.camera.toml"), one.camera_text.clone().into_bytes()));
        files.push((format!("{stem}.png"), side_by_side(&one.real, &one.drawn, 1)?));
        files.push((format!("{stem}.stars.csv"), report::table(&one.result).into_bytes()));
        stems.push(stem);
    }
    Ok(files)
}

/// Returns the name of an image without its folder and extension; with a number where another one has it.
fn stem_of(image: &str, taken: &[String]) -> String {
    let stem = Path::new(image).file_stem().map_or_else(|| "image".into(), |stem| stem.to_string_lossy().into_owned());
    let numbered = (2..).map(|number| format!("{stem}_{number}"));
    core::iter::once(stem.clone()).chain(numbered).find(|name| !taken.contains(name)).unwrap_or(stem)
}

/// Adds a table of the figures with their limits.
fn overview(page: &mut Page, compared: &[Compared]) {
    page.table(&[
        "image",
        "RA deg",
        "Dec deg",
        "roll deg",
        "stars",
        "outliers",
        "centroid px rms: without outliers, limit, all",
        "mag rms: without outliers, limit, all",
        "noise, drawn / real",
        "energy 3 x 3 px",
        "agrees",
    ]);
    let limits = [
        format!("{MOST_CENTROID_PX} and noise"),
        format!("{MOST_MAG} and noise"),
        format!("1 ± {MOST_NOISE}"),
        format!("± {MOST_ENERGY}"),
    ];
    let [centroid, mag, noise, energy] = limits.each_ref().map(String::as_str);
    page.row(&["limit", "", "", "", "", "", centroid, mag, noise, energy, ""]);
    for one in compared.iter().map(|one| &one.result) {
        let cells = [
            one.image.clone(),
            format!("{:.4}", one.ra_deg),
            format!("{:.4}", one.dec_deg),
            format!("{:.4}", one.roll_deg),
            one.stars.to_string(),
            one.outliers.to_string(),
            format!("{:.3}, {:.3}, {:.3}", one.centroid_robust_px, one.centroid_limit_px, one.centroid_rms_px),
            format!("{:.3}, {:.3}, {:.3}", one.mag_robust, one.mag_limit, one.mag_rms),
            format!("{:.3}", one.background_noise_ratio),
            format!("{:+.3}", one.ensquared_energy_difference),
            if one.agrees { "yes" } else { "no" }.to_owned(),
        ];
        page.row_of(if one.agrees { "" } else { "bad" }, &cells);
    }
    page.end_table();
}

fn section(page: &mut Page, compared: &Compared) -> io::Result<()> {
    let one = &compared.result;
    page.heading(&one.image);
    for failure in &one.failures {
        page.paragraph(&format!("Does not agree: {failure}"));
    }
    for words in &one.limited_by {
        page.paragraph(&format!("Limited by {words}."));
    }
    if let Some(flipped) = &one.flipped {
        page.paragraph(&format!("The image was turned over: its {flipped} are in reverse order."));
    }
    let picture = side_by_side(&compared.real, &compared.drawn, SHRINK)?;
    page.wide_image(&base::base64::encode(&picture), "real, drawn, difference");
    page.paragraph(&format!(
        "Real, drawn, and real less drawn (grey: none; white and black: five times its noise). Both images have the same \
         greys; each pixel here is the brightest of {SHRINK} x {SHRINK}."
    ));
    page.heading("The camera as it was fitted");
    page.values(camera_table(one));
    page.heading("The published figures");
    page.table(&["figure", "published for such simulations", "here"]);
    published_figures(one).iter().for_each(|row| page.row(row));
    page.end_table();
    charts(one).iter().for_each(|chart| page.picture(&to_svg(chart)));
    page.heading("The worst stars");
    page.table(&["star", "outlier"]);
    for star in &one.worst_stars {
        page.row(&[star.words().as_str(), if star.is_outlier { "yes" } else { "no" }]);
    }
    page.end_table();
    star_table(page, one);
    Ok(())
}

fn camera_table(one: &Comparison) -> Vec<(&'static str, String)> {
    let mut rows = vec![
        ("focal length", format!("{:.4} ± {:.4} mm", one.focal_length_mm[0], one.focal_length_mm[1])),
        ("distortion k1", format!("{:+.4}", one.k1)),
        ("distortion k2", fitted_or_kept(one.k2, one.k2_error)),
        (
            "optical axis, column and row",
            [0, 1]
                .map(|i| {
                    fitted_or_kept(one.principal_point_px[i], one.principal_point_errors_px.map(|errors| errors[i]))
                })
                .join("; "),
        ),
        ("PSF", format!("{}; residual {:.2} of the noise squared", one.psf, one.psf_chi2)),
        (
            "light of G = 0",
            format!(
                "{:.3e} e- in one exposure; colour terms {:+.3}, {:+.3}",
                one.zero_point_e, one.colour[0], one.colour[1]
            ),
        ),
        (
            "illumination at the corner",
            format!(
                "{:.3} of the middle, from the {}; the stars say {:+.3} ± {:.3} mag besides",
                one.edge_illumination,
                if one.edge_is_by_stars { "stars" } else { "background" },
                one.edge_by_stars_mag[0],
                one.edge_by_stars_mag[1]
            ),
        ),
        ("gain, read noise", format!("{:.3} e-/DN, {:.2} e- rms", one.gain_e_per_dn, one.read_noise_e)),
    ];
    if let Some([gain, error]) = one.transfer_gain {
        rows.push(("gain by the frame's photon transfer", format!("{gain:.3} ± {error:.3} e-/DN")));
    }
    if let Some(air) = &one.refraction {
        rows.push((
            "stretch of the air",
            format!(
                "{:.2e} ± {:.2e}, vertical at {:.0} deg from right towards down; centroids without it {:.3} px rms along an axis",
                air.stretch, air.stretch_error, air.vertical_deg, air.rms_without_px
            ),
        ));
    }
    rows
}

/// Returns a number with its error, or that it is the camera file's.
fn fitted_or_kept(value: f64, error: Option<f64>) -> String {
    error.map_or_else(|| format!("{value:.3}, kept"), |error| format!("{value:.3} ± {error:.3}"))
}

/// Returns the four figures by which dense-star-field simulations have been judged in publications.
fn published_figures(one: &Comparison) -> [[String; 3]; 5] {
    let background = &one.background;
    let mean = background.drawn_mean_dn / background.real_mean_dn - 1.0;
    let rows = [
        ("SNR, drawn against real", "within 10 %", format!("{:+.1} %", 100.0 * one.snr_difference)),
        (
            "centroids",
            "0.01 px",
            format!(
                "{:.3} px rms against the sky with its noise; the drawn frame's own {:.3} px",
                one.centroid_rms_px, one.drawn_centroid_rms_px
            ),
        ),
        (
            "background, mean",
            "within 5 %",
            format!(
                "{:+.2} %; {:.2} % rms over {} places",
                100.0 * mean,
                100.0 * background.mean_difference_rms,
                background.places
            ),
        ),
        (
            "background, spread",
            "within 10 %",
            format!(
                "{:+.1} %; in the darker half {:+.1} %, in the brighter {:+.1} %",
                100.0 * (background.noise_ratio - 1.0),
                100.0 * (background.noise_ratio_dark_bright[0] - 1.0),
                100.0 * (background.noise_ratio_dark_bright[1] - 1.0)
            ),
        ),
        (
            "energy concentration",
            "above 90 %",
            format!(
                "5 x 5 px: real {:.1} %, drawn {:.1} %; 3 x 3 px: real {:.1} ± {:.1} %, drawn {:.1} %",
                100.0 * one.energy.real[1],
                100.0 * one.energy.drawn[1],
                100.0 * one.energy.real[0],
                100.0 * one.energy.errors[0],
                100.0 * one.energy.drawn[0]
            ),
        ),
    ];
    rows.map(|(name, published, here)| [name.to_owned(), published.to_owned(), here])
}

fn charts(one: &Comparison) -> Vec<Chart> {
    let profile =
        |values: &[f64]| values.iter().enumerate().map(|(ring, value)| [ring_px(ring), *value]).collect::<Vec<_>>();
    let stars = |of: fn(&crate::figures::StarRow) -> [f64; 2]| one.star_rows.iter().map(of).collect::<Vec<_>>();
    let rows =
        |of: fn(&crate::figures::SnrRow) -> f64| one.snr.iter().map(|row| [row.mag_g, of(row)]).collect::<Vec<_>>();
    let arrow = |star: &crate::figures::StarRow| {
        let from = [star.x_px, -star.y_px];
        let to = [from[0] + ENLARGED * star.dx_px, from[1] - ENLARGED * star.dy_px];
        Series::new("", Style::Line, 1, vec![from, to])
    };
    let mut field: Vec<Series> = vec![Series::new("star", Style::Points, 0, stars(|star| [star.x_px, -star.y_px]))];
    field.extend(one.star_rows.iter().map(arrow));
    vec![
        chart(
            "Distance of real stars from drawn ones",
            Axis::linear("along columns, px"),
            Axis::linear("along rows, px"),
            vec![
                Series::new("real", Style::Points, 0, stars(|star| [star.dx_px, star.dy_px])),
                Series::new(
                    "drawn, measured alike",
                    Style::Points,
                    1,
                    stars(|star| [star.drawn_dx_px, star.drawn_dy_px]),
                ),
            ],
            Vec::new(),
        ),
        chart(
            "The same over the field",
            Axis::linear("column, px"),
            Axis::linear("- row, px"),
            field,
            vec![format!("Lines: distances, {ENLARGED} times as long.")],
        ),
        chart(
            "Magnitudes of real stars less drawn ones",
            Axis::linear("Gaia G"),
            Axis::linear("difference, mag"),
            vec![
                Series::new("real", Style::Points, 0, stars(|star| [star.mag_g, star.dmag])),
                Series::new("drawn, measured alike", Style::Points, 1, stars(|star| [star.mag_g, star.drawn_dmag])),
            ],
            Vec::new(),
        ),
        chart(
            "The same by colour",
            Axis::linear("Gaia BP - RP"),
            Axis::linear("difference, mag"),
            vec![Series::new("real", Style::Points, 0, stars(|star| [star.bp_rp, star.dmag]))],
            Vec::new(),
        ),
        chart(
            "Radial profile",
            Axis::linear("distance, px"),
            Axis::log("share of the light per pixel"),
            vec![
                Series::new("real", Style::Line, 0, profile(&one.energy.real_profile)),
                Series::new("drawn", Style::DashedLine, 1, profile(&one.energy.drawn_profile)),
            ],
            Vec::new(),
        ),
        chart(
            "SNR in 5 x 5 px",
            Axis::linear("Gaia G"),
            Axis::log("SNR"),
            vec![
                Series::new("real", Style::Line, 0, rows(|row| row.real)),
                Series::new("drawn", Style::DashedLine, 1, rows(|row| row.drawn)),
            ],
            Vec::new(),
        ),
    ]
}

fn chart(title: &str, x: Axis, y: Axis, series: Vec<Series>, notes: Vec<String>) -> Chart {
    Chart { title: title.into(), x, y, series, ring: String::new(), notes }
}

fn star_table(page: &mut Page, one: &Comparison) {
    page.add(&format!("<details><summary>{} stars above SNR 20</summary>", one.stars));
    page.table(&["G", "BP - RP", "column px", "row px", "SNR", "dx px", "dy px", "d mag"]);
    for star in &one.star_rows {
        page.row(&[
            format!("{:.2}", star.mag_g),
            format!("{:.2}", star.bp_rp),
            format!("{:.2}", star.x_px),
            format!("{:.2}", star.y_px),
            format!("{:.1}", star.snr),
            format!("{:+.3}", star.dx_px),
            format!("{:+.3}", star.dy_px),
            format!("{:+.3}", star.dmag),
        ]);
    }
    page.end_table();
    page.add("</details>");
}

/// Spreads above the middle that are white.
const WHITE_SPREADS: f64 = 40.0;
/// Spreads of the difference that are white or black.
const DIFFERENCE_SPREADS: f64 = 5.0;
/// Columns between two pictures, px.
const GAP_PX: usize = 4;

/// Returns real | drawn | difference as a PNG file; `shrink` pixels of each side become one, the brightest of them for
/// the two images (stars stay visible), their mean for the difference.
fn side_by_side(real: &Picture, drawn: &Picture, shrink: usize) -> io::Result<Vec<u8>> {
    let mut sample: Vec<f64> = real.dn.iter().step_by(5).map(|dn| f64::from(*dn)).collect();
    let [middle, spread] = robust(&mut sample);
    let spread = spread.max(1.0);
    // The same greys for both: asinh shows faint and bright stars.
    let white = (WHITE_SPREADS / 3.0).asinh();
    let grey = |dn: f64| (255.0 * (0.12 + 0.88 * ((dn - middle) / (3.0 * spread)).asinh() / white)).clamp(0.0, 255.0);
    let difference = real.map(|i, dn| dn - drawn.dn[i]);
    let mut sample: Vec<f64> = difference.dn.iter().step_by(5).map(|dn| f64::from(*dn)).collect();
    let [_, noise] = robust(&mut sample);
    let of_difference = |dn: f64| (127.5 * (1.0 + dn / (DIFFERENCE_SPREADS * noise.max(0.5)))).clamp(0.0, 255.0);
    let highest = |values: &[f64]| values.iter().fold(f64::MIN, |a, b| a.max(*b));
    let mean = |values: &[f64]| values.iter().sum::<f64>() / values.len() as f64;
    let [width, height] = real.size_px.map(|side| side / shrink.max(1));
    let total = 3 * width + 2 * GAP_PX;
    let mut bytes = vec![255; total * height];
    let mut put = |number: usize, picture: &Picture, of: &dyn Fn(&[f64]) -> f64, grey: &dyn Fn(f64) -> f64| {
        let mut block = Vec::with_capacity(shrink * shrink);
        for y in 0..height {
            for x in 0..width {
                block.clear();
                (0..shrink)
                    .for_each(|dy| (0..shrink).for_each(|dx| block.push(picture.at(x * shrink + dx, y * shrink + dy))));
                #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "clamped to a byte")]
                {
                    bytes[y * total + number * (width + GAP_PX) + x] = grey(of(&block)) as u8;
                }
            }
        }
    };
    put(0, real, &highest, &grey);
    put(1, drawn, &highest, &grey);
    put(2, &difference, &mean, &of_difference);
    let mut png = Vec::new();
    write_grey8(&mut png, [total, height], &bytes)?;
    Ok(png)
}
