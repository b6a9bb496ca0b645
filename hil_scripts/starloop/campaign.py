"""Run a scenario for many seeds and values, over Dask, and keep one row of Parquet per run.

    python3 hil_scripts/starloop/campaign.py configs/scenarios/acquisition.toml --seeds 1..100 \\
        --grid control.delay_ms=0,100,200 --out out/delay --workers 8

One `starloop` process per task, one core each. In the folder given by --out:

    tasks/ID.parquet   one row per task, written under another name first: a file that is there is whole
    results.parquet    all rows
    summary.json       counts, and pass share and pointing errors by grid value
    campaign.svg       the same to look at
    campaign.json      what the folder is about: a campaign of another scenario or program is refused
    report.html        with --report: every metric over all runs, requirements, the worst runs; also report.json and
                       report.xml (JUnit)

Tasks whose row is there are not run again, so a campaign that was stopped goes on where it was, and more seeds or values
can be added. Runs that do not hold, and runs that give no report, are listed with the command that repeats them; the
others go on. Exit status: 0 all held, 4 some did not or a requirement is not met, 1 some gave no report, 130 stopped by
Ctrl-C. With --requirements it is 4 only where a requirement is not met, or not shown.

Needs hil_scripts/requirements_campaign.txt. On a cluster (--scheduler) program and scenario have the same paths everywhere.
"""
# mypy: ignore-errors

from __future__ import annotations

import argparse
import hashlib
import itertools
import json
import os
import re
import shlex
import shutil
import subprocess
import sys
import time
from pathlib import Path

import pyarrow
import pyarrow.parquet

if not __package__:  # called by its path
    sys.path[0] = str(Path(__file__).resolve().parents[1])

from starloop import campaign_page, campaign_report

STDERR_TAIL = 2000
"""Characters of standard error that are kept."""

RESULTS = (0, 4, 6)
"""Exit statuses of a run that came to its end: it held, or it did not."""

INTERRUPTED = 130
"""Exit status of a run that was stopped: its report is of the part that was flown."""

ATTITUDE_COUNTS = ("attitudes_used", "attitudes_gated", "frames_untagged", "estimator_starts")
"""Columns of a report that count the tracker's attitudes."""


# --- what to run -----------------------------------------------------------------------------------------------------


def parse_seeds(text: str) -> list[int]:
    """`1..100`, `1,2,5` or both: `1..3,7`."""
    seeds: list[int] = []
    for part in text.split(","):
        found = re.fullmatch(r"\s*(\d+)(?:\.\.(\d+))?\s*", part)
        if not found:
            raise argparse.ArgumentTypeError(f"got {part!r}, wanted seeds such as 1..100 or 1,2,5")
        first, last = int(found[1]), int(found[2] or found[1])
        if last < first:
            raise argparse.ArgumentTypeError(f"got {part!r}, wanted the smaller seed first")
        seeds.extend(range(first, last + 1))
    return list(dict.fromkeys(seeds))


def parse_grid(text: str) -> tuple[str, list[str]]:
    """`KEY=V1,V2`; commas inside brackets, braces and quotes belong to a value."""
    key, equals, given = text.partition("=")
    values, depth, quoted, start = [], 0, False, 0
    for at, c in enumerate(given):
        if c == '"':
            quoted = not quoted
        elif not quoted:
            depth += (c in "[{") - (c in "]}")
        if c == "," and depth == 0 and not quoted:
            values.append(given[start:at].strip())
            start = at + 1
    values.append(given[start:].strip())
    if not equals or not key.strip() or not all(values):
        raise argparse.ArgumentTypeError(f"got {text!r}, wanted KEY=V1,V2,... such as control.delay_ms=0,100")
    return key.strip(), list(dict.fromkeys(values))


def parse_setting(text: str) -> tuple[str, str]:
    """`KEY=VALUE`."""
    key, equals, value = text.partition("=")
    if not equals or not key.strip() or not value.strip():
        raise argparse.ArgumentTypeError(f"got {text!r}, wanted KEY=VALUE")
    return key.strip(), value.strip()


