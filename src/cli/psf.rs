//! `starloop psf`: a camera's star -> MTF of every link, widths, energies, what a star's colour changes; plots.

use crate::cli::{facts::Facts, named::named_camera};
use anyhow::{Context, Result, bail};
use clap::Args;
use config::{Camera, Chain, LightOfChain, Psf};
use frames::report::plot::{Axis, Chart, Series, Style};
use frames::{report::to_svg, sink::write_file_atomically};
use plan::optics::chain_psf::{ChainPsf, Drawing};
use plan::optics::{Band, PsfForm, PsfGrid, PsfModel, energy};
use plan::optics::{chain_light::ChainLight, energy::Centring, mtf::MtfChain};
use run::wiring::camera_parts::camera_params;
use serde_json::{Value, json};
use std::path::{Path, PathBuf};

/// Share of the light whose circle is printed.
const HELD: f64 = 0.9;
/// Largest circle that is tried, px.
const LARGEST_RADIUS_PX: f64 = 48.0;
/// Radii whose circles are printed, px.
const RADII_PX: [f64; 3] = [1.0, 2.0, 3.0];
/// Colours of stars that are compared, BP-RP: a hot star (O, B), the Sun, a cool dwarf (M4).
const COLORS: [(&str, f64); 3] = [("blue", -0.3), ("Sun", 0.82), ("red", 3.0)];
/// Largest difference between stars' colours with which one PSF is enough: the share of the flux per pixel that a
/// drawn star may err by.
const ONE_PSF: f64 = 1e-3;

/// Command line of `psf`.
#[derive(Debug, Args)]
#[command(
    after_help = "MTF: contrast that each link of the chain passes, 1 at frequency 0; the product is what pixels see. \
                  Nyquist is 0.5 cycles/px. Over a band every term is its mean weighted by electrons, and the product \
                  is the mean of the products. Motion is not in it: exposures integrate motion themselves.\n\n\
                  Energies are shares of all of a star's light. \"Before the pixel\" is the light, charge diffusion \
                  included; \"as pixels see it\" is blurred by a pixel, and what models are compared by. The envelope is the square \
                  of whole pixels around the Airy disc at the longest wavelength; more than 90 % in it is the published \
                  figure of merit for energy concentration.\n\n\
                  Examples:\n  starloop psf cameras/chain_tracker.toml\n  starloop psf my_bench.toml --at 0.5,1,2 \
                  --plot psf.svg"
)]
pub struct PsfArgs {
    /// Camera or bench file (TOML), or the name of a built-in one; without it: the built-in loopback bench's camera
    file: Option<PathBuf>,
    /// Frequencies of the MTF table, shares of the Nyquist frequency
    #[arg(long, value_name = "SHARES", value_delimiter = ',', default_value = "0.1,0.25,0.5,0.75,1,1.5,2")]
    at: Vec<f64>,
    /// Colour of the star instead of the camera's, Gaia BP-RP (chains over a band only)
    #[arg(long, value_name = "MAG", allow_negative_numbers = true)]
    bp_rp: Option<f64>,
    /// Place of the star on the detector instead of its middle, pixels (PSFs over a field only)
    #[arg(long, value_name = "X,Y", value_delimiter = ',', allow_negative_numbers = true)]
    place: Option<Vec<f64>>,
    /// Draw the chain into this file, and the star's profile and encircled energy into FILE_energy.svg
    #[arg(long, value_name = "FILE.svg")]
    plot: Option<PathBuf>,
    /// Print the report as one line of JSON
    #[arg(long)]
    json: bool,
}

