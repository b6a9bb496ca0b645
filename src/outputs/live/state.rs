//! Everything the page shows beside the picture, as one JSON object.
//!
//! Keys carry their unit; what is not known is `null`. Times are UTC: of the frame by the run's clock, of its arrival by the
//! view's. Test: below.

use crate::live::board::Board;
use crate::live::latest::Picture;
use frames::report::{NamedCounts, RunNumbers, Stage, TimeTally};
use serde_json::{Map, Value, json};

/// The state now.
pub(super) fn state_of(board: &mut Board) -> Value {
    board.listen();
    let now = board.clock.now();
    let frame = board.newest().map(|picture| frame_of(picture, (now - picture.taken).s()));
    let lateness = board.newest().map(lateness_of);
    let params = &board.params;
    json!({
        "starloop_version": env!("CARGO_PKG_VERSION"),
        "bench": params.bench,
        "camera": &*params.camera,
        "size_px": params.size_px,
        "field_deg": params.field_deg,
        "frame_period_ms": params.frame_period_s * 1e3,
        "readout_ms": params.readout_s * 1e3,
        "now_utc": now.to_rfc3339(),
        "is_over": board.is_over(),
        "frame": frame,
        "lateness": lateness,
        "run": board.has_numbers.then(|| run_of(&board.numbers)),
    })
}

fn frame_of(picture: &Picture, age_s: f64) -> Value {
    let meta = &picture.frame.meta;
    let active: Vec<Value> = meta
        .active
        .named()
        .iter()
        .map(|fault| {
            json!({ "name": fault.name, "number": fault.number, "value": fault.amount.value, "unit": fault.amount.unit })
        })
        .collect();
    json!({
        "number": meta.number,
        "count": picture.count,
        "utc": meta.mid_exposure.to_rfc3339(),
        "taken_utc": picture.taken.to_rfc3339(),
        "age_s": age_s,
        "exposure_s": meta.exposure_s,
        "attitude_wxyz": meta.attitude_wxyz,
        "ra_deg": meta.ra_deg,
        "dec_deg": meta.dec_deg,
        "roll_deg": meta.roll_deg,
        "rate_deg_s": meta.rate_deg_s,
        "lateness_ms": meta.lateness.ms(),
        "attitude_age_ms": meta.attitude_age.ms(),
        "horizon_ms": meta.horizon.ms(),
        "backend": meta.backend,
        "method": meta.method,
        "rung": meta.rung,
        "origin": meta.origin,
        "camera": &*meta.camera,
        "stars": picture.frame.truth.len(),
        "left_out_stars": meta.left_out_stars,
        "fault_flags": meta.faults.names().collect::<Vec<_>>(),
        "faults": active,
        "fault_count": meta.active.count(),
    })
}

fn lateness_of(picture: &Picture) -> Value {
    let bins = &picture.lateness;
    json!({ "reach_ms": bins.reach_s() * 1e3, "counts": bins.counts().to_vec() })
}

fn run_of(numbers: &RunNumbers) -> Value {
    let stages: Vec<Value> =
        Stage::ALL.iter().zip(&numbers.stages).map(|(stage, tally)| stage_of(*stage, tally)).collect();
    let ports: Vec<Value> = numbers
        .ports()
        .iter()
        .map(|port| json!({ "counters": counts(&port.counters, 0), "rejects": counts(&port.rejects, 1) }))
        .collect();
    json!({
        "frames_in_run": numbers.frames_in_run,
        "frames": numbers.frames,
        "stages": stages,
        "events": counts(&numbers.events, 1),
        "ports": ports,
        "ports_left_out": numbers.ports_left_out(),
    })
}

fn stage_of(stage: Stage, tally: &TimeTally) -> Value {
    json!({
        "name": stage.name(),
        "is_of_a_frame": Stage::OF_A_FRAME.contains(&stage),
        "count": tally.count(),
        "mean_ms": tally.mean_ms(),
        "p50_ms": tally.quantile_ms(0.5),
        "p99_ms": tally.quantile_ms(0.99),
        "max_ms": tally.max_ms(),
    })
}

/// Names and counts from `least` on.
fn counts<const MOST: usize>(named: &NamedCounts<MOST>, least: u64) -> Map<String, Value> {
    let told = named.iter().filter(|(_, count)| *count >= least);
    told.map(|(name, count)| (name.to_owned(), count.into())).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::live::view::tests::board;
    use frames::sink::Sink;
    use frames::sink::sample::sample_frame;

    #[test]
    fn before_the_first_frame_there_is_none() {
        let (mut board, _sink, _numbers) = board();
        let state = state_of(&mut board);
        assert_eq!((&state["frame"], &state["run"], &state["is_over"]), (&Value::Null, &Value::Null, &json!(false)));
        assert_eq!((&state["bench"], &state["readout_ms"]), (&json!("test bench"), &json!(80.0)));
    }

    #[test]
    fn the_newest_frame_and_the_newest_numbers_are_told() {
        let (mut board, mut sink, numbers) = board();
        (3..=4).for_each(|number| sink.send(&sample_frame(number)).unwrap());
        let mut run = RunNumbers::NONE;
        (run.frames.scheduled, run.frames_in_run) = (9, Some(600));
        run.events = [("late", 2), ("held", 0)].into_iter().collect();
        numbers.tell(&run);
        let state = state_of(&mut board);
        let frame = &state["frame"];
        assert_eq!((&frame["number"], &frame["count"]), (&json!(4), &json!(2)));
        assert_eq!(frame["faults"][0], json!({ "name": "hot_pixels", "number": 3, "value": 31.25, "unit": "e-/s" }));
        assert_eq!(frame["fault_flags"], json!(["link_drop", "hot_pixels"]));
        assert_eq!(state["lateness"]["counts"].as_array().map(Vec::len), Some(50));
        assert_eq!(state["run"]["frames"]["scheduled"], json!(9));
        assert_eq!(state["run"]["events"], json!({ "late": 2 }), "what never happened is left out");
        drop(sink);
        assert_eq!(state_of(&mut board)["is_over"], json!(false), "its totals are still to come");
        numbers.tell_last(&run);
        assert_eq!(state_of(&mut board)["is_over"], json!(true));
    }

    #[test]
    fn what_is_no_number_is_null() {
        let (mut board, mut sink, _numbers) = board();
        let mut frame = sample_frame(1);
        frame.meta.ra_deg = f64::NAN;
        sink.send(&frame).unwrap();
        assert_eq!(state_of(&mut board)["frame"]["ra_deg"], Value::Null);
    }
}
