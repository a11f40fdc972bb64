from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from haploop.base.errors import ConfigurationError
from haploop.calibration.drive import BEFORE
from haploop.calibration.perception import LabThreshold, event_levels, levels_of
from haploop.experiments import PAPER, PAPER_METRICS, Prediction, participant_model, predict_answers
from haploop.experiments.shown import prediction_contents
from haploop.mocks.people import SimulatedParticipant, load_participant_model
from tests.calibration.conftest import make_press
from tests.experiments.analysis.test_confusion import TABLES

RATE = 5000.0
SNAPS = {"latch": (0.24, 0.3), "toggle": (0.3,), "push": (0.3, 0.45)}
"""Times of the clicks of each press (s); its activation is at 0.3 s."""
NO_DOUBT = LabThreshold(12, 0.0, 0.01, 0.01, "push", 2.0, False)


def button(name: str, level: float, clicks: tuple[float, ...], lab: LabThreshold | None = NO_DOUBT) -> Any:
    """A digital button whose motion is its press, `level` dB above the threshold of a finger that presses."""
    parts = [make_press(((264, 10, 0.008),), at).acceleration for at in clicks]
    press = replace(make_press(), button=name, acceleration=np.sum(parts, axis=0))
    before = np.zeros(round(BEFORE * RATE))
    motion = np.concatenate([before, press.acceleration, before])
    motion = motion * 10 ** ((level - levels_of(motion, RATE).pressing) / 20)
    check = SimpleNamespace(accelerations=motion[None], measured=motion, rate_hz=RATE, lab=lab)
    return SimpleNamespace(press=press, check=check, simulated=True)


def three(level: float, lab: LabThreshold | None = NO_DOUBT) -> list[Any]:
    return [button(name, level, clicks, lab) for name, clicks in SNAPS.items()]


@pytest.mark.long
def test_what_is_far_above_threshold_and_unlike_is_told_apart():
    found = predict_answers(three(40))
    assert found.classes == tuple(SNAPS) and found.chance == pytest.approx(1 / 3)
    assert found.overall[0] > 0.93 and np.all(np.diag(found.cells) > 0.9)
    assert found.levels == pytest.approx([40] * 3, abs=0.5)
    rights = [predict_answers(three(level)).overall[0] for level in (0, 15)]
    assert rights[0] < rights[1] < found.overall[0]
    found = predict_answers(three(-30))
    assert found.overall == pytest.approx([1 / 3] * 3, abs=0.02)
    np.testing.assert_allclose(found.cells, 1 / 3, atol=0.02)


def test_two_of_one_motion_are_confused_and_a_third_is_not():
    latch, push = button("latch", 40, SNAPS["toggle"]), button("push", 40, SNAPS["push"])
    found = predict_answers([latch, button("toggle", 40, SNAPS["toggle"]), push])
    np.testing.assert_allclose(found.cells[:2, :2], 0.5, atol=0.06)
    assert found.cells[2, 2] > 0.9


@pytest.mark.long
def test_rows_add_up_and_the_range_holds_what_one_draw_says():
    found = predict_answers(three(15, None))
    np.testing.assert_allclose(found.cells.sum(axis=1), 1)
    assert np.all(found.least <= found.cells) and np.all(found.cells <= found.most)
    assert found.overall[2] - found.overall[1] > 0.1  # an estimated threshold leaves much open
    known = predict_answers(three(15))
    assert known.overall[2] - known.overall[1] < found.overall[2] - found.overall[1]
    # Other draws of what is not known say the same within their scatter.
    again = predict_answers(three(15, None), seed=1)
    np.testing.assert_allclose(again.cells, found.cells, atol=0.06)


def test_an_event_counts_by_its_energy():
    signal = button("toggle", 20, SNAPS["toggle"]).check.measured
    levels = event_levels(signal, RATE, 0.0, 0.03, 40)
    assert 10 * np.log10(np.sum(10 ** (levels / 10))) == pytest.approx(20, abs=0.2)
    assert np.argmax(levels) == pytest.approx((BEFORE + 0.3) / 0.03, abs=1)


@pytest.mark.parametrize("names", [("latch",), ("latch", "latch")])
def test_nothing_to_confuse_is_refused(names):
    with pytest.raises(ConfigurationError, match="at least two digital buttons, each of another name"):
        predict_answers([button(name, 20, (0.3,)) for name in names])