/// Runs the command.
///
/// # Errors
/// When the file is refused, its PSF cannot be drawn, or a plot cannot be written.
pub fn run(arguments: &PsfArgs) -> Result<()> {
    if let Some(bad) = arguments.at.iter().find(|share| !(0.0..=1000.0).contains(*share)) {
        bail!("--at has {bad}; wanted shares of the Nyquist frequency, 0 to 1000, such as 0.5,1");
    }
    if let Some(path) = arguments.plot.as_ref().filter(|path| path.extension().is_none_or(|end| end != "svg")) {
        bail!("--plot: got {}, wanted a name that ends in .svg: plots are SVG files", path.display());
    }
    let mut star = Star::new(named_camera(arguments.file.as_deref())?, arguments.bp_rp)?;
    if let Some(place) = &arguments.place {
        star.move_to(place)?;
    }
    let mut facts = facts(&star, &arguments.at);
    if !arguments.json {
        colors(&mut facts, &star)?;
    }
    facts.print("psf", arguments.json)?;
    if let Some(path) = &arguments.plot {
        for (path, svg) in files(&star, path) {
            write_file_atomically(&path, |out| std::io::Write::write_all(out, svg.as_bytes()))
                .with_context(|| format!("--plot {}", path.display()))?;
            if !arguments.json {
                println!("plot in {}", path.display());
            }
        }
    }
    Ok(())
}

fn facts(star: &Star, shares: &[f64]) -> Facts {
    let mut facts = Facts::new("", 12);
    head(&mut facts, star);
    facts.line("");
    facts.value("chain", Value::Null);
    if let Some((chain, drawn)) = &star.chain {
        mtf_table(&mut facts, star, chain, shares);
        facts.line("");
        facts.value("chain", mtf_values(chain, drawn, shares));
    }
    energies(&mut facts, star);
    concentration(&mut facts, star);
    facts
}

/// Returns the table of the chain for programs.
fn mtf_values(chain: &MtfChain, drawn: &ChainPsf, shares: &[f64]) -> Value {
    let at = |of: &dyn Fn(f64) -> f64| shares.iter().map(|share| of(share * NYQUIST)).collect::<Vec<f64>>();
    let terms = chain.terms().map(|term| {
        let mtf = at(&|f| chain.term(term, term.axis().map(|axis| axis * f)));
        json!({ "name": term.name(), "mtf": mtf })
    });
    json!({
        "shares_of_nyquist": shares, "terms": terms.collect::<Vec<_>>(),
        "product_along_rows": at(&|f| chain.product([f, 0.0])), "product_along_columns": at(&|f| chain.product([0.0, f])),
        "cutoff_cycles_per_px": chain.cutoff(), "mean_wavelength_nm": chain.mean_wavelength_nm(),
        "drawing_error": drawn.between + drawn.folded,
    })
}

fn head(facts: &mut Facts, star: &Star) {
    let (camera, optics) = (&star.camera, &star.camera.optics);
    let (pitch_um, f_number) = (camera.detector.pixel_pitch_um, optics.focal_length_mm / optics.aperture_mm);
    facts.named("camera").line(format_args!(
        "\"{}\": f = {} mm, f/{f_number:.2}, obscuration {}, {pitch_um} um pixels",
        camera.name, optics.focal_length_mm, optics.obscuration
    ));
    facts.value("camera", camera.name.as_str());
    facts.value("f_number", f_number);
    let Some((chain, drawn)) = &star.chain else {
        return facts.fact("star", model_text(&camera.psf));
    };
    let light = if let Psf::Chain(chain) = &camera.psf { Some(chain.light) } else { None };
    match (light, chain.params().band.as_slice()) {
        (Some(LightOfChain::Color(bp_rp)), band @ [first, .., last]) => facts.named("light").line(format_args!(
            "the band for a star of BP-RP = {bp_rp}: {} wavelengths from {:.0} to {:.0} nm, mean {:.0} nm",
            band.len(),
            first.wavelength_nm,
            last.wavelength_nm,
            chain.mean_wavelength_nm()
        )),
        _ => facts.fact("light", format_args!("{:.0} nm", chain.mean_wavelength_nm())),
    }
    facts.named("star").line(format_args!(
        "chain, drawn with {} samples per pixel to {} px; no pixel errs by more than {:.1e} of the flux",
        drawn.grid.oversampling(),
        drawn.grid.half_px(),
        drawn.between + drawn.folded
    ));
}

fn model_text(psf: &Psf) -> String {
    match psf {
        Psf::Gaussian { sigma_px } => format!("Gaussian, sigma {sigma_px} px"),
        Psf::Airy { f_number, wavelength_nm, obscuration } => {
            format!("Airy, f/{f_number:.2}, obscuration {obscuration}, {wavelength_nm} nm")
        }
        Psf::Chain(_) | Psf::Made(_) => "as the camera file gives it".into(),
    }
}

