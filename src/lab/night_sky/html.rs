//! Comparisons -> one HTML page with everything in it (tables, charts as SVG, pictures as data), and the files beside it.

use crate::picture::{Picture, robust};
use crate::report::{self, verdict};
use crate::result::{Comparison, MOST_CENTROID_PX, MOST_ENERGY, MOST_MAG, MOST_NOISE};
use crate::{compare::Compared, figures::ring_px};
use base::xml::escaped;
use core::fmt::Write;
use frames::report::plot::{Axis, Chart, Series, Style, to_svg};
use frames::sink::png::write_grey8;
use std::{io, path::Path};

/// Pixels of the images that are one pixel of the page's pictures, along each side.
const SHRINK: usize = 2;
/// How much a star's distance is enlarged in the chart of the field.
const ENLARGED: f64 = 400.0;
/// Style of the page.
const STYLE: &str = "body{font:15px/1.5 sans-serif;max-width:70em;margin:2em auto;padding:0 1em;color:#222}\
    table{border-collapse:collapse;margin:1em 0}td,th{border:1px solid #ccc;padding:.2em .6em;text-align:right}\
    th{background:#f3f3f3}td:first-child,th:first-child{text-align:left}img{max-width:100%}\
    .yes{color:#060;font-weight:bold}.no{color:#a00;font-weight:bold}svg{max-width:100%;height:auto}\
    @media print{@page{margin:14mm}body{max-width:none;margin:0;padding:0;font-size:11px}table{width:100%}td,th{padding:.15em .3em;overflow-wrap:break-word}\
    thead{display:table-header-group}tr,img,svg{break-inside:avoid}h2{break-after:avoid}}";

/// Returns the page.
fn page(compared: &[Compared], camera: &str) -> io::Result<String> {
    let mut page = String::new();
    let verdict = verdict(compared);
    let class = if compared.iter().all(|one| one.result.agrees) { "yes" } else { "no" };
    let _ = write!(
        page,
        "<!DOCTYPE html>\n<html lang=\"en\"><head><meta charset=\"utf-8\"><title>starloop compare</title><style>{STYLE}</style></head>\n\
         <body><h1>Real frames and drawn frames</h1>\n<p class=\"{class}\">{}</p>\n<p>Camera at the start: {}. starloop {}.</p>\n",
        escaped(&verdict),
        escaped(camera),
        env!("CARGO_PKG_VERSION")
    );
    page.push_str(&overview(compared));
    for one in compared {
        section(&mut page, one)?;
    }
    page.push_str("</body></html>\n");
    Ok(page)
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

/// Returns a table of the figures with their limits.
fn overview(compared: &[Compared]) -> String {
    let mut text = "<table><tr><th>image</th><th>RA deg</th><th>Dec deg</th><th>roll deg</th><th>stars</th><th>outliers</th><th>centroid px rms: without outliers, limit, all</th>\
                    <th>mag rms: without outliers, limit, all</th><th>noise, drawn / real</th><th>energy 3 x 3 px</th><th>agrees</th></tr>\n"
        .to_owned();
    let _ = writeln!(
        text,
        "<tr><td>limit</td><td></td><td></td><td></td><td></td><td></td><td>{MOST_CENTROID_PX} and noise</td><td>{MOST_MAG} and noise</td><td>1 &plusmn; {MOST_NOISE}</td><td>&plusmn; {MOST_ENERGY}</td><td></td></tr>"
    );
    for one in compared.iter().map(|one| &one.result) {
        let _ = writeln!(
            text,
            "<tr><td>{}</td><td>{:.4}</td><td>{:.4}</td><td>{:.4}</td><td>{}</td><td>{}</td><td>{:.3}, {:.3}, {:.3}</td><td>{:.3}, {:.3}, {:.3}</td><td>{:.3}</td><td>{:+.3}</td><td class=\"{}</td></tr>",
            escaped(&one.image),
            one.ra_deg,
            one.dec_deg,
            one.roll_deg,
            one.stars,
            one.outliers,
            one.centroid_robust_px,
            one.centroid_limit_px,
            one.centroid_rms_px,
            one.mag_robust,
            one.mag_limit,
            one.mag_rms,
            one.background_noise_ratio,
            one.ensquared_energy_difference,
            if one.agrees { "yes\">yes" } else { "no\">no" }
        );
    }
    text.push_str("</table>\n");
    text
}

fn section(page: &mut String, compared: &Compared) -> io::Result<()> {
    let one = &compared.result;
    let _ = writeln!(page, "<h2>{}</h2>", escaped(&one.image));
    for failure in &one.failures {
        let _ = writeln!(page, "<p class=\"no\">{}</p>", escaped(failure));
    }
    for words in &one.limited_by {
        let _ = writeln!(page, "<p>Limited by {}.</p>", escaped(words));
    }
    if let Some(flipped) = &one.flipped {
        let _ = writeln!(page, "<p>The image was turned over: its {flipped} are in reverse order.</p>");
    }
    let picture = side_by_side(&compared.real, &compared.drawn, SHRINK)?;
    let _ = writeln!(
        page,
        "<p><img alt=\"real, drawn, difference\" src=\"data:image/png;base64,{}\"><br>Real, drawn, and real less drawn (grey: none; white and black: five times its noise). \
         Both images have the same greys; each pixel here is the brightest of {SHRINK} x {SHRINK}.</p>",
        base::base64::encode(&picture)
    );
    page.push_str(&camera_table(one));
    page.push_str(&published_table(one));
    for chart in charts(one) {
        page.push_str(&to_svg(&chart));
        page.push('\n');
    }
    page.push_str("<h3>The worst stars</h3>\n<ul>\n");
    for star in &one.worst_stars {
        let kind = if star.is_outlier { "outlier: " } else { "" };
        let _ = writeln!(page, "<li>{kind}{}</li>", escaped(&star.words()));
    }
    page.push_str("</ul>\n");
    page.push_str(&star_table(one));
    Ok(())
}

fn camera_table(one: &Comparison) -> String {
    let mut rows = vec![
        ("focal length", format!("{:.4} &plusmn; {:.4} mm", one.focal_length_mm[0], one.focal_length_mm[1])),
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
        ("PSF", format!("{}; residual {:.2} of the noise squared", escaped(&one.psf), one.psf_chi2)),
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
                "{:.3} of the middle, from the {}; the stars say {:+.3} &plusmn; {:.3} mag besides",
                one.edge_illumination,
                if one.edge_is_by_stars { "stars" } else { "background" },
                one.edge_by_stars_mag[0],
                one.edge_by_stars_mag[1]
            ),
        ),
        ("gain, read noise", format!("{:.3} e-/DN, {:.2} e- rms", one.gain_e_per_dn, one.read_noise_e)),
    ];
    if let Some([gain, error]) = one.transfer_gain {
        rows.push(("gain by the frame's photon transfer", format!("{gain:.3} &plusmn; {error:.3} e-/DN")));
    }
    if let Some(air) = &one.refraction {
        rows.push((
            "stretch of the air",
            format!(
                "{:.2e} &plusmn; {:.2e}, vertical at {:.0} deg from right towards down; centroids without it {:.3} px rms along an axis",
                air.stretch, air.stretch_error, air.vertical_deg, air.rms_without_px
            ),
        ));
    }
    let mut text = "<h3>The camera as it was fitted</h3><table>\n".to_owned();
    for (name, value) in rows {
        let _ = writeln!(text, "<tr><td>{name}</td><td>{value}</td></tr>");
    }
    text.push_str("</table>\n");
    text
}