def tasks_of(
    seeds: list[int], grid: dict[str, list[str]], fixed: dict[str, str], random_faults: bool = False
) -> list[dict]:
    """Every combination, in an order that gives each grid value early runs: seeds outermost."""
    tasks = []
    for seed, values in itertools.product(seeds, itertools.product(*grid.values())):
        task = {"seed": seed, "grid": dict(zip(grid, values)), "fixed": fixed, "random_faults": random_faults}
        said = json.dumps([seed, sorted({**fixed, **task["grid"]}.items()), random_faults])
        tasks.append({**task, "id": f"seed{seed}_{hashlib.sha256(said.encode()).hexdigest()[:12]}"})
    return tasks


def command_of(task: dict, binary: str, scenario: str) -> list[str]:
    """The command that runs a task; it repeats it bit for bit anywhere."""
    settings = {**task["fixed"], **task["grid"]}
    command = [binary, "run", scenario, "--clock", "virtual", "--seed", str(task["seed"])]
    command += ["--random-faults"] if task["random_faults"] else []
    return command + [word for key, value in settings.items() for word in ("--set", f"{key}={value}")]


def run_task(task: dict, binary: str, scenario: str, timeout_s: float) -> dict:
    """Runs one task; what came out of it. Runs on a Dask worker, so it must need nothing but the standard library."""
    command = command_of(task, binary, scenario) + ["--json", "--quiet"]
    began = time.monotonic()
    status, error, out, err = None, None, "", ""
    try:
        # Tasks are the parallelism: one core each.
        environment = {**os.environ, "RAYON_NUM_THREADS": "1"}
        ended = subprocess.run(
            command, capture_output=True, text=True, timeout=timeout_s, env=environment, stdin=subprocess.DEVNULL
        )
        status, out, err = ended.returncode, ended.stdout, ended.stderr
    except subprocess.TimeoutExpired as expired:
        error = f"took longer than {timeout_s} s"
        err = (expired.stderr or b"").decode(errors="replace")
    except OSError as failed:
        error = f"cannot be run: {failed}"
    report = None
    try:
        report = json.loads(out) if out.strip() else None
    except json.JSONDecodeError as failed:
        error = f"its report is not JSON: {failed}"
    if status is not None and status not in RESULTS:
        report, error = None, f"no result, exit status {status}"
    if report is None and error is None:
        error = f"no report, exit status {status}"
    return {
        "report": report,
        "exit_status": status,
        "error": error,
        "stderr_tail": err[-STDERR_TAIL:],
        "task_wall_s": time.monotonic() - began,
    }


# --- rows ------------------------------------------------------------------------------------------------------------


def number(text: str) -> float | str:
    """A value of a grid as a number, when it is one."""
    try:
        return float(text)
    except ValueError:
        return text


def row_of(task: dict, result: dict, command: list[str]) -> dict:
    """One flat row: parameters, verdicts, errors, CRCs, times."""
    row = {
        "task": task["id"],
        "seed": task["seed"],
        "random_faults": task["random_faults"],
        **{f"param.{key}": number(value) for key, value in {**task["fixed"], **task["grid"]}.items()},
        "exit_status": result["exit_status"],
        "has_report": result["report"] is not None,
        "passed": bool(result["report"] and result["report"]["passed"]),
        "reasons": "; ".join(reason["text"] for reason in (result["report"] or {}).get("reasons", [])),
        "error": result["error"],
        "stderr_tail": result["stderr_tail"],
        "task_wall_s": result["task_wall_s"],
        "command": shlex.join(command),
    }
    report = result["report"] or {}
    for name in ("simulated_s", "wall_s", "speed", "fine_after_s", "predicted_pointing_arcsec", "tracker_availability"):
        row[name] = real(report.get(name))
    for name in ("largest_rendered_error_arcsec", "least_sun_angle_deg"):
        row[name] = real(report.get(name))
    for name in ("frames_held_to_truth", "violations", *ATTITUDE_COUNTS):
        row[name] = report.get(name)
    for group in ("pointing", "knowledge"):
        for name in ("boresight_arcsec", "roll_arcsec", "largest_boresight_arcsec"):
            row[f"{group}.{name}"] = real(report.get(group, {}).get(name))
    row.update({f"frames.{name}": count for name, count in report.get("frames", {}).items()})
    row["frames_crc32"] = "+".join(report["frames_crc32"]) if report else None
    row["telemetry_crc32"] = report.get("telemetry_crc32")
    for verdict in report.get("verdicts", []):
        name = re.sub(r"\W+", "_", verdict["name"]).strip("_")
        row.update({f"verdict.{name}.{part}": verdict[part] for part in ("passed", "got", "wanted")})
    for name in ("violation_lines", "refusals", "faults", "modes", "events"):
        row[name] = json.dumps(report[name]) if name in report else None
    return row