fn mtf_table(facts: &mut Facts, star: &Star, chain: &MtfChain, shares: &[f64]) {
    let heads: String = shares.iter().map(|share| format!("{share:>9}")).collect();
    facts.line(format_args!("{:<24}{heads}", "MTF at shares of Nyquist"));
    let mut row = |name: &str, of: &dyn Fn(f64) -> f64| {
        let values: String = shares.iter().map(|share| format!("{:>9.5}", of(share * NYQUIST) + 0.0)).collect();
        facts.line(format_args!("  {name:<22}{values}"));
    };
    for term in chain.terms() {
        row(term.name(), &|f| chain.term(term, term.axis().map(|axis| axis * f)));
    }
    if star.has_axes() {
        row("product along rows", &|f| chain.product([f, 0.0]));
        row("product along columns", &|f| chain.product([0.0, f]));
    } else {
        row("product", &|f| chain.product([f, 0.0]));
        row("product, 45 deg", &|f| chain.product([f * core::f64::consts::FRAC_1_SQRT_2; 2]));
    }
    facts.line(format_args!("  nothing passes beyond {:.2} cycles/px", chain.cutoff()));
}

fn energies(facts: &mut Facts, star: &Star) {
    let psf = &star.psf;
    let chain = star.chain.as_ref().map(|(chain, _)| ChainLight::of(chain));
    // Samples of what pixels see say nothing of the light before.
    let light = |of_model: &dyn Fn(&PsfModel) -> f64, of_chain: &dyn Fn(&ChainLight) -> f64| match (&chain, psf.form())
    {
        (Some(chain), _) => format!("{:.4}", of_chain(chain)),
        (None, PsfForm::Grid(_) | PsfForm::Field(_)) => "-".into(),
        _ => format!("{:.4}", of_model(psf)),
    };
    facts.line(format_args!("{:<32}{:>18}{:>20}", "star on a pixel's centre", "before the pixel", "as pixels see it"));
    let before = light(&energy::fwhm_px, &|chain| chain.fwhm_px());
    let fwhm_px = energy::seen_fwhm_px(psf);
    facts.line(format_args!("  {:<30}{before:>18}{fwhm_px:>20.4}", "FWHM, px"));
    facts.value("fwhm_px", fwhm_px);
    for radius_px in RADII_PX {
        let before = light(&|psf| energy::encircled_energy(psf, radius_px), &|chain| chain.encircled_energy(radius_px));
        let seen = energy::seen_encircled_energy(psf, radius_px);
        facts.line(format_args!("  {:<30}{before:>18}{seen:>20.4}", format!("encircled energy, {radius_px} px")));
        facts.element("encircled_energy", json!({ "radius_px": radius_px, "share": seen }));
    }
    let radius_px = energy::seen_radius_px(psf, HELD, LARGEST_RADIUS_PX);
    facts.value("radius_of_90_percent_px", json!(radius_px));
    let radius = radius_px.map_or_else(|| format!("over {LARGEST_RADIUS_PX}"), |px| format!("{px:.4}"));
    facts.line(format_args!("  {:<30}{:>18}{radius:>20}", format!("radius of {:.0} %, px", 100.0 * HELD), ""));
    let row = |name: &str, share: f64| format!("  {name:<48}{share:>20.4}");
    let [centre, corner] = [Centring::Centre, Centring::Corner].map(|at| energy::energy_on_detector(psf, at));
    facts.line(row("energy on detector (one pixel), centred", centre));
    facts.value("energy_on_detector_centred", centre);
    facts.line(row("energy on detector, star on a corner", corner));
    facts.value("energy_on_detector_on_a_corner", corner);
    for side_px in [3, 5, 7] {
        let share = energy::ensquared_energy(psf, side_px);
        facts.line(row(&format!("ensquared energy, {side_px} x {side_px} px"), share));
        facts.element("ensquared_energy", json!({ "side_px": side_px, "share": share }));
    }
}

