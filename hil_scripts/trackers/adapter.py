"""Shared by the adapters of this folder, which `starloop fly` starts as trackers: ADAPTER FRAMES CAMERA LOG

FRAMES is a folder of FITS images, CAMERA the camera file that drew them, LOG the table to write for `starloop report`. An
adapter calls `answer` with a function that takes an Image and returns the tracker's own numbers, or nothing. The camera
file gives what a calibration would. Each image is solved alone; nothing of the truth in its header is used.

Needs numpy; `Image.spots` scipy.
"""

import argparse
import math
import socket
import struct
import subprocess
import sys
import tempfile
import tomllib
import zlib
from pathlib import Path

import numpy

CARD = 80
BLOCK = 2880
SIGMAS = 5.0
"""A spot's pixels are so many times the noise above the background."""
BRIGHTEST = 30
"""Most spots, the brightest."""
GREYS_PER_SIGMA = 2.0
GREY_OF_BACKGROUND = 16.0
"""The scale of 8-bit images: linear from the background, in steps of the noise."""


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
        self.focal_mm = optics["focal_length_mm"]
        self.pixel_um = detector["pixel_pitch_um"] * binning
        self.focal_px = self.focal_mm * 1e3 / self.pixel_um
        distortion = file.get("distortion", {})
        self.k = [distortion.get(name, 0.0) for name in ("k1", "k2", "k3")]
        self.p = [distortion.get(name, 0.0) for name in ("p1", "p2")]
        self.centre = numpy.array([0.5 * (self.width - 1), 0.5 * (self.height - 1)])
        self.fov_deg = math.degrees(2 * math.atan(0.5 * self.width / self.focal_px))

    def of_tetra3rs(self, tetra3rs):
        """Returns the camera model of tetra3rs, whose distortion is that of places in pixels from the centre."""
        names, powers = ("k1", "k2", "k3", "p1", "p2"), (2, 4, 6, 1, 1)
        distortion = {name: value / self.focal_px**power for name, value, power in zip(names, [*self.k, *self.p], powers)}
        distortion = tetra3rs.RadialDistortion(**distortion)
        return tetra3rs.CameraModel(self.focal_px, self.width, self.height, distortion=distortion)

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
    noise = noise_of(light)
    smooth = ndimage.uniform_filter(light, 3)
    marked, count = ndimage.label(smooth > SIGMAS * noise / 3)
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


def noise_of(light):
    """Returns the standard deviation of pixels without stars, 0.3 at least."""
    return max(1.4826 * numpy.median(numpy.abs(light - numpy.median(light))), 0.3)


def write_png(path, grey):
    """Writes 8-bit greys as a PNG file."""

    def chunk(name, data):
        return struct.pack(">I", len(data)) + name + data + struct.pack(">I", zlib.crc32(name + data))

    height, width = grey.shape
    rows = numpy.hstack([numpy.zeros((height, 1), numpy.uint8), grey]).tobytes()
    header = struct.pack(">IIBBBBB", width, height, 8, 0, 0, 0, 0)
    parts = chunk(b"IHDR", header), chunk(b"IDAT", zlib.compress(rows, 1)), chunk(b"IEND", b"")
    Path(path).write_bytes(b"\x89PNG\r\n\x1a\n" + b"".join(parts))


class Image:
    """One image, with its camera."""

    def __init__(self, path, camera_file, folder):
        self.path, self._folder = path, folder
        self.header, self.pixels = read_fits(path)
        self.camera = Camera(camera_file, self.pixels.shape)

    def spots(self):
        return spots(self.pixels)

    @property
    def png(self):
        """The path of an 8-bit image: one beside the FITS file, or one made with the linear scale above."""
        beside = self.path.with_suffix(".png")
        if beside.exists():
            return str(beside)
        path = Path(self._folder, beside.name)
        light = self.pixels - numpy.median(self.pixels)
        grey = GREY_OF_BACKGROUND + GREYS_PER_SIGMA / noise_of(light) * light
        write_png(path, numpy.clip(numpy.round(grey), 0, 255).astype(numpy.uint8))
        return str(path)


def said(*words, **options):
    """Runs a program; returns its lines of two words as a dictionary."""
    done = subprocess.run([str(word) for word in words], check=True, stdout=subprocess.PIPE, text=True, **options)
    return dict(pair for pair in map(str.split, done.stdout.splitlines()) if len(pair) == 2)


def asked(port, text):
    """Sends a text to a server of this machine; returns its answer."""
    with socket.create_connection(("127.0.0.1", port)) as line:
        line.sendall(text.encode())
        return line.recv(4096).decode()


def parser(about):
    """Returns the parser of an adapter's command line."""
    made = argparse.ArgumentParser(description=about)
    for name in ("frames", "camera", "log"):
        made.add_argument(name, type=Path)
    return made


def answer(solve, columns, given=None, **remarks):
    """Solves every image and writes the log: remarks such as roll or axes, then a row with `columns` for each image."""
    given = given or parser("A star tracker for starloop fly").parse_args()
    images = sorted(given.frames.glob("*.fits"))
    if not images:
        sys.exit(f"{Path(sys.argv[0]).name}: {given.frames} has no FITS image; wanted the folder of a recorded run")
    lines = [f"# {name}: {value}" for name, value in remarks.items()] + [f"frame,utc,{columns}"]
    empty = [None] * len(columns.split(","))
    with tempfile.TemporaryDirectory() as folder:
        for path in images:
            image = Image(path, given.camera, folder)
            found = solve(image)
            cells = [image.header["FRAME"], image.header["T-MID"], *(empty if found is None else found)]
            lines.append(",".join("" if cell is None else str(cell) for cell in cells))
    given.log.write_text("\n".join([*lines, ""]))