def why_not(row: dict) -> str:
    """Why a run did not hold or gave no report, in a few words."""
    if row["error"]:
        return "; ".join([row["error"], *row["stderr_tail"].strip().splitlines()[-1:]])
    verdicts = [name[len("verdict.") : -len(".passed")] for name in row if name.endswith(".passed") and not row[name]]
    reported = [f"{v.replace('_', ' ')}: wanted {row[f'verdict.{v}.wanted']}, got {row[f'verdict.{v}.got']}" for v in verdicts]
    return "; ".join(reported + json.loads(row["violation_lines"] or "[]")[:3]) or row["reasons"] or "did not hold"


def real(value: float | None) -> float | None:
    """Whole numbers too become real ones, so that a column has one type."""
    return None if value is None else float(value)


def table_of(rows: list[dict]) -> pyarrow.Table:
    """Rows with different columns as one table; a column of numbers and words becomes one of words."""
    names = list(dict.fromkeys(name for row in rows for name in row))
    columns = {}
    for name in names:
        values = [row.get(name) for row in rows]
        kinds = {type(value) for value in values if value is not None}
        if str in kinds and len(kinds) > 1:
            values = [None if value is None else str(value) for value in values]
        empty = pyarrow.string() if not kinds else None
        columns[name] = pyarrow.array(values, type=empty)
    return pyarrow.table(columns)


def write_whole(path: Path, write) -> None:
    """`write` fills a file of another name beside it, which then takes the name: it is whole or not there."""
    path.parent.mkdir(parents=True, exist_ok=True)
    beside = path.with_name(f".{path.name}.{os.getpid()}.part")
    try:
        write(beside)
        with open(beside, "rb") as written:
            os.fsync(written.fileno())
        os.replace(beside, path)
    finally:
        beside.unlink(missing_ok=True)


def read_row(path: Path) -> dict | None:
    """Reads a task's row; None when it is missing or incomplete."""
    try:
        rows = pyarrow.parquet.read_table(path).to_pylist()
    except (OSError, pyarrow.ArrowException):
        return None
    return rows[0] if len(rows) == 1 else None


# --- the folder ------------------------------------------------------------------------------------------------------


def digest(path: Path) -> str:
    """SHA-256 of a file."""
    return hashlib.sha256(path.read_bytes()).hexdigest()


def named_files(scenario: Path) -> list[Path]:
    """The scenario file and every TOML file that it names, directly or not."""
    found, waiting = [], [scenario]
    while waiting:
        path = waiting.pop()
        if path in found or not path.is_file():
            continue
        found.append(path)
        names = re.findall(r'"([^"\n]+\.toml)"', path.read_text())
        waiting.extend((path.parent / name).resolve() for name in names)
    return found


def hold_to_folder(out: Path, scenario: Path, binary: Path) -> None:
    """Refuses to mix results of different scenarios or programs in one folder."""
    about = {
        "scenario": {str(path): digest(path) for path in sorted(named_files(scenario))},
        "program": digest(binary),
    }
    path = out / "campaign.json"
    if path.exists():
        before = json.loads(path.read_text())
        changed = [name for name in about if before.get(name) != about[name]]
        if changed:
            raise SystemExit(
                f"campaign: {out} holds results of another {' and '.join(changed)}: name another folder, or "
                "remove this one"
            )
        return
    write_whole(path, lambda beside: beside.write_text(json.dumps(about, indent=1) + "\n"))


def rows_there(out: Path, tasks: list[dict], retry: bool) -> dict[str, dict]:
    """Rows of tasks that need not be run again: not those that were stopped, nor, to retry, those without report."""
    rows = {task["id"]: read_row(out / "tasks" / f"{task['id']}.parquet") for task in tasks}
    there = {task: row for task, row in rows.items() if row and row["exit_status"] != INTERRUPTED}
    return {task: row for task, row in there.items() if row["has_report"] or not retry}


# --- running ---------------------------------------------------------------------------------------------------------


