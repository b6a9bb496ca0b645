"""The report about a campaign as one HTML file that needs no other; charts are inline SVG, drawn here."""

from __future__ import annotations

from html import escape
from typing import Any

from .campaign_report import COLOURS, MOST_CURVES, TAIL, complaint

STYLE = (
    "body{font:15px/1.45 Helvetica,Arial,'DejaVu Sans',sans-serif;color:#222;background:#fff;max-width:72em;margin:1.5em auto;"
    "padding:0 1em}h1{font-size:1.25em;padding:.6em .8em;border-radius:4px;color:#fff}.met{background:#00694e}"
    ".not_shown{background:#7a5a00}.broken{background:#a83a00}h2{font-size:1.1em;margin:1.8em 0 .4em;border-bottom:1px solid #ccc}"
    "table{border-collapse:collapse;font-size:.86em;margin:.4em 0}th,td{text-align:left;padding:.22em .7em;"
    "border-bottom:1px solid #e3e3e3;vertical-align:top}td.n{text-align:right;font-variant-numeric:tabular-nums;"
    "white-space:nowrap}th{background:#f3f3f3}tr.bad td{background:#fff1ea}code{font-size:.92em;word-break:break-all}"
    "svg{max-width:100%;height:auto;margin:.6em .6em .6em 0}p.small{color:#555;font-size:.86em}"
    "@media print{@page{margin:14mm}body{max-width:none;margin:0;padding:0;font-size:11px}table{width:100%}"
    "th,td{padding:.15em .4em;overflow-wrap:break-word}thead{display:table-header-group}"
    "tr,svg{break-inside:avoid}h1{print-color-adjust:exact;-webkit-print-color-adjust:exact}h2{break-after:avoid}}"
)
WIDTH, HEIGHT, LEFT, RIGHT, TOP, BOTTOM = 430, 230, 44, 14, 24, 34
CLASSES = {"passed": "met", "not_shown": "not_shown", "failed": "broken"}
"""Colour of the verdict."""


def html_of(report: dict[str, Any]) -> str:
    """The page: verdict, requirements, distributions, worst runs, provenance."""
    verdict = escape(report["verdict"])
    parts = [
        f'<!DOCTYPE html>\n<html lang="en"><head><meta charset="utf-8"><title>{verdict}</title>\n<style>{STYLE}</style></head>',
        f'<body><h1 class="{CLASSES[report["outcome"]]}">{verdict}</h1>',
        f"<p>Intervals have a confidence of {100 * report['confidence']:g} %: means by Student's t, quantiles by order "
        "statistics, shares by Clopper and Pearson. A run without a report, or without the number that a requirement is "
        f"about, does not meet it. {report['runs']} runs, {report['without_report']} without report.</p>",
        requirements(report),
        held(report),
        distributions(report),
        *(f"<h2>By {escape(key)}</h2>{split(report, key)}" for key in report["held_by_value"]),
        "<h2>Charts</h2><p class='small'>Share of the runs up to a value.</p>",
        *(chart(metric) for metric in report["metrics"] if metric["least"] < metric["most"]),
        worst(report),
        provenance(report["provenance"]),
        "</body></html>\n",
    ]
    return "\n".join(parts)


def figure(value: float | None) -> str:
    """A number of a table."""
    if value is None:
        return "unbounded"
    return f"{value:.0f}" if value == int(value) and abs(value) < 1e9 else f"{value:.5g}"


def table(heads: list[str], rows: list[list[str]], bad: list[bool] | None = None) -> str:
    """A table; a cell may bring its own td."""
    head = "".join(f"<th>{escape(text)}</th>" for text in heads)
    lines = []
    for at, row in enumerate(rows):
        cells = "".join(cell if cell.startswith("<td") else f"<td>{cell}</td>" for cell in row)
        mark = ' class="bad"' if bad and bad[at] else ""
        lines.append(f"<tr{mark}>{cells}</tr>")
    return f"<table><thead><tr>{head}</tr></thead><tbody>\n" + "\n".join(lines) + "\n</tbody></table>"


def right(text: str) -> str:
    """A cell of numbers."""
    return f'<td class="n">{escape(text)}</td>'


def estimate(of: dict[str, Any]) -> str:
    """A value and its interval."""
    return right(f"{figure(of['value'])} ({figure(of['low'])} .. {figure(of['high'])})")


def percent(share: dict[str, Any]) -> str:
    """A share and its interval."""
    if share["value"] is None:
        return right("no run")
    return right(f"{100 * share['value']:.2f} % ({100 * share['low']:.2f} .. {100 * share['high']:.2f} %)")


def requirements(report: dict[str, Any]) -> str:
    """The section of the requirements."""
    rows, bad = [], []
    for judgement in report["requirements"]:
        where = ", ".join(f"{key} = {value}" for key, value in judgement["where"].items())
        text = escape(judgement["text"]) + (f" ({escape(where)})" if where else "")
        rows.append([escape(judgement["id"]), text, judgement["verdict"], percent(judgement["share"]), escape(complaint(judgement))])
        bad.append(judgement["verdict"] != "met")
    return "<h2>Requirements</h2>" + table(["identifier", "requirement", "verdict", "share of runs", "measured"], rows, bad)


def held(report: dict[str, Any]) -> str:
    """The section of the runs that held, by value of the grid."""
    rows = [["all", right(str(report["runs"])), percent(report["held"])]]
    for key, values in report["held_by_value"].items():
        rows += [[escape(f"{key} = {value}"), right(str(share["count"])), percent(share)] for value, share in values.items()]
    return "<h2>Runs that held</h2>" + table(["runs", "number", "share that held"], rows)