def test_the_papers_tables_stand_beside_it():
    shown = prediction_contents(predict_answers(three(20)))
    assert [table.title.split(",")[0] for table in shown.tables] == [
        "Predicted answers",
        "The paper's tables III and IV: range over groups and days",
        "Tables III and IV of the paper",
    ]
    cells = shown.tables[2].rows
    assert len(cells) == 9 and all(len(row) == 6 for row in cells)
    assert cells[2][0] == "accuracy, push" and cells[2][2:] == ("81.00 %", "86.67 %", "88.33 %", "92.33 %")
    assert shown.values["cells"]["within"] <= 36
    assert shown.values["paper"]["answers_percent"]["push"]["push"] == [68, 90]
    assert any("Not in it: how well people remember" in note for note in shown.notes)
    other = [button(name, 20, (0.3,)) for name in ("knob", "key")]
    assert len(prediction_contents(predict_answers(other)).tables) == 1


def test_predicted_metrics_are_those_of_the_cells():
    """Where nothing is left open, each metric of the mean is that of a confusion matrix."""
    found = predict_answers(three(40))
    right, answered = np.diagonal(found.cells), found.cells.sum(axis=0)
    np.testing.assert_allclose(found.metrics[2, :, 0], right, atol=1e-12)
    np.testing.assert_allclose(found.metrics[1, :, 0], right / answered, atol=0.02)
    np.testing.assert_allclose(found.metrics[0, :, 0], (2 - answered + 2 * right) / 3, atol=1e-12)
    assert np.all(found.metrics[..., 1] <= found.metrics[..., 0])
    assert np.all(found.metrics[..., 0] <= found.metrics[..., 2])


def test_the_papers_metrics_are_those_of_its_matrices():
    for key, metrics in PAPER_METRICS.items():
        published = TABLES[key[0], str(key[1])]
        assert [list(row) for row in metrics] == [list(row) for row in published]


def test_the_papers_ranges_are_those_of_its_matrices():
    """Every integer matrix that gives tables III and IV to two decimals (rows presented, of 100 each)."""
    matrices = [
        *([[75, a, 25 - a], [33 - a, 67, a], [a - 6, 38 - a, 68]] for a in range(6, 26)),
        *([[92, a, 8 - a], [6 - a, 83, 11 + a], [4 + a, 17 - a, 79]] for a in range(7)),
        *([[95, a, 5 - a], [6 - a, 83, 11 + a], [a - 2, 21 - a, 81]] for a in range(2, 6)),
        [[100, 0, 0], [0, 87, 13], [0, 10, 90]],
    ]
    low, high = np.min(matrices, axis=0), np.max(matrices, axis=0)
    for row, presented in enumerate(PAPER):
        assert list(PAPER[presented].values()) == list(zip(low[row], high[row], strict=True))


def test_simulated_participants_answer_as_predicted(tmp_path):
    """Errors go where they were predicted to go."""
    found = predict_answers(three(18))
    path = tmp_path / "model.toml"
    cells = np.array([[0.4, 0.5, 0.1], [0.05, 0.6, 0.35], [0.3, 0.3, 0.4]])
    for one in (found, replace(found, cells=cells)):
        path.write_text(participant_model(one), encoding="utf-8")
        model = load_participant_model(path)
        np.testing.assert_allclose(answered(model, one), one.cells, atol=0.06)
    # They tell its amplitude from nothing where the mean person's threshold is.
    assert model.comparison.threshold * np.log(2) ** 0.5 == pytest.approx(10 ** (-18 / 20), rel=0.1)


def answered(model: Any, found: Prediction) -> np.ndarray:
    counts = np.zeros((3, 3))
    for number in range(120):
        who = SimulatedParticipant(model, f"P{number:03}", 1)
        for trial in range(10):
            for row, name in enumerate(found.classes):
                step: Any = SimpleNamespace(
                    kind="identification", block=f"b{row}", number=trial, stimulus={}, presented=name,
                    choices=found.classes, values=(0.0, 0.0),
                )  # fmt: skip
                counts[row, found.classes.index(who.answer(step))] += 1
    return counts / counts.sum(axis=1, keepdims=True)


def test_buttons_of_two_labs_are_not_compared():
    """The threshold would be that of whichever comes first."""
    one, other, third = three(20)
    unknown = replace(NO_DOUBT, force=float("nan"))
    for lab in (None, replace(NO_DOUBT, shift=9.0), unknown):
        other.check.lab = lab
        with pytest.raises(ConfigurationError, match="different thresholds"):
            predict_answers([one, other, third])
    for one in (same := three(20)):
        one.check.lab = replace(NO_DOUBT, force=float("nan"))
    assert predict_answers(same).overall[0] > 0.5


@pytest.mark.long
@pytest.mark.parametrize("name", ['a "quoted" one', "back\\slash", "über 1.0"])
def test_any_name_of_a_button_makes_a_model_that_can_be_read(name, tmp_path):
    found = predict_answers([button(name, -300, SNAPS["push"]), button("push", 40, SNAPS["push"])])
    path = tmp_path / "model.toml"
    path.write_text(participant_model(found), encoding="utf-8")
    assert load_participant_model(path) is not None
