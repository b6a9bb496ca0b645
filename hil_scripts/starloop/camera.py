"""Cameras that draw single images, and frames."""

from __future__ import annotations

import datetime
import functools
import json
import os
import tempfile
from typing import Any, Dict, List, Mapping, Optional, Sequence, Union

import numpy
import numpy.typing

from . import _native
from .client import toml_value
from .program import report

Rows = Union[Sequence[Sequence[float]], "numpy.typing.NDArray[Any]"]
Instant = Union[str, datetime.datetime]


class Frame:
    """One image with its truth and its facts."""

    def __init__(self, native: _native.Frame):
        self._native = native

    @property
    def image(self) -> "numpy.typing.NDArray[Any]":
        """Pixels, shape (height, width): digital numbers (uint16), or mean electrons of `stage="electrons"`."""
        return self._native.pixels

    @functools.cached_property
    def truth(self) -> "numpy.typing.NDArray[Any]":
        """Structured array with a row for each source in the image: id, x_px, y_px, electrons, mag_g, apparent_ra_deg ..."""
        columns = self._native.truth()
        arrays = {name: numpy.asarray(column) for name, column in columns.items()}
        table = numpy.empty(len(arrays["id"]), dtype=[(name, array.dtype) for name, array in arrays.items()])
        for name, array in arrays.items():
            table[name] = array
        return table

    @functools.cached_property
    def meta(self) -> Dict[str, Any]:
        """Facts of the frame: ra_deg, attitude_wxyz, exposure_s, gain_e_per_dn, method ..., by the keys of the control socket."""
        facts: Dict[str, Any] = json.loads(self._native.meta())
        return facts

    @property
    def header(self) -> str:
        """Cards of the FITS header, 80 characters each: `astropy.io.fits.Header.fromstring(frame.header)`."""
        return self._native.header()

    @property
    def wcs(self) -> Any:
        """The map from pixels to the sky as an `astropy.wcs.WCS`; needs astropy."""
        from astropy.io import fits  # type: ignore[import-untyped, import-not-found, unused-ignore]
        from astropy.wcs import WCS  # type: ignore[import-untyped, import-not-found, unused-ignore]

        return WCS(fits.Header.fromstring(self.header))

    def __repr__(self) -> str:
        return f"<starloop.Frame {self.image.shape[1]} x {self.image.shape[0]} {self.image.dtype}>"


