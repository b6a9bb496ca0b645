"""cedar-solve on the images of a data set, each lost in space: cedar_data_set.py FOLDER CAMERA OUT.json

FOLDER is a data set of PNG images, CAMERA the camera file that drew them. OUT.json gets a list with one entry for each image:
item, attitude (w, x, y, z) or null, and the stars that cedar-solve matched: place in the image (x, y; first centre 0) and
Hipparcos number. Runs in the environment of cedar_tracker.py.
"""

import json
import sys
from pathlib import Path

import numpy
from cedar_tracker import Camera, matched, matrix, quaternion, solver, spots
from PIL import Image

TIMEOUT_MS = 4000.0


def solve(tetra, path, camera_file):
    """Returns the entry of one image."""
    image = numpy.asarray(Image.open(path)).astype(float)
    camera = Camera(camera_file, image.shape)
    places = spots(image)
    entry = {"item": int(path.stem), "attitude": None, "matched": [], "spots": len(places)}
    if len(places) < 4:
        return entry
    ideal = camera.undistorted(places)
    found = matched(tetra, camera, ideal, TIMEOUT_MS, return_matches=True)
    if found["RA"] is None:
        return entry
    entry["attitude"] = quaternion(matrix(found["RA"], found["Dec"], -found["Roll"]))
    for (y, x), number in zip(found["matched_centroids"], found["matched_catID"]):
        # The place in the image of the centroid that was given.
        nearest = numpy.hypot(ideal[:, 0] + 0.5 - x, ideal[:, 1] + 0.5 - y).argmin()
        entry["matched"].append([*places[nearest].tolist(), int(number)])
    return entry


def main():
    folder, camera, out = map(Path, sys.argv[1:])
    tetra = solver()
    entries = [solve(tetra, path, camera) for path in sorted(folder.glob("images/*/*.png"))]
    out.write_text(json.dumps(entries))


if __name__ == "__main__":
    main()
