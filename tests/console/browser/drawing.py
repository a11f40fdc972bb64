"""Pictures in few colours, the figures of docs/figures, and the first screen of the demo's report."""

from __future__ import annotations

import re
import tempfile
from base64 import b64encode
from io import BytesIO
from pathlib import Path
from typing import Any

import numpy as np
from click.testing import CliRunner
from PIL import Image

import haploop
from haploop.commands.cli import cli
from haploop.reports.figures import png
from haploop.reports.html import write_figures

PICTURES = Path(__file__).parents[3] / "docs" / "pictures"
_COLOURS = 96


def save(shot: Image.Image, path: Path, count: int = _COLOURS) -> None:
    """Save a picture in so many colours, and say how large it is."""
    _few_colours(shot, count).save(path, optimize=True)
    print(f"{path.name}: {shot.width} x {shot.height}, {path.stat().st_size / 1e3:.0f} kB", flush=True)


def _few_colours(shot: Image.Image, count: int) -> Image.Image:
    """A picture with `count` colours; small things count for more, so that curves keep theirs."""
    pixels = np.asarray(shot).reshape(-1, 3)
    colours, where, counts = np.unique(pixels, axis=0, return_inverse=True, return_counts=True)
    sample = np.repeat(colours, 1 + (counts**0.4).astype(int), axis=0)[None]
    palette = Image.fromarray(sample).quantize(count, Image.Quantize.MEDIANCUT, kmeans=2)
    few = np.array(palette.getpalette()).reshape(-1, 3)
    # Grounds stay exactly what they are: white is white, and each has an entry of its own.
    free = np.ones(len(few), dtype=bool)
    for colour in colours[np.argsort(counts)[::-1][: count // 4]].astype(int):
        taken = int(np.argmin(np.where(free, np.abs(few - colour).sum(axis=1), np.inf)))
        few[taken], free[taken] = colour, False
    # Pillow finds the nearest colour of a palette to two bits only, which greys the white.
    nearest = [np.argmin(((few - colour) ** 2).sum(axis=1)) for colour in colours.astype(int)]
    drawn = Image.fromarray(np.array(nearest, dtype=np.uint8)[where.ravel()].reshape(shot.size[::-1]), "P")
    drawn.putpalette(few.astype(np.uint8).tobytes())
    return drawn


def figures(data: Path) -> None:
    """The figures of the console's own data, and of the forces of three people; a map takes more of it."""
    buttons = [haploop.DigitalButton.load(path) for path in sorted(data.glob("buttons/*.h5"))]
    plot = haploop.reports.plot
    with haploop.open_rig("simulated") as rig, tempfile.TemporaryDirectory() as place:
        asked = [(button, who) for button in ("latch", "push", "toggle") for who in ("P01", "P02", "P03")]
        forces = plot.forces([haploop.record(rig, *one, 4, Path(place)) for one in asked])
    drawn = {
        "forces": forces,
        "press": plot.press(*(one.press for one in buttons)),
        "drive": plot.drive(*(one.drive for one in buttons)),
        "comparison": plot.comparison(*buttons),
        "feeling": plot.feeling(*buttons),
        "response": plot.response(haploop.Calibration.load(data / "calibrations-made" / "A-button.h5")),
        "trend": plot.trend(haploop.History(data / "simulated-calibrations")),
    }
    for name, figure in drawn.items():
        shot = Image.open(BytesIO(png(figure, 110))).convert("RGB")
        path = PICTURES.parent / "figures" / f"{name}.png"
        save(shot, path)


_STYLE_OF_PAPER = """<!doctype html><style>body { margin: 10px; display: flex; gap: 10px; }
figure { margin: 0 0 20px; } figcaption { font: bold 13px sans-serif; } img { width: 320px; }</style>"""


def _columns(drawn: list[Path]) -> list[list[str]]:
    """Figures in three columns about as high as each other, as HTML with their numbers."""
    columns: list[list[str]] = [[], [], []]
    highs = [0.0, 0.0, 0.0]
    heights = {path: float(re.search(r'height="([\d.]+)pt"', path.read_text("utf-8"))[1]) for path in drawn}
    for path in sorted(drawn, key=heights.__getitem__, reverse=True):
        shortest = int(np.argmin(highs))
        highs[shortest] += heights[path]
        image = f'<img src="data:image/svg+xml;base64,{b64encode(path.read_bytes()).decode()}">'
        said = f"Figure {path.stem.split('-')[1]}"
        columns[shortest].append(f"<figure><figcaption>{said}</figcaption>{image}</figure>")
    return columns


def report(browser: Any, folder: Path) -> None:
    """The first screen of the demo's report, which README shows."""
    done = CliRunner().invoke(cli, ["demo", "--out", str(folder / "demo")])
    assert done.exit_code == 0, done.output
    page = browser.new_page(viewport={"width": 1040, "height": 512})
    page.goto((folder / "demo" / "report.html").as_uri())
    shot = Image.open(BytesIO(page.screenshot())).convert("RGB")
    path = PICTURES / "demo-report.png"
    save(shot, path)


def paper(browser: Any, data: Path, folder: Path) -> None:
    """The paper's figures of the lab's data and of simulated answers: `haploop figures --paper`."""
    files = [*sorted(data.glob("recordings/*.h5")), *sorted(data.glob("buttons/*.h5"))]
    for name in ("matching", "rating"):
        files.append(folder / name)
        for words in (["new", "--from", name], ["simulate", "--participants", "12"]):
            done = CliRunner().invoke(cli, ["experiment", words[0], str(files[-1]), *words[1:]])
            assert done.exit_code == 0, done.output
    made = write_figures(files, folder / "figures", paper=True, columns=1).files
    page = browser.new_page(viewport={"width": 1000, "height": 400})
    drawn = [path for path in made if path.suffix == ".svg"]
    page.set_content(_STYLE_OF_PAPER + "".join(f"<div>{''.join(column)}</div>" for column in _columns(drawn)))
    shot = Image.open(BytesIO(page.screenshot(full_page=True))).convert("RGB")
    path = PICTURES.parent / "figures" / "paper.png"
    save(shot, path)