class Camera:
    """A camera: a file, the name of a built-in one, or a dict with the tables of a camera file.

    >>> camera = Camera("cameras/small_tracker.toml")
    >>> camera.render(ra=10, dec=20).image.shape
    (256, 256)
    """

    def __init__(self, source: Union[str, "os.PathLike[str]", Mapping[str, Any]], *, folder: str = "."):
        self._file: Optional[str] = None
        if isinstance(source, Mapping):
            self._text, self._folder = toml_text(source), folder
            self._native = _native.Camera.parse(self._text, folder)
        else:
            self._file = os.fspath(source)
            self._native = _native.Camera.open(self._file)
        facts = json.loads(self._native.facts())
        self.name: str = facts["name"]
        """Its name."""
        self.size_px: tuple[int, int] = (facts["width_px"], facts["height_px"])
        """Columns and rows of the detector."""
        self.fov_deg: tuple[float, float] = tuple(facts["fov_deg"])
        """Field of view, full angles."""
        self.exposure_s: float = facts["exposure_s"]
        """Exposure time."""

    def render(
        self,
        attitude: Optional[Sequence[float]] = None,
        time: Optional[Instant] = None,
        *,
        ra: Optional[float] = None,
        dec: Optional[float] = None,
        roll: float = 0.0,
        rate: Optional[Sequence[float]] = None,
        los: Optional[Rows] = None,
        sources: Optional[Rows] = None,
        observer: Optional[Mapping[str, Any]] = None,
        bodies: bool = False,
        targets: Sequence[Mapping[str, Any]] = (),
        faults: Sequence[Mapping[str, Any]] = (),
        bench: Optional[Mapping[str, Any]] = None,
        seed: int = 1,
        noise_seed: Optional[int] = None,
        frame: int = 0,
        stage: str = "dn",
        backend: str = "auto",
        method: str = "auto",
    ) -> Frame:
        """Draws one image; the bits are those of `starloop render`.

        `attitude` is w, x, y, z of sensor_from_icrf, or give `ra`, `dec` and `roll` in degrees. `time` is the middle of the
        exposure (RFC 3339 text or a datetime with a zone). `rate` is in sensor axes, deg/s. `los` has rows of t_s, dx_px,
        dy_px, roll_arcsec; `sources` rows of x_px, y_px, electrons in place of the sky. `observer`, `targets` and `faults`
        have the keys of the tables [observer], [[target]] and [[event]] of a run file; `bench` any other tables. `frame` and
        the seeds fix the noise. `stage` is "dn" or "electrons". Raises ValueError with the reason.
        """
        return Frame(self._native.render(self._keywords(**{k: v for k, v in locals().items() if k != "self"})))

    def plan(self, attitude: Optional[Sequence[float]] = None, time: Optional[Instant] = None, **keywords: Any) -> Dict[str, Any]:
        """Returns what the planner chose for an image: method, stars, predicted_ms, planning_ms, is_within_budget, backend.

        Takes the keywords of `render`.
        """
        given: Dict[str, Any] = {"ra": None, "dec": None, "roll": 0.0, "rate": None, "los": None, "sources": None, "observer": None}
        given |= {"bodies": False, "targets": (), "faults": (), "bench": None, "seed": 1, "noise_seed": None, "frame": 0}
        given |= {"stage": "dn", "backend": "auto", "method": "auto", "attitude": attitude, "time": time, **keywords}
        chosen: Dict[str, Any] = json.loads(self._native.plan(self._keywords(**given)))
        return chosen

    def snr(self, *options: str) -> Dict[str, Any]:
        """Returns the report of `starloop snr` on this camera: signal-to-noise ratio by magnitude, limits, saturation.

        `options` are those of the command, such as "--bp-rp", "1.5".
        """
        return self._report("snr", options)

    def psf(self, *options: str) -> Dict[str, Any]:
        """Returns the report of `starloop psf` on this camera: width, encircled energy, MTF; `options` as for the command."""
        return self._report("psf", options)

    def verify(self, *options: str) -> Dict[str, Any]:
        """Returns the report of `starloop verify`: the camera's own frames compared with its file (EMVA 1288).

        `options` are those of the command, such as "--frames", "100". `holds` of a line is false where the frames differ.
        """
        return self._report("verify", options)

    def _report(self, command: str, options: Sequence[str]) -> Dict[str, Any]:
        if self._file is not None:
            return report(command, self._file, options)
        with tempfile.NamedTemporaryFile("w", suffix=".toml", dir=self._folder) as file:
            file.write(self._text)
            file.flush()
            return report(command, file.name, options)

    @staticmethod
    def _keywords(
        attitude: Any, time: Any, ra: Any, dec: Any, roll: Any, rate: Any, los: Any, sources: Any, observer: Any, bodies: Any,
        targets: Any, faults: Any, bench: Any, seed: Any, noise_seed: Any, frame: Any, stage: Any, backend: Any, method: Any,
    ) -> str:  # fmt: skip
        tables: Dict[str, Any] = {key: dict(table) if isinstance(table, Mapping) else table for key, table in (bench or {}).items()}
        if observer is not None:
            tables["observer"] = dict(observer)
        if bodies:
            tables["sky"] = {**tables.get("sky", {}), "bodies": True}
        if targets:
            tables["target"] = [dict(target) for target in targets]
        tables["render"] = {**tables.get("render", {}), "backend": backend, "method": method}
        if (ra is None) != (dec is None):
            raise ValueError("ra and dec: got one of them, wanted both")
        request: Dict[str, Any] = {
            "frame": frame,
            "stage": stage,
            "scene": {"bench": tables, "faults": [dict(fault) for fault in faults], "seed": seed, "noise_seed": noise_seed},
        }
        if attitude is not None:
            request["attitude"] = _numbers(attitude)
        if ra is not None:
            request["pointing_deg"] = [float(ra), float(dec), float(roll)]
        if time is not None:
            request["time"] = time.isoformat() if isinstance(time, datetime.datetime) else str(time)
        if rate is not None:
            request["rate_deg_s"] = _numbers(rate)
        for name, rows in (("los", los), ("sources", sources)):
            if rows is not None:
                request[name] = [_numbers(row) for row in rows]
        return json.dumps(request)

    def __repr__(self) -> str:
        return f"<starloop.Camera {self.name!r} {self.size_px[0]} x {self.size_px[1]} px>"


def _numbers(row: Any) -> List[float]:
    return [float(number) for number in row]


def toml_text(tables: Mapping[str, Any]) -> str:
    """Returns the text of a file with these keys and tables."""
    plain = json.loads(json.dumps(tables, default=dict))
    return "".join(f"{key} = {toml_value(value)}\n" for key, value in plain.items())
