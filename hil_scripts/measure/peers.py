"""Other programs that draw stars, each used as its documentation recommends for speed: from peers import PEERS

A peer has a name, says which version it is, and draws a scene to mean electrons. `prepare` gets all that does not change from
frame to frame and is not timed. A peer that cannot be imported, or cannot draw a scene, says why (`Cannot`): the table has a
blank cell with this reason. Peers that sample a PSF in the middle of a pixel get a PSF that is wider by the pixel's variance
(1/12 px^2), which is the nearest that they can come to the integral over the pixel.
"""

import importlib
import importlib.metadata
import math
import os

import numpy as np

REACH_SIGMA = 5.5
"""Stars end so many standard deviations from their centre: 4e-8 of the light is beyond."""


#: Words before the time of a drawing that is left out.
TOO_SLOW = "would take about "


class Cannot(Exception):
    """The reason why a peer does not draw a scene."""


def need(module):
    """Imports a module, or says that it is missing."""
    try:
        return importlib.import_module(module)
    except Exception as error:  # a package may fail in many ways while it is imported
        raise Cannot(f"{module} is not installed here ({type(error).__name__})") from error


def version(package):
    try:
        return importlib.metadata.version(package)
    except importlib.metadata.PackageNotFoundError:
        return "-"


def expanded(scene):
    """Every star at every position of the path, with its share of the light: x, y, electrons."""
    path = scene.path
    x = (scene.x[:, None] + path[None, :, 0]).ravel()
    y = (scene.y[:, None] + path[None, :, 1]).ravel()
    return x, y, np.repeat(scene.electrons / len(path), len(path))


def reach_px(scene):
    return math.ceil(REACH_SIGMA * scene.sigma_px + 0.5)


def erf(x):
    """The error function to 1.5e-7 (Abramowitz and Stegun 7.1.26), for environments without SciPy."""
    t = 1.0 / (1.0 + 0.3275911 * np.abs(x))
    p = t * (0.254829592 + t * (-0.284496736 + t * (1.421413741 + t * (-1.453152027 + t * 1.061405429))))
    return np.sign(x) * (1.0 - p * np.exp(-x * x))


class Numpy:
    """Vectors over stars, a row and a column of integrals each, added up with bincount."""

    name, package = "numpy", "numpy"
    motion, threads = "every position is a star", 1

    def prepare(self, scene):
        def draw():
            size, reach = scene.size_px, reach_px(scene)
            total = np.zeros(size * size)
            x, y, e = expanded(scene)
            for at in range(0, len(x), 4096):
                some = slice(at, at + 4096)
                (i, gx), (j, gy) = (profile(v[some], scene.sigma_px, reach) for v in (x, y))
                values = (gy * e[some, None])[:, :, None] * gx[:, None, :]
                inside = (((j >= 0) & (j < size))[:, :, None]) & (((i >= 0) & (i < size))[:, None, :])
                place = (j[:, :, None] * size + i[:, None, :])[inside]
                total += np.bincount(place, values[inside], size * size)
            return total.reshape(size, size)

        return draw

    def noise(self, scene):
        random, maps = np.random.default_rng(1), patterns(scene)

        def add(mean):
            e = random.poisson(mean * (1 + maps[0]) + scene.dark_e) + maps[1]
            return digital(e + random.normal(0.0, scene.read_noise_e, e.shape), scene)

        return add


def profile(v, sigma, reach):
    """Pixels about every place, and the share of a Gaussian that falls into each."""
    pixels = np.rint(v).astype(np.int64)[:, None] + np.arange(-reach, reach + 1)
    edges = (np.concatenate([pixels, pixels[:, -1:] + 1], axis=1) - 0.5 - v[:, None]) / (sigma * math.sqrt(2.0))
    return pixels, 0.5 * np.diff(erf(edges), axis=1)


