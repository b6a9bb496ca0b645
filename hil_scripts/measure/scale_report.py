"""Tables and exponents of scale.py: from scale_report import guide_text, bent_line"""

import math

from page import table as table_of
from soak_account import line_fit

STAGES = ("sky", "plan", "render", "detector")
TITLES = {
    "stars": ("Stars", "stars", "2048 x 2048 px, no motion, full noise"),
    "pixels": ("Pixels", "pixels", "2,000 stars, no motion, full noise"),
    "path": ("Length of the path", "rows", "500 stars on 1024 x 1024 px, random places of 1 px rms that share the exposure"),
    "heads": ("Heads", "heads", "1024 x 1024 px each, a run on the real clock at 5 Hz; all heads of a slot together"),
    "exposure": ("Exposure", "s", "the built-in catalog in Orion on 1024 x 1024 px, a slew of 1 deg/s: 51 px/s"),
}
#: Exponents within so many standard errors of one, and so near to it, count as linear.
SIGMAS, NEAR_LINEAR = 2.0, 0.1
#: Mean square of residuals, in squared logarithms, below which one line is enough: 1 % rms.
STRAIGHT = 1e-4


def slope(points):
    """Returns exponent and standard error of a power law through (x, y); no error with two points."""
    exponent, error, rms = line_fit([(math.log(x), math.log(y)) for x, y in points])
    return exponent, error if len(points) > 2 else None, rms**2 * len(points)


def bent_line(points):
    """Returns the exponents below and above the bend that fits best, each with its error and range; one when a single line does.

    A bend needs three points on either side, which share the point of the bend, and must take most of the residual away.
    """
    points = [(x, y) for x, y in points if x > 0.0 and y > 0.0]
    if len(points) < 2:
        return []
    whole = slope(points)
    best = None
    for bend in range(2, len(points) - 2):
        below, above = points[: bend + 1], points[bend:]
        fits = slope(below), slope(above)
        squares = fits[0][2] + fits[1][2]
        if best is None or squares < best[0]:
            best = squares, [(fits[0][:2], below), (fits[1][:2], above)]
    if best and best[0] < 0.5 * whole[2] and whole[2] > STRAIGHT * len(points):
        return [(*fit, side[0][0], side[-1][0]) for fit, side in best[1]]
    return [(whole[0], whole[1], points[0][0], points[-1][0])]


def spelled(exponents):
    """Exponents as text: 0.02 ± 0.01 up to 1,000; 0.98 ± 0.03 from there."""
    words = []
    for place, (exponent, error, low, high) in enumerate(exponents):
        text = f"{exponent:.2f}" + (f" ± {error:.2f}" if error is not None else "")
        if len(exponents) > 1:
            text += f" up to {high:,.10g}" if place == 0 else f" from {low:,.10g}"
        words.append(text)
    return "; ".join(words)


def is_linear(exponent, error):
    return abs(exponent - 1.0) <= max(NEAR_LINEAR, SIGMAS * (error or 0.0))


def reading(name, rows, exponents):
    """A sentence: where the sum of all stages is linear, and which stage takes most of the time at either end."""
    ends = []
    for x, found in (rows[0], rows[-1]):
        stage = max(STAGES, key=lambda one: found[f"{one}_ms"])
        ends.append(f"{100.0 * found[f'{stage}_ms'] / total(found):.0f} % of the time is {stage} at {x:,.10g}")
    linear = [f"{low:,.10g} to {high:,.10g}" for exponent, error, low, high in exponents if is_linear(exponent, error)]
    where = f"Linear from {' and '.join(linear)}" if linear else "Nowhere linear"
    return f"{where}; {', '.join(ends)}."


def total(found):
    return sum(found[f"{stage}_ms"] for stage in STAGES)


def table(name, part):
    """The table of an axis, its exponents and how to read them."""
    title, word, scene = TITLES[name]
    rows = part["rows"]
    lines = [f"### {title}", "", f"{scene[0].upper()}{scene[1:]}. Medians, ms.", ""]
    cells = [[f"{x:,.10g}", f"{found['stars']:,}", found["method"] or "as planned", *(f"{found[f'{stage}_ms']:.3g}" for stage in STAGES),
              f"{total(found):.3g}"] for x, found in rows]  # fmt: skip
    lines += table_of([word, "stars drawn", "method", *STAGES, "all"], cells)
    series = {stage: bent_line([(x, found[f"{stage}_ms"]) for x, found in rows]) for stage in STAGES}
    series["all"] = bent_line([(x, total(found)) for x, found in rows])
    lines += ["", *table_of(["stage", "exponent"], [[stage, spelled(exponents)] for stage, exponents in series.items() if exponents])]
    return "\n".join([*lines, "", reading(name, rows, series["all"]), ""])


def largest_text(part):
    lines = ["### The largest scene", "", "| stars | pixels | rows of the path | sky + plan + drawing, ms | detector, ms | all, ms | memory of the process, MiB | process, s |",
             "|---|---|---|---|---|---|---|---|"]  # fmt: skip
    for rows, found in part["rows"]:
        drawing = found["sky_ms"] + found["plan_ms"] + found["render_ms"]
        lines.append(f"| {found['stars']:,} | 4096 x 4096 | {rows} | {drawing:.0f} | {found['detector_ms']:.0f} | {total(found):.0f} | "
                     f"{found['memory_bytes'] / 2**20:.0f} | {found['process_s']:.1f} |")  # fmt: skip
    return "\n".join([*lines, "", f"The process reads the stars as CSV, draws {part['rows'][0][1]['repeats']} times or more, and writes FITS.", ""])


def windows_text(part):
    rate_hz, found = part["rows"][0]
    frames, stages = found["frames"], found["stages"]
    events = {word: count for word, count in found["events"].items() if word in ("late", "dropped", "held", "overloaded", "degraded")}
    lines = ["### 500 Hz with windows", ""]
    lines += [f"{found['windows']} windows, {found['pixels']:,} pixels of 1024 x 1024, {rate_hz:g} Hz for {found['seconds']:g} s on the real clock: "
              f"{frames['scheduled']:,} slots, {frames['delivered']:,} frames delivered, {frames['late']} late, {frames['dropped']} dropped; "
              f"events: {', '.join(f'{word} {count}' for word, count in events.items()) or 'none of these'}.", ""]  # fmt: skip
    names = ("wake", "receive", "attitude", "sky", "plan", "render", "detector", "release_to_delivered")
    cells = [[name, *(f"{stages[name][key]:.3f}" for key in ("p50_ms", "p99_ms", "p999_ms", "max_ms"))] for name in names]
    lines += table_of(["stage", "p50 ms", "p99 ms", "p99.9 ms", "max ms"], cells)
    return "\n".join([*lines, ""])


def guide_text(parts):
    """All parts as Markdown."""
    if not parts:
        return ""
    one = next(iter(parts.values()))
    loads = [part["load_before"] for part in parts.values()]
    text = [f"Machine: {one['machine']}; starloop on the CPU, 2 threads. Load average before each part: {min(loads):.1f} to {max(loads):.1f}.", ""]
    text += [table(name, parts[name]) for name in TITLES if name in parts]
    if "largest" in parts:
        text.append(largest_text(parts["largest"]))
    if "windows" in parts:
        text.append(windows_text(parts["windows"]))
    return "\n".join(text)
