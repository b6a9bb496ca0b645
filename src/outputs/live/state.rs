//! Everything the page shows beside the picture, as one JSON object.
//!
//! At the top: the run, and one head, the first where none is asked for. `heads` lists all of them with the same keys.
//! The facts of a frame are those of [`frames::sink::facts`]. Keys carry their unit; unknown values are `null`. Times
//! are UTC: of the frame by the run's clock, of its arrival by the view's. Test: below.

use crate::live::head::{Board, Head};
use crate::live::kept::{Picture, frame_of};
use base::time::Tai;
use frames::report::{NamedCounts, NewestEvent, OF_OTHER_NODES, RunNumbers, Stage, TimeTally};
use serde_json::{Map, Value, json};

/// Returns the state now, with head `chosen` at the top; `None` when the head does not exist.
pub(super) fn state_of(board: &mut Board, chosen: usize) -> Option<Value> {
    board.listen();
    let now = board.clock.now();
    let heads: Vec<Map<String, Value>> =
        board.heads.iter_mut().enumerate().map(|(number, head)| head_of(number, head, now)).collect();
    let mut state = heads.get(chosen)?.clone();
    // The run's end at the top, the head's own in the list.
    let of_run = [
        ("starloop_version", json!(env!("CARGO_PKG_VERSION"))),
        ("bench", json!(board.params.bench)),
        ("now_utc", json!(now.to_rfc3339())),
        ("is_over", json!(board.is_over())),
        ("run", json!(board.has_numbers.then(|| run_of(&board.numbers, &board.params.stage_limit_ms)))),
        ("heads", json!(heads)),
    ];
    state.extend(of_run.map(|(key, value)| (key.to_owned(), value)));
    Some(Value::Object(state))
}

/// Returns one head: its description, and its newest frame.
fn head_of(number: usize, head: &mut Head, now: Tai) -> Map<String, Value> {
    let frame = head.newest().map(|picture| frame_of(picture, (now - picture.taken).s()));
    let lateness = head.newest().map(lateness_of);
    let params = &head.params;
    let facts = [
        ("head", json!(number)),
        ("name", json!(params.name)),
        ("camera", json!(&*params.camera)),
        ("size_px", json!(params.size_px)),
        ("field_deg", json!(params.field_deg)),
        ("frame_period_ms", json!(params.frame_period_s * 1e3)),
        ("readout_ms", json!(params.readout_s * 1e3)),
        ("is_over", json!(head.is_over())),
        ("frame", json!(frame)),
        ("lateness", json!(lateness)),
        ("kept_frames", json!(head.kept.numbers())),
        ("kept_at_most", json!(head.kept.most())),
    ];
    facts.map(|(key, value)| (key.to_owned(), value)).into_iter().collect()
}

fn lateness_of(picture: &Picture) -> Value {
    let bins = &picture.lateness;
    json!({ "reach_ms": bins.reach_s() * 1e3, "counts": bins.counts().to_vec() })
}

fn run_of(numbers: &RunNumbers, limits_ms: &[Option<f64>; Stage::COUNT]) -> Value {
    let stages: Vec<Value> = Stage::ALL
        .iter()
        .zip(&numbers.stages)
        .zip(limits_ms)
        .map(|((stage, tally), limit)| stage_of(*stage, tally, *limit))
        .collect();
    let ports: Vec<Value> = numbers
        .ports()
        .iter()
        .map(|port| json!({ "counters": counts(&port.counters, 0), "rejects": counts(&port.rejects, 1) }))
        .collect();
    json!({
        "verdict": numbers.word,
        "account": numbers.account,
        "frames_in_run": numbers.frames_in_run,
        "frames": numbers.frames,
        "stages": stages,
        "events": counts(&numbers.events, 1),
        "newest_events": numbers.newest.iter().rev().map(event_of).collect::<Vec<_>>(),
        "ports": ports,
        "ports_left_out": numbers.ports_left_out(),
        "name_of_other_nodes": OF_OTHER_NODES,
    })
}

fn event_of(event: &NewestEvent) -> Value {
    json!({
        "kind": event.kind,
        "what": event.what,
        "utc": event.at.to_rfc3339(),
        "frame": event.frame,
        "span_ms": event.span.s() * 1e3,
    })
}

fn stage_of(stage: Stage, tally: &TimeTally, limit_ms: Option<f64>) -> Value {
    json!({
        "name": stage.name(),
        "is_of_a_frame": Stage::OF_A_FRAME.contains(&stage),
        "count": tally.count(),
        "mean_ms": tally.mean_ms(),
        "p50_ms": tally.quantile_ms(0.5),
        "p99_ms": tally.quantile_ms(0.99),
        "max_ms": tally.max_ms(),
        "limit_ms": limit_ms,
        "cumulative": tally.cumulative().map(|(bound_s, count)| json!([bound_s * 1e3, count])).collect::<Vec<_>>(),
    })
}

