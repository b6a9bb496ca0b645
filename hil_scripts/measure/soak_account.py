"""Judges what soak_flight.py found: from soak_account import account, memory_slope, latency

Every frame number of a run is followed: from its slot to each output. A number that does not arrive must have a cause that the
run itself reports: its fate and cause in frames_timing.csv, a commanded fault, or a counted event of a sink.
"""

import csv
import json
import math
from pathlib import Path

#: A process that grows faster than this share of its memory per hour is not flat: it would double within four days.
FLAT_SHARE_PER_H = 0.01
#: Share of a run that warms up: caches, kept frames and tables fill.
WARM_UP_SHARE = 0.2
#: Standard errors by which growth must be beyond the limit, or below it.
SIGMAS = 2.0
#: Events by which a sink names a frame that it gave up.
SINK_EVENTS = ("sink_dropped", "sink_refused", "sink_cut", "sink_busy")
#: Faults that drop frames, or make them late, because they were commanded to.
DROPPING, DELAYING = ("frame_drop",), ("frame_late",)


def quantile(values, share):
    """Returns the value below which a share of the sorted values is; None without values."""
    return values[min(len(values) - 1, int(share * len(values)))] if values else None


# --- frames -----------------------------------------------------------------------------------------------------------


def slots_of(folder):
    """Returns the rows of frames_timing.csv by frame number, and numbers that have two rows."""
    slots, twice = {}, []
    with open(Path(folder) / "timing/frames_timing.csv", newline="") as file:
        for row in csv.DictReader(file):
            number = int(row["frame"])
            if number in slots:
                twice.append(number)
            slots[number] = row
    return slots, twice


def camera_sessions(folder, names):
    """Returns each session of the camera's client: numbers and CRC-32 in the order received, and frames that came in part."""
    sessions = []
    for name in names:
        path, whole, parts, ended = Path(folder) / name, [], 0, {}
        lines = path.read_text().split("\n")[:-1] if path.exists() else []
        for line in lines:
            number, crc32, state = line.split(",", 2)
            if number == "end":
                ended = json.loads(state)
            elif number:
                whole.append((int(number), crc32))
            else:
                parts += 1
        sessions.append({"whole": whole, "parts": parts, "end": ended})
    return sessions


def commanded_spans(found, words):
    """Returns when faults of such words act, seconds after the first exposure."""
    planned = [(event["at_s"], event["at_s"] + event.get("for_s", 0.0)) for event in found["planned_events"] if event["do"] in words]
    injected = [(event["from_s"], event["from_s"] + event["for_s"]) for event in found["injected"] if event["do"] in words]
    return planned + injected


def is_within(t_s, spans, slack_s):
    return any(begin - slack_s <= t_s <= end + slack_s for begin, end in spans)


def lost_slots(slots, found, period_s):
    """Returns how many slots were not sent, by cause, and those that have no cause and no commanded fault."""
    spans, causes, lost = commanded_spans(found, DROPPING), {}, []
    for number, row in sorted(slots.items()):
        if row["fate"] != "dropped":
            continue
        if row["cause"]:
            cause = row["cause"]
        elif is_within(number * period_s, spans, 2.0 * period_s):
            cause = "commanded frame_drop"
        else:
            cause = "no cause"
            lost.append(number)
        causes[cause] = causes.get(cause, 0) + 1
    return causes, lost


def named_losses(folder, found):
    """Returns the frames that events of sinks name, and how many such events are counted and not known one by one."""
    head, *lines = (Path(folder) / "run/events.jsonl").read_text().splitlines()
    listed = [json.loads(line) for line in lines] + found["monitor"]["events"]
    named = {event["frame"] for event in listed if event["kind"] in SINK_EVENTS and event["frame"] is not None}
    kept = sum(json.loads(line)["kind"] in SINK_EVENTS for line in lines)
    counted = sum(json.loads(head)["counts"].get(kind, 0) for kind in SINK_EVENTS)
    return named, counted - kept


def recorder_gaps(sent, recorded, sink, losses):
    """Returns frames that were sent and not recorded, where no event names them or the sink counts another number of them."""
    named, unlisted = losses
    missing, counted = sorted(sent - recorded), sink["dropped"] + sink["refused"]
    without = [number for number in missing if number not in named]
    lost = missing if len(missing) != counted else without if len(without) > unlisted else []
    return {"sent": len(sent), "recorded": len(recorded), "missing": len(missing), "counted": counted, "lost": lost,
            "never_sent": sorted(recorded - sent)}  # fmt: skip