class Progress:
    """One line on standard error, drawn over on a terminal, else repeated now and then."""

    def __init__(self, total: int, there: int):
        self.total, self.there, self.began = total, there, time.monotonic()
        self.done = self.not_held = self.no_report = 0
        self.is_terminal = sys.stderr.isatty()
        self.drawn_at = self.began

    def add(self, row: dict) -> None:
        """Counts a row that is finished, and shows the progress now and then."""
        self.done += 1
        self.no_report += not row["has_report"]
        self.not_held += row["has_report"] and not row["passed"]
        now = time.monotonic()
        if now - self.drawn_at >= (0.2 if self.is_terminal else 10.0) or self.there + self.done == self.total:
            self.drawn_at = now
            print(self.line(now), end="\r" if self.is_terminal else "\n", file=sys.stderr, flush=True)

    def line(self, now: float) -> str:
        """How far it is, in words."""
        rate = self.done / max(now - self.began, 1e-3)
        left_s = (self.total - self.there - self.done) / max(rate, 1e-9)
        reported = f"{self.there + self.done}/{self.total} tasks ({self.there} were there), {self.not_held} did not hold, "
        return reported + f"{self.no_report} without report, {rate:.2f} tasks/s, {left_s:.0f} s left    "

    def say(self, text: str) -> None:
        """A line of its own."""
        print(f"{' ' * 110}\r{text}" if self.is_terminal else text, file=sys.stderr, flush=True)


def run_all(client, tasks: list[dict], given: argparse.Namespace, progress: Progress) -> dict[str, dict]:
    """Runs tasks and writes their rows as they come."""
    from dask.distributed import as_completed

    binary, scenario = str(given.binary), str(given.scenario)
    by_key, rows = {}, {}
    # A worker that is lost takes its task with it: tried again elsewhere, then given up.
    futures = [
        client.submit(run_task, task, binary, scenario, given.timeout, key=f"starloop-{task['id']}", pure=False)
        for task in tasks
    ]
    by_key = {future.key: task for future, task in zip(futures, tasks)}
    for future in as_completed(futures):
        task = by_key[future.key]
        try:
            result = future.result()
        except Exception as lost:  # whatever became of a worker, the others go on
            reported = f"lost by Dask: {type(lost).__name__}: {lost}"
            result = {"report": None, "exit_status": None, "error": reported, "stderr_tail": "", "task_wall_s": 0.0}
        future.release()
        command = command_of(task, binary, scenario)
        row = row_of(task, result, command)
        rows[task["id"]] = row
        path = given.out / "tasks" / f"{task['id']}.parquet"
        write_whole(path, lambda beside: pyarrow.parquet.write_table(table_of([row]), beside))
        if not row["passed"]:
            progress.say(f"seed {task['seed']}: {why_not(row)}\n    {shlex.join(command)}")
        progress.add(row)
    return rows


def cluster_client(given: argparse.Namespace):
    """A client of the cluster that was named, or of one of this machine."""
    from dask.distributed import Client, LocalCluster

    if given.scheduler:
        return Client(given.scheduler, timeout="30s"), None
    cluster = LocalCluster(
        n_workers=given.workers, threads_per_worker=1, processes=True, dashboard_address=None, silence_logs=40
    )
    return Client(cluster), cluster


# --- what it came to -------------------------------------------------------------------------------------------------


def quantile(values: list[float], share: float) -> float | None:
    """The value below which `share` of the values lie, between neighbours by straight line."""
    if not values:
        return None
    ordered = sorted(values)
    place = share * (len(ordered) - 1)
    low = int(place)
    high = min(low + 1, len(ordered) - 1)
    return ordered[low] + (ordered[high] - ordered[low]) * (place - low)


def figures(rows: list[dict]) -> dict:
    """Counts and errors of some rows."""
    pointing = [row["pointing.boresight_arcsec"] for row in rows if row["pointing.boresight_arcsec"] is not None]
    reports = [row for row in rows if row["has_report"]]
    return {
        "tasks": len(rows),
        "without_report": len(rows) - len(reports),
        "passed": sum(row["passed"] for row in rows),
        "pass_share": sum(row["passed"] for row in rows) / max(len(rows), 1),
        "violations": sum(row["violations"] for row in reports),
        "pointing_arcsec": {
            name: quantile(pointing, share) for name, share in (("median", 0.5), ("p95", 0.95), ("largest", 1.0))
        },
    }


