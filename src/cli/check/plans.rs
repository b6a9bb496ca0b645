//! `starloop check`, plans: how a frame would be drawn, how wrong that may be, and whether there is time for it.
//!
//! Input: a plan of the frame planner. Output: text. Predictions are for the real clock of this machine; nothing is
//! drawn here.

use crate::cli::{facts::Facts, frame_plan::over_budget_text};
use base::accuracy::AccuracyBudget;
use config::{Bench, Degrade};
use plan::exposure::plan::{Assessment, MOTION_SHARE, Verdict};
use plan::exposure::{Degradation, ExposurePlan, PsfSampling};
use plan::exposure::{cost::CostModel, sampling::sampling_error};
use run::runtime::{Imager, RunParams};
use serde_json::json;

/// Limits that plans are judged by.
pub(super) struct Planned {
    budget: AccuracyBudget,
    pub(super) cost: CostModel,
    /// Time for drawing before frames are degraded, ms; `None`: they never are.
    pub(super) limit_ms: Option<f64>,
    /// Time there is for drawing, ms.
    budget_ms: f64,
    readout_ms: f64,
    due_ms: f64,
    degrade: Degrade,
    last_degradation: Degradation,
}

impl Planned {
    pub(super) fn new(bench: &Bench, params: &RunParams, imager: &Imager) -> Self {
        let cost = params.cost.unwrap_or(imager.cost);
        let budget_ms = params.drawing_budget_ms(&cost);
        Self {
            budget: params.budget,
            cost,
            limit_ms: (params.degrade && !imager.is_exact()).then_some(budget_ms),
            budget_ms,
            readout_ms: params.camera.predicted_readout_ms(&cost),
            due_ms: params.camera.readout_s * 1e3,
            degrade: bench.timing.degrade,
            last_degradation: params.last_degradation,
        }
    }
}

/// Writes how pixel values are computed from the PSF, and the errors of the other methods.
pub(super) fn write_sampling(facts: &mut Facts, params: &RunParams) {
    let (camera, budget) = (&params.camera, &params.budget);
    let full_well_e = camera.detector.full_well_e;
    let noise_e = full_well_e.sqrt().hypot(camera.detector.read_noise_e_rms);
    facts.line("PSF sampling: pixel values from the PSF; the noise is that of a pixel at full well");
    facts.line("  method            centroid px   pixel sigma  verdict");
    let used = camera.sampling;
    let uncharted = (!PsfSampling::CHARTED.contains(&used)).then_some(used);
    for sampling in PsfSampling::CHARTED.into_iter().chain(uncharted) {
        let error = sampling_error(&camera.psf, sampling);
        let pixel_sigma = error.peak * full_well_e / noise_e;
        let verdict = if !sampling.is_exact() && !camera.psf.is_gaussian() {
            "refused: for Gaussian PSFs alone"
        } else if error.centroid_px > MOTION_SHARE * budget.centroid_px {
            "refused: centroid error over the budget"
        } else if pixel_sigma > budget.pixel_sigma {
            "refused: pixel error over the budget"
        } else {
            "fits"
        };
        let mark = if sampling == used { '>' } else { ' ' };
        let name = sampling.to_string();
        facts.line(format_args!("{mark} {name:<16} {:>12.2e}  {pixel_sigma:>12.2e}  {verdict}", error.centroid_px));
    }
    facts.line("");
}

/// Writes the degradation levels, in order, for frames short of time.
pub(super) fn write_degradations(facts: &mut Facts, planned: &Planned) {
    let when = match planned.degrade {
        _ if planned.limit_ms.is_none() && planned.degrade != Degrade::Never => "never: the reference takes its time",
        Degrade::OnRealClock => "on the real clock (timing.degrade = \"real_clock\")",
        Degrade::Always => "on both clocks (timing.degrade = \"always\"; virtual: by the built-in costs)",
        Degrade::Never => "never: frames are late instead (timing.degrade = \"never\")",
    };
    let Planned { budget_ms, readout_ms, due_ms, .. } = *planned;
    facts.line("degradation levels, in the order in which they are taken when drawing would take too long");
    facts.fact("when", when);
    facts.named("time").line(format_args!(
        "a frame is due {due_ms:.1} ms after its exposure: {budget_ms:.1} ms to draw it, {readout_ms:.1} ms for \
         the detector, the rest for everything else"
    ));
    if budget_ms <= 0.0 {
        facts.warning("the detector alone takes longer than there is: frames will be late at any level");
    }
    for degradation in Degradation::ALL {
        let taken = if degradation > planned.last_degradation { " (not taken: timing.degrade_to)" } else { "" };
        facts.line(format_args!("  {:<18} {}{taken}", degradation.name(), degradation.gives_up()));
    }
    facts.line("");
}

