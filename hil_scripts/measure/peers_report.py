"""Tables and chart of bench_peers.py: from peers_report import markdown, svg."""

import math

from page import Axis, Chart, table
from peers import TOO_SLOW
from peers_loop import LOOPS

COLOURS = ["#d62728", "#7f7f7f", "#1f77b4", "#2ca02c", "#9467bd", "#ff7f0e", "#8c564b", "#17becf"]


OURS = "starloop"
BOUNDS = {loop.name for loop in LOOPS}


def programs(rows):
    return list(dict.fromkeys(row.program for row in rows))


def peer_times(rows, scene):
    """Returns the rows of a scene by program, without the bounds."""
    return {row.program: row for row in rows if row.scene == scene and row.ms is not None and row.program not in BOUNDS}


def levels(rows):
    """Returns the names of starloop at all measured vector levels."""
    return [name for name in programs(rows) if name.startswith(OURS)] or [OURS]


def scenes(rows):
    return list(dict.fromkeys(row.scene for row in rows))


def cell(row, notes):
    """Time and error; in brackets the time that it would take, or a number of a note with the reason."""
    if row.ms is None:
        if row.reason.startswith(TOO_SLOW):
            return f"({row.reason.removeprefix(TOO_SLOW)})"
        if row.reason not in notes:
            notes.append(row.reason)
        return f"({notes.index(row.reason) + 1})"
    return f"{row.ms:.3g}, {row.l1:.0e}"


def contests(rows):
    """Each scene with starloop at each vector level: scene, level, starloop's row or None, and the peers that are faster."""
    for name in scenes(rows):
        of_scene = peer_times(rows, name)
        peers = [row for row in of_scene.values() if not row.program.startswith(OURS)]
        for level in levels(rows):
            ours = of_scene.get(level)
            yield name, level, ours, [row for row in peers if ours and row.ms < ours.ms]


def behind(rows):
    """Scenes in which a peer is faster than starloop at an error that is equal or smaller."""
    found = []
    for name, level, ours, quicker in contests(rows):
        better = [row.program for row in quicker if row.l1 <= ours.l1]
        if not ours or better:
            against = f" than {level}" if level != OURS else ""
            found.append(f"{name} ({', '.join(better)}{against})" if better else f"{name} ({level} did not draw it)")
    return found


def faster(rows):
    """Scenes in which a peer is faster than starloop, at any error."""
    return [f"{name}: {row.program}, {ours.ms / row.ms:.2g} times as fast at L1 {row.l1:.0e}, {level} at {ours.l1:.0e}"
            for name, level, ours, quicker in contests(rows) for row in quicker]  # fmt: skip


def ratios(rows):
    """A table of how many times as long the loops take as starloop at their vector level."""
    by = {(row.scene, row.program): row.ms for row in rows if row.ms is not None}
    lower = next((level for level in levels(rows) if level != OURS), OURS)
    pairs = [("numba", OURS), ("C loop", OURS), ("bound V4", OURS), ("bound V3", lower)]
    lines = []
    for scene in scenes(rows):
        times = [by.get((scene, level)) for level in levels(rows)]
        found = [(by.get((scene, loop)), by.get((scene, ours))) for loop, ours in pairs]
        cells = [f"{other / ours:.2g}" if ours and other else "-" for other, ours in found]
        lines.append([scene, *(f"{ms:.3g}" if ms else "-" for ms in times), *cells])
    return table(["scene", *(f"{level}, ms" for level in levels(rows)), *(f"{loop} / {ours}" for loop, ours in pairs)], lines)


def markdown(rows, facts):
    """The tables, with notes on blank cells, and what they were measured with. Bounds and other vector levels are in the second one."""
    notes, elsewhere = [], {*BOUNDS, *levels(rows)} - {OURS}
    names = [name for name in programs(rows) if name not in elsewhere]
    by = {(row.scene, row.program): row for row in rows}
    lines = [f"Machine: {facts['machine']}. Peers: {facts['peers']}.", f"Threads: {facts['threads']}.", ""]
    lines += table(["scene", *names], [[scene, *(cell(by[scene, name], notes) for name in names)] for scene in scenes(rows)])
    lines += ["", "Median ms, L1. In brackets: too slow to be drawn; about what it would take."]
    lines += [f"({number}) {note}." for number, note in enumerate(notes, 1)]
    lines += ["", f"Motion: {facts['motion']}."]
    at_equal = behind(rows)
    lines += ["", "A peer is faster at an equal or smaller error in: " + ("; ".join(at_equal) if at_equal else "none") + "."]
    lines += ["A peer is faster at any error in: " + ("; ".join(faster(rows)) or "none") + "."]
    lines += ["", "The loops, as ratios of times (above 1: starloop is faster):", "", *ratios(rows)]
    return "\n".join(lines) + "\n"


def svg(rows):
    """Error against time of all programs and scenes, both on logarithmic axes."""
    drawn = [row for row in rows if row.ms is not None]
    times = Axis("milliseconds per image", *decades([row.ms for row in drawn]), is_log=True)
    errors = Axis("error: L1 against f64", *decades([max(row.l1, 1e-9) for row in drawn]), is_log=True)
    chart = Chart("", times, errors, height=520, right=150)
    for number, name in enumerate(programs(rows)):
        points = [(row.ms, max(row.l1, 1e-9), f"{name}, {row.scene}: {row.ms:.3g} ms, L1 {row.l1:.1e}") for row in drawn if row.program == name]
        chart.points(points, COLOURS[number % len(COLOURS)], name, number)
    return chart.text()


def decades(values):
    """Returns the powers of ten around values."""
    low, high = math.floor(math.log10(min(values))), math.ceil(math.log10(max(values)))
    return 10.0**low, 10.0 ** max(high, low + 1)