def summary_of(rows: list[dict], grid: dict[str, list[str]]) -> dict:
    """All rows, each grid value, and what to look at."""
    by_value = {
        key: {value: figures([row for row in rows if row[f"param.{key}"] == number(value)]) for value in values}
        for key, values in grid.items()
    }
    failed = [
        {"seed": row["seed"], "why": why_not(row), "exit_status": row["exit_status"], "command": row["command"]}
        for row in rows
        if not row["passed"]
    ]
    simulated_h = sum(row["simulated_s"] or 0.0 for row in rows) / 3600.0
    return {**figures(rows), "simulated_h": simulated_h, "by_value": by_value, "not_passed": failed}


def plot(rows: list[dict], grid: dict[str, list[str]], path: Path, title: str) -> None:
    """Pointing error and pass share against each grid parameter, or against the seed."""
    import matplotlib

    matplotlib.use("svg")
    from matplotlib import pyplot

    matplotlib.rcParams["svg.hashsalt"] = "starloop"
    keys = list(grid) or ["seed"]
    figure, axes = pyplot.subplots(len(keys), 2, figsize=(11, 3.6 * len(keys)), squeeze=False)
    for (errors, shares), key in zip(axes, keys):
        values = grid.get(key) or sorted({row["seed"] for row in rows})
        of = [[row for row in rows if row["seed" if key == "seed" else f"param.{key}"] == number(str(v))] for v in values]
        is_scale = all(isinstance(number(str(value)), float) for value in values)
        at = [number(str(value)) for value in values] if is_scale else list(range(len(values)))
        pointing = [[r["pointing.boresight_arcsec"] for r in some if r["pointing.boresight_arcsec"]] for some in of]
        for place, some in zip(at, pointing):
            errors.plot([place] * len(some), some, ".", color="tab:blue", alpha=0.4)
        middle = [(place, quantile(some, 0.5)) for place, some in zip(at, pointing) if some]
        errors.plot(*zip(*middle), "-", color="tab:orange", label="median") if middle else None
        everything = [error for some in pointing for error in some]
        if everything and max(everything) > 30.0 * min(everything):
            errors.set_yscale("log")
        errors.set_ylabel("rms pointing error, arcsec")
        shares.plot(at, [figures(some)["pass_share"] for some in of], "o-", color="tab:green")
        shares.set_ylabel("share of runs that held")
        shares.set_ylim(-0.03, 1.03)
        for panel in (errors, shares):
            panel.set_xlabel(key)
            panel.grid(alpha=0.3)
            if not is_scale:
                panel.set_xticks(at, [str(value) for value in values])
    figure.suptitle(title)
    figure.tight_layout()
    write_whole(path, lambda beside: figure.savefig(beside, format="svg", metadata={"Date": None}))
    pyplot.close(figure)


