"""Tests of `starloop keys`, `schema` and `init`: python3 hil_scripts/tests/test_keys.py

Every shipped configuration is valid by the schema of its kind, by another program's validator; what the program refuses
the schema refuses too, as far as one key says it. Needs jsonschema.
"""

import json
import tomllib
import unittest

import jsonschema

from support import ROOT, InAFolder, starloop

FOLDERS = {
    "bench": "benches",
    "scenario": "scenarios",
    "camera": "cameras",
    "link": "links",
    "spacecraft": "spacecraft",
}
CAMERA = "[detector]\nwidth_px = 64\nheight_px = 64\n[optics]\nfocal_length_mm = 50\n"


def printed(*words):
    return starloop(*words, status=0).stdout


def validator(kind):
    schema = json.loads(printed("schema", kind))
    jsonschema.Draft202012Validator.check_schema(schema)
    return jsonschema.Draft202012Validator(schema)


def problems(kind, text):
    return [error.message for error in validator(kind).iter_errors(tomllib.loads(text))]


class Schema(InAFolder):
    def test_every_shipped_file_is_valid(self):
        for kind, folder in FOLDERS.items():
            by_schema = validator(kind)
            files = sorted((ROOT / "configs" / folder).glob("*.toml"))
            self.assertGreater(len(files), 1, folder)
            for file in files:
                errors = [error.message for error in by_schema.iter_errors(tomllib.loads(file.read_text()))]
                self.assertEqual(errors, [], file.name)

    def test_wrong_values_are_refused(self):
        self.assertEqual(problems("camera", CAMERA), [])
        for kind, text, part in [
            ("camera", CAMERA + "focal_lenght_mm = 25\n", "focal_lenght_mm"),
            ("camera", CAMERA.replace("64", "0"), "minimum"),
            ("camera", CAMERA + '[radiometry]\nmodel = "linear_gray"\n', "linear_gray"),
            ("camera", CAMERA.replace("focal_length_mm = 50", ""), "focal_length_mm"),
            ("camera", CAMERA + "[exposure]\nexposure_s = 0\n", "minimum"),
            ("bench", "[timing]\nframe_rate_hz = 20000.0\n", "maximum"),
            ("bench", '[sink]\nkind = "null"\nfits = true\n', "not valid"),
            ("bench", '[link]\nkind = "canopen"\n', "not valid"),
            ("bench", "nonsense = 1\n", "nonsense"),
            ("scenario", 'bench = "a.toml"\n', "required"),
            ("link", 'parity = "mark"\n', "mark"),
            ("spacecraft", "[body]\ninertia_kg_m2 = [1.0, 2.0]\n", "not of type"),
        ]:
            self.assertTrue(any(part in problem for problem in problems(kind, text)), (text, problems(kind, text)))

    def test_the_program_refuses_the_same(self):
        file = self.folder / "bench.toml"
        for text in ["nonsense = 1\n", "[timing]\nframe_rate_hz = 20000.0\n", '[sink]\nkind = "null"\nfits = true\n']:
            file.write_text(text)
            self.assertEqual(starloop("check", str(file)).returncode, 1, text)


class Printed(InAFolder):
    def test_the_guide_has_the_reference(self):
        self.assertEqual(printed("keys"), (ROOT / "src/guide/keys.md").read_text())
        self.assertIn("`exposure_s`", printed("keys", "camera"))
        self.assertNotIn("`exposure_s`", printed("keys", "link"))

    def test_templates_are_valid_and_are_checked(self):
        for kind in FOLDERS:
            self.assertEqual(problems(kind, printed("init", kind)), [], kind)
            (self.folder / f"{kind}.toml").write_text(printed("init", kind))
        (self.folder / "over.toml").write_text('camera = "camera.toml"\nlink = "link.toml"\n')
        for bench in ["bench.toml", "over.toml"]:
            starloop("check", "--built-in-costs", str(self.folder / bench), status=0)

    def test_a_kind_that_is_none_is_refused(self):
        self.assertEqual(starloop("schema", "benches").returncode, 2)


if __name__ == "__main__":
    unittest.main()
