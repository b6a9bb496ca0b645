//! Beside overexposed stars: digital numbers of GPU and CPU, and of the reference.

use crate::scene::{Motion, Scene, device, draw_cpu, draw_gpu, star};
use base::image::Image;
use plan::exposure::{Drawing, ExposurePlan, Source};
use plan::optics::PsfModel;
use starloop_image::{gpu::Electrons, render::Backend, render::gpu::Gpu, render::reference::Reference};

/// Of the scenes' instrument, e-.
const FULL_WELL_E: f64 = 1e5;
/// Rows with the bright stars; the faint ones are below them.
const ROWS: usize = 150;
/// Electrons of a digital number.
const GAIN_E_PER_DN: f64 = 1.55;

fn stars() -> Vec<Source> {
    let faint = |id: u32| star(id, 3e3, [40.0 * f64::from(id), 170.3]);
    let bright = [star(0, 2e9, [101.3, 88.8]), star(1, 3e8, [117.1, 88.2]), star(2, 1e11, [230.4, 60.1])];
    bright.into_iter().chain((3..7).map(faint)).collect()
}

/// Returns the largest difference of two images in digital numbers, in the rows of bright stars; pixels hold a full well at most.
fn difference_dn(a: &[f64], b: &[f64], width: usize) -> f64 {
    let dn = |e: f64| (e.min(FULL_WELL_E) / GAIN_E_PER_DN).round();
    a.iter().zip(b).take(ROWS * width).map(|(a, b)| (dn(*a) - dn(*b)).abs()).fold(0.0, f64::max)
}

fn wide(image: &Image<f32>) -> Vec<f64> {
    image.pixels().iter().map(|e| f64::from(*e)).collect()
}

fn truth(plan: &ExposurePlan, [width, height]: [usize; 2]) -> Vec<f64> {
    let mut reference = Reference::new(width, height);
    reference.render(plan).expect("the reference draws");
    let Electrons::Precise(image) = reference.electrons() else { panic!("the reference draws in double precision") };
    image.pixels().to_vec()
}

#[test]
fn cpu_gpu_and_reference_agree_beside_overexposed_stars() {
    let Some(device) = device() else { return };
    for (motion, method) in [
        (Motion::Still, "auto"),
        (Motion::Slew([0.012, -0.02, 0.05]), "auto"),
        (Motion::Jitter(24, 1.2), "samples:24"),
        (Motion::Jitter(24, 1.2), "effective-psf:24"),
    ] {
        let scene = Scene::new(PsfModel::gaussian(0.75), motion, method);
        let mut gpu = Gpu::new(device.clone(), scene.size[0], scene.size[1]).expect("a backend");
        let mut planner = scene.planner();
        let plan = planner.plan(&stars()).clone();
        assert_eq!(plan.list_of(&plan.stars[0]).drawing, Drawing::Whole);
        let cpu = wide(&draw_cpu(&plan, scene.size));
        let on_device = wide(&draw_gpu(&mut gpu, &plan, scene.size));
        let truth = truth(&plan, scene.size);
        let found =
            [(&cpu, &on_device), (&cpu, &truth), (&on_device, &truth)].map(|(a, b)| difference_dn(a, b, scene.size[0]));
        println!("{method}: {found:?} DN");
        assert!(found.into_iter().all(|dn| dn <= 1.0), "{method}: {found:?} DN");
        // Negative control: the same stars in ordinary footprints.
        let mut old = plan.clone();
        let list = plan.stars[5].list;
        assert_ne!(plan.lists[list as usize].drawing, Drawing::Whole);
        old.stars.iter_mut().for_each(|star| star.list = list);
        let (cpu, on_device) = (wide(&draw_cpu(&old, scene.size)), wide(&draw_gpu(&mut gpu, &old, scene.size)));
        let found =
            [(&cpu, &on_device), (&cpu, &truth), (&on_device, &truth)].map(|(a, b)| difference_dn(a, b, scene.size[0]));
        println!("{method}, ordinary footprints: {found:?} DN");
        assert!(found.into_iter().all(|dn| dn > 1.0), "control, {method}: {found:?} DN");
    }
}

#[test]
fn whole_stars_come_after_the_last_block_and_leave_nothing_behind() {
    let Some(device) = device() else { return };
    let scene = Scene::new(PsfModel::gaussian(0.75), Motion::Still, "auto");
    let mut gpu = Gpu::new(device, scene.size[0], scene.size[1]).expect("a backend");
    let mut planner = scene.planner();
    let plan = planner.plan(&stars()).clone();
    let at_once = draw_gpu(&mut gpu, &plan, scene.size);
    gpu.limit_block(2);
    assert_eq!(draw_gpu(&mut gpu, &plan, scene.size).pixels(), at_once.pixels());
    let dark = draw_gpu(&mut gpu, planner.plan(&[]), scene.size);
    assert!(dark.pixels().iter().all(|e| *e == 0.0), "nothing is left of the frame before");
}
