"""Tests of the packages: python3 hil_scripts/tests/test_packages.py

Makes them with package.sh, checks every part, installs the .deb into a bare Debian and runs the program there without a
network; the tarball too.

The bare root is made once by debootstrap and kept in target/bare_root; that needs root and a Debian mirror. Where it cannot
be made, the tests that need it are skipped, and say why. Sizes and start times are printed at the end of the run.
"""

import functools
import gzip
import hashlib
import json
import os
import re
import shutil
import sys
import tempfile
import time
import tomllib
import unittest
import zipfile
from pathlib import Path

from support import PROGRAM, ROOT, TARGET, InAFolder, output, ran

SUITE = "bookworm"
MIRROR = "http://deb.debian.org/debian"
PATIENCE_S = 600.0
LARGEST_PACKAGE_BYTES = 40e6
"""A package that is larger holds something that does not belong there."""
VIRTUAL = ("run", "--clock", "virtual", "--duration", "1")
measured = {}


@functools.cache
def packages():
    """Returns the folder of packages, made by package.sh."""
    folder = Path(tempfile.mkdtemp(prefix="starloop_packages_"))
    unittest.addModuleCleanup(shutil.rmtree, folder)
    make_packages(folder)
    return folder


def make_packages(folder):
    environment = {**os.environ, "STARLOOP_BINARY": str(PROGRAM), "SOURCE_DATE_EPOCH": "1767225600"}
    output(str(ROOT / "hil_scripts/packaging/package.sh"), "--out", str(folder), env=environment)


def only(pattern):
    """Returns the one file of the packages with a name of this form."""
    (path,) = packages().glob(pattern)
    return path


@functools.cache
def bare_root():
    """Returns the folder of a bare Debian, or why there is none."""
    kept = TARGET / "bare_root"
    if (kept / "made").exists():
        return kept
    if os.geteuid() != 0:
        return "debootstrap needs root"
    if not shutil.which("debootstrap"):
        return "debootstrap is not installed"
    shutil.rmtree(kept, ignore_errors=True)
    made = ran("debootstrap", "--variant=minbase", SUITE, kept, MIRROR)
    if made.returncode != 0:
        return f"debootstrap failed: {made.stdout[-300:]}"
    shutil.rmtree(kept / "var/cache/apt", ignore_errors=True)
    shutil.rmtree(kept / "var/lib/apt/lists", ignore_errors=True)
    (kept / "made").write_text(SUITE)
    return kept


