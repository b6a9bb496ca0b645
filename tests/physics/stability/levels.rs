//! Degradation levels: the parts that a frame gives up, in order, as its time shrinks.

use crate::scene::{Dice, camera, draw_cpu, instrument, los, star};
use crate::stability::motion::zigzag;
use base::accuracy::AccuracyBudget;
use plan::exposure::{
    Degradation, ExposurePlan, Instrument, MethodChoice, PixelPath, PixelPoint, Planner, Shutter, Source,
};
use plan::exposure::{cost::CostModel, method::MethodName, plan::Verdict};
use plan::optics::PsfModel;

/// Detector, px.
const SIDE: usize = 256;
/// Steps of the time budget.
const STEPS: u32 = 60;
/// From one step to the next.
const SHRINK: f64 = 0.88;

/// Drawing a star at a node is all that costs.
const COST: CostModel = CostModel {
    frame_ms: 0.01,
    pixel_ns: 0.0,
    far_pixel_ns: 0.0,
    star_ns: 10.0,
    motion_ms: 0.0,
    path_step_ns: 0.0,
    motion_star_ns: 0.0,
    splat_ns: 1000.0,
    table_pixel_ns: 100.0,
    product_pixel_ns: 0.0,
    base_pixel_ns: 100.0,
    kernel_node_ns: 100.0,
    kernel_entry_ns: 1000.0,
    threads: 1.0,
    readout_pixel_ns: 0.0,
};

/// Returns stars over four decades.
fn stars() -> Vec<Source> {
    let mut dice = Dice::new(21);
    let mut place = || dice.between(5.0, SIDE as f64 - 6.0);
    let places: Vec<[f64; 2]> = (0..200).map(|_| [place(), place()]).collect();
    (0..).zip(places).map(|(id, px)| star(id, 4.0 * 10.0_f64.powf(f64::from(id % 50) / 12.5), px)).collect()
}

fn planner(cost: CostModel) -> Planner {
    let instrument = instrument(camera(SIDE), &PsfModel::gaussian(0.8));
    // As many legs as leave a choice of numbers of nodes for every level.
    let scene = zigzag(0.8, 24, 1.5);
    let mut planner = Planner::new(instrument, AccuracyBudget::default(), cost, MethodChoice::Auto, scene.los);
    planner.motion_mut().image_path = scene.path;
    planner
}

fn within(limit_ms: f64) -> ExposurePlan {
    planner(COST).within_ms(limit_ms).down_to(Degradation::BrightStarsOnly).plan(&stars()).clone()
}

/// Without a word of the user nothing is drawn that no sensor would see: the frame is late instead.
#[test]
fn default_degradation_ends_before_motion_and_visible_stars_are_left_out() {
    let plan = planner(COST).within_ms(0.0).plan(&stars()).clone();
    assert_eq!(plan.degradation, Degradation::Budget10);
    assert_ne!(plan.chosen.method.name(), MethodName::Static, "motion is drawn: {:?}", plan.chosen);
    assert!(plan.chosen.cost_ms > 0.0, "late by its prediction");
    assert_eq!(within(0.0).degradation, Degradation::BrightStarsOnly, "which is there for those who name it");
}

#[test]
fn degradations_are_taken_in_order_as_time_shrinks() {
    let full = planner(COST).plan(&stars()).clone();
    assert_eq!((full.degradation, full.chosen.verdict), (Degradation::Full, Verdict::Fits), "{:?}", full.chosen);
    let mut seen = vec![Degradation::Full];
    let mut limit_ms = 1.1 * full.chosen.cost_ms;
    let mut kept = full.stars.len();
    for _ in 0..STEPS {
        let plan = within(limit_ms);
        let last = *seen.last().unwrap();
        assert!(plan.degradation >= last, "{limit_ms} ms: {} after {last}", plan.degradation);
        assert!(plan.stars.len() <= kept, "{limit_ms} ms: {} stars after {kept}", plan.stars.len());
        assert!(
            plan.chosen.cost_ms <= limit_ms || plan.degradation == Degradation::BrightStarsOnly,
            "{limit_ms} ms: {:?}",
            plan.chosen
        );
        assert_eq!(plan.stars.len() + plan.cut_off.stars, stars().len(), "every star is drawn or counted");
        if plan.degradation != last {
            println!(
                "{limit_ms:8.3} ms: {:18} {:3} stars, {} ({} classes), {:.3} ms",
                plan.degradation.name(),
                plan.stars.len(),
                plan.chosen.method,
                plan.classes.len(),
                plan.chosen.cost_ms
            );
            seen.push(plan.degradation);
        }
        kept = plan.stars.len();
        limit_ms *= SHRINK;
    }
    assert_eq!(seen, Degradation::ALL, "every level is used");
    assert!(kept < full.stars.len() / 2, "in the end stars go: {kept}");
    assert!(kept == 0 || draw_cpu(&within(limit_ms)).sum() > 0.0, "the brightest are drawn");
}