def cells(of: dict[str, Any]) -> list[str]:
    """The numbers of a distribution."""
    deviation = right("" if of["deviation"] is None else figure(of["deviation"]))
    extremes = [right(figure(of["least"])), right(figure(of["most"]))]
    return [right(str(of["count"])), estimate(of["mean"]), deviation, estimate(of["median"]), estimate(of["p95"]), *extremes]


NUMBERS = ["runs", "mean", "deviation", "median", f"{100 * TAIL:g} % quantile", "least", "most"]


def distributions(report: dict[str, Any]) -> str:
    """The section of each metric over all runs."""
    rows = [[escape(metric["id"]), *cells(metric)] for metric in report["metrics"]]
    return "<h2>Metrics over all runs</h2>" + table(["metric", *NUMBERS], rows)


def split(report: dict[str, Any], key: str) -> str:
    """Metrics by value of the grid; those that are the same in all runs are left out."""
    rows = []
    for metric in report["metrics"]:
        if metric["least"] == metric["most"]:
            continue
        for value, of in metric["by_value"][key].items():
            rows.append([escape(metric["id"]), escape(value), *(cells(of) if of else [right("0")])])
    return table(["metric", key, *NUMBERS], rows) if rows else "<p>All metrics are the same in all runs.</p>"


def worst(report: dict[str, Any]) -> str:
    """The worst runs with the commands that repeat them."""

    def run(of: dict[str, Any], first: str) -> list[str]:
        settings = ", ".join(f"{key} = {value}" for key, value in of["settings"].items())
        value = right("none" if of["value"] is None else figure(of["value"]))
        return [escape(first), right(str(of["seed"])), escape(settings), value, f"<code>{escape(of['command'])}</code>"]

    heads = ["seed", "settings", "value", "command that repeats it"]
    rows = [run(of, judgement["id"]) for judgement in report["requirements"] for of in judgement["worst"]]
    text = "<h2>Worst runs of each requirement</h2>" + table(["requirement", *heads], rows)
    changing = [metric for metric in report["metrics"] if metric["least"] < metric["most"]]
    text += "<h2>Worst run of each metric</h2>" + table(["metric", *heads], [run(m["worst"], m["id"]) for m in changing])
    failed = [run(of, of["error"] or "did not hold") for of in report["not_held"]]
    text += f"<h2>Runs that did not hold: {report['not_held_count']}</h2>"
    return text + (table(["why", *heads], failed) if failed else "<p>None.</p>")


def provenance(of: dict[str, Any]) -> str:
    """The section that says what flew where."""
    program = of["program"]
    rows = [
        ["command line", f"<code>{escape(' '.join(of['command_line']))}</code>"],
        ["program", f"<code>{escape(program['path'])}</code> {escape(program['version'])}, SHA-256 {program['sha256']}"],
        ["host", escape(f"{of['host']} ({of['machine']}), Python {of['python']}")],
        ["seeds", f"{of['seeds'][0]} to {of['seeds'][1]}"],
        *([f"<code>{escape(file['path'])}</code>", f"<code>{file['sha256']}</code>"] for file in of["files"]),
    ]
    return "<h2>Provenance</h2>" + table(["what", "value"], rows)


def chart(metric: dict[str, Any]) -> str:
    """The distribution's curve of one metric, one for each value of the first key of the grid."""
    low, high = metric["least"], metric["most"]
    across, down = WIDTH - LEFT - RIGHT, HEIGHT - TOP - BOTTOM

    def place(point: list[float]) -> str:
        return f"{LEFT + across * (point[0] - low) / (high - low):.1f},{TOP + down * (1.0 - point[1]):.1f}"

    shown = list(metric["curves"].items())[:MOST_CURVES]
    lines = []
    for at, (name, points) in enumerate(shown):
        path = " ".join(place(point) for point in [[points[0][0], 0.0], *points])
        colour = COLOURS[at]
        lines.append(f'<polyline points="{path}" fill="none" stroke="{colour}" stroke-width="1.6"/>')
        lines.append(f'<text x="{WIDTH - RIGHT - 4}" y="{TOP + down - 8 - 13 * at}" fill="{colour}" text-anchor="end">{escape(name)}</text>')
    grid = "".join(
        f'<line x1="{LEFT}" x2="{WIDTH - RIGHT}" y1="{TOP + down * (1 - share):.1f}" y2="{TOP + down * (1 - share):.1f}" stroke="#ddd"/>'
        f'<text x="{LEFT - 6}" y="{TOP + down * (1 - share) + 4:.1f}" text-anchor="end">{share:g}</text>'
        for share in (0.0, 0.25, 0.5, 0.75, 1.0)
    )
    ends = f'<text x="{LEFT}" y="{HEIGHT - 14}">{figure(low)}</text>'
    ends += f'<text x="{WIDTH - RIGHT}" y="{HEIGHT - 14}" text-anchor="end">{figure(high)}</text>'
    name = f'<text x="{LEFT}" y="15" font-weight="bold">{escape(metric["id"])}</text>'
    size = f'width="{WIDTH}" height="{HEIGHT}" viewBox="0 0 {WIDTH} {HEIGHT}"'
    font = 'font-family="Helvetica,Arial,sans-serif" font-size="11"'
    return f'<svg xmlns="http://www.w3.org/2000/svg" {size} {font}>{grid}{name}{ends}{"".join(lines)}</svg>'
