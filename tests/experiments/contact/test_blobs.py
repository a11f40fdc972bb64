"""Pictures of what is no single fingertip: each is refused by its name, and activates nothing.

Fingers are ellipses whose edge is blurred by the optics, of 130 grey levels, at 5.3 pixels a millimetre.
"""

from collections.abc import Iterable

import numpy as np
import pytest
import scipy

from haploop.base.arrays import FloatArray
from haploop.experiments.contact import Activator
from haploop.experiments.contact.area import Background, Contact, ContactMeter
from haploop.instruments import Frame
from tests.rows import thinned

SHAPE = (240, 320)
PIXEL = 1 / 5.3e3**2
Y, X = np.indices(SHAPE, dtype=float)
LAMP = 28.0 * (1 + 0.4 * X / SHAPE[1])
NOISE = 2.5
BLUR = 1.2


def finger(
    area: float, x: float = 160.0, y: float = 120.0, *, level: float = 130.0, aspect: float = 1.25
) -> FloatArray:
    """A contact of an area (m^2)."""
    width = np.sqrt(area / PIXEL / (np.pi * aspect))
    inside = 1 - np.hypot((X - x) / (width * aspect), (Y - y) / width)
    return np.asarray(level * scipy.special.ndtr(inside * width * np.sqrt(aspect) / BLUR))


def glow(x: float, y: float, size: float, level: float) -> FloatArray:
    return np.asarray(level * np.exp(-((X - x) ** 2 + (Y - y) ** 2) / (2 * size**2)))


def meter() -> ContactMeter:
    return ContactMeter(Background(LAMP.copy(), NOISE), PIXEL)


def taken(light: FloatArray | float, number: int = 0, seed: int = 0, time: float | None = None) -> Frame:
    rng = np.random.default_rng([seed, number])
    image = np.clip(np.round(LAMP + light + NOISE * rng.normal(size=SHAPE)), 0, 255)
    return Frame(image.astype(np.uint8), number, number / 60 if time is None else time)


def of(light: FloatArray | float) -> Contact:
    return meter().measure(taken(light))


BESIDE = np.sqrt(100e-6 / PIXEL / np.pi)
CASES: dict[str, tuple[FloatArray, str]] = {
    "a glow in the corner": (glow(310, 10, 45, 90), "a glow without an edge"),
    "a gradient of light": (np.asarray(60 * np.maximum(X / SHAPE[1] - 0.4, 0)), "a glow without an edge"),
    "two fingers that touch": (
        np.maximum(finger(100e-6, 160 - BESIDE, aspect=1.0), finger(100e-6, 160 + BESIDE, aspect=1.0)),
        "not the shape of one fingertip",
    ),
    "two unlike fingers that touch": (
        np.maximum(finger(120e-6, 140, 110), finger(60e-6, 140 + 64, 125)),
        "not the shape of one fingertip",
    ),
    "two fingers apart": (
        np.maximum(finger(100e-6, 90), finger(60e-6, 230)),
        "more than one finger on the surface",
    ),
    "a palm": (finger(1500e-6, aspect=1.4), "1500 mm² touch the surface"),
    "half out of the picture": (finger(150e-6, 0.0), "partly outside the picture"),
    "half out of the picture, below": (finger(150e-6, y=239.0), "partly outside the picture"),
    "a dim finger": (finger(100e-6, level=10.0), "grey levels bright, and 12 are needed"),
    "a smudge beside a finger": (
        np.maximum(finger(100e-6), finger(30e-6, 260, 60, level=25.0)),
        "a faint spot beside the finger",
    ),
    "a glow beside a finger": (
        np.maximum(finger(100e-6), glow(300, 220, 22, 50)),
        "a glow beside the finger",
    ),
    "saturated": (finger(100e-6, level=230.0), "saturated"),
}


@pytest.mark.parametrize("case", CASES)
def test_what_is_no_fingertip_is_refused_by_its_name(case):
    light, named = CASES[case]
    found = of(light)
    if case == "a palm":
        assert found.area == pytest.approx(1500e-6, rel=0.01)
        named = "mm² touch the surface, more than a fingertip (450 mm²): a palm"
    assert named in found.problem


@pytest.mark.parametrize("seed", range(3))
def test_areas_of_clean_pictures_are_within_seven_thousandths(seed):
    rng = np.random.default_rng([20261127, seed])
    for number in range(12):
        area = rng.uniform(40e-6, 300e-6)
        x, y = rng.uniform(-30, 30, 2)
        aspect, level = rng.uniform(1.0, 1.6), rng.uniform(60, 150)
        light = finger(area, 160 + x, 120 + y, aspect=aspect, level=level)
        found = meter().measure(taken(light, number, seed))
        assert found.problem == "", found.problem
        assert found.area == pytest.approx(area, rel=7e-3)


def played(lights: Iterable[FloatArray | float]) -> list[str]:
    """What a button of 90 mm^2 does with frames at 60 a second."""
    measured, activator = meter(), Activator(90e-6, 20e-6)
    return [
        what
        for number, light in enumerate(lights)
        if (what := activator.see(measured.measure(taken(light, number))))
    ]


def touch(area: float, frames: int = 20) -> list[FloatArray]:
    rise = np.sin(np.linspace(0.1, np.pi - 0.1, frames))
    return [finger(area * share) for share in rise]


def test_a_press_is_one_press():
    assert played([0.0, 0.0, *touch(150e-6), 0.0, *touch(60e-6), 0.0, *touch(150e-6), 0.0]) == ["press"] * 2


@pytest.mark.parametrize("case", thinned([case for case in CASES if case != "a palm"], 3))
def test_what_is_refused_activates_nothing_nor_does_its_going(case):
    """One of two fingers is lifted: the other one has not crossed the threshold."""
    light, stays = CASES[case][0], finger(150e-6)
    assert played([0.0, 0.0, light, light, stays, stays, 0.0]) == []
    assert played([0.0, light, light, 0.0, 0.0, *touch(150e-6)]) == ["press"]


@pytest.mark.long
@pytest.mark.parametrize("drift", [0.5, -0.5], ids=["brighter", "darker"])
def test_the_background_is_followed(drift):
    """Half a grey level a second, for 40 s: six presses of six, and areas as before."""
    measured, activator, number = meter(), Activator(90e-6, 20e-6), 0
    counted, largest = 0, []

    def frames(lights, step):
        nonlocal number, counted
        for light in lights:
            number += 1
            frames.time += step
            time = frames.time
            contact = measured.measure(taken(light + drift * time * LAMP / 28.0, number, time=time))
            counted += activator.see(contact) == "press"
            largest.append(contact.area)

    frames.time = 0.0
    for _ in range(6):
        frames([0.0] * 25, 0.25)
        frames(touch(150e-6, 12), 1 / 20)
    assert counted == 6
    assert max(largest) == pytest.approx(150e-6 * np.sin(np.pi / 2), rel=0.01)


@pytest.mark.long
def test_a_smudge_that_stays_becomes_background_and_a_finger_does_not():
    measured = meter()
    smudge = finger(30e-6, 260, 60, level=9.0)
    problems = [bool(measured.measure(taken(smudge, n, time=n / 2)).problem) for n in range(80)]
    assert problems[1] and not problems[-1]
    rests = [measured.measure(taken(smudge + finger(100e-6), n, time=40 + n / 2)) for n in range(80)]
    assert {one.problem for one in rests} == {""}
    assert rests[-1].area == pytest.approx(100e-6, rel=0.01)
