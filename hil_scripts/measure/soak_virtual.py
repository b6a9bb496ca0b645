"""Flies the simulated hours of soak.py on the virtual clock: from soak_virtual import fly_virtual

A day is flown in legs. Each leg is a process of its own, so that every thread, link, sink and file begins again, and it goes on
at the instant at which the one before ended. Within a leg the bus goes off and comes back, the flight computer goes to safe mode
and back, trackers and gyro are switched off, clocks step, and the faults of a seed come on top.
"""

import json
import shutil
import subprocess
import time
from datetime import datetime, timedelta
from pathlib import Path

from soak_account import commanded_spans, is_within, line_fit
from soak_bench import CONFIGS, bench_text, fault_schedule, limits_text
from soak_clients import RecorderReader, Samples

#: Frames and attitudes per second; at 20 Hz a simulated day would take more than an hour of a core, at 2 Hz eight minutes.
RATE_HZ, ATTITUDE_HZ = 2.0, 10.0
#: Simulated seconds from one fault to the next.
GAPS_S = (60.0, 300.0)
#: Simulated seconds of a leg, and how much of it warms up.
LEG_S, WARM_UP_SHARE = 7200.0, 0.2
START = datetime(2026, 3, 1)
#: Restarts of each leg, as shares of its time.
RESTARTS = (
    (0.10, {"do": "bus_off", "for_s": 5.0}),
    (0.25, {"do": "tracker_off", "for_s": 20.0}),
    (0.40, {"do": "bus_silence", "for_s": 10.0}),
    (0.50, {"do": "safe"}),
    (0.55, {"do": "resume"}),
    (0.70, {"do": "gyro_dropout", "for_s": 4.0}),
    (0.85, {"do": "clock_step", "step_ms": 40.0, "for_s": 10.0}),
    # Longer than a period: those behind the last late frame must wait for it.
    (0.93, {"do": "frame_late", "late_ms": 1200.0, "for_s": 3.0}),
)
SINK = '\n[sink]\nkind = "recorder"\nfits = true\n'


class MemoryByFrames(Samples):
    """Memory of the program over the frames that it has recorded."""

    def __init__(self, pid, reader):
        super().__init__(pid, 0.5)
        self.reader, self.by_frames = reader, []

    def step(self):
        before = len(self.rows)
        super().step()
        self.by_frames += [(len(self.reader.frames), row[1]) for row in self.rows[before:]]


def leg_events(seed, seconds):
    """Returns the events of a leg: its restarts and the faults of its seed."""
    planned, injected = fault_schedule(seed, seconds, GAPS_S, without=("slew",))
    return [{**event, "at_s": round(share * seconds, 3)} for share, event in RESTARTS] + planned + injected


def fly_leg(binary, folder, number, seconds, seed, start):
    """Flies one leg and returns where its frames went and how its memory went."""
    shutil.rmtree(folder, ignore_errors=True)
    folder.mkdir(parents=True)
    events = leg_events(seed, seconds)
    bench = folder / "bench.toml"
    bench.write_text(bench_text(seed, seconds, events, rate_hz=RATE_HZ, attitude_hz=ATTITUDE_HZ, jitter=False, gateway=False,
                                bit_rates=(500e3, 5e6), camera=CONFIGS / "cameras/small_tracker.toml", sinks=SINK,
                                start_utc=start.strftime("%Y-%m-%dT%H:%M:%SZ"), limits=limits_text(events, RATE_HZ)))  # fmt: skip
    command = [str(binary), "run", str(bench), "--clock", "virtual", "--json", "--out", str(folder / "run")]
    begun = time.monotonic()
    with open(folder / "report.json", "w") as report, open(folder / "log.txt", "w") as log:
        process = subprocess.Popen(command, stdin=subprocess.DEVNULL, stdout=report, stderr=log)
        reader = RecorderReader(folder / "run").begin()
        memory = MemoryByFrames(process.pid, reader).begin()
        status = process.wait()
    reader.end(), memory.end()
    if not (folder / "run/summary.json").exists():
        raise RuntimeError(f"leg {number} ended with {status}: {(folder / 'log.txt').read_text()[-500:]}")
    found = judged(folder, reader, events, seconds)
    found.update({"leg": number, "start_utc": start.isoformat(), "seconds": seconds, "wall_s": time.monotonic() - begun,
                  "exit_status": status, "memory": slope_of(memory.by_frames), "errors": [e for e in (reader.error, memory.error) if e]})  # fmt: skip
    shutil.rmtree(folder / "run")
    return found