/// Returns the share within the square around the Airy disc at the longest wavelength.
fn concentration(facts: &mut Facts, star: &Star) {
    let lambda_n_px = match (&star.chain, &star.camera.psf) {
        (Some((chain, _)), _) => {
            let p = chain.params();
            let longest_nm = p.band.iter().map(|light| light.wavelength_nm).fold(0.0, f64::max);
            longest_nm * 1e-3 * p.f_number / p.pixel_pitch_um
        }
        (None, Psf::Airy { f_number, wavelength_nm, .. }) => {
            wavelength_nm * 1e-3 * f_number / star.camera.detector.pixel_pitch_um
        }
        _ => return,
    };
    let radius_px = energy::airy_radius_px(lambda_n_px);
    #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "a small positive number")]
    let side_px = (2.0 * (radius_px - 0.5).ceil().max(1.0)) as usize + 1;
    let share = energy::ensquared_energy(&star.psf, side_px.min(97));
    facts.line(format_args!(
        "energy concentration: {:.1} % within {side_px} x {side_px} px, the envelope of the Airy disc (radius \
         {radius_px:.2} px): {} the published 90 %",
        100.0 * share,
        if share > HELD { "above" } else { "not above" }
    ));
}

/// Writes how the star of a chain over a band changes with colours other than the reference.
fn colors(facts: &mut Facts, star: &Star) -> Result<()> {
    let (Some((chain, drawn)), Some(band)) = (&star.chain, &star.camera.band) else { return Ok(()) };
    facts.line("");
    facts.line(format_args!(
        "{:<22}{:>10}{:>12}{:>14}{:>22}",
        "star colour", "mean nm", "seen FWHM", "EE 1 px", "largest difference"
    ));
    let reference = PsfModel::grid(drawn.grid.clone());
    let same = Drawing {
        oversampling: Some(drawn.grid.oversampling()),
        half_px: Some(drawn.grid.half_px()),
        ..Drawing::default()
    };
    let mut worst = 0.0_f64;
    for (name, bp_rp) in COLORS {
        let other = MtfChain::new(chain.params().in_band(band, bp_rp))?;
        let psf = PsfModel::grid(ChainPsf::draw(&other, &same)?.grid);
        let difference = largest_difference(&psf, &reference);
        worst = worst.max(difference);
        facts.line(format_args!(
            "  {:<20}{:>10.0}{:>9.4} px{:>14.4}{difference:>13.1e} of flux",
            format!("{name}, BP-RP = {bp_rp}"),
            other.mean_wavelength_nm(),
            energy::seen_fwhm_px(&psf),
            energy::seen_encircled_energy(&psf, 1.0)
        ));
    }
    let reported = if worst <= ONE_PSF {
        "one PSF is enough for all stars"
    } else {
        "one PSF does not do for all stars: choose psf.bp_rp for those that matter"
    };
    facts.line(format_args!("  {reported} (a pixel may err by {ONE_PSF:.0e} of the flux)"));
    Ok(())
}

/// Returns the largest difference of a pixel's share between two stars at the same place.
fn largest_difference(a: &PsfModel, b: &PsfModel) -> f64 {
    // A pixel's share changes slowly against an eighth of a pixel, and fades beyond a few pixels.
    let at = |i: i32| f64::from(i) / 8.0;
    let places = (0..=64).flat_map(|y| (0..=y).map(move |x| (at(x), at(y))));
    places.map(|(x, y)| (a.pixel(x, y) - b.pixel(x, y)).abs()).fold(0.0, f64::max)
}

// A camera's star: its PSF and the chain that makes it, for a colour and a place in the field.

/// Nyquist frequency, cycles/px.
pub(super) const NYQUIST: f64 = 0.5;
/// Samples per pixel of a blend of a field's PSFs.
const GRID_OVERSAMPLING: usize = 16;
/// Share of the light that may lie outside such a blend.
const GRID_OUTSIDE: f64 = 1e-4;

/// A camera's star and all that is known of it.
#[derive(Debug)]
pub(super) struct Star {
    pub(super) camera: Camera,
    pub(super) psf: PsfModel,
    /// The chain, and what drawing it errs by; for chains.
    pub(super) chain: Option<(MtfChain, ChainPsf)>,
}

