"""Every figure, one and two columns wide: no text overlaps, and every curve is told apart in grey."""

import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from datetime import UTC, datetime
from itertools import combinations
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from matplotlib.figure import Figure
from matplotlib.image import AxesImage

from haploop.acquisition import Recording, Representative, accepted_presses
from haploop.base.errors import ConfigurationError
from haploop.calibration import ButtonPlan, Calibration, Check, VibrationMap, check_feeling, map_plan
from haploop.calibration.drive import Offer, Offers
from haploop.calibration.response.modes import Modes
from haploop.calibration.response.terms import terms_of
from haploop.console import server
from haploop.experiments import load_experiment
from haploop.experiments.shown import confusion_figure, ratings_figure
from haploop.instruments import open_rig
from haploop.reports import figures, plot
from haploop.reports.contents import forces_in, plan_contents
from haploop.reports.figures.plotting import colour, legend_under, letter, new_figure, style
from tests.command_line import Demo
from tests.reports.colour_vision import LEAST, VISIONS, lab, nearest
from tests.reports.figure_checks import alike, drawn_texts, overlaps

BUTTONS = ("latch", "toggle", "push")
NAMES = (
    "profiles", "profile", "recording", "forces", "forces of twelve", "forces of one", "drives",
    "drive of a long name", "drive",
    "comparison", "comparison of one", "response", "response and truth", "plan", "feeling", "check", "button",
    "iterations", "map", "map of a row", "before and after", "responses", "ratings", "ratings of seven",
    "confusion",
    "confusion of many", "trend",
)  # fmt: skip
Draw = Callable[..., Figure]


def vibration_map(points: range) -> VibrationMap:
    """A map of smooth modes, without a measurement."""
    with open_rig("simulated", simulate="twin") as rig:
        plan = map_plan(rig, points=points)
    hz, rows, columns = np.array([66.0, 135.0, 263.5, 410.0, 520.0]), plan.rows, plan.columns
    poles = -0.01 * 2 * np.pi * hz + 2j * np.pi * hz
    row, column = np.divmod(np.array(points), columns)
    shapes = np.array(
        [np.sin(m * np.pi * (row + 0.5) / rows) * np.sin(n * np.pi * (column + 0.5) / columns)
         for m, n in ((1, 1), (1, 2), (2, 2), (1, 4), (3, 2))]
    )  # fmt: skip
    unknowns = len(terms_of(poles, hz)[0])
    shares = np.zeros((len(plan.patches), len(points), unknowns))
    shares[:, :, : len(hz)] = 1e-3 * shapes.T * np.array([1, 0.5, 0.3, 0.2])[: len(plan.patches), None, None]
    return VibrationMap(
        plan, tuple(map(str, points)), (), Modes(poles, np.ones((len(plan.patches), 1))), shares,
        np.ones(len(plan.patches), complex), np.zeros(len(points)), (), np.zeros(1), 60.0,
        "0" * 64, "2026-11-22T09:00:00+00:00",
    )  # fmt: skip


def rated(names: Sequence[str] = ("Rough-Smooth", "Unclear-Clear", "Weak-Strong")) -> Any:
    pairs = [
        SimpleNamespace(pair=name, mean=np.full((3, 2), 50.0), deviation=np.full((3, 2), 9.0))
        for name in names
    ]
    return SimpleNamespace(
        levels=(("none", "given", "both"), ("latch", "push")), pairs=pairs, normalised=True
    )


def planned(button: str) -> ButtonPlan:
    """A plan of two methods at one and at four patches, of which nothing was computed."""
    curves = [
        Offers(
            method,
            patches,
            0.6,
            tuple(Offer(0.02 * n, 0.03 * n, 2.0 * n + above, 0.1, 48.0) for n in range(1, 11)),
        )
        for above, patches in ((-8.0, "A"), (4.0, "A, B, C, D"))
        for method in ("modulated", "broadband")
    ]
    return ButtonPlan(button, "lab", tuple(curves), True, ())


def confused(classes: Sequence[str] = BUTTONS) -> Any:
    counts = 1 + 9 * np.eye(len(classes), dtype=int)
    one = SimpleNamespace(counts=counts, classes=tuple(classes))
    return SimpleNamespace(matrices={("I", "1"): one, ("II", "1"): one}, by=("group", "day"), pooled=one)


