#!/usr/bin/env python3
"""Draws a data set on the workers of a Dask cluster, shard by shard, into one folder that all of them share.

    python3 hil_scripts/starloop/dask_data_set.py configs/data_sets/lost_in_space.toml --count 10000 --out out/stars --workers 2
    python3 hil_scripts/starloop/dask_data_set.py my_set.toml --count 1000000 --out /shared/set --scheduler tcp://head:8786

One `starloop dataset --shards` process per task, one core each. Shards that are there are not drawn again, so a data set that
was stopped goes on where it was. The files are those of `starloop dataset` without this script, byte by byte. Exit status: 0
whole, 1 a shard could not be drawn, 130 stopped by Ctrl-C.

Needs hil_scripts/requirements_campaign.txt. With --scheduler, program, description and folder have the same paths on every
machine.
"""
# mypy: ignore-errors

from __future__ import annotations

import argparse
import json
import shutil
import subprocess
import sys
import time
import tomllib
from pathlib import Path

USUAL_SHARD_ITEMS = 250
"""Items of a shard where the description says nothing."""
CONFIGS = Path(__file__).resolve().parents[2] / "configs"
"""The files of built-in names: beside hil_scripts in a clone, beside the clients in the Debian package."""


def description(given: Path) -> Path:
    """The file of a description: one of this name, or that of a built-in name such as data_sets/targets.toml."""
    found = next((path for path in (given, CONFIGS / given) if path.is_file()), None)
    if found is None:
        raise SystemExit(f"{given}: no such file; wanted a description of a data set, or a built-in one such as data_sets/targets.toml")
    return found.resolve()


def shards_of(spec: Path, count: int) -> int:
    """The number of shards of a data set."""
    items = tomllib.loads(spec.read_text()).get("output", {}).get("shard_items", USUAL_SHARD_ITEMS)
    return -(-count // items)


def draw(binary: str, spec: str, count: int, out: str, images: str | None, shard: int) -> dict:
    """Draws one shard; what came of it. Runs on a Dask worker, so it needs nothing but the standard library."""
    command = [binary, "dataset", spec, "--count", str(count), "--out", out, "--shards", f"{shard}..{shard + 1}"]
    command += ["--workers", "1", "--quiet", "--json"] + (["--images", images] if images else [])
    done = subprocess.run(command, capture_output=True, text=True, stdin=subprocess.DEVNULL)
    made = json.loads(done.stdout) if done.returncode == 0 else {}
    return {"shard": shard, "status": done.returncode, "made": made, "why": done.stderr.strip()[-500:]}


def main() -> int:
    """Draws the shards on the workers; the exit status."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("spec", type=Path, help="description of the data set (TOML)")
    parser.add_argument("--count", type=int, required=True, help="number of items")
    parser.add_argument("--out", type=Path, required=True, help="folder of the data set")
    parser.add_argument("--images", help="form of the images in place of the description's")
    built = Path("target/release/starloop")
    found = built if built.is_file() else Path(shutil.which("starloop") or built)
    parser.add_argument("--binary", type=Path, default=found, help=f"the program (default {found})")
    where = parser.add_mutually_exclusive_group()
    where.add_argument("--workers", type=int, default=2, help="processes on this machine")
    where.add_argument("--scheduler", help="address of a running cluster, such as tcp://head:8786")
    given = parser.parse_args()

    given.spec = description(given.spec)
    if not given.binary.is_file():
        raise SystemExit(f"{given.binary}: no such program; wanted starloop on the PATH, or --binary FILE")
    try:
        from dask.distributed import Client, LocalCluster, as_completed
    except ImportError:
        raise SystemExit("dask is not installed; install hil_scripts/requirements_campaign.txt with python3 -m pip install -r") from None

    binary, spec, out = (str(path.resolve()) for path in (given.binary, given.spec, given.out))
    shards = shards_of(given.spec, given.count)
    cluster = None if given.scheduler else LocalCluster(n_workers=given.workers, threads_per_worker=1, dashboard_address=None)
    began, drawn, failed = time.monotonic(), 0, []
    with Client(given.scheduler or cluster) as client:
        try:
            tasks = [client.submit(draw, binary, spec, given.count, out, given.images, shard, pure=False) for shard in range(shards)]
            for number, (_, result) in enumerate(as_completed(tasks, with_results=True), 1):
                drawn += result["made"].get("drawn", 0)
                if result["status"] != 0:
                    failed.append(result)
                    print(f"shard {result['shard']}: {result['why']}", file=sys.stderr)
                rate = drawn / (time.monotonic() - began)
                print(f"{number} of {shards} shards, {drawn} items drawn, {rate:.1f} items/s", file=sys.stderr)
        except KeyboardInterrupt:
            client.cancel(tasks)
            return 130
    if cluster:
        cluster.close()
    if failed:
        print(f"{given.out}: {len(failed)} of {shards} shards could not be drawn")
        return 1
    print(f"{given.out}: whole; {drawn} items drawn in {time.monotonic() - began:.1f} s")
    return 0


if __name__ == "__main__":
    sys.exit(main())
