//! Frames under jitter that came over the bus, drawn: as with configured lines, and as their variance says.

use crate::scene::{
    EXPOSURE_S, FOCAL_PX, Picture, camera, draw_cpu, draw_reference, everything, instrument, los, planner_of, star,
};
use base::time::{Span, Tai};
use glam::DVec3;
use plan::attitude::{ClockEstimate, HistoryLimits, JitterHistory, JitterLine, LosPath, WheelHarmonic};
use plan::optics::PsfModel;

const SIZE: usize = 48;
const SIGMA_PX: f64 = 1.2;
const ELECTRONS: f64 = 1e5;
/// Shares of the flux per pixel: phases moved to mid-exposure differ by 1e-9 of a radian.
const SAME_PATH: f64 = 1e-8;

fn history() -> JitterHistory {
    JitterHistory::new(HistoryLimits::default(), Span::from_ms(5))
}

fn estimate() -> ClockEstimate {
    ClockEstimate {
        offset: Span::ZERO,
        reference_remote_ns: 0,
        drift: 0.0,
        offset_sigma: Span::ZERO,
        drift_sigma: 0.0,
        drift_walk_per_s: 0.0,
        residual: Span::ZERO,
        spread: Span::ZERO,
        pairs: 1,
    }
}

/// Returns one frame with the jitter of a history: by the reference and by the CPU's automatic method.
fn frames(history: &JitterHistory) -> [Picture; 2] {
    let mut los = LosPath { jitter: history.new_track(), ..los() };
    history.fill(los.exposure_start, los.exposure_start + Span::from_s(EXPOSURE_S), &mut los.jitter);
    let psf = PsfModel::gaussian(SIGMA_PX);
    let mut planner = planner_of(instrument(camera(SIZE), &psf), "auto", los, None);
    let plan = planner.plan(&[star(0, ELECTRONS, [23.3, 24.1])]).clone();
    [draw_reference(&plan), draw_cpu(&plan)]
}

fn largest_difference(a: &Picture, b: &Picture) -> f64 {
    let pairs = (0..SIZE * SIZE).map(|i| (a.at(i % SIZE, i / SIZE), b.at(i % SIZE, i / SIZE)));
    pairs.map(|(a, b)| (a - b).abs() / ELECTRONS).fold(0.0, f64::max)
}

fn line(frequency_hz: f64, x_px: f64, phase_rad: f64) -> JitterLine {
    JitterLine { frequency_hz, amplitude_rad: DVec3::new(0.3, 1.0, 0.0) * (x_px / FOCAL_PX), phase_rad }
}

#[test]
fn a_frame_is_the_same_by_configured_and_by_uploaded_lines() {
    let lines = [line(7.0, 1.5, 0.3), line(53.0, 0.8, 2.0), line(180.0, 0.2, -1.0)];
    let (mut configured, mut uploaded, mut other) = (history(), history(), history());
    configured.set_lines(&lines, Tai::from_ns(0)).unwrap();
    uploaded.set_uploaded_lines(&lines).unwrap();
    uploaded.follow_clock(&estimate());
    other.set_uploaded_lines(&lines[1..]).unwrap();
    other.follow_clock(&estimate());
    let [[reference, cpu], [by_bus, cpu_by_bus], [without, _]] = [&configured, &uploaded, &other].map(frames);
    assert!(largest_difference(&reference, &by_bus) < SAME_PATH);
    // The CPU sums in f32.
    assert!(largest_difference(&cpu, &cpu_by_bus) < 1e-6);
    assert!(largest_difference(&reference, &without) > 1e-3, "a line left out shows");
}

#[test]
fn a_frame_is_the_same_by_a_wheel_and_by_its_line() {
    // 3000 rpm: the second harmonic is 100 Hz; (3)^2 of the amplitude at 1000 rpm. Angle 0 at the exposure's start.
    let wanted = line(100.0, 0.9, 0.7);
    let row = WheelHarmonic {
        wheel: 0,
        harmonic: 2.0,
        amplitude_rad: wanted.amplitude_rad / 9.0,
        exponent: 2.0,
        phase_rad: 0.7,
    };
    let (mut configured, mut wheel) = (history(), history());
    configured.set_lines(&[wanted], Tai::from_ns(0)).unwrap();
    wheel.set_wheel_harmonics(&[row]).unwrap();
    wheel.wheel_speeds([100.0 * core::f64::consts::PI, 0.0, 0.0, 0.0], Tai::from_ns(0)).unwrap();
    let [[reference, _], [by_wheel, by_wheel_cpu]] = [&configured, &wheel].map(frames);
    assert!(largest_difference(&reference, &by_wheel) < SAME_PATH);
    // The star as a tracker measures it, by the method the planner picks.
    let window = everything(SIZE);
    let [(flux, [x, y]), (cpu_flux, [cpu_x, cpu_y])] = [&by_wheel, &by_wheel_cpu].map(|frame| frame.moments(&window));
    assert!((x - cpu_x).hypot(y - cpu_y) < 0.002 && (flux / cpu_flux - 1.0).abs() < 1e-3, "the default budget");
}