/// Writes one frame's plan.
pub(super) fn write_plan(facts: &mut Facts, number: u32, plan: &ExposurePlan, planned: &Planned) {
    let (stars, reach, chosen) = (plan.stars.len(), plan.reach_px, &plan.chosen);
    let rate_deg_s = plan.motion.los.rate_rad_s.length().to_degrees();
    facts.element(
        "plans",
        json!({
            "frame": number,
            "stars": stars,
            "rate_deg_s": rate_deg_s,
            "path_px": reach,
            "method": chosen.method.to_string(),
            "centroid_px": chosen.centroid_px,
            "flux_rel": chosen.flux_rel,
            "pixel_sigma": chosen.pixel_sigma,
            "drawing_ms": chosen.cost_ms,
            "level": plan.degradation.to_string(),
        }),
    );
    facts.line(format_args!(
        "plan of frame {number}: {stars} stars, {rate_deg_s:.3} deg/s, path of at most {reach:.2} px"
    ));
    facts.line("  method                       centroid px    flux      pixel sigma  cost ms  verdict");
    for assessment in plan.assessed.iter().filter(|assessment| is_reported(assessment, plan)) {
        let mark = if assessment.method == plan.chosen.method { '>' } else { ' ' };
        facts.line(format_args!("{mark} {}", assessment_line(assessment)));
    }
    write_classes(facts, plan);
    let side_px = 2 * plan.half_px + 1;
    let lost = plan.psf.lost_flux(plan.half_px);
    if let Some(field) = plan.psf.as_field() {
        let [columns, rows] = field.cells().map(|cells| cells + 1);
        facts
            .fact("PSF", format_args!("{columns} x {rows} over the field; every star is a blend of the four about it"));
    }
    facts
        .named("footprint")
        .line(format_args!("{side_px} x {side_px} px about every node: {lost:.1e} of a star's light is lost at most"));
    if let Some(whole) = plan.classes.iter().find(|class| class.is_whole) {
        let (side_px, lost) = (2 * plan.whole.half_px + 1, plan.psf.lost_flux(plan.whole.half_px));
        facts.named("whole").line(format_args!(
            "{} stars of {:.2e} e- and more: {side_px} x {side_px} px, {lost:.1e} is lost at most",
            whole.stars, whole.faintest_e
        ));
    }
    let cut = &plan.cut_off;
    if cut.stars > 0 {
        facts.named("left out").line(format_args!(
            "{} stars with {:.3e} e- together: no pixel lacks more than {:.3e} e-",
            cut.stars, cut.electrons, cut.most_in_pixel_e
        ));
    }
    write_time(facts, plan, planned);
}

/// Returns true for the chosen variant, and for each method's cheapest one that fits, or else its least wrong one.
fn is_reported(assessment: &Assessment, plan: &ExposurePlan) -> bool {
    let variants = || plan.assessed.iter().filter(|other| other.method.name() == assessment.method.name());
    let least_wrong = || variants().min_by(|a, b| a.pixel_sigma.total_cmp(&b.pixel_sigma));
    let best = variants().find(|other| other.verdict.keeps_shape()).or_else(least_wrong);
    assessment.method == plan.chosen.method || best.is_some_and(|best| best.method == assessment.method)
}

/// Returns the stars by brightness, when they are drawn by more than one method.
fn write_classes(facts: &mut Facts, plan: &ExposurePlan) {
    if plan.classes.len() < 2 {
        return;
    }
    facts.line("  stars by brightness, each class by its own method (costs without the empty frame)");
    facts.line("     stars   from e-     below e-   method                       centroid px  pixel sigma  cost ms");
    for (i, class) in plan.classes.iter().enumerate() {
        let (above_e, faintest_e) = plan.brightness_of(i);
        let below = if above_e.is_finite() { format!("{above_e:.2e}") } else { "-".into() };
        let chosen = &class.chosen;
        facts.line(format_args!(
            "  {:>8}  {faintest_e:>9.2e}  {below:>9}   {:<28} {:>11.2e}  {:>11.4}  {:>7.2}",
            class.stars,
            chosen.method.to_string(),
            chosen.centroid_px,
            chosen.pixel_sigma,
            chosen.cost_ms
        ));
    }
}

fn write_time(facts: &mut Facts, plan: &ExposurePlan, planned: &Planned) {
    let Planned { budget_ms, readout_ms, due_ms, .. } = *planned;
    let draw_ms = plan.chosen.cost_ms;
    facts.named("time").line(format_args!(
        "drawing {draw_ms:.1} ms of the {budget_ms:.1} ms there are, detector {readout_ms:.1} ms, due after \
         {due_ms:.1} ms"
    ));
    let degradation = plan.degradation;
    let over = over_budget_text(plan, &planned.budget);
    let gives_up = if over.is_some() && degradation == Degradation::Full {
        "nothing that any method would keep"
    } else {
        degradation.gives_up()
    };
    facts.fact("level", format_args!("{degradation}: gives up {gives_up}"));
    if draw_ms > budget_ms {
        facts.warning("frames will be late all the same: drawing takes longer than there is time");
    }
    if let Some(words) = over {
        facts.warning(words);
    }
    facts.line("");
}

fn assessment_line(a: &Assessment) -> String {
    let verdict = match a.verdict {
        Verdict::Fits => "fits",
        Verdict::NeedsSmoothMotion => "refused: there is jitter, and it is for smooth motion",
        Verdict::PathTooLong => "refused: the path is too long for a kernel",
        Verdict::OtherSampling => "refused: its kernels are exact, and psf.sampling asks for another",
        Verdict::TooManyKernels => "refused: its kernels would take too much memory",
        Verdict::CentroidOverBudget => "refused: centroid error over the budget",
        Verdict::PixelOverBudget => "refused: pixel error over the budget",
        Verdict::FluxOverBudget => "loses more flux than the budget: the PSF's wings are cut (no method does better)",
    };
    if a.centroid_px.is_nan() {
        return format!("{:<28} {:>11}  {:>9}  {:>10}  {:>7}  {verdict}", a.method.name().name(), "-", "-", "-", "-");
    }
    let method = a.method.to_string();
    format!(
        "{method:<28} {:>11.2e}  {:>9.1e}  {:>10.4}  {:>7.2}  {verdict}",
        a.centroid_px, a.flux_rel, a.pixel_sigma, a.cost_ms
    )
}