def camera_gaps(sessions, sent, crc32s, sink, losses):
    """Follows the frames of each session of the network camera; gaps must be frames that came in part, or counted by the camera.

    `unnamed` has those that no event names."""
    named, unlisted = losses
    rows, lost, wrong, out_of_order = [], [], [], 0
    for session in sessions:
        numbers = [number for number, _ in session["whole"]]
        wrong += [number for number, crc32 in session["whole"] if crc32s.get(number, crc32) != crc32]
        out_of_order += sum(later <= earlier for earlier, later in zip(numbers, numbers[1:]))
        span = {number for number in sent if numbers and numbers[0] <= number <= numbers[-1]}
        missing = sorted(span - set(numbers))
        without = [number for number in missing if number not in named]
        # The last ones are the frames that came in part: which ones they were is not known.
        lost += without[: max(0, len(without) - session["parts"])]
        rows.append({"received": len(numbers), "missing": missing, "parts": session["parts"], "end": session["end"]})
    # Events that are only counted explain as many frames, once for all sessions.
    unnamed = lost[: max(0, len(lost) - unlisted)]
    own = [count for name, count in sink["counts"].items() if "dropped" in name or "cut" in name]
    counted = sink["dropped"] + sink["refused"] + sum(own)
    # The camera counts what it gives up without an event: as many frames are counted, and not named.
    lost = unnamed[: max(0, len(unnamed) - sum(own))]
    return {"sessions": len(rows), "received": sum(row["received"] for row in rows), "in_part": sum(row["parts"] for row in rows),
            "missing": sum(len(row["missing"]) for row in rows), "counted": counted, "lost": lost, "unnamed": unnamed,
            "wrong_bits": wrong, "out_of_order": out_of_order, "rows": rows}  # fmt: skip


def account(folder):
    """Returns where every frame of a flight went, and `lost`: descriptions of frames that nothing counts. It must be empty."""
    folder = Path(folder)
    found = json.loads((folder / "found.json").read_text())
    summary = json.loads((folder / "run/summary.json").read_text())
    slots, twice = slots_of(folder)
    period_s = summary["frame_period_s"]
    wanted = round(found["seconds"] / period_s)
    recorded = dict(found["recorder"]["frames"])
    causes, without_cause = lost_slots(slots, found, period_s)
    sent = {number for number, row in slots.items() if row["fate"] != "dropped"}
    losses = named_losses(folder, found)
    recorder = recorder_gaps(sent, set(recorded), summary["sinks"][0], losses)
    sessions = camera_sessions(folder, found["camera"]["files"])
    camera = camera_gaps(sessions, sent, recorded, summary["sinks"][1], losses)
    fates = {}
    for row in slots.values():
        fates[row["fate"]] = fates.get(row["fate"], 0) + 1
    findings = {
        "slots without a row": sorted(set(range(wanted)) - slots.keys()),
        "slots with two rows": twice,
        "dropped without a cause": without_cause,
        "sent, neither recorded nor counted": recorder["lost"],
        "recorded, never sent": recorder["never_sent"],
        "recorded with other pixels than its row": found["recorder"]["wrong"],
        "of the network camera, neither received nor counted": camera["lost"],
        "received with other pixels than recorded": camera["wrong_bits"],
        "received out of order": [camera["out_of_order"]] if camera["out_of_order"] else [],
    }
    counted = {name: (summary["frames"][name], fates.get(fate, 0)) for name, fate in (("dropped", "dropped"), ("held", "held"))}
    differ = [name for name, (reported, seen) in counted.items() if reported != seen]
    return {"slots": wanted, "fates": fates, "causes_of_dropped": causes, "recorder": recorder, "camera": camera,
            "counts_that_differ": differ, "lost": {what: which for what, which in findings.items() if which}}  # fmt: skip


# --- memory -----------------------------------------------------------------------------------------------------------


def line_fit(points):
    """Returns slope and its standard error of a straight line through points, and the rms about it."""
    n = len(points)
    mean_x, mean_y = (sum(column) / n for column in zip(*points))
    spread = sum((x - mean_x) ** 2 for x, _ in points)
    slope = sum((x - mean_x) * (y - mean_y) for x, y in points) / spread
    squares = sum((y - mean_y - slope * (x - mean_x)) ** 2 for x, y in points)
    return slope, math.sqrt(squares / max(n - 2, 1) / spread), math.sqrt(squares / n)


