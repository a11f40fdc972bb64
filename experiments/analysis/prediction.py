"""What people would answer when digital buttons are to be matched with physical ones: a prediction.

Model: a person feels the course of a button's loudness, the level above the own threshold in windows of 30 ms
(shorter, and a vibration is felt as one pulse) about the activation. Levels count in just noticeable
differences, which were measured as 20 % of the amplitude 10 dB above threshold and as 20 dB near it; below it
nothing is felt. What is felt is compared with what is remembered of each physical button, all of them as much
quieter as the digital ones are on the whole, and the nearest is answered. Noise of one just noticeable
difference in each window is the least that a person can have; memory adds to it, by an amount that nobody
has measured. What is not known is drawn at random, many times, and stated as a range: the threshold of the
mean person within what the act may have, and the share of the differences that memory keeps. What breaks
it: cues that are no vibration of the surface (force, travel, sound), pitch, learning with confirmation,
answers by preference. Sources: docs/hardware.md, "Feeling a vibration"; the window: Remache-Vinueza et al.,
Scientific Reports 15, 2025.
"""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ...acquisition import Representative
from ...base.arrays import FloatArray
from ...base.errors import ConfigurationError
from ...calibration import Check, DigitalButton
from ...calibration.drive import BEFORE
from ...calibration.perception import Act, event_levels, pressing_act, thresholds

PAPER = {
    "latch": {"latch": (75, 100), "toggle": (0, 25), "push": (0, 19)},
    "toggle": {"latch": (0, 27), "toggle": (67, 87), "push": (6, 25)},
    "push": {"latch": (0, 19), "toggle": (10, 32), "push": (68, 90)},
}
"""Answers in percent in the paper's four groups and days: the range of all integer matrices that give its
tables III and IV to two decimals."""

PAPER_METRICS = {
    ("I", 1): ((82.67, 76.33, 81.00), (73.53, 63.81, 73.12), (75.0, 67.0, 68.0)),
    ("I", 2): ((94.00, 88.67, 86.67), (90.20, 83.00, 80.61), (92.0, 83.0, 79.0)),
    ("II", 1): ((97.00, 87.33, 88.33), (95.96, 79.81, 83.51), (95.0, 83.0, 81.0)),
    ("II", 2): ((100.0, 92.33, 92.33), (100.0, 89.69, 87.38), (100.0, 87.0, 90.0)),
}
"""The 36 cells of the paper's tables III and IV, by group and day: accuracy, precision and sensitivity
(`METRICS`) of latch, toggle and push, in percent."""

_WINDOW, _FIRST, _WINDOWS = 0.030, -0.15, 17
"""Length of a window (s), begin of the first about the activation (s), and their number."""
_MEMORY = (0.05, 1.0)
"""Share of the squared differences that memory keeps, least and most (estimate)."""
_LAPSE = 0.02
"""Share of answers that have nothing to do with the stimulus (estimate)."""
_WORLDS, _PEOPLE, _TRIALS = 200, 30, 60
"""Draws of what is not known, people in each, and trials of each person and button."""
_RANGE = (5.0, 95.0)
"""Percentiles of the draws that are stated."""


@dataclass(frozen=True, eq=False)
class Prediction:
    """A predicted confusion matrix: rows are presented, columns answered; fractions of a row."""

    classes: tuple[str, ...]
    cells: FloatArray
    """(classes, classes) mean over what is not known."""
    least: FloatArray
    most: FloatArray
    """(classes, classes) 90 % of what is not known lies between."""
    overall: tuple[float, float, float]
    """Right answers: mean, least, most."""
    metrics: FloatArray
    """(metrics, classes, 3): mean, least and most of each of `METRICS`."""
    levels: tuple[float, ...]
    """dB of each button above the threshold of the mean person."""
    act: Act
    """Threshold that was assumed."""
    simulated: bool

    @property
    def chance(self) -> float:
        """Right answers of a person who feels nothing."""
        return 1 / len(self.classes)


def predict_answers(buttons: Sequence[DigitalButton], seed: int = 0) -> Prediction:
    """Predict the answers to digital buttons, of which each was made of one physical button.

    Raises ConfigurationError for fewer than two, or two of one name.
    """
    classes = tuple(one.press.button for one in buttons)
    if len(classes) < 2 or len(set(classes)) < len(classes):
        raise ConfigurationError("A prediction needs at least two digital buttons, each of another name.")
    if len({repr(one.check.lab) for one in buttons}) > 1:  # a force that is not known is NaN
        raise ConfigurationError(
            "The buttons were checked with different thresholds of people ([people] in the rig file): check "
            "them again on one rig, for the answer would depend on which comes first."
        )
    act = pressing_act(buttons[0].check.lab)
    felt = np.array([felt_levels(one.press, one.check) for one in buttons]) - act.shift
    recorded = np.array([recorded_levels(one.press) for one in buttons]) - act.shift
    rng = np.random.default_rng(seed)
    worlds = np.array([_world(felt, recorded, act, rng) for _ in range(_WORLDS)])
    right = np.trace(worlds, axis1=1, axis2=2) / len(classes)
    low, high = np.percentile(right, _RANGE)
    each = metrics_of(worlds)
    return Prediction(
        classes=classes,
        cells=worlds.mean(axis=0),
        least=np.percentile(worlds, _RANGE[0], axis=0),
        most=np.percentile(worlds, _RANGE[1], axis=0),
        overall=(float(right.mean()), float(low), float(high)),
        metrics=np.stack([each.mean(axis=0), *np.percentile(each, _RANGE, axis=0)], axis=2),
        levels=tuple(_total(one) for one in felt),
        act=act,
        simulated=any(one.simulated for one in buttons),
    )


