"""Scatter of channels: known gains and delays of simulated patches, found beside a table that drifts."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from haploop.base.arrays import FloatArray
from haploop.base.errors import ConfigurationError, DataError
from haploop.calibration import Calibration, Drift, Multisine, measure_response
from haploop.calibration.drive.actuation import Actuation
from haploop.calibration.model import ChannelScatter, channel_change, with_scatter
from haploop.instruments import open_rig
from haploop.instruments.config import RigFile
from haploop.mocks.plant.hysteresis import Hysteresis
from haploop.mocks.plant.modal_surface import ModalSurface
from haploop.mocks.plant.table import TouchTable, make_plate
from haploop.reports.contents import contents_of
from tests.raising import raises

pytestmark = pytest.mark.long

STEP = 2e-5
"""Period of the rig's outputs (s)."""


class Late:
    """A patch whose linear volts are multiplied, and late by a part of a step."""

    def __init__(self, gain: float, delay: float) -> None:
        self._law, self._gain, self._share, self._last = Hysteresis(0.12), 1 + gain, delay / STEP, 0.0

    def follow(self, volts: FloatArray) -> FloatArray:
        linear = self._gain * self._law.follow(volts)
        before = np.concatenate([[self._last], linear[:-1]])
        self._last = float(linear[-1])
        return np.asarray((1 - self._share) * linear + self._share * before)


class Unsteady(TouchTable):
    """A table whose patch A has a gain and a delay, and whose modes have each drifted on their own."""

    gain: float = 0.0
    delay: float = 1e-5
    common: float = 0.0
    own: float = 0.0

    def make(self, file: RigFile, rng: np.random.Generator) -> ModalSurface:
        plate = make_plate(rng, 0.0, self.damping_scale)
        turned = np.random.default_rng(71).standard_normal(len(plate.natural_hz))
        return ModalSurface(
            replace(plate, natural_hz=plate.natural_hz * (1 + self.common + self.own * turned))
        )

    def law(self, patch: str, file: RigFile) -> Any:
        return Late(self.gain, self.delay)


def measured(**plant: float) -> Calibration:
    with open_rig("simulated", simulate="twin", simulation={"seed": 5207}, plant=Unsteady(**plant)) as rig:
        return Calibration.of(measure_response(rig, "A", "button", excitation=Multisine()))


@pytest.fixture(scope="module")
def before() -> Calibration:
    return measured()


@pytest.mark.parametrize("drift", [{}, {"common": 0.005}, {"own": 0.002}, {"damping_scale": 1.05}], ids=str)
def test_gain_and_delay_are_told_from_a_drift(before, drift):
    for gain, delay in ((0.0, 0.0), (0.006, 1.5e-6)):
        found = channel_change(before, measured(gain=gain, delay=1e-5 + delay, **drift))
        assert found.gain == pytest.approx(gain, abs=0.001)
        assert found.delay == pytest.approx(delay, abs=4e-7)


def shifted(calibration: Calibration, gain: float, delay: float, rng: np.random.Generator) -> Calibration:
    """The calibration measured again with another gain and delay of its channel, and other noise."""
    response = calibration.response
    s, noise = 2j * np.pi * response.frequencies, rng.standard_normal((2, len(response.frequencies)))
    changed = response.velocity * (1 + gain) * np.exp(-s * delay)
    velocity = changed + response.deviation * (noise[0] + 1j * noise[1]) / np.sqrt(2)
    return replace(calibration, response=replace(response, velocity=velocity))


def test_a_stated_scatter_is_right_about_the_next_change(before):
    """Mean square of the next change over the stated variance, of channels whose scatter is known: one."""
    rng, gain, delay, ratios = np.random.default_rng(4402), 0.004, 1e-6, []

    def changed() -> tuple[float, float]:
        return gain * rng.standard_normal(), delay * rng.standard_normal()

    for _ in range(80):
        earlier = [shifted(before, *changed(), rng) for _ in range(8)]
        [stated] = with_scatter([before], earlier)
        following = changed()
        ratios.append((following[0] / stated.scatter.gain, following[1] / stated.scatter.delay))
    assert stated.scatter.changes == 8
    ours = np.mean(np.square(ratios), axis=0)
    assert np.all((ours > 0.6) & (ours < 1.6)), ours


def test_what_is_no_change_of_a_channel_is_refused(before):
    rng = np.random.default_rng(1)
    again = [shifted(before, 0.0, 0.0, rng) for _ in range(2)]
    raises(ConfigurationError, "There are 2 earlier calibrations", with_scatter, [before], again)
    elsewhere = replace(before, response=replace(before.response, point="31"))
    raises(ConfigurationError, "only those of one place", channel_change, elsewhere, before)
    backwards = replace(before, response=replace(before.response, velocity=before.response.velocity[::-1]))
    raises(DataError, "no gain, delay or drift of modes explains", channel_change, backwards, before)


def test_a_plan_counts_the_scatter_that_calibrations_state(before):
    other = replace(before, response=replace(before.response, patch="B"))
    f = np.linspace(100.0, 500.0, 50)
    only = Drift(common=0.0, own=0.0, damping=0.0)

    def variance(scatter: ChannelScatter, drift: Drift = only) -> FloatArray:
        table = Actuation.of([replace(before, scatter=scatter), other])
        assert np.all(np.abs(table.drifted(f, drift)[0, 0, 1]) == 0)
        return np.asarray(table.drifted(f, drift)[0, 0, 0].real / np.abs(table.gain(f)[0, 0]) ** 2)

    assert variance(ChannelScatter(0.003, 0.0, 8)) == pytest.approx(np.full(50, 9e-6))
    assert variance(ChannelScatter(0.0, 1e-6, 8)) == pytest.approx((2e-6 * np.pi * f) ** 2)
    # Not measured: an estimate. Asked for: what was asked.
    assert variance(ChannelScatter()) == pytest.approx(1e-4 + (4e-6 * np.pi * f) ** 2)
    assert variance(ChannelScatter(), replace(only, gain=0.03, delay=0.0)) == pytest.approx(np.full(50, 9e-4))


def test_a_calibration_keeps_and_says_its_scatter(before, tmp_path):
    rng = np.random.default_rng(2)
    [stated] = with_scatter([before], [shifted(before, g, 0.0, rng) for g in (0.002, -0.002, 0.004)])
    stated.save(tmp_path / "table.h5")
    again = Calibration.load(tmp_path / "table.h5")
    assert again.scatter == stated.scatter and again.digest == stated.digest != before.digest
    assert contents_of(again).values["channel"]["changes"] == 3
    [said], [guessed] = (
        [f.lines for f in contents_of(c).facts if f.label == "Channel"] for c in (again, before)
    )
    assert f"{100 * stated.scatter.gain:.2f} % of gain" in str(said[0]) and "3 changes within" in str(said[0])
    assert "1.00 % of gain and 2 µs of delay (estimates)" in str(guessed[0])