class Contents(InAFolder):
    def test_the_checksums_are_right_and_a_changed_byte_is_found(self):
        check = lambda folder: ran("sha256sum", "-c", "--quiet", "SHA256SUMS", cwd=folder)
        self.assertEqual(check(packages()).returncode, 0)
        sums = (packages() / "SHA256SUMS").read_text().splitlines()
        names = {line.split()[1] for line in sums}
        self.assertEqual(names, {path.name for path in packages().iterdir()} - {"SHA256SUMS"})
        copy = self.folder / "packages"
        shutil.copytree(packages(), copy)
        path = next(copy.glob("*.deb"))
        content = bytearray(path.read_bytes())
        content[len(content) // 2] ^= 1
        path.write_bytes(content)
        self.assertNotEqual(check(copy).returncode, 0, "control: a damaged package")

    def test_the_debian_package_has_every_part(self):
        deb = only("*.deb")
        self.assertLess(deb.stat().st_size, LARGEST_PACKAGE_BYTES)
        measured["Debian package"] = deb.stat().st_size
        measured["installed"] = 1024 * int(output("dpkg-deb", "-f", str(deb), "Installed-Size"))
        names = {line.split()[5].removeprefix("./") for line in output("dpkg-deb", "-c", str(deb)).splitlines()}
        wanted = {
            "usr/bin/starloop",
            "usr/lib/systemd/system/starloop@.service",
            "usr/lib/udev/rules.d/60-starloop.rules",
            "usr/share/bash-completion/completions/starloop",
            "usr/share/doc/starloop/changelog.gz",
            "usr/share/doc/starloop/copyright",
            "usr/share/doc/starloop/LICENSE-APACHE",
            "usr/share/doc/starloop/sbom.cdx.json",
            "usr/share/doc/starloop/third_party_licences.txt.gz",
            "usr/share/fish/vendor_completions.d/starloop.fish",
            "usr/share/man/man1/starloop-run.1.gz",
            "usr/share/man/man1/starloop.1.gz",
            "usr/share/starloop/configs/benches/loopback.toml",
            "usr/share/starloop/firmware_protocol/dbc/starloop.dbc",
            "usr/share/starloop/host_setup.sh",
            "usr/share/starloop/python/requirements_flight_computer.txt",
            "usr/share/starloop/python/starloop/client.py",
            "usr/share/starloop/python/starloop_client.py",
            "usr/share/zsh/vendor-completions/_starloop",
        }
        self.assertLessEqual(wanted, names, wanted - names)
        shipped = {path.relative_to(ROOT).as_posix() for path in (ROOT / "configs").rglob("*.toml")}
        self.assertEqual({name.removeprefix("usr/share/starloop/") for name in names if name.endswith(".toml")}, shipped)
        self.assertNotIn("usr/share/no_such_file", names, "control")

    def test_every_command_has_a_page(self):
        output("dpkg-deb", "-x", str(only("*.deb")), self.folder)
        pages = self.folder / "usr/share/man/man1"
        output(str(PROGRAM), "man", f"{self.folder}/pages")
        wanted = {f"{path.name}.gz" for path in (self.folder / "pages").iterdir()}
        self.assertEqual({path.name for path in pages.iterdir()}, wanted)
        self.assertIn(".TH ", gzip.decompress((pages / "starloop.1.gz").read_bytes()).decode())
        licences = self.folder / "usr/share/doc/starloop/third_party_licences.txt.gz"
        text = gzip.decompress(licences.read_bytes()).decode()
        self.assertIn("Permission is hereby granted", text)
        self.assertIn("\nclap ", text)

    def test_the_list_of_crates_is_whole(self):
        bom = json.loads(only("*.cdx.json").read_text())
        self.assertEqual((bom["bomFormat"], bom["specVersion"]), ("CycloneDX", "1.5"))
        refs = [part["bom-ref"] for part in bom["components"]] + [bom["metadata"]["component"]["bom-ref"]]
        self.assertEqual(len(refs), len(set(refs)), "each once")
        names = {part["name"] for part in bom["components"]}
        self.assertLessEqual({"clap", "wgpu", "starloop_run", "serde"}, names)
        self.assertFalse({"criterion", "proptest"} & names, "crates of tests are not in the program")
        for part in bom["components"]:
            if not part["name"].startswith(("starloop_", "firmware_protocol")):
                self.assertRegex(part["hashes"][0]["content"], "^[0-9a-f]{64}$", part)
                self.assertTrue(part["licenses"], part)
        edges = {ref for edge in bom["dependencies"] for ref in edge["dependsOn"]}
        self.assertLessEqual(edges, set(refs), "dependencies are listed")

    def test_the_same_sources_give_the_same_bytes(self):
        make_packages(self.folder)
        digest = lambda path: hashlib.sha256(path.read_bytes()).hexdigest()
        for path in sorted(packages().iterdir()):
            self.assertEqual(digest(path), digest(self.folder / path.name), path.name)

    def test_a_missing_program_is_refused(self):
        environment = {**os.environ, "STARLOOP_BINARY": "/nonexistent/starloop"}
        words = [str(ROOT / "hil_scripts/packaging/package.sh"), "--out", "/nonexistent/out"]
        done = ran(*words, env=environment, status=1)
        self.assertIn("/nonexistent/starloop is missing", done.stderr)
        self.assertIn("package.sh builds it", done.stderr)

    def test_the_wheel_has_the_same_program_and_names_the_project(self):
        with zipfile.ZipFile(only("*.whl")) as wheel:
            (program,) = [name for name in wheel.namelist() if name.endswith(".data/scripts/starloop")]
            self.assertEqual(wheel.read(program), PROGRAM.read_bytes())
            (metadata,) = [name for name in wheel.namelist() if name.endswith("/METADATA")]
            package = tomllib.loads((ROOT / "Cargo.toml").read_text())["workspace"]["package"]
            self.assertIn(f"Project-URL: Repository, {package['repository']}\n", wheel.read(metadata).decode())
        self.assertEqual(output("dpkg-deb", "-f", str(only("*.deb")), "Homepage").strip(), package["repository"])

    def test_the_first_page_works_with_the_package(self):
        output("dpkg-deb", "-x", str(only("*.deb")), self.folder)
        unpacked = {"STARLOOP_BINARY": f"{self.folder}/usr/bin/starloop", "STARLOOP_SHARE": f"{self.folder}/usr/share/starloop"}
        follow = [sys.executable, str(ROOT / "hil_scripts/tests/test_recipes.py"), "-k", "readme_md"]
        done = ran(*follow, env={**os.environ, **unpacked}, status=0)
        self.assertIn("Ran 1 test", done.stderr)
        (self.folder / "usr/share/starloop/python/starloop/client.py").unlink()
        done = ran(*follow, env={**os.environ, **unpacked})
        self.assertNotEqual(done.returncode, 0, "control: a package without the client")

    def test_the_container_file_installs_the_package(self):
        text = (packages() / "Containerfile").read_text()
        self.assertIn("COPY starloop_*.deb", text)
        self.assertRegex(text, r'ENTRYPOINT \["/usr/bin/starloop"\]')


class Unit(InAFolder):
    @unittest.skipUnless(shutil.which("systemd-analyze"), "systemd-analyze is not installed")
    def test_the_unit_is_well_formed(self):
        output("dpkg-deb", "-x", str(only("*.deb")), self.folder)
        unit = self.folder / "usr/lib/systemd/system/starloop@.service"
        text = unit.read_text().replace("/usr/bin/starloop", f"{self.folder}/usr/bin/starloop")
        verify = lambda path: ran("systemd-analyze", "verify", "--man=no", path)
        good, bad = self.folder / "starloop@good.service", self.folder / "starloop@bad.service"
        good.write_text(text)
        bad.write_text(text.replace("LimitRTPRIO=50", "LimitRTPRIO=much").replace("[Service]", "[Service]\nNoSuchKey=1"))
        about = lambda path: [line for line in verify(path).stderr.splitlines() if "starloop@" in line]
        self.assertEqual(about(good), [])
        self.assertTrue(about(bad), "control")

    def test_every_rule_is_a_line_of_udev(self):
        rules = (ROOT / "hil_scripts/packaging/60-starloop.rules").read_text().splitlines()
        rules = [line for line in rules if line and not line.startswith("#")]
        self.assertGreaterEqual(len(rules), 4)
        pair = r'[A-Z]+(\{\w+\})?(==|=)"[^"]*"'
        for rule in rules:
            self.assertRegex(rule, f"^{pair}(, {pair})*$")
        self.assertNotRegex('ACTION=="add" SUBSYSTEM', f"^{pair}(, {pair})*$", "control")


class Bare(unittest.TestCase):
    """The program in a Debian that has nothing but its base, without a network."""

    @classmethod
    def setUpClass(cls):
        bare = bare_root()
        if isinstance(bare, str):
            raise unittest.SkipTest(f"no bare root: {bare}")
        if os.geteuid() != 0:
            raise unittest.SkipTest("chroot needs root")
        packages()
        folder = Path(tempfile.mkdtemp(prefix="starloop_bare_", dir=TARGET))
        cls.addClassCleanup(shutil.rmtree, folder)
        cls.root = folder / "root"
        output("cp", "-a", "--reflink=auto", str(bare), str(cls.root))
        shutil.copy(only("*.deb"), cls.root / "tmp/starloop.deb")
        shutil.copy(only("*.tar.gz"), cls.root / "tmp/starloop.tar.gz")

    def inside(self, *words, status=0):
        """Runs a command in the bare root, where no network is."""
        words = ["unshare", "--net", "--mount", "chroot", str(self.root), "/usr/bin/env", "-i", "PATH=/usr/bin:/bin:/usr/sbin:/sbin", "HOME=/root", *words]
        return ran(*words, status=status).stdout

    def test_1_nothing_is_there_before(self):
        self.inside("test", "-e", "/usr/bin/starloop", status=1)

    def test_2_the_tarball_runs_where_it_is(self):
        self.inside("tar", "-xzf", "/tmp/starloop.tar.gz", "-C", "/opt")
        (folder,) = (self.root / "opt").iterdir()
        measured["tarball"] = only("*.tar.gz").stat().st_size
        program = f"/opt/{folder.name}/bin/starloop"
        self.assertIn("starloop", self.inside(program, "--version"))
        self.inside(program, *VIRTUAL, "--out", "/tmp/of_tarball")
        self.assertTrue((self.root / "tmp/of_tarball/summary.json").exists())
        install = (folder / "INSTALL").read_text()
        newest = re.search(r"glibc ([0-9.]+) or newer", install)[1]
        asked = output("objdump", "-T", str(folder / "bin/starloop"))
        versions = {tuple(map(int, found.split("."))) for found in re.findall(r"GLIBC_([0-9.]+)", asked)}
        self.assertGreaterEqual(tuple(map(int, newest.split("."))), max(versions))

    def test_3_the_package_installs_and_does_its_main_job(self):
        self.inside("dpkg", "--install", "/tmp/starloop.deb")
        self.assertIn("install ok installed", self.inside("dpkg", "--status", "starloop"))
        self.inside("starloop", *VIRTUAL, "--out", "/tmp/of_package")
        summary = json.loads((self.root / "tmp/of_package/summary.json").read_text())
        self.assertEqual((summary["frames"]["delivered"], summary["losses"]), (10, []))
        with tempfile.TemporaryDirectory() as scratch:
            output(str(PROGRAM), *VIRTUAL, "--out", f"{scratch}/run")
            here = json.loads(Path(f"{scratch}/run/summary.json").read_text())
        self.assertEqual(summary["run_crc32"], here["run_crc32"], "the same bits as here")
        self.inside("starloop", "run", "--duration", "1", "--sink", "null", "--quiet")
        self.inside("starloop", "run", "/usr/share/starloop/configs/scenarios/imaging_faults.toml", "--clock", "virtual", "--sink", "null")
        wrote = self.inside("starloop", "render", "--camera", "cameras/star_tracker_20deg.toml", "--ra", "83.8", "--dec", "-1.2", "--out", "/tmp/orion.png")
        self.assertIn("/tmp/orion.png: 1024 x 1024 px", wrote)
        found = json.loads(self.inside("starloop", "doctor", "--json"))
        states = {finding["name"]: finding["state"] for finding in found["findings"]}
        self.assertEqual((states["GPU adapters"], states["CAN"]), ("missing", "missing"), states)

    def test_4_the_command_of_the_unit_runs(self):
        self.inside("cp", "-r", "/usr/share/starloop/configs/.", "/etc/starloop/")
        unit = (self.root / "usr/lib/systemd/system/starloop@.service").read_text()
        command = re.search(r"^ExecStart=(.*)$", unit, re.MULTILINE)[1].replace("%I", "benches/loopback")
        self.inside("sh", "-c", f"cd /tmp && {command} --duration 0.5")
        self.assertTrue(list((self.root / "tmp/out").rglob("summary.json")))

    def test_5_it_starts_quickly(self):
        # The middle of seven, into the docs; a busy machine takes longer, so no limit is asserted.
        for name, words in (("--version", ["--version"]), ("first frame", ["run", "--clock", "virtual", "--duration", "0.1", "--sink", "null", "--quiet"])):
            times = []
            for _ in range(7):
                begin = time.monotonic()
                self.inside("starloop", *words)
                times.append(time.monotonic() - begin)
            measured[f"start to {name}"] = sorted(times)[3]

    def test_6_the_package_is_removed_whole(self):
        self.inside("dpkg", "--purge", "starloop")
        left = [path for path in (self.root / "usr").rglob("*starloop*")]
        self.assertEqual(left, [])


def tearDownModule():
    for name, value in measured.items():
        text = f"{1e3 * value:.0f} ms" if isinstance(value, float) else f"{value / 1e6:.1f} MB"
        print(f"measured: {name}: {text}", file=sys.stderr)


if __name__ == "__main__":
    unittest.main()
