"""openstartracker (github.com/UBNanosatLab/openstartracker). Its startracker.py runs; OPENSTARTRACKER_PORT: another port than 8010."""
import os
from adapter import answer, asked
PORT = int(os.environ.get("OPENSTARTRACKER_PORT", 8010))
SOLVE = "rgb.solve_image({!r}, quiet=1); m = rgb.last_match and rgb.last_match.match.winner\n"
PRINT = "print(*np.degrees([np.arctan2(m.R21, m.R11), np.arcsin(m.R31), -np.arctan2(m.R32, m.R33)]) if m else ())\n"
def solve(image):
    return [float(angle) for angle in asked(PORT, SOLVE.format(image.png) + PRINT).split()] or None
answer(solve, "ra,dec,roll", roll="openstartracker")
