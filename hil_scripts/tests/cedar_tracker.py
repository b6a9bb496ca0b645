"""cedar-solve as a star tracker under test: cedar_tracker.py FRAMES CAMERA LOG

FRAMES is a folder of FITS images, CAMERA the camera file that drew them, LOG the table to write for `starloop report`.
Every image is solved alone, lost in space. The camera file gives what a calibration would: focal length and distortion.
Attitudes are cedar-solve's own right ascension, declination and roll. Its catalog places are not those that a moving
observer sees; --aberration takes the Earth's velocity into account, which cedar-solve itself does not.

Needs cedar-solve (PyPI), which brings numpy, scipy, Pillow and its database for fields of 10 to 30 degrees.
"""

import argparse
import contextlib
import logging
import math
import os
import sys
import tomllib
from datetime import datetime, timezone
from pathlib import Path

import numpy

CARD = 80
BLOCK = 2880
SIGMAS = 5.0
"""A spot's pixels are so many times the noise above the background."""
BRIGHTEST = 30
"""Spots that are given to cedar-solve."""


def read_fits(path):
    """Returns header and pixels of the first image of a FITS file of 16-bit whole numbers."""
    data = Path(path).read_bytes()
    header, place = {}, 0
    while True:
        card = data[place : place + CARD].decode("ascii")
        place += CARD
        if card.rstrip() == "END":
            break
        if card[8:10] == "= ":
            value = card[10:].split("'")[1] if card[10:].lstrip().startswith("'") else card[10:].split("/")[0]
            header[card[:8].strip()] = value.strip()
    place = -(-place // BLOCK) * BLOCK
    if header["BITPIX"] != "16":
        raise ValueError(f"{path}: got BITPIX {header['BITPIX']}, wanted 16")
    shape = (int(header["NAXIS2"]), int(header["NAXIS1"]))
    stored = numpy.frombuffer(data, ">i2", shape[0] * shape[1], place).reshape(shape)
    return header, stored.astype(float) + float(header.get("BZERO", 0))


class Camera:
    """Geometry of a camera file: focal length in pixels of the image, distortion, principal point."""

    def __init__(self, path, size):
        file = tomllib.loads(Path(path).read_text())
        detector, optics = file["detector"], file["optics"]
        self.height, self.width = size
        binning = detector.get("binning", {}).get("factor", 1)
        self.focal_px = optics["focal_length_mm"] * 1e3 / detector["pixel_pitch_um"] / binning
        distortion = file.get("distortion", {})
        self.k = [distortion.get(name, 0.0) for name in ("k1", "k2", "k3")]
        self.p = [distortion.get(name, 0.0) for name in ("p1", "p2")]
        self.centre = numpy.array([0.5 * (self.width - 1), 0.5 * (self.height - 1)])
        self.fov_deg = math.degrees(2 * math.atan(0.5 * self.width / self.focal_px))

    def undistorted(self, places):
        """Returns places (x, y; first centre 0) where an ideal camera has them."""
        seen = (places - self.centre) / self.focal_px
        ideal = seen.copy()
        for _ in range(20):
            x, y = ideal.T
            r2 = x * x + y * y
            radial = 1 + r2 * (self.k[0] + r2 * (self.k[1] + r2 * self.k[2]))
            p1, p2 = self.p
            shift = numpy.stack([2 * p1 * x * y + p2 * (r2 + 2 * x * x), p1 * (r2 + 2 * y * y) + 2 * p2 * x * y], 1)
            ideal = (seen - shift) / radial[:, None]
        return ideal * self.focal_px + self.centre


def spots(image):
    """Returns the places (x, y) of the brightest spots, by the centre of gravity of their pixels."""
    from scipy import ndimage

    # The median of every fourth pixel of each direction, which is enough for a smooth background.
    coarse = ndimage.median_filter(image[2::4, 2::4], size=9)
    rows, columns = (numpy.clip((numpy.arange(size) - 2) / 4, 0, None) for size in image.shape)
    grid = numpy.meshgrid(rows, columns, indexing="ij")
    background = ndimage.map_coordinates(coarse, grid, order=1, mode="nearest")
    light = image - background
    noise = 1.4826 * numpy.median(numpy.abs(light - numpy.median(light)))
    smooth = ndimage.uniform_filter(light, 3)
    marked, count = ndimage.label(smooth > SIGMAS * max(noise, 0.3) / 3)
    found = []
    for number, window in enumerate(ndimage.find_objects(marked), 1):
        rows, columns = (slice(max(part.start - 1, 0), min(part.stop + 1, size)) for part, size in zip(window, image.shape))
        part = numpy.where(
            (marked[rows, columns] == number) | (marked[rows, columns] == 0), numpy.clip(light[rows, columns], 0, None), 0
        )
        total = part.sum()
        if total <= 0 or part.shape[0] > 25 or part.shape[1] > 25:
            continue
        y, x = numpy.mgrid[rows, columns]
        found.append((total, (x * part).sum() / total, (y * part).sum() / total))
    found.sort(reverse=True)
    return numpy.array([place[1:] for place in found[:BRIGHTEST]]).reshape(-1, 2)


def earth_velocity(when):
    """Velocity of the Earth over that of light, ICRF axes, from its mean orbit: good to a percent."""
    days = (when - datetime(2000, 1, 1, 12, tzinfo=timezone.utc)).total_seconds() / 86400
    anomaly = math.radians(357.528 + 0.9856003 * days)
    longitude = math.radians(280.46 + 0.9856474 * days + 1.915 * math.sin(anomaly) + 0.02 * math.sin(2 * anomaly))
    beta, e, perihelion = 9.9365e-5, 0.01671, math.radians(282.94)
    # Perpendicular to the direction of the Sun, and a constant part by the orbit's eccentricity.
    along = [math.sin(longitude) - e * math.sin(perihelion), -math.cos(longitude) + e * math.cos(perihelion)]
    tilt = math.radians(23.4393)
    return beta * numpy.array([along[0], along[1] * math.cos(tilt), along[1] * math.sin(tilt)])


def matrix(ra_deg, dec_deg, roll_deg):
    """Rows: the sensor's axes x right, y down, z boresight in ICRF axes; roll is the position angle of image up."""
    ra, dec, roll = (math.radians(angle) for angle in (ra_deg, dec_deg, roll_deg))
    z = numpy.array([math.cos(dec) * math.cos(ra), math.cos(dec) * math.sin(ra), math.sin(dec)])
    east = numpy.array([-math.sin(ra), math.cos(ra), 0.0])
    north = numpy.cross(z, east)
    up = math.cos(roll) * north + math.sin(roll) * east
    y = -up
    return numpy.stack([numpy.cross(y, z), y, z])


def quaternion(rows):
    """The quaternion w, x, y, z of v_sensor = q v_icrf q*, for a matrix v_sensor = rows v_icrf."""
    from scipy.spatial.transform import Rotation

    x, y, z, w = Rotation.from_matrix(rows).as_quat()
    return w, x, y, z


def corrected(rows, beta):
    """The attitude of a moving observer, where the given one was found from stars at their catalog places."""
    catalog = rows[2]
    # The star of this catalog place is seen on the boresight, and so is the boresight's own direction.
    true = catalog + (beta - catalog * (catalog @ beta))
    true /= numpy.linalg.norm(true)
    turn = numpy.cross(true, catalog)
    # A small turn that takes the true direction to the catalog's comes first.
    cross = numpy.array([[0, -turn[2], turn[1]], [turn[2], 0, -turn[0]], [-turn[1], turn[0], 0]])
    u, _, v = numpy.linalg.svd(rows @ (numpy.eye(3) + cross))
    return u @ v


def arguments():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("frames", type=Path)
    parser.add_argument("camera", type=Path)
    parser.add_argument("log", type=Path)
    parser.add_argument("--aberration", action="store_true", help="correct for the Earth's velocity")
    parser.add_argument("--timeout-ms", type=float, default=2000.0, help="longest search for one image")
    return parser.parse_args()


def solver():
    """Returns cedar-solve, which says nothing."""
    logging.disable(logging.CRITICAL)
    with contextlib.redirect_stdout(open(os.devnull, "w")):
        from tetra3 import Tetra3

        return Tetra3()


def matched(tetra, camera, ideal, timeout_ms, **more):
    """Returns what cedar-solve finds for places (x, y; first centre 0) of an ideal camera."""
    # Its rows come first, and its first pixel's centre is at 0.5.
    return tetra.solve_from_centroids(
        ideal[:, ::-1] + 0.5,
        (camera.height, camera.width),
        fov_estimate=camera.fov_deg,
        fov_max_error=0.05 * camera.fov_deg,
        solve_timeout=timeout_ms,
        distortion=None,
        **more,
    )


def attitude_of(tetra, camera, image, timeout_ms, when=None):
    """Returns the attitude of an image and its number of stars, or None; `when` corrects for the Earth's velocity."""
    places = spots(image)
    if len(places) < 4:
        return None
    found = matched(tetra, camera, camera.undistorted(places), timeout_ms)
    if found["RA"] is None:
        return None
    rows = matrix(found["RA"], found["Dec"], -found["Roll"])
    return quaternion(rows if when is None else corrected(rows, earth_velocity(when))), found["Matches"]


def solve(tetra, path, given):
    """Returns the row of one image: number, time, attitude or nothing, stars."""
    header, image = read_fits(path)
    number, utc = header["FRAME"], header["T-MID"]
    when = datetime.fromisoformat(utc.replace("Z", "")[:26]).replace(tzinfo=timezone.utc)
    found = attitude_of(tetra, Camera(given.camera, image.shape), image, given.timeout_ms, when if given.aberration else None)
    if found is None:
        return [number, utc, "", "", "", "", ""]
    return [number, utc, *(f"{value:.12f}" for value in found[0]), str(found[1])]


def main():
    given = arguments()
    images = sorted(given.frames.glob("*.fits"))
    if not images:
        sys.exit(f"cedar_tracker.py: {given.frames} has no FITS image; wanted the folder of a recorded run")
    tetra = solver()
    lines = [",".join(solve(tetra, path, given)) for path in images]
    given.log.write_text("\n".join(["frame,utc,q_w,q_x,q_y,q_z,stars", *lines, ""]))


if __name__ == "__main__":
    main()
