#!/usr/bin/env python3
"""Puts a wheel together from the release build: the module, the package's Python files, and the program.

    hil_scripts/packaging/make_wheel.py [--build target/release] [--out target/packages]

hil_scripts/packaging/package.sh builds and calls it. Standard library only. The platform tag names the newest version of glibc that a symbol of the module or the program needs
(PEP 600), and the wheel is refused when either needs a library that not every Linux has.
"""

import argparse
import base64
import hashlib
import pathlib
import platform
import re
import subprocess
import sys
import tomllib
import zipfile

ROOT = pathlib.Path(__file__).resolve().parents[2]
PACKAGE = ROOT / "hil_scripts" / "starloop"
LIBRARIES = {"linux-vdso.so.1", "libgcc_s.so.1", "libm.so.6", "libc.so.6", "libdl.so.2", "libpthread.so.0", "librt.so.1"}
"""Libraries that every Linux with glibc has (PEP 600)."""
METADATA = """Metadata-Version: 2.4
Name: starloop
Version: {version}
Summary: Star-sensor stimulator: what a star sensor sees, rendered exactly and on time
Project-URL: Repository, {repository}
License-Expression: MIT OR Apache-2.0
License-File: LICENSE-MIT
License-File: LICENSE-APACHE
Requires-Python: >=3.9
Requires-Dist: numpy>=1.24
Classifier: Operating System :: POSIX :: Linux
Classifier: Programming Language :: Python :: 3
Classifier: Programming Language :: Rust
Classifier: Typing :: Typed
Description-Content-Type: text/markdown

{description}"""
WHEEL = """Wheel-Version: 1.0
Generator: starloop make_wheel
Root-Is-Purelib: false
Tag: {tag}
"""
EPOCH = (2026, 1, 1, 0, 0, 0)
"""Time of every file in the archive: the same build gives the same wheel."""


def glibc_of(binary):
    """Returns the newest (major, minor) of glibc that a binary needs; ends the program when it needs a foreign library."""
    linked = subprocess.run(["ldd", binary], check=True, capture_output=True, text=True).stdout
    needed = {pathlib.Path(line.split()[0]).name for line in linked.splitlines() if line.split()}
    foreign = {name for name in needed - LIBRARIES if not name.startswith("ld-linux")}
    if foreign:
        sys.exit(f"{binary} needs {', '.join(sorted(foreign))}, which not every Linux has: a wheel cannot carry it")
    versions = re.findall(rb"GLIBC_(\d+)\.(\d+)", pathlib.Path(binary).read_bytes())
    return max((int(major), int(minor)) for major, minor in versions)


def files(build, tag, package):
    """Yields (name in the wheel, bytes, is executable)."""
    yield "starloop/_native.abi3.so", (build / "lib_native.so").read_bytes(), True
    for path in sorted(PACKAGE.iterdir()):
        if path.suffix in (".py", ".pyi", ".typed") or path.name == "py.typed":
            yield f"starloop/{path.name}", path.read_bytes(), False
    yield "starloop/starloop.dbc", (ROOT / "firmware_protocol" / "dbc" / "starloop.dbc").read_bytes(), False
    version = package["version"]
    yield f"starloop-{version}.data/scripts/starloop", (build / "starloop").read_bytes(), True
    info = f"starloop-{version}.dist-info"
    description = (ROOT / "src" / "guide" / "python.md").read_text()
    yield f"{info}/METADATA", METADATA.format(**package, description=description).encode(), False
    yield f"{info}/WHEEL", WHEEL.format(tag=tag).encode(), False
    for name in ("LICENSE-MIT", "LICENSE-APACHE"):
        yield f"{info}/licenses/{name}", (ROOT / name).read_bytes(), False


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--build", type=pathlib.Path, default=ROOT / "target/release", help="folder of the built module and program")
    parser.add_argument("--out", type=pathlib.Path, default=ROOT / "target/packages", help="folder for the wheel")
    options = parser.parse_args()
    package = tomllib.loads((ROOT / "Cargo.toml").read_text())["workspace"]["package"]
    version = package["version"]
    binaries = [options.build / name for name in ("lib_native.so", "starloop")]
    major, minor = max(glibc_of(binary) for binary in binaries)
    tag = f"cp39-abi3-manylinux_{major}_{minor}_{platform.machine()}"
    options.out.mkdir(parents=True, exist_ok=True)
    for old in options.out.glob("starloop-*.whl"):
        old.unlink()
    path = options.out / f"starloop-{version}-{tag}.whl"
    record = []
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as wheel:

        def add(name, data, is_executable):
            entry = zipfile.ZipInfo(name, EPOCH)
            entry.external_attr = (0o100755 if is_executable else 0o100644) << 16
            wheel.writestr(entry, data, zipfile.ZIP_DEFLATED)

        for name, data, is_executable in files(options.build, tag, package):
            digest = base64.urlsafe_b64encode(hashlib.sha256(data).digest()).rstrip(b"=").decode()
            record.append(f"{name},sha256={digest},{len(data)}")
            add(name, data, is_executable)
        name = f"starloop-{version}.dist-info/RECORD"
        add(name, "\n".join([*record, f"{name},,"]).encode() + b"\n", False)
    print(f"{path}: {path.stat().st_size / 1e6:.1f} MB")


if __name__ == "__main__":
    main()
