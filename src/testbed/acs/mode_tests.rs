//! The table of modes: dwell times to the step, hysteresis, every row reachable.

use super::mode_logic::{Cause, Mode, ModeLogic, Situation, Thresholds};
use super::test_body::{PERIOD, start, thresholds};
use base::time::{Span, Tai};

/// Returns a body at rest on its target.
fn calm() -> Situation {
    Situation { rate_rad_s: 0.0, rate_error_rad_s: 0.0, error_rad: Some(0.0), sigma_rad: 0.0, slew_over: false }
}

/// Steps until the mode changes, at most 100 s; the time since the first step.
fn time_to_change(mode: Mode, situation: &Situation) -> Option<(Span, Mode, Cause)> {
    let mut logic = ModeLogic::new(mode, thresholds());
    let mut at = start();
    while at - start() < Span::from_ms(100_000) {
        if let Some(event) = logic.step(at, situation) {
            assert_eq!((event.at, event.from, logic.mode), (at, mode, event.to), "event and mode agree");
            return Some((at - start(), event.to, event.cause));
        }
        at = at + PERIOD;
    }
    None
}

#[test]
fn every_row_fires_after_its_dwell() {
    let t = thresholds();
    let fast = Situation { rate_rad_s: 3.0 * t.rate_high_rad_s, rate_error_rad_s: 1.0, ..calm() };
    let blind = Situation { error_rad: None, ..calm() };
    let far = Situation { error_rad: Some(2.0 * t.slew_above_rad), ..calm() };
    let off = Situation { error_rad: Some(2.0 * t.fine_leave_rad), ..calm() };
    let vague = Situation { sigma_rad: 2.0 * t.fine_leave_sigma_rad, ..calm() };
    let over = Situation { slew_over: true, ..calm() };
    let over_but_off = Situation { slew_over: true, ..off };
    use Mode::{CoarsePointing, FinePointing, RateDamping, Safe, Slew};
    for (from, situation, dwell, to, cause) in [
        (RateDamping, calm(), t.rate_dwell, CoarsePointing, Cause::RateLow),
        (RateDamping, blind, t.safe_without_attitude, Safe, Cause::NoAttitude),
        (CoarsePointing, fast, t.rate_dwell, RateDamping, Cause::RateHigh),
        (FinePointing, fast, t.rate_dwell, RateDamping, Cause::RateHigh),
        (Slew, fast, t.rate_dwell, RateDamping, Cause::RateHigh),
        (CoarsePointing, blind, t.safe_without_attitude, Safe, Cause::AttitudeLost),
        (FinePointing, blind, t.coarse_without_attitude, CoarsePointing, Cause::AttitudeLost),
        (Slew, blind, t.coarse_without_attitude, CoarsePointing, Cause::AttitudeLost),
        (CoarsePointing, far, t.fine_leave_dwell, Slew, Cause::FarFromTarget),
        (CoarsePointing, calm(), t.fine_enter_dwell, FinePointing, Cause::Settled),
        (FinePointing, off, t.fine_leave_dwell, CoarsePointing, Cause::ErrorLarge),
        (FinePointing, vague, t.fine_leave_dwell, CoarsePointing, Cause::SigmaLarge),
        (Slew, far, t.fine_leave_dwell, CoarsePointing, Cause::ErrorLarge),
        (Slew, over, t.fine_enter_dwell, FinePointing, Cause::Settled),
        (Slew, over_but_off, t.slew_settle, CoarsePointing, Cause::SlewOver),
    ] {
        assert_eq!(time_to_change(from, &situation), Some((dwell, to, cause)), "{from:?} {situation:?}");
    }
}

#[test]
fn nothing_moves_without_a_cause() {
    let turning = Situation { rate_rad_s: 1.5 * thresholds().rate_low_rad_s, rate_error_rad_s: 1.0, ..calm() };
    for (mode, situation) in [
        (Mode::RateDamping, turning),
        (Mode::CoarsePointing, turning),
        (Mode::CoarsePointing, Situation { error_rad: Some(1.0), ..turning }),
        (Mode::FinePointing, calm()),
        (Mode::Slew, calm()),
        (Mode::Safe, calm()),
        (Mode::Safe, Situation { rate_rad_s: 1.0, error_rad: None, ..calm() }),
    ] {
        assert_eq!(time_to_change(mode, &situation), None, "{mode:?}");
    }
}

/// Returns the mode changes in 100 s while the error swings between 0.8 of the entry and 1.2 of it, 3 s each.
fn changes_while_swinging(thresholds: Thresholds) -> u32 {
    let mut logic = ModeLogic::new(Mode::CoarsePointing, thresholds);
    let enter = thresholds.fine_enter_rad;
    let mut changes = 0;
    for k in 0..1000_i64 {
        let at: Tai = start() + Span::from_ns(PERIOD.ns() * k);
        // Begins with a calm time, so that fine pointing is reached.
        let error = if k < 100 || k / 30 % 2 == 0 { 0.8 * enter } else { 1.2 * enter };
        changes += u32::from(logic.step(at, &Situation { error_rad: Some(error), ..calm() }).is_some());
    }
    changes
}

#[test]
fn hysteresis_and_dwell_keep_the_modes_from_chattering() {
    assert_eq!(changes_while_swinging(thresholds()), 1, "into fine pointing, once");
    let t = thresholds();
    let none = Thresholds { fine_leave_rad: t.fine_enter_rad, fine_enter_dwell: Span::ZERO, ..t };
    assert!(changes_while_swinging(none) > 10, "without hysteresis it must chatter");
}

#[test]
fn a_short_outage_changes_nothing() {
    let mut logic = ModeLogic::new(Mode::FinePointing, thresholds());
    for k in 0..1000_i64 {
        // 1.9 s without attitude, 0.1 s with: below the 2 s dwell each time.
        let error_rad = (k % 20 == 19).then_some(0.0);
        let at = start() + Span::from_ns(PERIOD.ns() * k);
        assert_eq!(logic.step(at, &Situation { error_rad, ..calm() }), None, "step {k}");
    }
}