def patterns(scene):
    """Photo-response and offset of every pixel."""
    random = np.random.default_rng(2)
    shape = (scene.size_px, scene.size_px)
    return random.normal(0.0, scene.prnu, shape), random.normal(0.0, scene.dsnu_e, shape)


def digital(e, scene):
    return np.clip(np.floor(e / scene.gain_e_per_dn + scene.black_dn + 0.5), 0, 65535).astype(np.uint16)


class Numba:
    """A compiled loop over bands of rows, positions and pixels: what a C programmer would write."""

    name, package = "numba", "numba"
    motion, threads = "loop over positions", "all"

    def __init__(self):
        numba = need("numba")
        root_half = math.sqrt(0.5)

        @numba.njit(parallel=True, fastmath=True, cache=False)
        def draw(image, x, y, e, path, sigma, reach, bands):
            size = image.shape[0]
            scale, share = root_half / sigma, 1.0 / len(path)
            for band in numba.prange(bands):
                first, last = band * size // bands, (band + 1) * size // bands
                image[first:last] = 0.0
                gx = np.empty(2 * reach + 1, np.float32)
                for s in range(len(x)):
                    for p in range(len(path)):
                        cx, cy = x[s] + path[p, 0], y[s] + path[p, 1]
                        top, left = int(np.rint(cy)) - reach, int(np.rint(cx)) - reach
                        if top >= last or top + 2 * reach < first:
                            continue
                        before = math.erf((left - 0.5 - cx) * scale)
                        for i in range(2 * reach + 1):
                            after = math.erf((left + i + 0.5 - cx) * scale)
                            gx[i] = 0.5 * (after - before)
                            before = after
                        begin, end = max(0, -left), min(2 * reach + 1, size - left)
                        for j in range(max(top, first), min(top + 2 * reach + 1, last)):
                            level = math.erf((j + 0.5 - cy) * scale) - math.erf((j - 0.5 - cy) * scale)
                            level *= 0.5 * e[s] * share
                            for i in range(begin, end):
                                image[j, left + i] += level * gx[i]

        @numba.njit(parallel=True, fastmath=True, cache=False)
        def noise(mean, prnu, dsnu, dark, read, gain, black, out):
            for j in numba.prange(mean.shape[0]):
                for i in range(mean.shape[1]):
                    e = np.random.poisson(mean[j, i] * (1.0 + prnu[j, i]) + dark) + dsnu[j, i]
                    e += np.random.normal(0.0, read)
                    out[j, i] = min(max(math.floor(e / gain + black + 0.5), 0.0), 65535.0)

        self.threads, self._draw, self._noise = numba.get_num_threads(), draw, noise

    def prepare(self, scene):
        image = np.zeros((scene.size_px, scene.size_px), np.float32)
        bands = 8 * self.threads

        def draw():
            self._draw(image, scene.x, scene.y, scene.electrons, scene.path, scene.sigma_px, reach_px(scene), bands)
            return image

        return draw

    def noise(self, scene):
        prnu, dsnu = (one.astype(np.float32) for one in patterns(scene))
        out = np.zeros(prnu.shape, np.uint16)

        def add(mean):
            numbers = (scene.dark_e, scene.read_noise_e, scene.gain_e_per_dn, scene.black_dn)
            self._noise(mean, prnu, dsnu, *numbers, out)
            return out

        return add