def memory_slope(samples, end_s):
    """Returns the growth of a process, bytes per hour, after its warm-up and while it runs; `verdict` is "flat" or "grows"."""
    points = [(row[0] / 3600.0, row[1]) for row in samples if WARM_UP_SHARE * end_s <= row[0] <= end_s]
    slope, error, rms = line_fit(points)
    mean = sum(y for _, y in points) / len(points)
    limit = FLAT_SHARE_PER_H * mean
    verdict = "grows" if slope - SIGMAS * error > limit else "flat" if slope + SIGMAS * error < limit else "undecided"
    return {"bytes_per_hour": slope, "standard_error": error, "rms_bytes": rms, "mean_bytes": mean, "samples": len(points),
            "limit_bytes_per_hour": limit, "first_bytes": points[0][1], "last_bytes": points[-1][1],
            "most_threads": max(row[2] for row in samples), "most_descriptors": max(row[3] for row in samples),
            "verdict": verdict}  # fmt: skip


# --- times ------------------------------------------------------------------------------------------------------------

TIMES = ("release_to_delivered_ms", "mid_exposure_to_delivered_ms", "wake_ms", "lateness_ms")
QUANTILES = (("p50", 0.5), ("p99", 0.99), ("p99.9", 0.999))


def times_of(row, exposure_s):
    """Returns the times of a frame that went out, ms."""
    total = float(row["release_to_delivered_ms"]) if row["release_to_delivered_ms"] else None
    since_middle = None if total is None else total + 500.0 * exposure_s
    return {"release_to_delivered_ms": total, "mid_exposure_to_delivered_ms": since_middle,
            "wake_ms": float(row["wake_ms"] or 0.0), "lateness_ms": float(row["lateness_ms"] or 0.0)}  # fmt: skip


def latency(folder):
    """Returns quantiles of the times of all frames, of those without a fault that delays them, and by minute."""
    folder = Path(folder)
    found = json.loads((folder / "found.json").read_text())
    period_s = json.loads((folder / "run/summary.json").read_text())["frame_period_s"]
    slots, _ = slots_of(folder)
    paused = [(at_s, at_s + for_s + 0.5) for at_s, word, for_s in found["outside"] if word == "program_paused"]
    spans = commanded_spans(found, DELAYING) + paused
    all_rows, free, minutes = [], [], {}
    for number, row in slots.items():
        if row["fate"] == "dropped" or not row["release_to_delivered_ms"]:
            continue
        exposure_s = (int(row["release_tai_ns"]) - int(row["exposure_start_tai_ns"])) * 1e-9
        times, t_s = times_of(row, exposure_s), number * period_s
        all_rows.append(times)
        minutes.setdefault(int(t_s // 60), []).append(times["release_to_delivered_ms"])
        if not is_within(t_s, spans, 1.0):
            free.append(times)
    by_minute = [(minute, *(quantile(sorted(values), share) for _, share in QUANTILES), max(values))
                 for minute, values in sorted(minutes.items())]  # fmt: skip
    return {"all": quantiles_of(all_rows), "undisturbed": quantiles_of(free), "by_minute": by_minute}


def quantiles_of(rows):
    """Returns count and quantiles of each time."""
    found = {"frames": len(rows)}
    for name in TIMES if rows else ():
        values = sorted(row[name] for row in rows)
        found[name] = {word: quantile(values, share) for word, share in QUANTILES} | {"max": values[-1]}
    return found


def bus_load(folder, names):
    """Returns the mean share of the bus that was taken while the node was connected, its least and largest second, and the seconds."""
    seconds, by_others = [], []
    for name in names:
        path = Path(folder) / name
        for _, others, own in json.loads(path.read_text())["loads"][1:] if path.exists() else []:
            seconds.append(others + own)
            by_others.append(others)
    if not seconds:
        return {"seconds": 0}
    seconds.sort()
    return {"seconds": len(seconds), "mean": sum(seconds) / len(seconds), "p5": quantile(seconds, 0.05), "median": quantile(seconds, 0.5),
            "p95": quantile(seconds, 0.95), "by_starloop": sum(by_others) / len(by_others)}  # fmt: skip