impl Star {
    pub(super) fn new(mut camera: Camera, bp_rp: Option<f64>) -> Result<Self> {
        if let Some(bp_rp) = bp_rp {
            let band = camera.band.clone();
            match (&mut camera.psf, band) {
                (Psf::Chain(chain), Some(band)) => take_color(chain, &band, bp_rp)?,
                _ => bail!("--bp-rp is {bp_rp}, but \"{}\" has no chain over a [band]: leave it out", camera.name),
            }
        }
        let Psf::Chain(chain) = &camera.psf else {
            let psf = camera_params(&camera)?.psf;
            return Ok(Self { camera, psf, chain: None });
        };
        let chain = MtfChain::new(chain.params.clone())?;
        let drawn =
            ChainPsf::draw(&chain, &Drawing::default()).with_context(|| format!("camera \"{}\"", camera.name))?;
        Ok(Self { camera, psf: PsfModel::grid(drawn.grid.clone()), chain: Some((chain, drawn)) })
    }

    /// Takes the PSF of another place in the field.
    pub(super) fn move_to(&mut self, place: &[f64]) -> Result<()> {
        let detector = &self.camera.detector;
        let size = [detector.width_px, detector.height_px].map(f64::from);
        let &[x, y] = place else { bail!("--place has {} numbers; wanted two, such as 100,200", place.len()) };
        if !(-0.5..=size[0] - 0.5).contains(&x) || !(-0.5..=size[1] - 0.5).contains(&y) {
            bail!("--place is {x},{y}; wanted a place on the detector of {} x {} px", size[0], size[1]);
        }
        if self.psf.as_field().is_none() {
            bail!("--place is {x},{y}, but \"{}\" has one PSF for all places: leave it out", self.camera.name);
        }
        let half_px = self.psf.half_px(GRID_OUTSIDE).max(2);
        let blend = PsfGrid::sampled(GRID_OVERSAMPLING, half_px, |dx, dy| self.psf.pixel_of([x, y], dx, dy));
        self.psf = PsfModel::grid(blend.with_context(|| format!("the PSF at {x},{y}"))?);
        Ok(())
    }

    /// Returns whether x and y differ.
    pub(super) fn has_axes(&self) -> bool {
        self.chain.as_ref().is_some_and(|(chain, _)| chain.has_axes())
    }
}

fn take_color(chain: &mut Chain, band: &Band, bp_rp: f64) -> Result<()> {
    if !(-1.0..=7.0).contains(&bp_rp) {
        bail!("--bp-rp is {bp_rp}; wanted a colour from -1 to 7, such as the Sun's, 0.82");
    }
    chain.light = LightOfChain::Color(bp_rp);
    chain.params = chain.params.in_band(band, bp_rp);
    Ok(())
}

// The plots of `starloop psf`: the chain over frequency, and the star over distance.

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
    let x = Axis::linear("spatial frequency over Nyquist (0.5 cycles/px)");
    let title = format!("Modulation transfer, {}", star.camera.name);
    Some(Chart::new(title, x, Axis::linear("MTF"), series).noted(format!(
        "Mean wavelength {:.0} nm, f/{:.2}; cutoff {:.2} of Nyquist.",
        chain.mean_wavelength_nm(),
        chain.params().f_number,
        chain.cutoff() / NYQUIST
    )))
}

fn star_chart(star: &Star) -> Chart {
    let psf = &star.psf;
    let peak = psf.pixel(0.0, 0.0);
    let steps = 48;
    let circles = (0..=steps).map(|i| FURTHEST_PX * f64::from(i) / f64::from(steps));
    let energy = circles.map(|r| [r, if r > 0.0 { energy::seen_encircled_energy(psf, r) } else { 0.0 }]).collect();
    let profile = |r: f64| psf.pixel(r, 0.0) / peak;
    let series = vec![
        curve("pixel's share over the largest, along rows", Style::Line, 0, FURTHEST_PX, &profile),
        Series::new("encircled energy", Style::Line, 1, energy),
        curve("90 %", Style::DashedLine, 2, FURTHEST_PX, &|_| 0.9),
    ];
    let (x, y) = (Axis::linear("distance from the star, px"), Axis::linear("share"));
    Chart::new(format!("The star as pixels see it, {}", star.camera.name), x, y, series)
        .noted(format!("Largest share of a pixel: {peak:.4}."))
}