#[test]
fn each_degradation_gives_up_what_it_says() {
    let full = planner(COST).plan(&stars()).clone();
    let mut limit_ms = full.chosen.cost_ms;
    for _ in 0..STEPS {
        let plan = within(limit_ms);
        let budget = plan.degradation.loosened(&AccuracyBudget::default());
        match plan.degradation {
            Degradation::Full => assert_eq!(plan.cut_off.stars, full.cut_off.stars),
            Degradation::FaintStarsOut | Degradation::Budget3 | Degradation::Budget10 => {
                assert!(plan.cut_off.stars > full.cut_off.stars, "{}: {:?}", plan.degradation, plan.cut_off);
                assert!(plan.chosen.centroid_px <= budget.centroid_px, "{}: {:?}", plan.degradation, plan.chosen);
                assert!(plan.chosen.pixel_sigma <= budget.pixel_sigma, "{}: {:?}", plan.degradation, plan.chosen);
            }
            Degradation::MotionOut | Degradation::BrightStarsOnly => {
                assert_eq!(plan.chosen.method.nodes(), 1, "{}: {}", plan.degradation, plan.chosen.method);
                let reported = plan.chosen.centroid_px > AccuracyBudget::default().centroid_px;
                assert!(reported, "it is reported: {:?}", plan.chosen);
            }
        }
        limit_ms *= SHRINK;
    }
}

#[test]
fn without_a_time_budget_nothing_is_ever_given_up() {
    let dear = CostModel { splat_ns: 1e12, table_pixel_ns: 1e12, kernel_entry_ns: 1e12, ..COST };
    let mut planner = planner(dear);
    let plan = planner.plan(&stars());
    assert_eq!((plan.degradation, plan.chosen.verdict), (Degradation::Full, Verdict::Fits), "{:?}", plan.chosen);
    assert!(plan.chosen.cost_ms > 1e6, "dear it is: {:?}", plan.chosen);
}

/// The time of following a path counts: in what is predicted, and in what a level leaves for drawing.
#[test]
fn a_path_costs_the_steps_that_planning_it_takes() {
    let steps = |legs: u32, shutter: Shutter| {
        let instrument = Instrument { shutter, ..instrument(camera(SIDE), &PsfModel::gaussian(0.8)) };
        let scene = zigzag(0.8, legs, 1.5);
        let mut planner = Planner::new(instrument, AccuracyBudget::default(), COST, MethodChoice::Auto, scene.los);
        planner.motion_mut().image_path = scene.path;
        let first = planner.plan(&stars()).path_steps;
        assert_eq!(planner.plan(&stars()).path_steps, first, "the same path takes the same steps");
        planner.motion_mut().image_path = None;
        assert_eq!(planner.plan(&stars()).path_steps, 0, "control: nothing moves");
        first
    };
    let [short, long] = [24, 96].map(|legs| steps(legs, Shutter::Global));
    assert!(long > 2 * short, "four times the legs: {short} and {long} steps");
    let rolling = steps(24, Shutter::Rolling { line_s: 1e-6 });
    assert!(rolling > 2 * short, "three rows: {short} and {rolling} steps");
    let dear = CostModel { path_step_ns: 1e6, ..COST };
    let [cheap, dear] = [COST, dear].map(|cost| planner(cost).plan(&stars()).clone());
    let more_ms = dear.chosen.cost_ms - cheap.chosen.cost_ms;
    assert!((more_ms / dear.path_steps as f64 - 1.0).abs() < 1e-9, "{more_ms} ms for {} steps", dear.path_steps);
    let limit_ms = 1.1 * cheap.chosen.cost_ms;
    let degradation = |cost| planner(cost).within_ms(limit_ms).plan(&stars()).degradation;
    assert_eq!(degradation(COST), Degradation::Full);
    let as_much_ns = 1e6 * 0.5 * limit_ms / cheap.path_steps as f64;
    assert!(
        degradation(CostModel { path_step_ns: as_much_ns, ..COST }) > Degradation::Full,
        "half of the time is gone"
    );
}

/// Memory for kernels is reserved with the first frame, so a frame with a time budget takes no longer ones.
#[test]
fn with_a_time_budget_kernels_reach_no_further_than_memory_is_reserved_for() {
    let with = |choice: MethodChoice, reach_px: f64, limit_ms: Option<f64>| {
        let mut dice = Dice::new(3);
        let mut place = || dice.between(-reach_px, reach_px);
        let point = |[dx_px, dy_px]: [f64; 2]| PixelPoint { t_s: 0.0, dx_px, dy_px, roll_rad: 0.0 };
        let mut points: Vec<_> = (0..256).map(|_| point([place(), place()])).collect();
        points[0] = point([reach_px; 2]);
        let instrument = instrument(camera(SIDE), &PsfModel::gaussian(0.8));
        let mut planner = Planner::new(instrument, AccuracyBudget::default(), CostModel::CPU, choice, los());
        planner.motion_mut().image_path = PixelPath::samples(points).ok();
        if let Some(limit_ms) = limit_ms {
            planner = planner.within_ms(limit_ms);
        }
        let many: Vec<Source> = (0..10).flat_map(|_| stars()).collect();
        let chosen = planner.plan(&many).chosen;
        (chosen.method.name(), chosen.verdict)
    };
    let method = |reach_px, limit_ms| with(MethodChoice::Auto, reach_px, limit_ms).0;
    let reserved_px = plan::exposure::plan::RESERVED_KERNEL_PX;
    for limit_ms in [None, Some(1e3)] {
        assert_eq!(method(0.9 * reserved_px, limit_ms), MethodName::EffectivePsf, "{limit_ms:?}");
    }
    assert_eq!(method(1.2 * reserved_px, None), MethodName::EffectivePsf, "no frame waits");
    assert_eq!(method(1.2 * reserved_px, Some(1e3)), MethodName::Samples);
    let fixed = with(MethodChoice::Fixed(MethodName::EffectivePsf, None), 1.2 * reserved_px, Some(1e3));
    assert_eq!(fixed, (MethodName::EffectivePsf, Verdict::Fits), "the user's word is kept");
}
