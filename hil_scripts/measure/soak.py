#!/usr/bin/env python3
"""A long run with everything connected: python3 hil_scripts/measure/soak.py [--seconds 3600] [--virtual-hours 24] [--guide]

On the real clock: a spacecraft with the 1024 x 1024 tracker at 20 Hz, its bus filled to 90 %, a recorder, a network camera with a
client, the live view, the control socket and a serial line, under random faults of a seed; clients go and come back, the cable is
pulled, the program is paused. Every frame number must arrive at each output, or be counted by the run with its cause; the memory
must be flat. On the virtual clock the same for simulated hours in legs, each a process of its own. --out keeps soak.json and the
charts; --guide writes them into src/guide/soak.md. --kept judges the last flight again. Exit status 1: a frame is lost without an
event, or the memory grows. Needs Aravis for the system's Python (apt: gir1.2-aravis-0.8, python3-gi), python-can, cantools,
pyserial, numpy.
"""

import argparse
import json
import pathlib
import subprocess
import sys

from page import PROGRAM, ROOT, machine, put_between
from soak_account import account, bus_load, latency, memory_slope
from soak_flight import fly
from soak_report import latency_svg, memory_svg, real_text, virtual_text
from soak_virtual import fly_virtual

PAGE = ROOT / "src/guide/soak.md"
MARKS = {"real": ("<!-- the real hour, by soak.py -->", "<!-- end of the real hour -->"),
         "virtual": ("<!-- the simulated hours, by soak.py -->", "<!-- end of the simulated hours -->")}  # fmt: skip


def version(binary):
    said = subprocess.run([str(binary), "--version"], capture_output=True, text=True, check=True).stdout.split()
    return f"{said[1]} ({said[3]})"


def judged_real(folder, binary):
    """Returns all that is said of a flight, from the files that it left."""
    found = json.loads((folder / "found.json").read_text())
    summary = json.loads((folder / "run/summary.json").read_text())
    report = json.loads((folder / "report.json").read_text())
    frames, end_s = account(folder), found["seconds"]
    samples = [row for row in found["samples"] if row[0] <= end_s]
    loads, words, outside = [row[5] for row in samples], {}, {}
    for event in [*found["planned_events"], *found["injected"]]:
        words[event["do"]] = words.get(event["do"], 0) + 1
    for _, word, _ in found["outside"]:
        outside[word] = outside.get(word, 0) + 1
    verdicts = [f"{one['name']}: {one['got']}" for one in report.get("verdicts", []) if not one["passed"]] + report.get("violation_lines", [])
    frames["camera"].pop("rows")
    return {
        "begun_utc": found["begun_utc"], "seconds": end_s, "seed": found["seed"], "machine": machine(), "version": version(binary),
        "exit_status": found["exit_status"], "verdicts": verdicts, "frames": frames, "events": summary["event_counts"],
        "memory": memory_slope(samples, end_s), "latency": latency(folder), "bus": bus_load(folder, found["bus"]["files"]),
        "load_average": (min(loads), sum(loads) / len(loads), max(loads)),
        "cpu_share": (samples[-1][4] - samples[0][4]) / (samples[-1][0] - samples[0][0]),
        "recorded_bytes": found["recorder"]["bytes"], "cut": summary["sinks"][1]["counts"].get("frames_cut", 0), "not_wanted": summary["sinks"][1]["counts"].get("frames_not_wanted", 0),
        "monitor": {name: found["monitor"][name] for name in ("asked", "failed", "pictures")},
        "faults": {"planned": len(found["planned_events"]), "injected": len(found["injected"]), "words": words, "outside": outside},
        "worker_errors": found["worker_errors"], "camera_errors": found["camera"]["errors"],
    }  # fmt: skip


def problems(found):
    """Returns what ends the soak with 1."""
    said = []
    if real := found.get("real"):
        said += [f"real: {what}: {len(which)} frames" for what, which in real["frames"]["lost"].items()] if real["frames"]["lost"] else []
        unnamed = len(real["frames"]["camera"]["unnamed"])
        said += [f"real: {unnamed} frames that the network camera counts are named by no event"] if unnamed else []
        said += [f"real: counts differ of {real['frames']['counts_that_differ']}"] if real["frames"]["counts_that_differ"] else []
        said += [f"real: the memory is not flat but {real['memory']['verdict']}"] if real["memory"]["verdict"] != "flat" else []
        said += [f"real: {name} ended: {error}" for name, error in real["worker_errors"].items()]
        said += [] if real["bus"]["seconds"] else ["real: the load of the bus was not measured: bus_*.log says why"]
    if day := found.get("virtual"):
        said += [f"virtual: lost {day['lost']}"] if day["lost"] else []
        said += [f"virtual: counts differ in legs {day['legs_whose_counts_differ']}"] if day["legs_whose_counts_differ"] else []
    return said


def write_guide(found, charts):
    """Writes the parts that were flown between their marks, and the charts beside the page."""
    for name, text in (("real", real_text), ("virtual", virtual_text)):
        if name in found:
            put_between(PAGE, MARKS[name], text(found[name]))
    for name, text in charts.items():
        (PAGE.parent / name).write_text(text)


def arguments():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seconds", type=float, default=3600.0, help="length of the flight on the real clock; 0 for none")
    parser.add_argument("--virtual-hours", type=float, default=0.0, help="simulated hours; 0 for none")
    parser.add_argument("--leg-s", type=float, default=7200.0, help="simulated seconds of a leg")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--out", type=pathlib.Path, default=ROOT / "target/soak")
    parser.add_argument("--kept", action="store_true", help="fly nothing; judge what the last flights left in --out")
    parser.add_argument("--guide", action="store_true", help="write reports and charts into the guide")
    return parser.parse_args()


def main():
    chosen = arguments()
    out, found, charts = chosen.out.absolute(), {}, {}
    real, day = out / "real", out / "virtual"
    if not chosen.kept:
        if chosen.seconds > 0.0:
            fly(PROGRAM, real, chosen.seconds, chosen.seed)
        if chosen.virtual_hours > 0.0:
            fly_virtual(PROGRAM, day, chosen.virtual_hours, chosen.seed, chosen.leg_s)
    if (real / "found.json").exists() and (chosen.kept or chosen.seconds > 0.0):
        found["real"] = judged_real(real, PROGRAM)
        samples = json.loads((real / "found.json").read_text())["samples"]
        charts["soak_memory.svg"] = memory_svg(samples, found["real"]["seconds"])
        charts["soak_latency.svg"] = latency_svg(found["real"]["latency"]["by_minute"], found["real"]["seconds"])
        print(real_text(found["real"]))
    if (day / "virtual.json").exists() and (chosen.kept or chosen.virtual_hours > 0.0):
        found["virtual"] = json.loads((day / "virtual.json").read_text())
        print(virtual_text(found["virtual"]))
    if not found:
        sys.exit(f"{out} has no flight to judge: fly one without --kept, or name its folder with --out")
    (out / "soak.json").write_text(json.dumps(found))
    for name, text in charts.items():
        (out / name).write_text(text)
    if chosen.guide:
        write_guide(found, charts)
    said = problems(found)
    print("\n".join(said) or "no frame is lost without its event, and the memory is flat")
    return 1 if said else 0


if __name__ == "__main__":
    sys.exit(main())