/// Names and counts from `least` on.
fn counts<const MOST: usize>(named: &NamedCounts<MOST>, least: u64) -> Map<String, Value> {
    let reported = named.iter().filter(|(_, count)| *count >= least);
    reported.map(|(name, count)| (name.to_owned(), count.into())).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::live::view::tests::{board, board_of, params_of_three};
    use frames::sink::Sink;
    use frames::sink::sample::{bare_sample_frame, compare_with_pinned, differs_from_pinned, sample_frame};

    fn state_of(board: &mut Board) -> Value {
        super::state_of(board, 0).unwrap()
    }

    #[test]
    fn before_the_first_frame_there_is_none() {
        let (mut board, _sink, _numbers) = board();
        let state = state_of(&mut board);
        assert_eq!((&state["frame"], &state["run"], &state["is_over"]), (&Value::Null, &Value::Null, &json!(false)));
        assert_eq!((&state["bench"], &state["readout_ms"]), (&json!("test bench"), &json!(80.0)));
    }

    #[test]
    fn the_newest_frame_and_the_newest_numbers_are_reported() {
        let (mut board, mut sink, numbers) = board();
        (3..=4).for_each(|number| sink.send(&sample_frame(number)).unwrap());
        let mut run = RunNumbers::NONE;
        (run.frames.scheduled, run.frames_in_run) = (9, Some(600));
        run.events = [("late", 2), ("held", 0)].into_iter().collect();
        numbers.announce(&run);
        let state = state_of(&mut board);
        let frame = &state["frame"];
        assert_eq!((&frame["number"], &frame["count"]), (&json!(4), &json!(2)));
        assert_eq!(frame["faults"][0], json!({ "name": "hot_pixels", "number": 3, "value": 31.25, "unit": "e-/s" }));
        assert_eq!(frame["fault_flags"], json!(["link_drop", "hot_pixels"]));
        assert_eq!(state["lateness"]["counts"].as_array().map(Vec::len), Some(50));
        assert_eq!(state["run"]["frames"]["scheduled"], json!(9));
        assert_eq!(state["run"]["name_of_other_nodes"], json!(OF_OTHER_NODES), "the page has no name of its own");
        assert!(!include_str!("page/counts.js").contains(OF_OTHER_NODES));
        assert_eq!(state["run"]["events"], json!({ "late": 2 }), "what never happened is left out");
        drop(sink);
        assert_eq!(state_of(&mut board)["is_over"], json!(false), "its totals are still to come");
        numbers.send_last(&run);
        assert_eq!(state_of(&mut board)["is_over"], json!(true));
    }

    #[test]
    fn numbers_that_are_not_finite_are_null() {
        let (mut board, mut sink, _numbers) = board();
        let mut frame = sample_frame(1);
        frame.meta.ra_deg = f64::NAN;
        sink.send(&frame).unwrap();
        assert_eq!(state_of(&mut board)["frame"]["ra_deg"], Value::Null);
    }

    #[test]
    fn every_head_is_listed_and_one_is_at_the_top() {
        let (mut board, mut sinks, _numbers) = board_of(params_of_three());
        (1..=2).for_each(|number| sinks[1].send(&sample_frame(number)).unwrap());
        sinks[2].send(&sample_frame(30)).unwrap();
        let state = state_of(&mut board);
        let heads = state["heads"].as_array().unwrap();
        assert_eq!(heads.len(), 3);
        assert_eq!(heads[0]["frame"], Value::Null, "its first frame has not come");
        let newest =
            |head: usize| (&heads[head]["name"], &heads[head]["frame"]["number"], &heads[head]["frame"]["count"]);
        assert_eq!(newest(1), (&json!("head 1"), &json!(2), &json!(2)));
        assert_eq!(newest(2), (&json!("head 2"), &json!(30), &json!(1)));
        for chosen in 0..3 {
            let state = super::state_of(&mut board, chosen).unwrap();
            let keys = heads[chosen].as_object().unwrap().iter().filter(|(key, _)| *key != "is_over");
            keys.for_each(|(key, value)| assert_eq!(&state[key], value, "{key} of head {chosen}"));
        }
        assert_eq!(super::state_of(&mut board, 3), None, "control: the fourth does not exist");
    }

    #[test]
    fn run_is_over_when_every_head_is() {
        let (mut board, mut sinks, numbers) = board_of(params_of_three());
        numbers.send_last(&RunNumbers::NONE);
        drop(sinks.remove(1));
        let state = state_of(&mut board);
        assert_eq!((&state["is_over"], &state["heads"][1]["is_over"]), (&json!(false), &json!(true)));
        drop(sinks);
        assert_eq!(state_of(&mut board)["is_over"], json!(true));
    }

    #[test]
    fn state_of_a_frame_is_as_pinned() {
        let (mut board, mut sink, _numbers) = board();
        for (name, frame) in [("live_frame.json", sample_frame(7)), ("live_frame_bare.json", bare_sample_frame(8))] {
            sink.send(&frame).unwrap();
            let text = serde_json::to_string_pretty(&state_of(&mut board)["frame"]).unwrap() + "\n";
            compare_with_pinned(name, &text).unwrap();
            assert!(differs_from_pinned(name, &text.replace("\"origin\"", "\"source\"")), "control: another key");
        }
    }
}