class GalSim:
    """One profile with its path, convolved by FFT and drawn into a stamp per star; without a path, pixel by pixel in real
    space (`method="auto"` of a Gaussian with the pixel)."""

    name, package = "GalSim", "galsim"
    motion, threads = "profile convolved with the path", 1

    def __init__(self):
        self.galsim = need("galsim")

    def prepare(self, scene):
        galsim = self.galsim
        profile = galsim.Gaussian(sigma=scene.sigma_px)
        wide = reach_px(scene)
        if len(scene.path) > 1:
            points = [galsim.DeltaFunction(flux=1.0 / len(scene.path)).shift(*p) for p in scene.path.tolist()]
            profile = galsim.Convolve(profile, galsim.Sum(points))
            wide += math.ceil(np.abs(scene.path).max())
        image = galsim.ImageF(scene.size_px, scene.size_px, xmin=0, ymin=0, scale=1.0)

        def draw():
            image.setZero()
            for x, y, e in zip(scene.x.tolist(), scene.y.tolist(), scene.electrons.tolist()):
                i, j = round(x), round(y)
                bounds = galsim.BoundsI(i - wide, i + wide, j - wide, j + wide)
                stamp = galsim.ImageF(bounds, scale=1.0)
                profile.withFlux(e).drawImage(stamp, center=galsim.PositionD(x, y))
                common = bounds & image.bounds
                if common.isDefined():
                    image[common] += stamp[common]
            return image.array

        return draw

    def noise(self, scene):
        galsim, (prnu, dsnu) = self.galsim, patterns(scene)
        random = galsim.BaseDeviate(1)

        def add(mean):
            image = galsim.Image((mean * (1 + prnu) + scene.dark_e).astype(np.float32))
            image.addNoise(galsim.CCDNoise(random, gain=1.0, read_noise=scene.read_noise_e))
            return digital(image.array + dsnu, scene)

        return add


class Photutils:
    """`make_model_image` with the PRF that is integrated over pixels."""

    name, package = "photutils", "photutils"
    motion, threads = "every position is a star", 1

    def __init__(self):
        self.datasets, self.psf = need("photutils.datasets"), need("photutils.psf")
        self.table = need("astropy.table")

    def prepare(self, scene):
        sigma_fwhm = 2.0 * math.sqrt(2.0 * math.log(2.0))
        model = self.psf.CircularGaussianPRF(fwhm=scene.sigma_px * sigma_fwhm)
        side = 2 * reach_px(scene) + 1

        def draw():
            x, y, e = expanded(scene)
            table = self.table.QTable({"x_0": x, "y_0": y, "flux": e})
            return self.datasets.make_model_image((scene.size_px,) * 2, model, table, model_shape=(side, side))

        return draw

    def noise(self, scene):
        prnu, dsnu = patterns(scene)

        def add(mean):
            e = self.datasets.apply_poisson_noise(np.maximum(mean * (1 + prnu) + scene.dark_e, 0.0), seed=1)
            read = self.datasets.make_noise_image(e.shape, "gaussian", mean=0.0, stddev=scene.read_noise_e, seed=1)
            return digital(e + dsnu + read, scene)

        return add


class Torch:
    """Tensors over stars, a row and a column of integrals each, added up with `index_add_`."""

    name, package = "torch", "torch"
    motion, threads = "every position is a star", "all"

    def __init__(self):
        self.torch = need("torch")
        self.threads = self.torch.get_num_threads()

    def prepare(self, scene):
        torch, size, reach = self.torch, scene.size_px, reach_px(scene)
        x, y, e = (torch.from_numpy(v.astype(np.float32)) for v in expanded(scene))
        offsets = torch.arange(-reach, reach + 1)
        scale = 1.0 / (scene.sigma_px * math.sqrt(2.0))

        def profile(v):
            pixels = v.round().long()[:, None] + offsets
            edges = torch.cat([pixels, pixels[:, -1:] + 1], dim=1).float() - 0.5 - v[:, None]
            return pixels, 0.5 * torch.erf(edges * scale).diff(dim=1)

        def draw():
            # A margin of one stamp takes what falls outside; places farther out are moved to its edge.
            margin = size + 4 * reach + 2
            image = torch.zeros(margin * margin)
            for at in range(0, len(x), 16_384):
                some = slice(at, at + 16_384)
                (i, gx), (j, gy) = profile(x[some]), profile(y[some])
                i, j = ((v + 2 * reach + 1).clamp(0, margin - 1) for v in (i, j))
                values = (gy * e[some, None])[:, :, None] * gx[:, None, :]
                image.index_add_(0, (j[:, :, None] * margin + i[:, None, :]).reshape(-1), values.reshape(-1))
            inner = slice(2 * reach + 1, 2 * reach + 1 + size)
            return image.reshape(margin, margin)[inner, inner].numpy()

        return draw

    def noise(self, scene):
        torch = self.torch
        prnu, dsnu = (torch.from_numpy(one.astype(np.float32)) for one in patterns(scene))

        def add(mean):
            light = torch.from_numpy(np.ascontiguousarray(mean, np.float32)) * (1 + prnu) + scene.dark_e
            e = self.noisy(light, dsnu, scene.read_noise_e)
            return (e / scene.gain_e_per_dn + scene.black_dn + 0.5).floor().clamp(0, 65535).numpy().astype(np.uint16)

        return add

    def noisy(self, light, dsnu, read_noise_e):
        e = self.torch.poisson(light) + dsnu
        e += self.torch.randn(e.shape) * read_noise_e
        return e


