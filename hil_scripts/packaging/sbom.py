#!/usr/bin/env python3
"""Lists the crates that the program is built from: python3 hil_scripts/packaging/sbom.py FILE.cdx.json [--licences FILE.txt]

A CycloneDX 1.5 document in JSON: each crate with version, licence, SHA-256 of its source and what it depends on, from
`cargo metadata` and Cargo.lock; dependencies of tests and build scripts are left out. --licences also writes the licence
texts that come with these crates. --features names the features of the build (default: all).

SOURCE_DATE_EPOCH is the time of the document, so that the same sources give the same bytes.
"""

import argparse
import datetime
import hashlib
import json
import os
import subprocess
import sys
import tomllib
import uuid
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
PROGRAM = "starloop"
LICENCE_NAMES = ("licen", "copying", "notice", "unlicense", "copyright")


def metadata(features):
    """Returns what Cargo knows of the workspace, for this machine's target."""
    host = next(line.split()[1] for line in run("rustc", "-vV").splitlines() if line.startswith("host:"))
    named = ",".join(f"{PROGRAM}/{feature}" for feature in (features or "").split(",") if feature)
    chosen = ["--all-features"] if features is None else ["--features", named] if named else []
    words = ["cargo", "metadata", "--locked", "--format-version", "1", "--filter-platform", host, *chosen]
    return json.loads(run(*words))


def run(*words):
    return subprocess.run(words, cwd=ROOT, check=True, stdout=subprocess.PIPE, text=True).stdout


def checksums():
    """Returns the SHA-256 of the source of each crate from a registry."""
    lock = tomllib.loads((ROOT / "Cargo.lock").read_text())
    return {(entry["name"], entry["version"]): entry.get("checksum") for entry in lock["package"]}


def linked(nodes, first):
    """Returns the ids of what is linked into `first`, and for each id what it depends on itself."""
    needs, waiting = {}, [first]
    while waiting:
        node = waiting.pop()
        if node in needs:
            continue
        normal = lambda dependency: any(kind["kind"] is None for kind in dependency["dep_kinds"])
        needs[node] = sorted(dependency["pkg"] for dependency in nodes[node]["deps"] if normal(dependency))
        waiting += needs[node]
    return needs


def purl(package):
    return f"pkg:cargo/{package['name']}@{package['version']}"


def component(package, kind, sums):
    found = {
        "type": kind,
        "bom-ref": purl(package),
        "name": package["name"],
        "version": package["version"],
        "purl": purl(package),
    }
    if package.get("license"):
        found["licenses"] = [{"expression": package["license"].replace("/", " OR ")}]
    if package.get("repository"):
        found["externalReferences"] = [{"type": "vcs", "url": package["repository"]}]
    checksum = sums.get((package["name"], package["version"]))
    if checksum:
        found["hashes"] = [{"alg": "SHA-256", "content": checksum}]
    return found


def document(packages, needs, first, moment):
    sums = checksums()
    others = sorted((packages[node] for node in needs if node != first), key=purl)
    components = [component(package, "library", sums) for package in others]
    edges = [{"ref": purl(packages[node]), "dependsOn": sorted({purl(packages[below]) for below in needs[node]})} for node in needs]
    body = {
        "bomFormat": "CycloneDX",
        "specVersion": "1.5",
        "version": 1,
        "metadata": {
            "timestamp": moment.strftime("%Y-%m-%dT%H:%M:%SZ"),
            "component": component(packages[first], "application", sums),
        },
        "components": components,
        "dependencies": sorted(edges, key=lambda edge: edge["ref"]),
    }
    digest = hashlib.sha256(json.dumps(body, sort_keys=True).encode()).hexdigest()
    body["serialNumber"] = f"urn:uuid:{uuid.uuid5(uuid.NAMESPACE_OID, digest)}"
    return body


def licence_texts(packages, needs, first):
    """Returns the texts that come with the crates; equal ones once, below the names of all crates that have them."""
    owners, without = {}, []
    for node in sorted(needs, key=lambda node: purl(packages[node])):
        package = packages[node]
        if package["source"] is None:
            continue
        folder = Path(package["manifest_path"]).parent
        files = [path for path in sorted(folder.iterdir()) if path.is_file() and path.name.lower().startswith(LICENCE_NAMES)]
        name = f"{package['name']} {package['version']} ({package.get('license')})"
        if not files:
            without.append(name)
        for path in files:
            text = path.read_text(encoding="utf-8", errors="replace").strip()
            owners.setdefault(text, []).append(name)
    parts = ["Licence texts of the crates that starloop is built from.\n"]
    parts += [f"{'-' * 80}\n{chr(10).join(dict.fromkeys(names))}\n\n{text}\n" for text, names in owners.items()]
    if without:
        parts.append(f"{'-' * 80}\nCrates whose source has no file with a licence text:\n\n" + "\n".join(without) + "\n")
    return "\n".join(parts)


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("out", type=Path)
    parser.add_argument("--licences", type=Path)
    parser.add_argument("--features", help="features of the build, separated by commas; default: all")
    arguments = parser.parse_args()
    found = metadata(arguments.features)
    packages = {package["id"]: package for package in found["packages"]}
    first = next(node for node, package in packages.items() if package["name"] == PROGRAM and package["source"] is None)
    needs = linked({node["id"]: node for node in found["resolve"]["nodes"]}, first)
    epoch = int(os.environ.get("SOURCE_DATE_EPOCH") or run("git", "log", "-1", "--format=%ct").strip())
    moment = datetime.datetime.fromtimestamp(epoch, datetime.timezone.utc)
    bom = document(packages, needs, first, moment)
    arguments.out.write_text(json.dumps(bom, indent=1) + "\n")
    if arguments.licences:
        arguments.licences.write_text(licence_texts(packages, needs, first))
    print(f"{len(bom['components'])} crates in {arguments.out}", file=sys.stderr)


if __name__ == "__main__":
    main()