def parse_arguments() -> argparse.Namespace:
    """The arguments of the command line."""
    parser = argparse.ArgumentParser(
        description=__doc__.split("\n\n")[0], formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("scenario", type=Path, help="scenario file")
    parser.add_argument("--seeds", type=parse_seeds, default=[1], help="such as 1..100 or 1,2,5 (default 1)")
    parser.add_argument(
        "--grid", type=parse_grid, action="append", default=[], metavar="KEY=V1,V2", help="values to try; repeatable"
    )
    parser.add_argument(
        "--set", type=parse_setting, action="append", default=[], metavar="KEY=VALUE", help="same in all; repeatable"
    )
    parser.add_argument(
        "--random-faults", action="store_true", help="add to each run the random faults that its seed decides"
    )
    parser.add_argument("--out", type=Path, required=True, help="folder of the results")
    where = parser.add_mutually_exclusive_group()
    where.add_argument("--scheduler", help="address of a Dask scheduler, such as tcp://host:8786")
    where.add_argument("--workers", type=int, default=os.cpu_count() or 1, help="processes here (default: all cores)")
    built = Path("target/release/starloop")
    found = built if built.is_file() else Path(shutil.which("starloop") or built)
    parser.add_argument("--binary", type=Path, default=found, help=f"the program (default {found})")
    parser.add_argument("--timeout", type=float, default=3600.0, help="seconds one task may take (default 3600)")
    parser.add_argument("--retry", action="store_true", help="run tasks again that gave no report")
    parser.add_argument("--report", action="store_true", help="write report.html, report.json and report.xml")
    parser.add_argument("--requirements", type=Path, help="limits for every run (TOML); with --report")
    parser.add_argument("--confidence", type=float, default=0.95, help="of the report's intervals (default 0.95)")
    given = parser.parse_args()
    if given.requirements and not given.report:
        parser.error("--requirements: wanted --report with it")
    if not 0.5 <= given.confidence < 1.0:
        parser.error(f"--confidence: got {given.confidence}, wanted 0.5 up to below 1")
    files = [(given.scenario, "scenario"), (given.binary, "program")]
    for path, what in files + ([(given.requirements, "file of requirements")] if given.requirements else []):
        if not path.is_file():
            parser.error(f"no {what} at {path}")
    if given.workers < 1:
        parser.error(f"--workers: got {given.workers}, wanted 1 or more")
    keys = [key for key, _ in given.grid + given.set]
    twice = sorted({key for key in keys if keys.count(key) > 1})
    if twice:
        parser.error(f"given twice: {', '.join(twice)}")
    given.scenario, given.binary = given.scenario.resolve(), given.binary.resolve()
    return given


def write_report(report: dict, out: Path) -> None:
    """Writes report.html, report.json and report.xml."""
    page, most = campaign_page.html_of(report), campaign_report.MOST_HTML_BYTES
    if len(page.encode()) > most:
        raise SystemExit(f"campaign: the report has {len(page)} bytes; wanted at most {most}: fewer values")
    junit = campaign_report.junit_of(report)
    texts = {"report.json": json.dumps(report, indent=1) + "\n", "report.xml": junit, "report.html": page}
    for name, text in texts.items():
        write_whole(out / name, lambda beside, text=text: beside.write_text(text))


def report(rows: list[dict], planned: int, grid: dict[str, list[str]], given: argparse.Namespace, requirements) -> dict:
    """Writes the report about all rows, and says where it is."""
    about = {
        "title": f"{given.scenario.stem}, {planned} runs",
        "planned": planned,
        "provenance": campaign_report.provenance_of(given.out, given.binary, given.requirements, rows),
    }
    found = campaign_report.report_of(rows, grid, requirements, about, number, given.confidence)
    write_report(found, given.out)
    print(f"{found['verdict']}; {given.out / 'report.html'}")
    return found


def exit_status(rows: list[dict], found: dict | None, has_requirements: bool) -> int:
    """The exit status; requirements that were given decide instead of the runs' own verdicts."""
    if any(not row["has_report"] for row in rows):
        return 1
    is_met = found is None or found["is_met"]
    return 0 if is_met and (has_requirements or all(row["passed"] for row in rows)) else 4


def main() -> int:
    """Flies the campaign; the exit status."""
    given = parse_arguments()
    try:
        requirements = campaign_report.read_requirements(given.requirements)
    except campaign_report.RequirementError as wrong:
        raise SystemExit(f"campaign: {wrong}") from wrong
    grid, fixed = dict(given.grid), dict(given.set)
    tasks = tasks_of(given.seeds, grid, fixed, given.random_faults)
    hold_to_folder(given.out, given.scenario, given.binary)
    there = rows_there(given.out, tasks, given.retry)
    waiting = [task for task in tasks if task["id"] not in there]
    rows, stopped = dict(there), False
    if waiting:
        progress = Progress(len(tasks), len(there))
        client, cluster = cluster_client(given)
        try:
            rows.update(run_all(client, waiting, given, progress))
        except KeyboardInterrupt:
            stopped = True
            rows = rows_there(given.out, tasks, False)
            print(f"\ncampaign: stopped; {len(rows)} of {len(tasks)} rows are kept", file=sys.stderr)
        finally:
            client.close()
            if cluster:
                cluster.close()
    else:
        print(f"campaign: all {len(tasks)} tasks were there", file=sys.stderr)
    ordered = [rows[task["id"]] for task in tasks if task["id"] in rows]
    found = None
    if ordered:
        write_whole(
            given.out / "results.parquet",
            lambda beside: pyarrow.parquet.write_table(table_of(ordered), beside),
        )
        summary = summary_of(ordered, grid)
        text = json.dumps(summary, indent=1) + "\n"
        write_whole(given.out / "summary.json", lambda beside: beside.write_text(text))
        plot(ordered, grid, given.out / "campaign.svg", f"{given.scenario.stem}: {len(ordered)} runs")
        print(
            f"{summary['passed']} of {len(ordered)} held, {summary['without_report']} without report, "
            f"{summary['simulated_h']:.2f} simulated hours; {given.out}"
        )
        if given.report:
            found = report(ordered, len(tasks), grid, given, requirements)
    return 130 if stopped else exit_status(ordered, found, given.requirements is not None)


if __name__ == "__main__":
    sys.exit(main())
