"""A brute-force loop in C, compiled for this processor, as a bound beside the peers: from peers_loop import CLoop

It draws every star at every position and plans nothing. Its noise is one Gaussian per pixel. The table of ratios shows how near
starloop is to such a loop without motion, and how far ahead with motion.
"""

import ctypes
import os
import pathlib
import shutil
import subprocess
import tempfile

import numpy as np
from peers import Cannot, patterns, reach_px

SOURCE = pathlib.Path(__file__).with_name("peers_loop.c")
LANES = 16
"""Pixels that the loop adds at a time: no star may be wider."""
FLAGS = ["-O3", "-march=native", "-mprefer-vector-width=512", "-ffast-math", "-fopenmp", "-shared", "-fPIC", f"-DLANES={LANES}"]


def build(folder, compiler="cc"):
    """Compiles the loop into a folder; the second try is without the flag that only x86 processors have."""
    if shutil.which(compiler) is None:
        raise Cannot(f"a C compiler is missing here ({compiler})")
    library = pathlib.Path(folder) / "peers_loop.so"
    for flags in (FLAGS, [flag for flag in FLAGS if "vector-width" not in flag]):
        command = [compiler, *flags, str(SOURCE), "-o", str(library), "-lm"]
        done = subprocess.run(command, capture_output=True, text=True, check=False)
        if done.returncode == 0:
            return ctypes.CDLL(str(library))
    raise Cannot(f"{compiler} does not compile the loop: {(done.stderr.strip().splitlines() or ['no message'])[-1]}")


def pointer(array):
    return ctypes.c_void_p(array.ctypes.data)


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
        if 2 * reach + 1 > LANES:
            raise Cannot(f"a star is wider than {LANES} px")
        image = np.zeros((size, size + LANES), np.float32)
        columns = [np.ascontiguousarray(v, np.float64) for v in (scene.x, scene.y, scene.electrons, scene.path)]
        x, y, electrons, path = map(pointer, columns)
        sigma = ctypes.c_double(scene.sigma_px)

        def draw():
            counts = len(columns[0]), path, len(columns[3])
            self.library.draw(pointer(image), size, size + LANES, x, y, electrons, *counts, sigma, reach, bands)
            return image[:, :size]

        return draw

    def noise(self, scene):
        prnu, dsnu = (np.ascontiguousarray(one, np.float32) for one in patterns(scene))
        size, out = scene.size_px, np.zeros(prnu.shape, np.uint16)
        numbers = [ctypes.c_float(v) for v in (scene.dark_e, scene.read_noise_e, scene.gain_e_per_dn, scene.black_dn)]

        def add(mean):
            stride = mean.strides[0] // mean.itemsize
            self.library.add_noise(pointer(mean), size, stride, pointer(prnu), pointer(dsnu), *numbers, ctypes.c_uint32(1), pointer(out))
            return out

        return add
