//! The plots of `starloop psf`: the chain over frequency, and the star over distance.

use crate::cli::psf_star::{NYQUIST, Star};
use frames::report::plot::{Axis, Chart, Series, Style};
use frames::report::to_svg;
use plan::optics::energy;
use std::path::{Path, PathBuf};

/// Points of a curve.
const POINTS: u32 = 160;
/// Frequencies are shown to this share of Nyquist.
const HIGHEST: f64 = 3.0;
/// Distances are shown to this, px.
const FURTHEST_PX: f64 = 6.0;

/// Files and their texts: the chain, where there is one, under the name given, and the star beside it.
pub(super) fn files(star: &Star, path: &Path) -> Vec<(PathBuf, String)> {
    let chain = chain_chart(star).map(|chart| (path.to_path_buf(), to_svg(&chart)));
    let beside = if chain.is_some() { beside(path) } else { path.to_path_buf() };
    chain.into_iter().chain([(beside, to_svg(&star_chart(star)))]).collect()
}

/// Returns `dir/name_energy.svg` for `dir/name.svg`.
fn beside(path: &Path) -> PathBuf {
    let stem = path.file_stem().unwrap_or_default().to_string_lossy();
    path.with_file_name(format!("{stem}_energy.svg"))
}

fn curve(name: &str, style: Style, group: usize, to: f64, of: &dyn Fn(f64) -> f64) -> Series {
    let at = |i: u32| to * f64::from(i) / f64::from(POINTS);
    let points = (0..=POINTS).map(|i| [at(i), of(at(i))]).collect();
    Series::new(name, style, group, points)
}

fn chain_chart(star: &Star) -> Option<Chart> {
    let (chain, _) = star.chain.as_ref()?;
    let terms = chain.terms().enumerate().map(|(group, term)| {
        let along = |share: f64| term.axis().map(|axis| axis * share * NYQUIST);
        curve(term.name(), Style::DashedLine, group + 1, HIGHEST, &|share| chain.term(term, along(share)))
    });
    let product = |name: &str, group, along: [f64; 2]| {
        let at = move |share: f64| along.map(|axis| axis * share * NYQUIST);
        curve(name, Style::Line, group, HIGHEST, &|share| chain.product(at(share)))
    };
    let mut series: Vec<Series> = terms.collect();
    if chain.has_axes() {
        series.push(product("product along rows", 0, [1.0, 0.0]));
        series.push(product("product along columns", series.len(), [0.0, 1.0]));
    } else {
        series.push(product("product", 0, [1.0, 0.0]));
    }
    Some(Chart {
        title: format!("Modulation transfer, {}", star.camera.name),
        x: Axis::linear("spatial frequency over Nyquist (0.5 cycles/px)"),
        y: Axis::linear("MTF"),
        series,
        ring: String::new(),
        notes: vec![format!(
            "Mean wavelength {:.0} nm, f/{:.2}; cutoff {:.2} of Nyquist.",
            chain.mean_wavelength_nm(),
            chain.params().f_number,
            chain.cutoff() / NYQUIST
        )],
    })
}

fn star_chart(star: &Star) -> Chart {
    let psf = &star.psf;
    let peak = psf.pixel(0.0, 0.0);
    let steps = 48;
    let circles = (0..=steps).map(|i| FURTHEST_PX * f64::from(i) / f64::from(steps));
    let energy = circles.map(|r| [r, if r > 0.0 { energy::seen_encircled_energy(psf, r) } else { 0.0 }]).collect();
    Chart {
        title: format!("The star as pixels see it, {}", star.camera.name),
        x: Axis::linear("distance from the star, px"),
        y: Axis::linear("share"),
        series: vec![
            curve("pixel's share over the largest, along rows", Style::Line, 0, FURTHEST_PX, &|r| {
                psf.pixel(r, 0.0) / peak
            }),
            Series::new("encircled energy", Style::Line, 1, energy),
            curve("90 %", Style::DashedLine, 2, FURTHEST_PX, &|_| 0.9),
        ],
        ring: String::new(),
        notes: vec![format!("Largest share of a pixel: {peak:.4}.")],
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use config::{Camera, Document};

    fn star(name: &str) -> Star {
        Star::new(Camera::from_document(&Document::built_in(name).unwrap()).unwrap(), None).unwrap()
    }

    #[test]
    fn a_chain_has_two_plots_and_another_model_one() {
        let chain = files(&star("cameras/chain_tracker.toml"), Path::new("out/psf.svg"));
        let names: Vec<_> = chain.iter().map(|(path, _)| path.to_string_lossy().into_owned()).collect();
        assert_eq!(names, ["out/psf.svg", "out/psf_energy.svg"]);
        assert!(chain[0].1.contains("diffraction") && chain[0].1.contains("product"), "terms");
        assert!(chain[1].1.contains("encircled energy"), "energy");
        let gaussian = files(&star("cameras/small_tracker.toml"), Path::new("psf.svg"));
        assert_eq!(gaussian.len(), 1);
        assert_eq!(gaussian[0].0, Path::new("psf.svg"));
    }
}
