"""Tables and chart of bench_peers.py: from peers_report import markdown, svg."""

import html
import math

from peers_loop import CLoop

COLOURS = ["#d62728", "#7f7f7f", "#1f77b4", "#2ca02c", "#9467bd", "#ff7f0e", "#8c564b", "#17becf"]
WIDTH, HEIGHT, LEFT, RIGHT, TOP, BOTTOM = 860, 520, 70, 150, 20, 50


def programs(rows):
    return list(dict.fromkeys(row.program for row in rows))


def peer_times(rows, scene):
    """Returns the rows of a scene by program, without the bound."""
    return {row.program: row for row in rows if row.scene == scene and row.ms is not None and row.program != CLoop.name}


def scenes(rows):
    return list(dict.fromkeys(row.scene for row in rows))


def cell(row, notes):
    """Time and error, or a number of a note with the reason."""
    if row.ms is None:
        if row.reason not in notes:
            notes.append(row.reason)
        return f"({notes.index(row.reason) + 1})"
    return f"{row.ms:.3g} ms, {row.l1:.0e}"


def behind(rows):
    """Scenes in which a peer is faster than starloop at an error that is equal or smaller."""
    found = []
    for name in scenes(rows):
        of_scene = peer_times(rows, name)
        ours = of_scene.get("starloop")
        better = [row.program for row in of_scene.values() if ours and row.ms < ours.ms and row.l1 <= ours.l1]
        if not ours or better:
            found.append(f"{name} ({', '.join(better) or 'starloop did not draw it'})")
    return found


def faster(rows):
    """Scenes in which a peer is faster than starloop, at any error."""
    found = []
    for name in scenes(rows):
        of_scene = peer_times(rows, name)
        ours = of_scene.get("starloop")
        found += [f"{name}: {row.program}, {ours.ms / row.ms:.2g} times as fast at L1 {row.l1:.0e}, starloop at {ours.l1:.0e}"
                  for row in of_scene.values() if ours and row.ms < ours.ms]  # fmt: skip
    return found


def ratios(rows):
    """A table of how many times as long the compiled loops take."""
    loops = ("numba", CLoop.name)
    lines = ["| scene | starloop, ms | " + " | ".join(f"{name} / starloop" for name in loops) + " |", "|---" * 4 + "|"]
    by = {(row.scene, row.program): row.ms for row in rows if row.ms is not None}
    for scene in scenes(rows):
        ours = by.get((scene, "starloop"))
        others = [by.get((scene, name)) for name in loops]
        cells = [f"{other / ours:.2g}" if ours and other else "-" for other in others]
        lines.append(f"| {scene} | " + " | ".join([f"{ours:.3g}" if ours else "-", *cells]) + " |")
    return lines


def markdown(rows, facts):
    """The tables, with notes on blank cells, and what they were measured with."""
    notes, names = [], programs(rows)
    by = {(row.scene, row.program): row for row in rows}
    lines = [f"Machine: {facts['machine']}. Peers: {facts['peers']}.", f"Threads: {facts['threads']}.", ""]
    lines += ["| scene | " + " | ".join(names) + " |", "|---" * (len(names) + 1) + "|"]
    lines += [f"| {scene} | " + " | ".join(cell(by[scene, name], notes) for name in names) + " |" for scene in scenes(rows)]
    lines += [""] + [f"({number}) {note}." for number, note in enumerate(notes, 1)]
    lines += ["", f"Motion: {facts['motion']}."]
    at_equal = behind(rows)
    lines += ["", "A peer is faster at an equal or smaller error in: " + ("; ".join(at_equal) if at_equal else "none") + "."]
    lines += ["A peer is faster at any error in: " + ("; ".join(faster(rows)) or "none") + "."]
    lines += ["", "The compiled loops, as ratios of times (above 1: starloop is faster):", "", *ratios(rows)]
    return "\n".join(lines) + "\n"


def svg(rows):
    """Error against time of all programs and scenes, both on logarithmic axes."""
    drawn = [row for row in rows if row.ms is not None]
    names = programs(rows)
    x_from, x_to = decades([row.ms for row in drawn])
    y_from, y_to = decades([max(row.l1, 1e-9) for row in drawn])

    def x(ms):
        return LEFT + (math.log10(ms) - x_from) / (x_to - x_from) * (WIDTH - LEFT - RIGHT)

    def y(l1):
        return HEIGHT - BOTTOM - (math.log10(max(l1, 1e-9)) - y_from) / (y_to - y_from) * (HEIGHT - TOP - BOTTOM)

    out = [f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {WIDTH} {HEIGHT}" font-family="sans-serif" font-size="12">']
    out.append(f'<rect width="{WIDTH}" height="{HEIGHT}" fill="white"/>')
    for power in range(x_from, x_to + 1):
        at = x(10.0**power)
        out.append(f'<path d="M{at:.1f} {TOP}V{HEIGHT - BOTTOM}" stroke="#ddd"/>')
        out.append(f'<text x="{at:.1f}" y="{HEIGHT - BOTTOM + 16}" text-anchor="middle">{10.0**power:g}</text>')
    for power in range(y_from, y_to + 1):
        at = y(10.0**power)
        out.append(f'<path d="M{LEFT} {at:.1f}H{WIDTH - RIGHT}" stroke="#ddd"/>')
        out.append(f'<text x="{LEFT - 6}" y="{at + 4:.1f}" text-anchor="end">1e{power}</text>')
    out.append(f'<text x="{(LEFT + WIDTH - RIGHT) / 2}" y="{HEIGHT - 12}" text-anchor="middle">milliseconds per image</text>')
    out.append(f'<text transform="translate(16 {HEIGHT / 2}) rotate(-90)" text-anchor="middle">error: L1 against f64</text>')
    for number, name in enumerate(names):
        colour = COLOURS[number % len(COLOURS)]
        out.append(f'<circle cx="{WIDTH - RIGHT + 20}" cy="{TOP + 12 + 20 * number}" r="5" fill="{colour}"/>')
        out.append(f'<text x="{WIDTH - RIGHT + 32}" y="{TOP + 16 + 20 * number}">{html.escape(name)}</text>')
        for row in (row for row in drawn if row.program == name):
            title = html.escape(f"{row.program}, {row.scene}: {row.ms:.3g} ms, L1 {row.l1:.1e}")
            out.append(f'<circle cx="{x(row.ms):.1f}" cy="{y(row.l1):.1f}" r="5" fill="{colour}" fill-opacity="0.7">')
            out.append(f"<title>{title}</title></circle>")
    return "\n".join([*out, "</svg>"]) + "\n"


def decades(values):
    low, high = math.floor(math.log10(min(values))), math.ceil(math.log10(max(values)))
    return low, max(high, low + 1)