def participant_model(prediction: Prediction, seed: int = 0) -> str:
    """A model of simulated participants who answer as predicted: TOML for `haploop experiment simulate`."""
    lines = [
        "# Predicted from the buttons' motion and the threshold of a finger that presses.",
        f"seed = {seed}",
        "",
        "[identification]",
        "shift = {}                        # confirmation is not predicted",
        "",
    ]
    for name, row in zip(prediction.classes, prediction.cells, strict=True):
        each = zip(prediction.classes, row, strict=True)
        cells = ", ".join(f"{_quoted(other)} = {cell:.4f}" for other, cell in each)
        lines.append(f"answers.{_quoted(name)} = {{ {cells} }}")
    amplitude = 10 ** (-np.mean(prediction.levels) / 20)
    lines += [
        "",
        "[comparison]                      # amplitude, as a share of the verified drive",
        f"threshold = {max(amplitude / np.log(2) ** 0.5, 1e-3):.4f}",
        f"spread = {prediction.act.spread * np.log(10) / 20:.3f}",
    ]
    return "\n".join(lines) + "\n"


def metrics_of(answers: FloatArray) -> FloatArray:
    """(draws, metrics, classes): `METRICS` of (draws, classes, classes) fractions of a row."""
    right, answered = np.diagonal(answers, axis1=1, axis2=2), answers.sum(axis=1)
    # Nobody who answers never is right: the precision is then that of no answer.
    precision = right / np.where(answered > 0, answered, np.inf)
    return np.stack([1 - (1 + answered - 2 * right) / answers.shape[1], precision, right], axis=1)


def _quoted(name: str) -> str:
    """A key of TOML, which quotes as JSON does."""
    return json.dumps(name, ensure_ascii=False)


def felt_levels(press: Representative, check: Check) -> FloatArray:
    """(windows,) dB of the measured motion, about the activation."""
    activation = BEFORE + press.activation_index / press.rate_hz
    return event_levels(check.accelerations, check.rate_hz, activation + _FIRST, _WINDOW, _WINDOWS)


def recorded_levels(press: Representative) -> FloatArray:
    """(windows,) dB of the recorded press, about the activation."""
    activation = press.activation_index / press.rate_hz
    # A window that begins before the recording holds nothing.
    silence = np.zeros(round(-_FIRST * press.rate_hz))
    signal = np.concatenate([silence, np.asarray(press.acceleration)])
    return event_levels(signal, press.rate_hz, activation, _WINDOW, _WINDOWS)


def answers_of_people(
    felt: FloatArray, recorded: FloatArray, spread: float, kept: float, rng: np.random.Generator
) -> FloatArray:
    """(classes, classes) answers, fractions of a row, of people about a mean threshold of 0 dB.

    `felt` and `recorded` are (classes, windows) dB above it, `spread` is the standard deviation of people in
    dB, and `kept` the share of the squared differences that memory keeps.
    """
    classes = len(felt)
    remembered = (
        recorded + np.mean([_total(one) for one in felt]) - np.mean([_total(one) for one in recorded])
    )
    counts = np.zeros((classes, classes))
    for own in spread * rng.normal(size=_PEOPLE):
        moved, memory = (np.interp(levels - own, _LEVELS, _STEPS) for levels in (felt, remembered))
        apart = ((moved[:, None] - memory) ** 2).sum(axis=2)
        # Noise of one just noticeable difference a window matters along the remembered buttons only.
        noise = rng.normal(size=(_TRIALS, memory.shape[1])) / np.sqrt(kept) @ memory.T
        tie = 1e-9 * rng.random((classes, _TRIALS, classes))
        answered = np.argmin(apart[:, None] - 2 * noise + tie, axis=2)
        counts += [np.bincount(row, minlength=classes) for row in answered]
    shares = counts / counts.sum(axis=1, keepdims=True)
    return np.asarray((1 - _LAPSE) * shares + _LAPSE / classes)


def _total(levels: FloatArray) -> float:
    return float(10 * np.log10(np.sum(10 ** (levels / 10)) + 1e-30))


def _world(felt: FloatArray, recorded: FloatArray, act: Act, rng: np.random.Generator) -> FloatArray:
    """(classes, classes) answers of people, with one draw of what is not known."""
    threshold = rng.uniform(-act.lower, act.higher)
    kept = float(np.exp(rng.uniform(*np.log(_MEMORY))))
    return answers_of_people(felt - threshold, recorded - threshold, act.spread, kept, rng)


def _steps() -> tuple[FloatArray, FloatArray]:
    known = sorted(thresholds().differences, key=lambda one: one.sensation)
    near = known[0]
    above = min(known, key=lambda one: one.fraction)
    levels = np.linspace(0.0, 100.0, 1001)
    sizes = [20 * np.log10(1 + one.fraction) for one in (near, above)]
    size = np.exp(np.interp(levels, [near.sensation, above.sensation], np.log(sizes)))
    middle = 0.5 * (1 / size[1:] + 1 / size[:-1])
    return levels, np.concatenate([[0.0], np.cumsum(middle * np.diff(levels))])


_LEVELS, _STEPS = _steps()