#[cfg(test)]
mod psf_tests {
    use super::*;
    use std::path::Path;

    fn reported(name: &str) -> String {
        let star = Star::new(named_camera(Some(Path::new(name))).unwrap(), None).unwrap();
        let mut facts = facts(&star, &[0.0, 0.5, 1.0]);
        colors(&mut facts, &star).unwrap();
        facts.text()
    }

    #[test]
    fn a_chain_reports_its_links_its_energies_and_its_colours() {
        let text = reported("cameras/chain_tracker.toml");
        println!("{text}");
        for word in ["diffraction", "aberration", "charge diffusion", "pixel", "product", "FWHM", "radius of 90 %"] {
            assert!(text.contains(word), "no \"{word}\" in\n{text}");
        }
        for word in ["energy on detector", "ensquared energy, 3 x 3 px", "energy concentration", "blue", "red"] {
            assert!(text.contains(word), "no \"{word}\" in\n{text}");
        }
        let product = text.lines().find(|line| line.starts_with("  product ")).unwrap();
        assert!(product.contains(" 1.00000 "), "1 at frequency 0: {product}");
        assert!(text.lines().map(str::len).max().unwrap() <= 130, "width\n{text}");
    }

    #[test]
    fn a_gaussian_reports_its_closed_forms() {
        let text = reported("cameras/small_tracker.toml");
        assert!(text.contains("Gaussian, sigma 0.65 px") && !text.contains("diffraction"), "{text}");
        // 1 - exp(-1 / 2 / 0.65^2) and 2.35482 x 0.65.
        assert!(text.contains("0.6938") && text.contains("1.5306"), "{text}");
    }

    #[test]
    fn impossible_values_are_refused() {
        let camera = named_camera(Some(Path::new("cameras/small_tracker.toml"))).unwrap();
        let error = Star::new(camera, Some(0.5)).unwrap_err().to_string();
        assert!(error.contains("--bp-rp") && error.contains("no chain over a [band]"), "{error}");
        let error = named_camera(Some(Path::new("cameras/none.toml"))).unwrap_err().to_string();
        assert!(error.contains("cameras/none.toml"), "{error}");
    }

    #[test]
    fn a_place_belongs_to_a_field() {
        use plan::optics::psf_field::PsfField;
        let mut star = Star::new(named_camera(Some(Path::new("cameras/small_tracker.toml"))).unwrap(), None).unwrap();
        let error = star.move_to(&[10.0, 10.0]).unwrap_err().to_string();
        assert!(error.contains("one PSF for all places"), "{error}");
        let nodes = [0.6, 0.8, 0.6, 0.8].map(PsfModel::gaussian).to_vec();
        star.psf = PsfModel::field(PsfField::new([2, 2], [256, 256], nodes).unwrap());
        assert!(star.move_to(&[256.0, 10.0]).unwrap_err().to_string().contains("256 x 256"), "outside");
        assert!(star.move_to(&[10.0]).unwrap_err().to_string().contains("wanted two"), "half a place");
        star.move_to(&[255.5, 10.0]).unwrap();
        let right = PsfModel::gaussian(0.8);
        assert!(largest_difference(&star.psf, &right) < 1e-5, "the right edge has its own star");
    }

    #[test]
    fn another_star_differs_and_the_same_does_not() {
        let [narrow, wide] = [0.7, 0.71].map(PsfModel::gaussian);
        assert_eq!(largest_difference(&narrow, &narrow), 0.0);
        let peak = narrow.pixel(0.0, 0.0) - wide.pixel(0.0, 0.0);
        assert!((largest_difference(&narrow, &wide) - peak).abs() < 1e-12, "the middle differs most");
    }
}

#[cfg(test)]
mod psf_plot_tests {
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
