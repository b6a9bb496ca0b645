"""tetra3rs (PyPI), with its own centroids and the distortion of the camera file."""
import functools
import tetra3rs
from adapter import answer
database = functools.cache(lambda fov_deg: tetra3rs.SolverDatabase.generate_from_gaia(max_fov_deg=fov_deg))
def solve(image):
    camera = image.camera.of_tetra3rs(tetra3rs)
    found = database(image.camera.fov_deg).solve_from_centroids(tetra3rs.extract_centroids(image.pixels).centroids, camera_model=camera)
    return found.quaternion if found else None
answer(solve, "q_w,q_x,q_y,q_z")
