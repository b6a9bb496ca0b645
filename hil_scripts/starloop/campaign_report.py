"""One report about all runs of a campaign: rows of campaign.py -> HTML, JSON and JUnit.

Every number of a run is a metric; over the runs it has a distribution: mean (Student's t), median and 95 % quantile (order
statistics), spread and extremes, each with its interval of confidence, for all runs and by value of the grid. A requirement
is a limit for each run; the share of the runs that meet it has the interval of Clopper and Pearson. A run without a report,
or without that number, meets nothing. `campaign.py --report` writes it; needs hil_scripts/requirements_campaign.txt.

Requirements (TOML), `id`, `text`, `metric` and `most` or `least` as for trackers (guide: reports.md), and

    share = 0.95                        # least share of the runs that must meet the limit; without it: every run
    where = { "control.delay_ms" = 100 }   # only runs with these values of the grid
    by = "value"                        # compare the share itself, not the end of its interval
"""
# mypy: ignore-errors

from __future__ import annotations

import hashlib
import html
import json
import math
import platform
import subprocess
import sys
import tomllib
from dataclasses import dataclass, field
from pathlib import Path

from scipy import stats

SCHEMA = "starloop.campaign_report/1"
MOST_HTML_BYTES = 2_000_000
WORST = 10
"""Runs that are listed for each requirement, and of those that did not hold."""
CURVE_POINTS = 120
"""Points of a distribution's curve: a campaign of thousands of runs stays a small page."""
MOST_CURVES = 8
TAIL = 0.95
LOW_IS_WORSE = ("tracker_availability", "least_sun_angle_deg", "attitudes_used", "speed")
"""Metrics whose worst run is the one with the least; of all others it is the one with the most."""
NOT_METRICS = ("seed", "exit_status", "wall_s", "task_wall_s", "speed")
"""Columns that identify a run, or say how busy the machine was."""
COLOURS = ("#0072b2", "#d55e00", "#009e73", "#cc79a7", "#e69f00", "#56b4e9", "#000000", "#999999")


class RequirementError(ValueError):
    """A file of requirements that says something else than it can mean."""


@dataclass(frozen=True)
class Requirement:
    """A limit for every run."""

    id: str
    metric: str
    text: str = ""
    most: float | None = None
    least: float | None = None
    share: float | None = None
    where: dict = field(default_factory=dict)
    by: str = "interval"

    @property
    def limit(self) -> str:
        """The limit in words."""
        return f"at most {self.most:g}" if self.most is not None else f"at least {self.least:g}"

    def is_met_by(self, value: float | None) -> bool:
        """Whether one run meets it; of `most` the magnitude is compared."""
        if value is None or not math.isfinite(value):
            return False
        return abs(value) <= self.most if self.most is not None else value >= self.least


HOLDS = Requirement("CAMPAIGN-1", "passed", "Every run holds: its expectations and invariants", least=1.0)


def read_requirements(path: Path | None) -> list[Requirement]:
    """The requirements of a file; without one, that every run holds."""
    if path is None:
        return [HOLDS]
    try:
        given = tomllib.loads(path.read_text())
    except tomllib.TOMLDecodeError as wrong:
        raise RequirementError(f"{path}: {wrong}") from wrong
    unknown = set(given) - {"requirement"}
    if unknown or not given.get("requirement"):
        raise RequirementError(f"{path}: got {sorted(unknown) or 'no requirement'}, wanted [[requirement]] tables")
    found = [requirement_of(path, entry) for entry in given["requirement"]]
    names = [requirement.id for requirement in found]
    twice = sorted({name for name in names if names.count(name) > 1})
    if twice:
        raise RequirementError(f"{path}: requirement {twice} is there twice; wanted identifiers that differ")
    return found


