"""LOST (github.com/UWCubeSat/lost). The variable LOST names its folder, which has `lost` and `my-database.dat`, as its README makes them."""
import os
from adapter import answer, said
IDENTIFY = "--centroid-algo cog --centroid-mag-filter 5 --star-id-algo py --angular-tolerance 0.05 --false-stars 1000 --max-mismatch-prob 0.0001"
def solve(image):
    camera = ["--png", image.png, "--focal-length", image.camera.focal_mm, "--pixel-size", image.camera.pixel_um]
    attitude = "--database my-database.dat --attitude-algo dqm --print-attitude -"
    found = said("./lost", "pipeline", *camera, *IDENTIFY.split(), *attitude.split(), cwd=os.environ["LOST"])
    return [found.get(f"attitude_{angle}") for angle in ("ra", "de", "roll")]
answer(solve, "ra,dec,roll", roll="lost")
