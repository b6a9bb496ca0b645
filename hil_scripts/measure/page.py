"""Shared by measuring tools: where things are, the machine, parts of guide pages, charts. Import it before anything of starloop."""

import html
import math
import os
import pathlib
import re
import sys

sys.dont_write_bytecode = True

ROOT = pathlib.Path(__file__).resolve().parents[2]
sys.path.insert(1, str(ROOT / "hil_scripts"))
PROGRAM = pathlib.Path(os.environ.get("STARLOOP_BINARY", ROOT / "target/release/starloop")).resolve()
SYSTEM_PYTHON = "/usr/bin/python3"
"""The Python that has gi: the system's, not that of a virtual environment."""
LEFT, TOP, BOTTOM = 70, 24, 44
"""Margins of a chart, px."""


def machine():
    """Returns the cores that this process may use, and the name of their processor."""
    path = pathlib.Path("/proc/cpuinfo")
    names = re.findall(r"model name\s*:\s*(.*)", path.read_text() if path.exists() else "") or ["unknown processor"]
    return f"{len(os.sched_getaffinity(0))} cores of {names[0]}"


def put_between(path, marks, text):
    """Replaces the part of a page between two marks."""
    before, rest = path.read_text().split(marks[0])
    after = rest.split(marks[1])[1]
    path.write_text(f"{before}{marks[0]}\n\n{text}\n{marks[1]}{after}")


def fits_of(path):
    """Returns the cards of a FITS file, as text by keyword, and its pixels as DN, the first row at the top."""
    import numpy

    data, cards, place = pathlib.Path(path).read_bytes(), {}, 0
    while not (card := data[place : place + 80].decode("ascii")).startswith("END "):
        cards[card[:8].strip()] = card[10:].split("/")[0].strip(" '")
        place += 80
    rows, columns = int(cards["NAXIS2"]), int(cards["NAXIS1"])
    assert float(cards["BZERO"]) == 32768
    stored = numpy.frombuffer(data, ">u2", rows * columns, (place // 2880 + 1) * 2880)
    return cards, (stored ^ 0x8000).astype("<u2").reshape(rows, columns)


def table(head, rows):
    """Returns the lines of a table in Markdown, of cells that are text."""
    lines = ["| " + " | ".join(cells) + " |" for cells in (head, *rows)]
    return [lines[0], "|" + "---|" * len(head), *lines[1:]]


class Axis:
    """A linear or logarithmic axis from one value to another, with marks at decades or in equal steps."""

    def __init__(self, word, low, high, steps=4, is_log=False):
        self.word, self.low, self.high, self.steps = word, low, high, steps
        self.scale = math.log10 if is_log else float
        self.is_log = is_log

    def share(self, value):
        """Returns where a value is: 0 at the lower end, 1 at the upper one."""
        low, high = self.scale(self.low), self.scale(self.high)
        return (self.scale(max(value, self.low)) - low) / (high - low)

    def marks(self):
        if self.is_log:
            return [10.0**power for power in range(math.ceil(math.log10(self.low)), math.floor(math.log10(self.high)) + 1)]
        return [round(self.low + (self.high - self.low) * step / self.steps, 3) for step in range(self.steps + 1)]


class Chart:
    """A frame with two axes, into which lines and points are drawn."""

    def __init__(self, title, x_axis, y_axis, height=300, right=20, width=860):
        self.x_axis, self.y_axis, self.height, self.right, self.width = x_axis, y_axis, height, right, width
        self.out = [f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {width} {height}" font-family="sans-serif" font-size="12">',
                    f'<rect width="{width}" height="{height}" fill="white"/>']  # fmt: skip
        self.word(LEFT, 16, title)
        self.word((LEFT + width - right) / 2, height - 8, x_axis.word, 'text-anchor="middle"')
        self.out.append(f'<text transform="translate(14 {height / 2}) rotate(-90)" text-anchor="middle">{y_axis.word}</text>')
        for at in x_axis.marks():
            self.out.append(f'<path d="M{self.x(at):.1f} {TOP}V{height - BOTTOM}" stroke="#ddd"/>')
            self.word(f"{self.x(at):.1f}", height - BOTTOM + 15, f"{at:g}", 'text-anchor="middle"')
        for at in y_axis.marks():
            self.out.append(f'<path d="M{LEFT} {self.y(at):.1f}H{width - right}" stroke="#ddd"/>')
            self.word(LEFT - 6, f"{self.y(at) + 4:.1f}", f"{at:g}", 'text-anchor="end"')

    def x(self, value):
        return LEFT + self.x_axis.share(value) * (self.width - LEFT - self.right)

    def y(self, value):
        return self.height - BOTTOM - self.y_axis.share(value) * (self.height - TOP - BOTTOM)

    def word(self, x, y, text, more=""):
        self.out.append(f'<text x="{x}" y="{y}"{" " if more else ""}{more}>{html.escape(text)}</text>')

    def line(self, points, colour, word, place):
        """Draws a line, and its name into the corner."""
        path = " ".join(f"{self.x(x):.1f},{self.y(y):.1f}" for x, y in points)
        self.out.append(f'<polyline points="{path}" fill="none" stroke="{colour}" stroke-width="1.5"/>')
        self.word(self.width - self.right - 8, TOP + 14 * (place + 1), word, f'text-anchor="end" fill="{colour}"')

    def points(self, points, colour, word, place):
        """Draws (x, y, title), and their name beside the chart."""
        beside = self.width - self.right + 20
        self.out.append(f'<circle cx="{beside}" cy="{TOP + 8 + 20 * place}" r="5" fill="{colour}"/>')
        self.word(beside + 12, TOP + 12 + 20 * place, word)
        for x, y, title in points:
            self.out.append(f'<circle cx="{self.x(x):.1f}" cy="{self.y(y):.1f}" r="5" fill="{colour}" fill-opacity="0.7">')
            self.out.append(f"<title>{html.escape(title)}</title></circle>")

    def text(self):
        return "\n".join([*self.out, "</svg>"]) + "\n"