def judged(folder, reader, events, seconds):
    """Follows every frame number of a leg into the recording."""
    summary = json.loads((folder / "run/summary.json").read_text())
    report = json.loads((folder / "report.json").read_text())
    wanted, recorded = round(seconds * RATE_HZ), set(reader.frames)
    spans = commanded_spans({"planned_events": events, "injected": []}, ("frame_drop",))
    missing = sorted(set(range(wanted)) - recorded)
    without = [number for number in missing if not is_within(number / RATE_HZ, spans, 2.0 / RATE_HZ)]
    sink, frames = summary["sinks"][0], summary["frames"]
    return {"frames": wanted, "recorded": len(recorded), "dropped": len(missing), "counted": frames["dropped"] + sink["dropped"] + sink["refused"],
            "lost": without, "beyond": sorted(recorded - set(range(wanted))), "wrong": reader.wrong, "events": summary["event_counts"],
            "faults": len(report["faults"]), "violations": report["violation_lines"]}  # fmt: skip


def slope_of(rows):
    """Returns the growth of the memory, bytes per simulated hour after the warm-up; None with too few samples."""
    most = rows[-1][0] if rows else 0
    points = [(frames / RATE_HZ / 3600.0, rss) for frames, rss in rows if frames >= WARM_UP_SHARE * most]
    if len(points) < 3 or points[0][0] == points[-1][0]:
        return None
    slope, error, _ = line_fit(points)
    return {"bytes_per_hour": slope, "standard_error": error, "mean_bytes": sum(y for _, y in points) / len(points), "largest_bytes": max(y for _, y in points)}


def fly_virtual(binary, folder, hours, seed, leg_s=LEG_S, say=print):
    """Flies so many simulated hours and returns all legs and their sum."""
    folder, legs, left_s, start = Path(folder).absolute(), [], hours * 3600.0, START
    while left_s > 0.5:
        seconds = min(leg_s, left_s)
        leg = fly_leg(binary, folder / f"leg_{len(legs):02}", len(legs), seconds, seed + len(legs), start)
        legs.append(leg)
        left_s, start = left_s - seconds, start + timedelta(seconds=seconds)
        say(f"leg {leg['leg']}: {leg['recorded']} of {leg['frames']} frames recorded, {leg['dropped']} dropped, {len(leg['lost'])} without an event, "
            f"status {leg['exit_status']}, {leg['wall_s']:.0f} s")  # fmt: skip
    found = {"hours": hours, "seed": seed, "rate_hz": RATE_HZ, "leg_s": leg_s, "legs": legs, **sum_of(legs)}
    folder.mkdir(parents=True, exist_ok=True)
    (folder / "virtual.json").write_text(json.dumps(found))
    return found


def sum_of(legs):
    """Returns the sum of all legs: frames, events, and the mean growth of memory with the error of that mean."""
    total = {name: sum(leg[name] for leg in legs) for name in ("frames", "recorded", "dropped", "counted", "faults", "wall_s")}
    events = {}
    for leg in legs:
        for word, count in leg["events"].items():
            events[word] = events.get(word, 0) + count
    slopes = [leg["memory"]["bytes_per_hour"] for leg in legs if leg["memory"]]
    memory = None
    if slopes:
        mean = sum(slopes) / len(slopes)
        spread = (sum((slope - mean) ** 2 for slope in slopes) / max(len(slopes) - 1, 1) / len(slopes)) ** 0.5
        memory = {"bytes_per_hour": mean, "standard_error": spread, "mean_bytes": sum(leg["memory"]["mean_bytes"] for leg in legs if leg["memory"]) / len(slopes)}
    lost = {f"leg {leg['leg']}": {name: leg[name] for name in ("lost", "beyond", "wrong", "errors", "violations") if leg[name]} for leg in legs}
    differ = [leg["leg"] for leg in legs if leg["dropped"] != leg["counted"]]
    return {"total": {**total, "events": events}, "memory": memory, "lost": {name: what for name, what in lost.items() if what}, "legs_whose_counts_differ": differ}