def trend_of_four(columns: Any) -> Figure:
    """The trend of four places, without their measurements."""
    days = [datetime(2026, 11, day, tzinfo=UTC) for day in range(1, 12)]
    metrics = {
        (patch, "button"): SimpleNamespace(
            resonance_hz=200.0 + 30 * k, damping=0.01, gain=1.0 + k, coherence=1
        )
        for k, patch in enumerate("ABCD")
    }
    limits = {"resonance": 0.01, "damping": 0.2, "gain": 0.1}
    periods = [SimpleNamespace(name="g1", begin=days[0], end=days[-1], metrics=metrics, thresholds=limits)]
    with pytest.MonkeyPatch.context() as patched:
        patched.setattr("haploop.reports.figures.history._active_periods", lambda *_: periods)
        return figures.trend(SimpleNamespace(looks=[]), columns)


@pytest.fixture(scope="module")
def gallery(demo: Demo) -> Mapping[str, Draw]:
    presses = [Representative.load(demo.folder / "presses" / f"{name}.h5") for name in BUTTONS]
    checks = [Check.load(demo.folder / "checks" / f"{name}.h5") for name in BUTTONS]
    table = Calibration.load(demo.folder / "calibration.h5")
    recordings = [Recording.open(path) for path in sorted((demo.folder / "recordings").glob("*.h5"))]
    rng = np.random.default_rng(3)
    twelve = {
        b: {f"P{k:02d}": rng.normal(m, 0.2, 10) for k in range(1, 13)}
        for b, m in (("latch", 7.0), ("toggle", 2.0), ("push", 4.0))
    }
    tried = [
        SimpleNamespace(within=SimpleNamespace(root=error, floor=0.01), kept=kept)
        for error, kept in ((0.05, True), (0.03, True), (0.04, False))
    ]
    button = SimpleNamespace(press=presses[2], check=checks[2], learning=SimpleNamespace(iterations=tried))
    felt = [(p.button, check_feeling(c, p)) for p, c in zip(presses, checks, strict=True)]
    truth = table.model.velocity(table.response.frequencies) * 1.05
    rows = list(zip(presses, checks, strict=True))
    whole, part = vibration_map(range(84)), vibration_map(range(12))
    by_name = dict(zip(BUTTONS, checks, strict=True))
    return {
        "profiles": lambda c: figures.profiles([figures.Profile.of(p) for p in presses], c),
        "profile": lambda c: figures.profiles([figures.Profile.of(presses[0])], c),
        "recording": lambda c: figures.recording_figure(
            [(recordings[0], accepted_presses(recordings[0]))], c
        ),
        "forces": lambda c: figures.activation_forces(forces_in(recordings), None, c),
        "forces of twelve": lambda c: figures.activation_forces(twelve, {"latch": 7.0, "push": 4.0}, c),
        "forces of one": lambda c: figures.activation_forces({"a $x_1$": {"P01": np.array([7.0])}}, None, c),
        "drives": lambda c: figures.drives([check.drive for check in checks], (-50, 50), c),
        "drive of a long name": lambda c: figures.drives(
            [replace(checks[0].drive, button="the doorbell of the oldest house")], None, c
        ),
        "drive": lambda c: figures.drives([checks[0].drive], None, c),
        "comparison": lambda c: figures.comparison(rows, c),
        "comparison of one": lambda c: figures.comparison(rows[:1], c),
        "response": lambda c: figures.response(table, None, c),
        "response and truth": lambda c: figures.response(table, truth, c),
        "plan": lambda c: figures.plan_figure([planned(p.button) for p in presses], c),
        "feeling": lambda c: figures.feeling_figure(felt, c),
        "check": lambda c: figures.check_figure(checks[0], c),
        "button": lambda c: figures.button_figure(button, c),
        "iterations": lambda c: figures.iterations_figure(button, c),
        "map": lambda c: figures.map_figure(whole, c),
        "map of a row": lambda c: figures.map_figure(part, c),
        "before and after": lambda _: figures.before_and_after(by_name, {"latch": checks[0]}),
        "responses": lambda _: figures.responses([table], [table]),
        "ratings": lambda c: ratings_figure(rated(), c),
        "ratings of seven": lambda c: ratings_figure(rated(load_experiment("rating").file.pair_names), c),
        "confusion": lambda c: confusion_figure(confused(), c),
        "confusion of many": lambda c: confusion_figure(confused([f"a long name {k}" for k in range(6)]), c),
        "trend": trend_of_four,
    }


@pytest.mark.long
@pytest.mark.parametrize("name", NAMES)
def test_no_text_overlaps_another_or_leaves_the_canvas(gallery, name):
    for columns in (1, 2):
        figure = gallery[name](columns)
        figures.mark_simulated(figure)
        texts = drawn_texts(figure)
        assert overlaps(figure, texts) == [], columns
        assert alike(figure) == []
        assert "simulated" in [text for text, *_ in texts]


def test_every_figure_is_among_them(gallery):
    assert tuple(gallery) == NAMES