def requirement_of(path: Path, entry: dict) -> Requirement:
    """A requirement of an entry of the file; refuses unknown and missing keys."""
    known = Requirement.__dataclass_fields__
    place = f'{path}: requirement "{entry.get("id", "")}"'
    unknown = sorted(set(entry) - set(known))
    if unknown or not entry.get("id") or not entry.get("metric"):
        raise RequirementError(f"{place}: got {unknown or sorted(entry)}, wanted id, metric and {', '.join(known)}")
    if ("most" in entry) == ("least" in entry):
        raise RequirementError(f"{place}: wanted most or least, one of them")
    numbers = [entry[name] for name in ("most", "least", "share") if name in entry]
    if not all(isinstance(number, (int, float)) and math.isfinite(number) for number in numbers):
        raise RequirementError(f"{place}: got {numbers}, wanted finite numbers")
    if not 0.0 < entry.get("share", 1.0) <= 1.0:
        raise RequirementError(f"{place}: got the share {entry['share']}, wanted above 0, up to 1")
    if entry.get("by", "interval") not in ("interval", "value"):
        raise RequirementError(f'{place}: got by = "{entry["by"]}", wanted "interval" or "value"')
    return Requirement(**entry)


# --- statistics ------------------------------------------------------------------------------------------------------


def share_of(right: int, count: int, confidence: float) -> dict:
    """A share with the interval of Clopper and Pearson."""
    beyond = 0.5 * (1.0 - confidence)
    low = float(stats.beta.ppf(beyond, right, count - right + 1)) if right else 0.0
    high = float(stats.beta.ppf(1.0 - beyond, right + 1, count - right)) if right < count else 1.0
    return {"value": right / count if count else None, "low": low, "high": high, "count": count}


def mean_of(values: list[float], confidence: float) -> dict:
    """The mean with the interval of Student's t; no interval of a single run."""
    count = len(values)
    mean = math.fsum(values) / count
    if count < 2:
        return {"value": mean, "low": None, "high": None}
    deviation = math.sqrt(math.fsum((value - mean) ** 2 for value in values) / (count - 1))
    half = float(stats.t.ppf(0.5 * (1.0 + confidence), count - 1)) * deviation / math.sqrt(count)
    return {"value": mean, "low": mean - half, "high": mean + half}


def quantile_of(ordered: list[float], share: float, confidence: float) -> dict:
    """A quantile between neighbours by straight line, and the two values of the order that enclose it with this
    confidence; an end that so few runs do not bound is None."""
    count, place = len(ordered), share * (len(ordered) - 1)
    below = int(place)
    above = min(below + 1, count - 1)
    value = ordered[below] + (ordered[above] - ordered[below]) * (place - below)
    beyond = 0.5 * (1.0 - confidence)
    # The number of values below the quantile is binomial: P(X < low) <= beyond, P(X >= high) <= beyond.
    low = int(stats.binom.ppf(beyond, count, share))
    high = int(stats.binom.isf(beyond, count, share)) + 1
    return {
        "value": value,
        "low": ordered[low - 1] if low >= 1 else None,
        "high": ordered[high - 1] if high <= count else None,
    }


def distribution(values: list[float], confidence: float) -> dict:
    """All that is said of one metric over some runs."""
    ordered = sorted(values)
    mean = mean_of(ordered, confidence)
    squares = math.fsum((value - mean["value"]) ** 2 for value in ordered)
    return {
        "count": len(ordered),
        "mean": mean,
        "median": quantile_of(ordered, 0.5, confidence),
        "p95": quantile_of(ordered, TAIL, confidence),
        "deviation": math.sqrt(squares / (len(ordered) - 1)) if len(ordered) > 1 else None,
        "least": ordered[0],
        "most": ordered[-1],
    }