/// Returns a number with its error, or that it is the camera file's.
fn fitted_or_kept(value: f64, error: Option<f64>) -> String {
    error.map_or_else(|| format!("{value:.3}, kept"), |error| format!("{value:.3} &plusmn; {error:.3}"))
}

/// Returns the four figures by which dense-star-field simulations have been judged in publications.
fn published_table(one: &Comparison) -> String {
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
                "5 x 5 px: real {:.1} %, drawn {:.1} %; 3 x 3 px: real {:.1} &plusmn; {:.1} %, drawn {:.1} %",
                100.0 * one.energy.real[1],
                100.0 * one.energy.drawn[1],
                100.0 * one.energy.real[0],
                100.0 * one.energy.errors[0],
                100.0 * one.energy.drawn[0]
            ),
        ),
    ];
    let mut text = "<h3>The published figures</h3><table><tr><th>figure</th><th>published for such simulations</th><th>here</th></tr>\n".to_owned();
    for (name, published, here) in rows {
        let _ = writeln!(text, "<tr><td>{name}</td><td>{published}</td><td>{here}</td></tr>");
    }
    text.push_str("</table>\n");
    text
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

fn star_table(one: &Comparison) -> String {
    let mut text = format!(
        "<details><summary>{} stars above SNR 20</summary><table><tr><th>G</th><th>BP - RP</th><th>column px</th><th>row px</th><th>SNR</th>\
         <th>dx px</th><th>dy px</th><th>d mag</th></tr>\n",
        one.stars
    );
    for star in &one.star_rows {
        let _ = writeln!(
            text,
            "<tr><td>{:.2}</td><td>{:.2}</td><td>{:.2}</td><td>{:.2}</td><td>{:.1}</td><td>{:+.3}</td><td>{:+.3}</td><td>{:+.3}</td></tr>",
            star.mag_g, star.bp_rp, star.x_px, star.y_px, star.snr, star.dx_px, star.dy_px, star.dmag
        );
    }
    text.push_str("</table></details>\n");
    text
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

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_of_files_are_no_markup() {
        assert_eq!(escaped("<b a=\"1\">&"), "&lt;b a=&quot;1&quot;&gt;&amp;");
    }
}
