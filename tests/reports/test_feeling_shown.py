import json
from typing import Any

import numpy as np
import pytest

from haploop.calibration import Feeling, feeling_of
from haploop.calibration.perception import Pressed
from haploop.reports.contents.feeling import feeling_facts, feeling_values
from haploop.reports.figures import feeling_figure, png

RATE = 5000.0


def felt(size: float, with_press: bool = True) -> Feeling:
    t = np.arange(round(0.8 * RATE)) / RATE
    shape = np.exp(-(((t - 0.4) / 0.01) ** 2)) * np.sin(2 * np.pi * 264 * t)
    rng = np.random.default_rng(917)
    plays = size * (1.05 * shape + 0.001 * rng.normal(size=(4, len(t))))
    return feeling_of(size * shape, plays.mean(axis=0), RATE, Pressed(shape if with_press else None), plays)


@pytest.mark.parametrize("size", [0.0, 1e-4, 0.3])
@pytest.mark.parametrize("with_press", [True, False])
def test_the_values_are_json_and_say_what_the_feeling_is(size, with_press):
    feeling = felt(size, with_press)
    values = json.loads(json.dumps(feeling_values(feeling), allow_nan=False))
    assert values["felt"] == feeling.felt and values["notes"] == list(feeling.notes)
    assert ("recorded" in values["levels"]) == with_press
    assert values["sentence"] == feeling.sentence
    for name, level in (("measured", feeling.measured), ("residual", feeling.residual)):
        shown = values["levels"][name]["above_pressing_threshold_db"]
        assert shown == level.pressing if np.isfinite(level.pressing) else shown is None
        assert len(values["levels"][name]["bands_db"]) == len(values["third_octaves_hz"])
    for one in feeling.acts:
        assert values["acts"][one.act.name]["people"] == list(one.people)


def test_the_facts_hold_the_levels_and_every_sentence():
    feeling = felt(0.3)
    lines = [str(line) for one in feeling_facts(feeling) for line in one.lines]
    assert f"measured {feeling.measured.pressing:+.1f} dB" in " ".join(lines)
    assert {feeling.sentence, *feeling.notes, *(one.sentence() for one in feeling.acts[1:])} <= set(lines)


@pytest.mark.long
def test_the_figure_has_levels_and_both_thresholds_for_each_button():
    loud, quiet = felt(3.0), felt(1e-4, with_press=False)
    figure = feeling_figure([("latch", loud), ("push", quiet)])
    assert len(figure.axes) == 4
    titles = [axes.get_title(loc="left") for axes in figure.axes]
    assert titles[0].endswith("pressing finger: yes") and titles[2].endswith("pressing finger: no")
    drawn: dict[str, Any] = {line.get_label(): line for line in figure.axes[0].get_lines()}
    assert list(drawn) == [
        "threshold, pressing", "threshold, at rest", "recorded press", "target", "measured", "difference",
        "noise",
    ]  # fmt: skip
    shown = loud.octaves_hz > 49
    np.testing.assert_array_equal(drawn["threshold, at rest"].get_ydata(), loud.resting_db[shown])
    np.testing.assert_array_equal(drawn["measured"].get_ydata(), loud.measured.bands[shown])
    assert png(figure) == png(feeling_figure([("latch", loud), ("push", quiet)]))


def test_a_motion_of_nothing_is_drawn():
    assert png(feeling_figure([("push", felt(0.0, with_press=False))]))
