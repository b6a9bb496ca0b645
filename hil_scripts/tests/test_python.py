"""The Python package, installed from its wheel into an environment of its own: images, runs, types, examples of the guide."""

import ast
import json
import os
import re
import statistics
import sys
import unittest

from support import PROGRAM, ROOT, SCRIPTS, folder_for, output


class Package(unittest.TestCase):
    @classmethod
    def setUpClass(cls):
        folder = folder_for(cls)
        output(sys.executable, SCRIPTS / "packaging/make_wheel.py", "--build", PROGRAM.parent, "--out", folder / "wheels")
        (cls.wheel,) = (folder / "wheels").glob("*.whl")
        output(sys.executable, "-m", "venv", "--system-site-packages", folder / "environment")
        cls.python = folder / "environment" / "bin" / "python"
        # numpy comes from the environment of the tests.
        site = output(sys.executable, "-c", "import numpy, pathlib; print(pathlib.Path(numpy.__file__).parent.parent)").strip()
        (there,) = (folder / "environment" / "lib").glob("python3*/site-packages")
        (there / "tests_environment.pth").write_text(site + "\n")
        output(cls.python, "-m", "pip", "install", "-q", "--no-deps", "--no-index", cls.wheel)
        cls.work = folder / "work"
        cls.work.mkdir()

    def ask(self, code):
        """Runs code in the environment, away from the repository, and returns the JSON that it prints last."""
        return json.loads(output(self.python, "-c", code, cwd=self.work).strip().splitlines()[-1])

    def test_images_are_those_of_the_command(self):
        for extra, keywords in (
            ([], ""),
            (["--rate", "0.1,0.4,-0.2", "--seed", "5", "--noise-seed", "9", "--frame", "3"], "rate=(0.1, 0.4, -0.2), seed=5, noise_seed=9, frame=3"),
            (["--stage", "electrons"], "stage='electrons'"),
        ):
            path = self.work / "command.fits"
            output(PROGRAM, "render", "--camera", "cameras/small_tracker.toml", "--ra", "83.8", "--dec", "-5.4", "--roll", "12",
                "--time", "2026-05-01T00:00:00Z", *extra, "--out", path)  # fmt: skip
            equal, other = self.ask(
                "import json, starloop, numpy; from astropy.io import fits; "
                "camera = starloop.Camera('cameras/small_tracker.toml'); "
                f"frame = camera.render(ra=83.8, dec=-5.4, roll=12, time='2026-05-01T00:00:00Z', {keywords}); "
                f"other = camera.render(ra=83.9, dec=-5.4, roll=12, time='2026-05-01T00:00:00Z', {keywords}); "
                f"data = fits.getdata('{path}'); "
                "print(json.dumps([bool((data == frame.image).all()), bool((data == other.image).all())]))"
            )
            self.assertTrue(equal, f"{extra}")
            self.assertFalse(other, "control: another attitude is another image")

    def test_truth_facts_and_map_agree(self):
        worst, rows, kinds = self.ask(
            "import json, starloop, numpy; camera = starloop.Camera('cameras/star_tracker_20deg.toml'); "
            "frame = camera.render((1, 0, 0, 0)); t = frame.truth[frame.truth['mag_g'] < 6]; "
            "x, y = frame.wcs.all_world2pix(t['catalog_ra_deg'], t['catalog_dec_deg'], 0); "
            "print(json.dumps([float(numpy.hypot(x - t['x_px'], y - t['y_px']).max()), len(t), sorted(set(t['kind'].tolist()))]))"
        )
        self.assertGreater(rows, 10)
        self.assertLess(worst, 0.05, "the map of the header leads from catalog places to the places of the truth")
        self.assertEqual(kinds, ["star"])

    def test_observer_bodies_and_faults_work(self):
        earth, stray = self.ask(
            "import json, starloop; camera = starloop.Camera('cameras/small_tracker.toml'); "
            "orbit = {'kind': 'circular_orbit', 'altitude_km': 550.0, 'inclination_deg': 97.6}; "
            "views = [camera.render(ra=ra, dec=0, observer=orbit, bodies=True) for ra in range(0, 360, 30)]; "
            "hidden = sum(not view.truth['is_star'].any() for view in views); "
            "plain = camera.render(ra=10, dec=20); "
            "lit = camera.render(ra=10, dec=20, faults=[{'do': 'stray_light', 'e_per_s': 50000}]); "
            "print(json.dumps([hidden, float(lit.image.mean() - plain.image.mean())]))"
        )
        self.assertGreater(earth, 0, "the Earth hides the stars of some directions")
        self.assertGreater(stray, 10.0, "stray light is in every pixel")

    def test_runs_step_and_repeat(self):
        code = (
            "import json, zlib, starloop\n"
            "def fly(seed):\n"
            "    with starloop.Run('benches/closed_loop_small.toml', seed=seed, settings={'timing.duration_s': 3}) as run:\n"
            "        frames = [zlib.crc32(frame.image.tobytes()) for frame in run.frames()]\n"
            "        return frames, run.finish()['frames']['delivered'], run.exit_status\n"
            "print(json.dumps([fly(1), fly(1), fly(2)]))"
        )
        first, again, other = self.ask(code)
        self.assertEqual(first, again)
        self.assertEqual(first[1:], [6, 0])
        self.assertEqual(len(first[0]), 6)
        self.assertNotEqual(first[0], other[0], "control: another seed")

    def test_mistakes_are_errors_with_reasons(self):
        code = (
            "import json, starloop\n"
            "def why(act):\n"
            "    try: act()\n"
            "    except (ValueError, starloop.StarloopError) as error: return str(error)\n"
            "    return ''\n"
            "camera = starloop.Camera('cameras/small_tracker.toml')\n"
            "print(json.dumps([why(lambda: starloop.Camera('nowhere.toml')), why(lambda: camera.render((2, 0, 0, 0))),\n"
            "    why(lambda: camera.render(ra=3)), why(lambda: camera.render(ra=3, dec=100)), why(camera.render),\n"
            "    why(lambda: camera.render(ra=3, dec=3, faults=[{'do': 'frame_torn'}])),\n"
            "    why(lambda: starloop.Run('benches/closed_loop_small.toml').step(s=-1))]))"
        )
        wanted = ["nowhere.toml", "norm 1", "wanted both", "-90 to 90", "wanted attitude", "need a run", "step"]
        for message, part in zip(self.ask(code), wanted):
            self.assertIn(part, message)

    def test_an_image_that_does_not_fit_into_memory_is_a_memory_error(self):
        camera = (ROOT / "configs/cameras/small_tracker.toml").read_text()
        big = re.sub(r"(width_px|height_px) = 256", r"\1 = 16384", camera).replace("pitch_um = 72.0", "pitch_um = 1.125")
        (self.work / "big.toml").write_text(big)
        code = (
            "import json, resource, starloop\n"
            "resource.setrlimit(resource.RLIMIT_AS, (2_000_000_000, 2_000_000_000))\n"
            "def why(path):\n"
            "    try: return str(starloop.Camera(path).render(ra=84, dec=-1).image.shape)\n"
            "    except MemoryError as error: return str(error)\n"
            f"print(json.dumps([why({str(self.work / 'big.toml')!r}), why('cameras/small_tracker.toml')]))"
        )
        refused, drawn = self.ask(code)
        self.assertIn("needs", refused)
        self.assertIn("16384 x 16384 px", refused)
        self.assertEqual(drawn, "(256, 256)", "control: a small one in the same interpreter")

    def test_items_are_those_of_the_folder_and_workers_of_ray_draw_the_same(self):
        folder = self.work / "set"
        code = f"""
import json, zlib, pickle, numpy, starloop
spec = {{"name": "x", "camera": "cameras/small_tracker.toml", "seed": 4, "output": {{"shard_items": 3, "images": "png"}}}}
stars = starloop.DataSet(spec)
made = stars.make(7, {str(folder)!r}, workers=2)
crc = lambda image: zlib.crc32(image.astype("<u2").tobytes())
items = [stars[number] for number in (6, 0, 5)]
again = pickle.loads(pickle.dumps(stars))[5]
import ray
ray.init(num_cpus=2, include_dashboard=False, logging_level="ERROR", log_to_driver=False)
rows = ray.data.read_datasource(starloop.ray_source(spec, 7)).take_all()
print(json.dumps([made, [item.labels for item in items], [crc(item.image) for item in items], crc(again.image),
                  [[int(row["item"]), crc(numpy.asarray(row["image"]))] for row in rows]]))
"""
        made, labels, sums, again, rows = self.ask(code)
        self.assertTrue(made["is_whole"] and made["drawn"] == 7)
        import pyarrow.dataset

        table = pyarrow.dataset.dataset(f"{folder}/labels/items").to_table().to_pylist()
        wanted = {row["item"]: row for row in table}
        self.assertEqual(sums, [wanted[item]["crc32"] for item in (6, 0, 5)])
        self.assertNotEqual(sums[0], sums[1], "control: items differ")
        self.assertEqual(again, sums[2])
        for label in labels:
            row = wanted[label["item"]]
            self.assertEqual({name: label[name] for name in row}, row)
        self.assertEqual(sorted(map(tuple, rows)), [(item, wanted[item]["crc32"]) for item in range(7)])

    def test_reports_on_a_camera_are_those_of_the_commands(self):
        snr, psf, verify, refused = self.ask(
            "import json, starloop; camera = starloop.Camera('cameras/small_tracker.toml')\n"
            "try: camera.snr('--window', '4'); refused = ''\n"
            "except ValueError as error: refused = str(error)\n"
            "print(json.dumps([camera.snr('--bp-rp', '1.5'), camera.psf(), camera.verify('--frames', '20'), refused]))"
        )
        direct = json.loads(output(PROGRAM, "snr", "cameras/small_tracker.toml", "--bp-rp", "1.5", "--json"))
        self.assertEqual(snr, direct)
        self.assertGreater(psf["fwhm_px"], 0.5)
        self.assertTrue(verify["holds"] in (True, False) and verify["data_sheet"])
        self.assertIn("--window is 4", refused)

    def test_examples_of_the_guide_run(self):
        text = (ROOT / "src" / "guide" / "python.md").read_text()
        examples = re.findall(r"```python\n(.*?)```", text, re.S)
        self.assertGreaterEqual(len(examples), 2)
        for example in examples:
            self.assertTrue(output(self.python, "-c", example, cwd=self.work))

    def test_the_notebook_of_the_guide_runs(self):
        notebook = json.loads((ROOT / "src" / "guide" / "accuracy_and_speed.ipynb").read_text())
        self.assertEqual(notebook["nbformat"], 4)
        cells = ["".join(cell["source"]) for cell in notebook["cells"] if cell["cell_type"] == "code"]
        facts = "import json; print(json.dumps([errors, len(at_s), pointing, pyplot.get_fignums(), fault_at_s, stars, held, report]))"
        (self.work / "notebook.py").write_text("\n\n".join([*cells, facts]))
        environment = {**os.environ, "MPLBACKEND": "Agg"}
        said = output(self.python, "notebook.py", cwd=self.work, env=environment)
        errors, frames, pointing, charts, fault_at_s, stars, held, report = json.loads(said.strip().splitlines()[-1])
        self.assertLess(errors["auto"], 1e-4, "the planner keeps its budget")
        self.assertGreater(errors["gaussian"], 0.1, "control: a method that is wrong for a streak is seen to be")
        self.assertLess(errors["samples:32"], errors["samples:4"])
        self.assertEqual(charts, [1, 2, 3], "three charts")
        self.assertGreater(frames, 100)
        self.assertGreater(max(pointing), 5000, "control: the turn is in the chart")
        self.assertLess(sorted(pointing[-20:])[10], 10, "the loop settles on the new target")
        blind = {count for at_s, count in zip(fault_at_s, stars) if 32 < at_s < 44}
        seeing = {count for at_s, count in zip(fault_at_s, stars) if 10 < at_s < 29}
        self.assertEqual(blind, {0}, "the fault blinds the tracker")
        self.assertGreater(min(seeing), 10, "control: before it there are stars")
        self.assertLess(max(held[20:]), 60, "the gyro carries on")
        self.assertEqual([fault["name"] for fault in report["faults"]], ["stray_light"])
        self.assertEqual(report["verdict"], "ok")

    def test_what_an_image_costs_beside_the_command(self):
        scene = ["--camera", "cameras/star_tracker_20deg.toml", "--ra", "83.8", "--dec", "-5.4", "--backend", "cpu"]
        command, render, facts = [], [], []
        for _ in range(9):
            said = output(PROGRAM, "render", *scene, "--timing", "--out", self.work / "timed.fits")
            command.append(next(json.loads(line)["total_ms"] for line in said.splitlines() if line.startswith("{")))
            ours, beside, shape = self.ask(
                "import json, starloop, statistics, time; camera = starloop.Camera('cameras/star_tracker_20deg.toml'); a, b = [], []\n"
                "for _ in range(25):\n"
                "    t = time.perf_counter(); frame = camera.render(ra=83.8, dec=-5.4, backend='cpu')\n"
                "    a.append(time.perf_counter() - t)\n"
                "    t = time.perf_counter(); frame.truth, frame.meta; b.append(time.perf_counter() - t)\n"
                "print(json.dumps([1e3 * statistics.median(a[4:]), 1e3 * statistics.median(b[4:]), frame.image.shape]))"
            )
            self.assertEqual(shape, [1024, 1024])
            render.append(ours)
            facts.append(beside)
        theirs, ours, beside = (statistics.median(times) for times in (command, render, facts))
        print(f"1024 x 1024 with full noise: command {theirs:.2f} ms, camera.render {ours:.2f} ms ({100 * (ours / theirs - 1):+.1f} %), "
              f"its truth and meta {beside:.2f} ms more ({100 * beside / theirs:.1f} %)")  # fmt: skip

    def test_the_command_is_installed_and_importing_is_quick(self):
        self.assertIn("starloop", output(self.python.parent / "starloop", "--version"))
        seconds = self.ask("import time; t = time.perf_counter(); import starloop; print(time.perf_counter() - t)")
        print(f"import starloop: {seconds:.3f} s")

    def test_types_are_complete(self):
        examples = "\n".join(re.findall(r"```python\n(.*?)```", (ROOT / "src" / "guide" / "python.md").read_text(), re.S))
        (self.work / "typed.py").write_text(examples)
        (self.work / "wrong.py").write_text('import starloop\nstarloop.Camera("a").render(ra="x")\n')
        mypy = [sys.executable, "-m", "mypy", "--strict", "--python-executable", str(self.python)]
        output(*mypy, "typed.py", cwd=self.work)
        with self.assertRaises(AssertionError, msg="control: a wrong type is found"):
            output(*mypy, "wrong.py", cwd=self.work)

    def test_every_public_name_has_a_docstring(self):
        def names(node, prefix):
            """Public functions and classes without a docstring."""
            kinds = (ast.FunctionDef, ast.AsyncFunctionDef, ast.ClassDef)
            for one in node.body:
                if isinstance(one, kinds) and not one.name.startswith("_"):
                    if not ast.get_docstring(one):
                        yield prefix + one.name
                    if isinstance(one, ast.ClassDef):
                        yield from names(one, f"{prefix}{one.name}.")

        missing = [name for path in sorted((SCRIPTS / "starloop").glob("*.py")) for name in names(ast.parse(path.read_text()), f"{path.name}: ")]
        self.assertEqual(missing, [])
        self.assertEqual(list(names(ast.parse("class A:\n    'a'\n    def b(self): pass\n    def _c(self): pass"), "")), ["A.b"], "control")

    def test_the_sources_of_the_package_are_typed(self):
        output(sys.executable, "-m", "mypy", "--strict", "--python-executable", self.python, "-p", "starloop", cwd=self.work)


if __name__ == "__main__":
    unittest.main()
