"""cedar-solve with the aberration of light as a tracker under test: cedar_tracker.py FRAMES CAMERA LOG [--aberration]

As hil_scripts/trackers/cedar_solve.py, with one more option: cedar-solve's catalog places are not those that a moving observer
sees; --aberration takes the Earth's velocity into account, which cedar-solve itself does not.

Needs cedar-solve (PyPI), which brings numpy, scipy, Pillow and its database for fields of 10 to 30 degrees.
"""

import contextlib
import logging
import math
import os
import sys
from datetime import datetime, timezone
from pathlib import Path

import numpy

sys.path.append(str(Path(__file__).resolve().parents[1] / "trackers"))

from adapter import Camera, answer, parser, spots  # noqa: E402, F401 - found by the line above


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


def attitude_of(tetra, camera, pixels, timeout_ms, when=None):
    """Returns the attitude of an image and its number of stars, or None; `when` corrects for the Earth's velocity."""
    places = spots(pixels)
    if len(places) < 4:
        return None
    found = matched(tetra, camera, camera.undistorted(places), timeout_ms)
    if found["RA"] is None:
        return None
    rows = matrix(found["RA"], found["Dec"], -found["Roll"])
    return quaternion(rows if when is None else corrected(rows, earth_velocity(when))), found["Matches"]


def solve(tetra, image, given):
    """Returns attitude and stars of one image; nothing where there is none."""
    when = datetime.fromisoformat(image.header["T-MID"].replace("Z", "")[:26]).replace(tzinfo=timezone.utc)
    found = attitude_of(tetra, image.camera, image.pixels, given.timeout_ms, when if given.aberration else None)
    return found and [*(f"{value:.12f}" for value in found[0]), found[1]]


def main():
    arguments = parser(__doc__.splitlines()[0])
    arguments.add_argument("--aberration", action="store_true", help="correct for the Earth's velocity")
    arguments.add_argument("--timeout-ms", type=float, default=2000.0, help="longest search for one image")
    given = arguments.parse_args()
    tetra = solver()
    answer(lambda image: solve(tetra, image, given), "q_w,q_x,q_y,q_z,stars", given)


if __name__ == "__main__":
    main()
