"""Presses and participants that are unlike the others, of few and of many, and what becomes of them."""

from pathlib import Path

import numpy as np
import pytest

from benchmarks.synthetic_presses import FAMILIES, RATE, error
from haploop.acquisition import Protocol, Recording, Segmentation, Window, record, representative
from haploop.acquisition.presses.averaging import REGISTRATION, average
from haploop.acquisition.presses.registration import WarpModel
from haploop.base.errors import ConfigurationError
from tests.acquisition.presses import pressworld
from tests.acquisition.presses.pressworld import world_rig
from tests.raising import raises
from tests.rows import thinned

TEMPO, HANDS = FAMILIES["tempo"], FAMILIES["hands"]


@pytest.mark.parametrize("count", [4, 10])
def test_presses_of_another_button_are_left_out(count, full):
    for seed in range(80, 100 if full else 81):
        presses = TEMPO.warped(seed, 1, count).curves[0].copy()
        presses[-1:] = HANDS.warped(seed + 1, 1, 1).curves[0]
        (kept,) = average([presses[:, None]], RATE, method="mean").kept
        assert kept.tolist() == [True] * (count - 1) + [False]


@pytest.mark.parametrize("method", thinned(["automatic", "registration", "barycentre", "mean"], 4))
def test_a_participant_who_pressed_another_button_is_left_out_by_every_method(method):
    right = [curves[:, None] for curves in TEMPO.warped(80, 4, 4).curves]
    wrong = HANDS.warped(5, 1, 4).curves[0][:, None]
    with_it, without = average([*right, wrong], RATE, method=method), average(right, RATE, method=method)
    assert with_it.members == without.members == 16
    assert [bool(kept.any()) for kept in with_it.kept] == [True] * 4 + [False]
    assert np.array_equal(with_it.template, without.template)
    assert np.array_equal(with_it.spread, without.spread)


@pytest.mark.parametrize("method", ["automatic", "barycentre"])
def test_the_order_of_two_presses_or_participants_does_not_matter(method, full):
    for seed in range(500, 504 if full else 501):
        two = TEMPO.jittered(seed, 1, 2).curves[0][:, None]
        one = average([two], RATE, method=method)
        assert error(average([two[::-1].copy()], RATE, method=method).template[0], one.template[0]) < 1e-9
        one = average([two[:1], two[1:]], RATE, method=method)
        assert error(average([two[1:], two[:1]], RATE, method=method).template[0], one.template[0]) < 1e-9


def test_of_two_presses_noise_is_not_copied():
    """A barycentre of two follows the noise of both, and without one of them only the other is left."""
    template = HANDS.template((np.arange(2000) - 600) / RATE, np.zeros(HANDS.events))
    noise = 0.3 * np.std(template) * np.random.default_rng(0).standard_normal((2, 1, 2000))
    found = average([template + noise], RATE)
    assert found.method == REGISTRATION and "two presses" in found.reason
    assert error(found.template[0], template) < error((template + noise)[:, 0].mean(axis=0), template)
    assert np.sqrt(np.mean(found.spread**2)) == pytest.approx(0.3 * np.std(template), rel=0.15)


def held(hold: float, who: str, seed: int, folder: Path, monkeypatch: pytest.MonkeyPatch) -> Recording:
    monkeypatch.setattr(pressworld, "HOLD", hold)
    return record(world_rig(seed=seed), "push", who, 4, folder)


@pytest.mark.long
def test_presses_held_for_any_time_open_together(tmp_path, monkeypatch):
    short, long = (held(t, who, 5, tmp_path, monkeypatch) for t, who in ((0.1, "P01"), (0.3, "P02")))
    alone, both = representative([short]), representative([short, long])
    after = [one.acceleration[one.activation_index + 400 :] for one in (alone, both)]
    assert np.abs(after[1]).max() > 0.95 * np.abs(after[0]).max()
    assert np.mean((both.activation > 0.1) & (both.activation < 0.9)) < 0.002
    assert both.members == 8 and both.left_out == ()


@pytest.mark.long
def test_a_press_of_under_half_the_time_is_left_out(tmp_path, monkeypatch):
    long, short = (held(t, who, 5, tmp_path, monkeypatch) for t, who in ((0.5, "P01"), (0.06, "P02")))
    others = held(0.5, "P03", 6, tmp_path, monkeypatch)
    found = representative([long, short, others])
    assert found.members == 8 and len(found.left_out) == 4
    assert all("P02, press at" in one and "less than half the time" in one for one in found.left_out)


def test_two_files_of_one_name_keep_their_own_segmentations(tmp_path):
    def recorded(folder: str, seed: int, least: float) -> Recording:
        protocol = Protocol(segmentation=Segmentation(least_peak=least))
        return record(world_rig(seed=seed), "push", "P01", 3, tmp_path / folder, protocol=protocol)

    files = recorded("monday", 1, 0.5), recorded("tuesday", 3, 1.5)
    for order in (files, files[::-1]):
        found = representative(order)
        assert found.members == 6 and found.left_out == ()
        own = [one for name, one in found.parameters.items() if name.startswith("P01-push.h5 (")]
        assert sorted(one["least_peak"] for one in own) == [0.5, 1.5]


def test_a_press_that_is_not_found_again_is_said_to_be_left_out(tmp_path):
    recording = record(world_rig(seed=1), "push", "P01", 3, tmp_path)
    assert recording.sensors.force is not None
    recording.force[: recording.verdicts[0].end + 500] = 0.0
    found = representative([recording])
    assert found.members == 2
    assert found.left_out == ("P01, press 1, attempt 1: it is not found with the recording's segmentation",)


@pytest.mark.parametrize(
    "values", [{"taper": 0.3}, {"longest": 0.0}, {"high_pass_hz": 0.0}, {"before": -1.0}]
)
def test_a_window_or_a_model_of_warps_that_cannot_be_is_refused(values):
    raises(ConfigurationError, "no window of a press", Window, **values)
    for wrong in ({"knots": 3}, {"stretch": 0.0}, {"reach": 0.0}, {"floor": np.nan}):
        raises(ConfigurationError, "no model of warps", WarpModel, **wrong)
