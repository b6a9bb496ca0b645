"""Loops in C beside the peers: from peers_loop import LOOPS

`CLoop` draws every star at every position and plans nothing; its noise is one Gaussian per pixel. `Avx2` and `Avx512` are the bound
of images without motion and of their noise, by hand for one vector level each. The tables show how near starloop is to them.
"""

import ctypes
import os
import pathlib
import platform
import shutil
import subprocess
import tempfile

import numpy as np
from peers import Cannot, patterns, reach_px

SOURCE = pathlib.Path(__file__).with_name("peers_loop.c")
BOUND = pathlib.Path(__file__).with_name("peers_bound.c")
BOUND_NOISE = pathlib.Path(__file__).with_name("peers_bound_noise.c")
LANES = 16
"""Pixels that the loop adds at a time: no star may be wider."""
COMMON = ["-O3", "-ffast-math", "-fopenmp", "-shared", "-fPIC"]
FLAGS = [*COMMON, "-march=native", "-mprefer-vector-width=512", f"-DLANES={LANES}"]


def build(folder, compiler="cc", source=SOURCE, given=FLAGS):
    """Compiles a loop into a folder; the second try is without the flag that only x86 processors have."""
    if shutil.which(compiler) is None:
        raise Cannot(f"a C compiler is missing here ({compiler})")
    library = pathlib.Path(folder) / f"{source.stem}.so"
    for flags in (given, [flag for flag in given if "vector-width" not in flag]):
        command = [compiler, *flags, str(source), "-o", str(library), "-lm"]
        done = subprocess.run(command, capture_output=True, text=True, check=False)
        if done.returncode == 0:
            return ctypes.CDLL(str(library))
    raise Cannot(f"{compiler} does not compile {source.name}: {(done.stderr.strip().splitlines() or ['no message'])[-1]}")


def pointer(array):
    return ctypes.c_void_p(array.ctypes.data)


def image_of(scene):
    """An image with a whole vector more at its right edge."""
    if 2 * reach_px(scene) + 1 > LANES - 1:
        raise Cannot(f"a star is wider than {LANES - 1} px")
    return np.zeros((scene.size_px, scene.size_px + LANES), np.float32)


class CLoop:
    """The loop, with all threads."""

    name, package = "C loop", None
    motion, threads = "loop over positions", "all"

    def __init__(self):
        with tempfile.TemporaryDirectory() as folder:
            self.library = build(folder)
        self.threads = len(os.sched_getaffinity(0))

    def prepare(self, scene):
        size, reach, bands = scene.size_px, reach_px(scene), 8 * self.threads
        columns = [np.ascontiguousarray(v, np.float64) for v in (scene.x, scene.y, scene.electrons, scene.path)]
        image = image_of(scene)
        x, y, electrons, path = map(pointer, columns)
        sigma = ctypes.c_double(scene.sigma_px)

        def draw():
            counts = len(columns[0]), path, len(columns[3])
            self.library.draw(pointer(image), size, size + LANES, x, y, electrons, *counts, sigma, reach, bands)
            return image[:, :size]

        return draw

    def noise(self, scene):
        return noise_of(self.library.add_noise, scene)


def noise_of(function, scene):
    """The noise of a loop: a mean image in, digital numbers out."""
    prnu, dsnu = (np.ascontiguousarray(one, np.float32) for one in patterns(scene))
    size, out = scene.size_px, np.zeros(prnu.shape, np.uint16)
    numbers = [ctypes.c_float(v) for v in (scene.dark_e, scene.read_noise_e, scene.gain_e_per_dn, scene.black_dn)]

    def add(mean):
        stride = mean.strides[0] // mean.itemsize
        function(pointer(mean), size, stride, pointer(prnu), pointer(dsnu), *numbers, ctypes.c_uint32(1), pointer(out))
        return out

    return add


class Bound:
    """The bound of one vector level, with all threads."""

    package, motion = None, "no motion"

    def __init__(self):
        if platform.machine() != "x86_64":
            raise Cannot("the bound is for x86-64")
        with tempfile.TemporaryDirectory() as folder:
            self.library = build(folder, source=BOUND, given=COMMON)
            if not self.library.has_level(self.level):
                raise Cannot(f"this processor lacks {self.name}")
            self.detector = build(folder, source=BOUND_NOISE, given=[*COMMON, f"-march=x86-64-v{self.level}"])
        self.threads = len(os.sched_getaffinity(0))

    def prepare(self, scene):
        if len(scene.path) > 1:
            raise Cannot("the bound is of images without motion")
        image, size = image_of(scene), scene.size_px
        columns = [np.ascontiguousarray(v, np.float64) for v in (scene.x + scene.path[0, 0], scene.y + scene.path[0, 1], scene.electrons)]
        x, y, electrons = map(pointer, columns)
        sigma = ctypes.c_double(scene.sigma_px)

        def draw():
            stars = x, y, electrons, len(columns[0])
            self.library.bound(self.level, pointer(image), size, size + LANES, *stars, sigma, reach_px(scene), self.threads)
            return image[:, :size]

        return draw

    def noise(self, scene):
        block = 2 * self.detector.lanes()
        if scene.size_px % block:
            raise Cannot(f"the bound makes {block} pixels at a time")
        return noise_of(self.detector.bound_noise, scene)


class Avx2(Bound):
    name, level = "bound V3", 3


class Avx512(Bound):
    name, level = "bound V4", 4


LOOPS = [CLoop, Avx2, Avx512]
