"""Sample rates: right within what is stated, or refused with the least rate that the step needs."""

import re
from itertools import product
from pathlib import Path

import numpy as np
import pytest

import haploop
from haploop.acquisition import find_presses
from haploop.acquisition.presses.force_at import Instant, force_at
from haploop.acquisition.presses.segmentation import _first_lasting
from haploop.acquisition.presses.segmentation_settings import LEAST_RATES, Segmentation
from haploop.instruments import Press, load_rig_file
from haploop.mocks.plant.buttons import Finger, button_named, press_button
from tests.exchange.lab_files import Written, german
from tests.rows import thinned

FIT = Segmentation().fit


def rig_at(rate_hz: float) -> haploop.instruments.RigFile:
    """The simulated rig at a rate, on cards that reach it."""
    file = load_rig_file("simulated")
    daq = file.daq.model_copy(update={"devices": {"Dev1": "PCIe-6351", "Dev2": "PCIe-6351"}})
    return file.model_copy(update={"rate_hz": rate_hz, "daq": daq if rate_hz > 30_000 else file.daq})


@pytest.mark.parametrize(
    ("rate_hz", "button"),
    thinned(product([500, 800, 999, 1000, 2000, 5000, 48_000], ["latch", "toggle", "push"]), 4),
)
def test_force_at_activation_is_within_its_bound(rate_hz, button, tmp_path):
    """Of a live recording; the truth is the plant's. What is stated is no more than the rate makes it."""
    with haploop.open_rig(rig_at(rate_hz)) as rig:
        found = find_presses(haploop.record(rig, button, "P01", 4, out=tmp_path))
        truth = [press.activation_force for press in rig.simulation.truth.presses]
    assert len(found) == len(truth) == 4
    for press, true in zip(found, truth, strict=True):
        assert abs(press.force_at_activation - true) <= press.force_uncertainty
        assert press.force_uncertainty < (0.3 if rate_hz < 900 else 0.2 if rate_hz < 2001 else 0.05) * true


@pytest.mark.parametrize("rate_hz", [200, 333, 490])
def test_a_rate_that_is_too_low_is_refused_before_anyone_presses(rate_hz, tmp_path):
    few = pytest.raises(haploop.ConfigurationError, match=f"{rate_hz} samples/s, and a recording needs 500")
    with haploop.open_rig(rig_at(rate_hz)) as rig, few:
        haploop.record(rig, "push", "P01", 1, out=tmp_path)
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize("rate_hz", [80, 200, 300, 334, 400, 500, 666, 800, 999, 1000, 2000, 5000, 48_000])
def test_a_constant_and_a_ramp_read_as_they_are(rate_hz):
    """At whatever rate and place between two samples; at the ends of a signal there is nothing to say."""
    ramp = 40.0 * np.arange(400) / rate_hz
    for at in (100.0, 100.3, 100.5, 100.99):
        for signal, true in ((np.full(400, 4.0), 4.0), (ramp, 40 * at / rate_hz)):
            value, _ = force_at(signal, Instant(at, 1.0, rate_hz), FIT * rate_hz, 0.0)
            assert value == pytest.approx(true, rel=1e-9)
    assert force_at(ramp, Instant(0.5, 1.0, rate_hz), FIT * rate_hz, 0.0) is None


@pytest.mark.long
@pytest.mark.parametrize("rate_hz", [500, 800, 999, 2000, 5000, 48_000])
def test_the_stated_uncertainty_holds_for_presses_that_nobody_chose(rate_hz):
    """Of 100 presses of any button, finger and phase of the clock, 98 are within what is stated."""
    rng = np.random.default_rng(20_26)
    within = []
    for number in range(400):
        name = ("latch", "toggle", "push", f"odd{number}")[number % 4]
        press = press_button(button_named(name), Finger.of(rng), Press(name, "P01", 1, 1), 1.0, rng)
        times = rng.uniform(0, 1 / rate_hz) + np.arange(0.9 * rate_hz, 1.5 * rate_hz) / rate_hz
        force = press.force(times) + rng.normal(0, 0.03, len(times))
        closed = np.searchsorted(press.flips, times, side="right") % 2 == 1
        first = _first_lasting(closed, 0, max(1, round(0.005 * rate_hz)))
        value, stated = force_at(force, Instant(first - 0.5, 1.0, rate_hz), FIT * rate_hz, 0.03)
        within.append(abs(value - press.activation_force) <= stated)
    assert np.mean(within) >= 0.98


@pytest.mark.long
@pytest.mark.parametrize(("every", "force", "bandwidth"), [
    (1, True, 2500), (2, True, 1250), (10, True, 250), pytest.param(15, False, 0, marks=pytest.mark.long),
])  # fmt: skip
def test_an_imports_rate(every, force, bandwidth, run, tmp_path):
    """Resampling adds nothing: neither certainty of the force, nor bandwidth."""
    with haploop.open_rig("simulated") as rig:
        live = haploop.record(rig, "push", "P01", 2, out=tmp_path / "live")
        truth = [press.activation_force for press in rig.simulation.truth.presses]
    part = slice(None, None, every)
    path, signals = tmp_path / "a.csv", (live.force, live.acceleration[2], live.activation)
    german(path, Written(live.rate_hz / every, *(signal[part] for signal in signals), 2))
    made = run("import", path, "-o", tmp_path / "a.h5", "-p", "P01", "--button", "push", "--as", "recording")
    assert made.exit_code == 0, made.stderr
    recording = haploop.Recording.open(tmp_path / "a.h5")
    assert recording.measured_hz == pytest.approx(5000 / every, rel=1e-3)
    found = find_presses(recording)
    assert len(found) == 2
    shown = run("show", tmp_path / "a.h5")
    represented = run("represent", tmp_path / "a.h5", "-o", tmp_path / "press.h5")
    if not force:
        assert all(press.force_at_activation is None for press in found)
        assert "333.333 samples/s, and 500 are needed" in " ".join(shown.stdout.split())
        assert represented.exit_code == 2 and "needs 500" in represented.stderr
        return
    for press, true in zip(found, truth, strict=True):
        assert abs(press.force_at_activation - true) <= press.force_uncertainty
    assert "N, each within" in shown.stdout
    press = haploop.Representative.load(tmp_path / "press.h5")
    assert press.bandwidth_hz == pytest.approx(bandwidth, rel=1e-3)
    assert f"{bandwidth} Hz, " in run("show", tmp_path / "press.h5").stdout


def test_the_document_shows_the_table():
    text = Path("docs/how-to/recording.md").read_text(encoding="utf-8")
    section = text.split("## Sample rates")[1].split("\n## ")[0]
    rows = re.findall(r"^\| ([a-z ]+) \| (\d+) \|$", section, re.MULTILINE)
    assert {step: float(hz) for step, hz in rows} == {step: one.hz for step, one in LEAST_RATES.items()}
