"""Compares two reports of one test plan, metric by metric: compare_reports.py A/report.json B/report.json [--cases]

Two intervals of 95 % do not make 95 % of all metrics agree: of N equal metrics about N/20 lie outside by chance. Each
difference has a p-value from both intervals; Holm's procedure (Scandinavian J. Statistics 6 (1979), 65) finds those that
differ with a family-wise chance of a false alarm of 5 %, whatever the dependence between metrics. The number of metrics
that lie outside one by one is printed beside the number expected. Counts are compared as counts of rare events from equally
many frames: given their sum, one of them is binomial. Other metrics without an interval are listed where they differ.
--cases: metrics of single cases too. Exit status 4: something differs. Standard library only.
"""
# mypy: ignore-errors

import argparse
import json
import math
import sys
from dataclasses import dataclass, field
from pathlib import Path
from statistics import NormalDist

FAMILY_WISE = 0.05
COUNTS = ("false_solutions", "losses")
"""Numbers of rare events."""
COPIES = ("noise_equivalent_angle", "acquisition_confidence")
"""Functions of another metric: they would be counted twice."""
STEPPED = ("exclusion_angle",)
"""Their interval is a step of a sweep: they agree where the steps overlap."""


@dataclass
class Comparison:
    """Two reports beside one another."""

    rows: list = field(default_factory=list)
    """Identifier, case, first metric, second metric, p-value."""
    outside: int = 0
    """Metrics that differ by more than both intervals, taken one by one."""
    different: set = field(default_factory=set)
    """Identifiers and cases that differ, by Holm's procedure over all rows."""
    exact: set = field(default_factory=set)
    """Metrics without an interval that differ."""
    missing: set = field(default_factory=set)
    """Those that only one of the reports has."""

    alone: float = 0.05
    """Chance that one metric lies outside."""

    @property
    def expected(self):
        """Metrics that lie outside by chance."""
        return len(self.rows) * self.alone

    @property
    def chance(self):
        """Chance of so many outside, if metrics were independent."""
        n, k, p = len(self.rows), self.outside, self.alone
        return sum(math.comb(n, i) * p**i * (1 - p) ** (n - i) for i in range(k, n + 1))


def half(metric, towards):
    """Half of an interval on the side of another value; `None`: unbounded there."""
    if towards >= metric["value"]:
        return None if metric["high"] is None else metric["high"] - metric["value"]
    return metric["value"] - metric["low"]


def p_value(a, b, confidence):
    """The chance of a difference as large between two estimates of one quantity; `None` without an interval."""
    halves = half(a, b["value"]), half(b, a["value"])
    if None in halves:
        return 1.0
    size, apart = math.hypot(*halves), abs(a["value"] - b["value"])
    if size <= 1e-12 * max(abs(a["value"]), abs(b["value"]), 1e-12):
        return None
    factor = NormalDist().inv_cdf(0.5 * (1 + confidence))
    return 2 * (1 - NormalDist().cdf(factor * apart / size))


def count_p_value(one, other):
    """The chance of two counts as far apart, from equally many frames with one and the same rate."""
    least, total = int(min(one, other)), int(one + other)
    tail = sum(math.comb(total, i) for i in range(least + 1)) / 2**total
    return min(1.0, 2 * tail)


def overlap(a, b):
    """True where two steps of a sweep, open at their lower ends, have an angle in common."""
    high = [math.inf if m["high"] is None else m["high"] for m in (a, b)]
    return max(a["low"], b["low"]) < min(high)


def compare(one, other, with_cases=False):
    """Compares two reports, read from JSON."""
    confidence = one["settings"]["confidence"]
    keyed = [
        {(m["id"], m["case"]): m for m in report["metrics"] if with_cases or m["case"] is None} for report in (one, other)
    ]
    found = Comparison(alone=1 - confidence)
    found.missing = set(keyed[0]) ^ set(keyed[1])
    for key, a in keyed[0].items():
        b = keyed[1].get(key)
        if b is None or key[0].split(".")[0] in COPIES:
            continue
        if key[0].endswith(STEPPED):
            if not overlap(a, b):
                found.exact.add(key)
            continue
        p = count_p_value(a["value"], b["value"]) if key[0] in COUNTS else p_value(a, b, confidence)
        if p is None:
            if not math.isclose(a["value"], b["value"], rel_tol=1e-9, abs_tol=1e-12):
                found.exact.add(key)
            continue
        found.rows.append((*key, a, b, p))
        found.outside += p < found.alone
    ordered = sorted(found.rows, key=lambda row: row[4])
    for place, row in enumerate(ordered):
        if row[4] >= FAMILY_WISE / (len(ordered) - place):
            break
        found.different.add(row[:2])
    return found


def said(m):
    """A metric with its interval, in words."""
    high = "unbounded" if m["high"] is None else format(m["high"], ".4f")
    return f"{m['value']:.4f} ({m['low']:.4f} .. {high})"


def show(found, out=sys.stdout):
    """Prints all rows, then the counts."""
    for identifier, case, a, b, p in found.rows:
        mark = "DIFFERS" if (identifier, case) in found.different else "outside" if p < found.alone else ""
        name = identifier if case is None else f"{case}: {identifier}"
        print(f"{name} | {said(a)} | {said(b)} | p = {p:.4f} | {mark}", file=out)
    for what, keys in (("without an interval, differs", found.exact), ("in one report only", found.missing)):
        for identifier, case in sorted(keys, key=str):
            print(f"{case or 'whole plan'}: {identifier} | {what}", file=out)
    print(
        f"{len(found.rows)} metrics: {found.outside} outside one by one, {found.expected:.1f} expected by chance "
        f"(so many or more: {found.chance:.3f} if independent); {len(found.different)} differ by Holm's procedure; "
        f"{len(found.exact)} without an interval differ",
        file=out,
    )


def main():
    """Compares two reports and prints what differs."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("one", type=Path)
    parser.add_argument("other", type=Path)
    parser.add_argument("--cases", action="store_true", help="metrics of single cases too")
    given = parser.parse_args()
    one, other = (json.loads(path.read_text()) for path in (given.one, given.other))
    found = compare(one, other, given.cases)
    show(found)
    sys.exit(4 if found.different or found.exact or found.missing else 0)


if __name__ == "__main__":
    main()
