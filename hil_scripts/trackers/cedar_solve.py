"""cedar-solve (PyPI), on spots of adapter.py."""
from adapter import answer
from tetra3 import Tetra3
tetra = Tetra3()
def solve(image):
    places = image.camera.undistorted(image.spots())[:, ::-1] + 0.5
    fov_deg = image.camera.fov_deg
    found = tetra.solve_from_centroids(places, image.pixels.shape, fov_estimate=fov_deg, fov_max_error=0.05 * fov_deg, distortion=None)
    return [found[angle] for angle in ("RA", "Dec", "Roll")]
answer(solve, "ra,dec,roll", roll="tetra3")