def curve(values: list[float]) -> list[list[float]]:
    """Points of the distribution's curve: value, share of the runs up to it."""
    ordered, count = sorted(values), len(values)
    places = range(count) if count <= CURVE_POINTS else (i * (count - 1) // (CURVE_POINTS - 1) for i in range(CURVE_POINTS))
    return [[ordered[place], (place + 1) / count] for place in places]


# --- runs ------------------------------------------------------------------------------------------------------------


def value_of(row: dict, metric: str) -> float | None:
    """The number of a run; true and false are 1 and 0."""
    value = row.get(metric)
    if isinstance(value, bool):
        return float(value) if row["has_report"] else None
    return float(value) if isinstance(value, (int, float)) and math.isfinite(value) else None


def metrics_of(rows: list[dict]) -> list[str]:
    """Columns that are numbers of runs, in the order of the rows."""
    names = dict.fromkeys(name for row in rows for name in row)
    wanted = [name for name in names if name not in NOT_METRICS and not name.startswith("param.")]
    flags = ("has_report", "random_faults")
    return [name for name in wanted if name not in flags and any(value_of(row, name) is not None for row in rows)]


def values_of(rows: list[dict], metric: str) -> list[float]:
    """The values of a metric in the rows that have one."""
    return [value for row in rows if (value := value_of(row, metric)) is not None]


def by_value(rows: list[dict], grid: dict[str, list[str]], number) -> dict[str, dict[str, list[dict]]]:
    """Rows by key and value of the grid."""
    return {key: {value: [r for r in rows if r[f"param.{key}"] == number(value)] for value in grid[key]} for key in grid}


def short(row: dict, metric: str) -> dict:
    """A run in a list of runs."""
    settings = {key[len("param.") :]: value for key, value in row.items() if key.startswith("param.") and value is not None}
    return {"seed": row["seed"], "settings": settings, "value": value_of(row, metric), "command": row["command"]}


def worst_of(rows: list[dict], metric: str, low_is_worse: bool) -> list[dict]:
    """The worst runs of a metric, worst first; those without the number come before all others."""
    rank = {True: lambda value: value, False: lambda value: -abs(value)}[low_is_worse]

    def place(row: dict) -> tuple:
        value = value_of(row, metric)
        return (value is not None, rank(value) if value is not None else 0.0, row["task"])

    return [short(row, metric) for row in sorted(rows, key=place)[:WORST]]


def judged(requirement: Requirement, rows: list[dict], number, confidence: float) -> dict:
    """A requirement with its verdict."""
    wanted = {f"param.{key}": number(str(value)) for key, value in requirement.where.items()}
    some = [row for row in rows if all(row.get(key) == value for key, value in wanted.items())]
    measured = values_of(some, requirement.metric)
    met = [row for row in some if requirement.is_met_by(value_of(row, requirement.metric))]
    share = share_of(len(met), len(some), confidence)
    if not some or not measured:
        verdict = "not measured"
    elif requirement.share is None or requirement.by == "value":
        verdict = "met" if share["value"] >= (requirement.share or 1.0) else "NOT MET"
    else:
        least = requirement.share
        verdict = "met" if share["low"] >= least else "NOT MET" if share["high"] < least else "not shown"
    return {
        "id": requirement.id,
        "text": requirement.text,
        "metric": requirement.metric,
        "limit": requirement.limit,
        "share_wanted": requirement.share or 1.0,
        "where": requirement.where,
        "verdict": verdict,
        "by": requirement.by,
        "share": share,
        "runs": len(some),
        "without_number": len(some) - len(measured),
        "worst": worst_of(some, requirement.metric, requirement.least is not None),
    }


def provenance_of(out: Path, binary: Path, requirements: Path | None, rows: list[dict]) -> dict:
    """Where all of it comes from."""
    about = json.loads((out / "campaign.json").read_text())
    version = subprocess.run([str(binary), "--version"], capture_output=True, text=True, stdin=subprocess.DEVNULL)
    files = dict(about["scenario"])
    for path in [out / "results.parquet", *([requirements] if requirements else [])]:
        files[str(path)] = hashlib.sha256(path.read_bytes()).hexdigest()
    return {
        "command_line": sys.argv,
        "program": {"path": str(binary), "version": version.stdout.strip(), "sha256": about["program"]},
        "host": platform.node(),
        "machine": platform.machine(),
        "python": platform.python_version(),
        "seeds": [min(row["seed"] for row in rows), max(row["seed"] for row in rows)],
        "files": [{"path": path, "sha256": digest} for path, digest in sorted(files.items())],
    }


def report_of(
    rows: list[dict],
    grid: dict[str, list[str]],
    requirements: list[Requirement],
    about: dict,
    number,
    confidence: float = 0.95,
) -> dict:
    """The report; `about` has title, planned (tasks) and provenance."""
    judgements = [judged(requirement, rows, number, confidence) for requirement in requirements]
    parts = by_value(rows, grid, number)

    def spread(some: list[dict], name: str) -> dict | None:
        values = values_of(some, name)
        return distribution(values, confidence) if values else None

    # One curve for each value of the first key of the grid.
    curved = next(({f"{key} = {value}": r for value, r in parts[key].items()} for key in parts), {"all runs": rows})
    metrics = []
    for name in metrics_of(rows):
        curves = {label: curve(found) for label, some in curved.items() if (found := values_of(some, name))}
        split = {key: {value: spread(some, name) for value, some in values.items()} for key, values in parts.items()}
        worst = worst_of([row for row in rows if value_of(row, name) is not None], name, name in LOW_IS_WORSE)[0]
        metrics.append({"id": name, **spread(rows, name), "by_value": split, "worst": worst, "curves": curves})
    not_held = [{**short(row, "passed"), "error": row["error"]} for row in rows if not row["passed"]]
    is_met = all(judgement["verdict"] == "met" for judgement in judgements)
    met = sum(judgement["verdict"] == "met" for judgement in judgements)
    whole = len(rows) == about["planned"]
    is_broken = any(judgement["verdict"] == "NOT MET" for judgement in judgements)
    outcome = "failed" if is_broken else "passed" if is_met and whole else "not_shown"
    word = outcome.upper().replace("_", " ")
    verdict = f"{word}: {about['title']}, {met} of {len(judgements)} requirements met by {len(rows)} runs"
    compared = sum(requirement.by == "value" for requirement in requirements)
    if compared:
        verdict += f", {compared} compared by value, not by interval"
    return {
        "schema": SCHEMA,
        "title": about["title"],
        "verdict": verdict if whole else f"{verdict} of {about['planned']} planned",
        "outcome": outcome,
        "is_met": is_met and whole,
        "confidence": confidence,
        "runs": len(rows),
        "planned": about["planned"],
        "without_report": sum(not row["has_report"] for row in rows),
        "held": share_of(sum(row["passed"] for row in rows), len(rows), confidence),
        "held_by_value": {
            key: {v: share_of(sum(r["passed"] for r in some), len(some), confidence) for v, some in values.items()}
            for key, values in parts.items()
        },
        "requirements": judgements,
        "metrics": metrics,
        "not_held": not_held[:WORST],
        "not_held_count": len(not_held),
        "provenance": about["provenance"],
    }


# --- documents -------------------------------------------------------------------------------------------------------


def junit_of(report: dict) -> str:
    """JUnit: a test case for each requirement."""
    judgements = report["requirements"]
    failures = sum(judgement["verdict"] == "NOT MET" for judgement in judgements)
    errors = sum(judgement["verdict"] not in ("met", "NOT MET") for judgement in judgements)
    quoted = lambda text: html.escape(str(text), quote=True)  # noqa: E731
    lines = ['<?xml version="1.0" encoding="UTF-8"?>', "<testsuites>"]
    lines.append(
        f'<testsuite name="{quoted(report["title"])}" tests="{len(judgements)}" failures="{failures}" errors="{errors}" skipped="0">'
    )
    for judgement in judgements:
        name = quoted(f"{judgement['id']} {judgement['text']}".strip())
        head = f'<testcase classname="campaign" name="{name}"'
        if judgement["verdict"] == "met":
            lines.append(f"{head}/>")
        else:
            message = quoted(complaint(judgement))
            element = "failure" if judgement["verdict"] == "NOT MET" else "error"
            lines.append(f'{head}><{element} type="{quoted(judgement["verdict"])}" message="{message}"/></testcase>')
    return "\n".join([*lines, "</testsuite>", "</testsuites>", ""])


def complaint(judgement: dict) -> str:
    """Compares the wanted share with that of the runs, in words."""
    share, runs = judgement["share"], judgement["runs"]
    wanted = f"{judgement['metric']} {judgement['limit']} in {100 * judgement['share_wanted']:g} % of the runs"
    if share["value"] is None:
        return f"{wanted}; got no run"
    got = f"{100 * share['value']:.2f} % ({100 * share['low']:.2f} to {100 * share['high']:.2f} %) of {runs}"
    missing = judgement["without_number"]
    rule = "; the share is compared by value" if judgement["by"] == "value" else ""
    return f"{wanted}; got {got}" + (f", {missing} without this number" if missing else "") + rule