class Sdasim(Torch):
    """`sdasim.splat.splat_gaussians`, every position of the path a source of its own, as its `expand_motion` does."""

    name, package = "sdasim", "sdasim"
    motion, threads = "every position is a star", "all"

    def __init__(self):
        self.torch, self.splat = need("torch"), need("sdasim.splat")
        self.own = need("sdasim.noise")
        self.threads = self.torch.get_num_threads()

    def prepare(self, scene):
        torch, size = self.torch, scene.size_px
        x, y, e = expanded(scene)
        places = torch.from_numpy(np.stack([y, x], axis=1).astype(np.float32))
        electrons = torch.from_numpy(e.astype(np.float32))
        sigma, reach = math.sqrt(scene.sigma_px**2 + 1.0 / 12.0), reach_px(scene)
        return lambda: self.splat.splat_gaussians(size, size, places, electrons, sigma, reach).numpy()

    def noisy(self, light, dsnu, read_noise_e):
        return self.own.gaussian_noise(self.own.poisson_noise(light) + dsnu, read_noise_e)


class SatSim:
    """Its steps for a star field: counts added to a grid of three by three per pixel (`add_counts`, bilinear), one
    convolution by FFT (`fftconv2p`), sums of three by three (`downsample`)."""

    name, package = "SatSim", "satsim"
    motion, threads = "every position is a star on the fine grid", "all"
    FINER, MARGIN_PX = 3, 32

    def __init__(self):
        os.environ.setdefault("TF_CPP_MIN_LOG_LEVEL", "3")
        self.tf = need("tensorflow")
        self.fpa, self.psf, self.math = need("satsim.image.fpa"), need("satsim.image.psf"), need("satsim.math")

    def prepare(self, scene):
        tf, finer = self.tf, self.FINER
        side = (scene.size_px + 2 * self.MARGIN_PX) * finer
        # A fine pixel of its own variance is in the bilinear split already.
        psf = self.psf.gen_gaussian(side, side, scene.sigma_px * finer)

        def draw():
            x, y, e = expanded(scene)
            # Its PSF has its centre between the middle pixels: half a fine pixel less, as in its own `render_full`.
            columns, rows = (((v + self.MARGIN_PX + 0.5) * finer - 1.0).astype(np.float32) for v in (x, y))
            grid = tf.Variable(tf.zeros([side, side]))
            fine = self.fpa.add_counts(grid, rows, columns, e.astype(np.float32), interpolation="bilinear")
            fine = self.math.fftconv2p(fine, psf, pad=1, dtype=tf.float32)
            whole = self.fpa.downsample(fine, finer, method="pool")
            inner = slice(self.MARGIN_PX, self.MARGIN_PX + scene.size_px)
            return np.asarray(whole)[inner, inner]

        return draw

    def noise(self, scene):
        raise Cannot("its photon noise comes with its own chain of the focal plane, not with these effects")


PEERS = [Numpy, Numba, GalSim, Photutils, Torch, Sdasim, SatSim]