def test_a_text_over_another_and_off_the_canvas_is_found():
    with style():
        figure = new_figure(1.5)
        axes = figure.add_subplot()
        axes.plot([0, 1], label="one", color=colour(1))
        axes.plot([1, 0], label="other", color=colour(4))
        letter(axes, 0, "A title without room for the legend", legend_rows=0)
        legend_under(axes, 1)
        figure.text(0.99, 0.5, "beyond the edge")
    found = " ".join(overlaps(figure))
    assert "overlaps 'other'" in found and "'beyond the edge' leaves the canvas" in found
    found = alike(figure)
    assert len(found) == 1 and found[0].startswith("'one' looks like 'other' (grey")


def test_red_and_green_of_one_brightness_are_found_and_dashes_mend_it():
    with style():
        figure = new_figure(1.5)
        axes = figure.add_subplot()
        one, _ = (
            axes.plot([0, 1], color=paint, label=name)[0]
            for paint, name in (("#d62728", "red"), ("#2ca02c", "green"))
        )
    assert (
        nearest("#d62728", "#2ca02c")[0]
        < 15
        < np.linalg.norm(lab("#d62728", "normal") - lab("#2ca02c", "normal"))
    )
    assert len(alike(figure)) == 1
    one.set_linestyle("--")
    assert alike(figure) == []


@pytest.mark.long
def test_every_colour_scale_goes_from_dark_to_light_for_everybody(gallery):
    """So that a value is read off it in any colour vision, and in grey."""
    seen = set()
    for name in NAMES:
        for image in gallery[name](2).findobj(AxesImage):
            scale = image.get_cmap()
            seen.add(scale.name)
            for vision in VISIONS:
                lightness = [lab(scale(level)[:3], vision)[0] for level in np.linspace(0, 1, 33)]
                steps = np.diff(lightness)
                assert min(steps) > -0.5 or max(steps) < 0.5, (name, scale.name, vision)
    assert seen == {"magma", "cividis", "Blues"}


def test_the_consoles_curves_are_told_apart_by_colour_for_everybody_but_a_grey_printer():
    """Curves that move have no dashes that one could see."""
    text = (Path(server.__file__).parent / "static" / "plots.js").read_text(encoding="utf-8")
    found = re.findall(r'"(#[0-9a-f]{6})"', text.partition("]")[0])
    assert len(found) == 6
    for one, other in combinations(found[:3], 2):  # as many as one plot of the scope has
        for vision in set(VISIONS) - {"grey"}:
            assert np.linalg.norm(lab(one, vision) - lab(other, vision)) > LEAST, (one, other, vision)


@pytest.mark.long
def test_a_plot_is_a_new_file_in_three_formats_at_two_widths(demo, run, tmp_path):
    drive = demo.folder / "drives" / "latch.h5"
    sizes = {}
    for kind, begins in (("png", b"\x89PNG"), ("pdf", b"%PDF"), ("svg", b"<?xml")):
        for columns in (1, 2):
            once, again = (tmp_path / f"{n}-{columns}.{kind}" for n in ("once", "again"))
            for out in (once, again):
                run("show", drive, "--plot", out, "--columns", columns, ends=0)
            assert once.read_bytes() == again.read_bytes()
            assert once.read_bytes().startswith(begins)
            sizes[kind, columns] = once.read_bytes()
    assert b'width="249' in sizes["svg", 1] and b'width="511' in sizes["svg", 2]  # points: 88 and 180 mm
    run("show", drive, "--plot", tmp_path / "a.jpg", says=".png or .pdf or .svg")


def test_plots_of_a_script_are_marked_and_saved_once(demo, tmp_path):
    press = Representative.load(demo.folder / "presses" / "latch.h5")
    figure = plot.press(press, columns=1)
    assert [text.get_text() for text in figure.texts] == ["simulated"]
    plot.save(figure, tmp_path / "press.svg")
    with pytest.raises(ConfigurationError, match="exists"):
        plot.save(figure, tmp_path / "press.svg")
    for made in (
        plot.check(Check.load(demo.folder / "checks" / "push.h5")),
        plot.response(Calibration.load(demo.folder / "calibration.h5")),
        plot.forces([Recording.open(demo.folder / "recordings" / "P01-latch.h5")]),
        plot.vibration_map(vibration_map(range(12))),
    ):
        assert "simulated" in [text.get_text() for text in made.texts]


def test_a_plan_says_how_its_broadband_rows_are_chosen():
    plan = planned("push")
    modulated = replace(plan, curves=tuple(one for one in plan.curves if one.method == "modulated"))
    whole, part = (plan_contents(one).tables[0].below for one in (plan, modulated))
    assert whole.endswith(" Rows that are broadband need `--method broadband` with it.")
    assert "broadband" not in part
