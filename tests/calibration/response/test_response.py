import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from haploop import calibration
from haploop.base.errors import ConfigurationError, DataError, InstrumentError
from haploop.calibration import LinearSweep, Multisine, fit, measure_response, quick_response
from haploop.calibration.response import settle
from haploop.calibration.response.spot import Channels
from haploop.instruments import Aim, Rig, open_rig
from tests.calibration.conftest import tamper
from tests.raising import raises
from tests.rig_files import changed

SHORT = LinearSweep(repeats=2, seconds=1.5, tail=0.3, shares=())


def difference(a: np.ndarray, b: np.ndarray) -> float:
    return float(np.linalg.norm(a - b) / np.linalg.norm(b))


def true_velocity(rig: Rig, frequencies: np.ndarray) -> np.ndarray:
    if rig.simulation is None:
        pytest.skip("only a simulation knows the truth")
    return np.asarray(rig.simulation.truth.velocity_response("A", "button", frequencies))


@pytest.mark.long
def test_the_response_is_the_plates_own(open):
    """In gain and phase up to the band's end: a delay or a skew of 14 us that was left in would show."""
    rig = open(hysteresis=0)
    seen: list[tuple[float, float]] = []
    response = measure_response(
        rig,
        progress=lambda _doing, done, total, _unit: seen.append((done, total)),
        excitation=LinearSweep(shares=()),
    )
    truth = true_velocity(rig, response.frequencies)
    assert difference(response.velocity, truth) < 0.002
    high = response.frequencies > 400
    assert difference(response.velocity[high], truth[high]) < 0.004
    assert difference(response.acceleration, truth * 2j * np.pi * response.frequencies) < 0.006
    assert difference(response.displacement * 2j * np.pi * response.frequencies, truth) < 0.006
    assert seen[-1][0] == pytest.approx(seen[-1][1]) == pytest.approx(3 * 8.2)
    assert response.simulated and response.rig == "simulated" and '"seed"' in response.rig_file


def test_hysteresis_changes_the_gain_and_adds_no_harmonics(calibrated):
    response = calibrated.calibration.response
    truth = true_velocity(calibrated.rig, response.frequencies)
    gain = np.vdot(truth, response.velocity) / np.vdot(truth, truth)
    assert difference(response.velocity / gain, truth) < 0.004
    assert abs(gain) == pytest.approx(1, abs=0.02)
    assert np.angle(gain) < -0.05


def test_noise_coherence_and_path_are_what_the_rig_has(calibrated):
    response = calibrated.calibration.response
    assert np.all((response.coherence >= 0) & (response.coherence <= 1))
    near = (response.frequencies >= 255) & (response.frequencies <= 272)
    assert response.coherence[near].min() > 0.999
    assert np.abs(response.path).max() < 1.03
    # Half a step of the staircase and the amplifier's pole.
    late = -np.polyfit(2 * np.pi * response.frequencies, np.unwrap(np.angle(response.path)), 1)[0]
    assert 30e-6 < late < 60e-6
    if calibrated.rig.simulated:
        # docs/hardware.md, "PDV-100": 0.02 um/s per sqrt(Hz) in the 20 mm/s range, and the converter's own.
        assert 0.018e-6 < np.median(response.noise) < 0.03e-6


@pytest.mark.long
@pytest.mark.parametrize("excitation", [
    Multisine(),
    Multisine(periods=2, settle=1.0),
    Multisine(lines="all"),
    Multisine(lines=(1, 4), settle=1.0),
    LinearSweep(seconds=3.0, shares=()),
], ids=["from rest", "settled", "all lines", "interleaved", "sweep"])  # fmt: skip
def test_the_truth_is_within_the_confidence_band(open, excitation):
    rig = open(hysteresis=0, vibrometer_noise_scale=20, seed=12)
    response = measure_response(rig, excitation=excitation)
    inside = response.frequencies > 30
    distance = np.abs(response.velocity - true_velocity(rig, response.frequencies))[inside]
    within = np.mean(distance < response.confidence(0.95)[inside])
    assert within > 0.88
    # And not because the band is wide.
    assert np.sqrt(np.mean(distance**2)) > 0.6 * np.sqrt(np.mean(response.deviation[inside] ** 2))
    assert np.mean(distance < response.confidence(0.5)[inside]) < 0.75
    assert excitation.duration == pytest.approx(
        float(response.excitation.split("; ")[1].split()[0]), abs=0.05
    )


def test_two_seconds_from_rest_are_a_response(open, full):
    """On a plant with hysteresis, whose law is found in the same two seconds; within one complex number."""
    seen: list[tuple[float, float]] = []
    for seed in range(180, 200) if full else (41,):
        rig = open(seed=seed)
        response = quick_response(rig, progress=lambda _doing, done, total, _unit: seen.append((done, total)))
        assert seen[-1] == (2.05, 2.05)
        assert "from rest" in response.excitation and response.source == "measured"
        truth, inside = true_velocity(rig, response.frequencies), response.frequencies > 30
        gain = np.vdot(truth, response.velocity) / np.vdot(truth, truth)
        assert abs(gain) == pytest.approx(1, abs=0.02) and np.angle(gain) < -0.05
        lines = difference(response.velocity[inside] / gain, truth[inside])
        model, known = fit(response), rig.simulation.truth
        fitted = difference(model.velocity(response.frequencies)[inside] / gain, truth[inside])
        plate = known.surface.modes(rig.clock.now())
        main = int(np.argmin(np.abs(plate.natural_hz - known.resonance_hz)))
        mode = min(model.resonances, key=lambda r: abs(r.frequency_hz - known.resonance_hz))
        off, damping = mode.frequency_hz - known.resonance_hz, mode.damping / plate.damping[main] - 1
        print(f"{seed}: lines {lines:.3%}, fit {fitted:.3%}, {off * 1e3:.1f} mHz, damping {damping:.2%}")
        assert lines < 0.005 and fitted < 0.002
        assert abs(off) < 0.005 and abs(damping) < 0.005


@pytest.mark.long
def test_a_known_law_takes_distortion_and_level_out(calibrated):
    rig, law, sweep = calibrated.rig, calibrated.calibration.hysteresis, calibrated.calibration.response
    for level in (None, 12.0):
        response = quick_response(rig, level=level, hysteresis=law)
        f = response.frequencies
        swept = np.interp(f, sweep.frequencies, sweep.velocity.real) + 1j * np.interp(
            f, sweep.frequencies, sweep.velocity.imag
        )
        assert difference(response.velocity, swept) < (0.006 if level is None else 0.02)
        assert response.level == law.level
    raises(ConfigurationError, "Sweeps measure the hysteresis", measure_response, rig, hysteresis=law)


def test_the_monitors_images_are_taken_out_where_the_path_is_known():
    """A staircase through a pole, as sampled, is not what it is at its own frequency: 4 mrad at 600 Hz."""
    rate_hz, corner = 50e3, 5000.0
    f = np.linspace(20, 620, 300)
    stairs = np.sinc(f / rate_hz) * np.exp(-1j * np.pi * f / rate_hz)
    for delay in (0.0, 6e-6):
        channels = Channels(rate_hz, delay, 0.0, lambda f: np.ones(len(f), complex))
        # All images that reach the monitor, summed up.
        n = np.arange(-400, 401)[:, None] * rate_hz + f
        images = np.sinc(n / rate_hz) * np.exp(-1j * np.pi * n / rate_hz) / (1 + 1j * n / corner)
        sampled = (images * np.exp(2j * np.pi * n * delay)).sum(axis=0)[None, :]
        true = stairs / (1 + 1j * f / corner)
        late = sampled[0] * np.exp(-2j * np.pi * f * delay)
        assert np.abs(late / true - 1).max() > 1e-3
        corrected = sampled[0] * channels.drive(sampled, np.ones(len(f), complex), f)
        assert np.abs(corrected / true - 1).max() < 2e-4
        # A path that is none such is left alone, but for the channel's own delay.
        other = sampled * (1 + 0.1 * np.sin(f / 30))
        assert np.allclose(
            channels.drive(other, np.ones(len(f), complex), f), np.exp(-2j * np.pi * f * delay), atol=1e-12
        )


@pytest.mark.parametrize(("spoil", "error", "says"), [
    (lambda rig, patch: tamper(rig, patch, laser=noise), DataError, "does not follow patch A"),
    (lambda rig, patch: tamper(rig, patch, drive=lambda v: 0.01 * v), InstrumentError, "drive monitor"),
    (lambda rig, patch: tamper(rig, patch, laser=lambda v: 100 * v), InstrumentError, "range of 20 mm/s"),
    (lambda rig, patch: patch.setattr(rig.operator, "confirm", unaimed), InstrumentError, "Aim the laser"),
    (lambda rig, patch: patch.setattr(rig.vibrometer, "signal_level", lambda: 0.02), InstrumentError,
     "2% of its light"),
], ids=["blind", "no drive", "out of range", "not confirmed", "dark"])  # fmt: skip
def test_what_cannot_be_measured_is_no_response(open, monkeypatch, spoil, error, says):
    rig = open()
    spoil(rig, monkeypatch)
    raises(error, says, measure_response, rig, excitation=SHORT)


def noise(volts: np.ndarray, rng: np.random.Generator = np.random.default_rng(1)) -> np.ndarray:  # noqa: B008
    return np.asarray(1e-3 * rng.standard_normal(len(volts)))


def unaimed(request: object) -> bool:
    return not isinstance(request, Aim)


def test_what_a_response_needs_is_asked_for(open):
    raises(ConfigurationError, "2 repeats", LinearSweep, repeats=1)
    with open_rig(changed(open().file, sensors={"drive": None})) as rig:
        raises(ConfigurationError, r"sensors\.drive", measure_response, rig, excitation=SHORT)


def test_estimators_see_only_what_a_lab_would_see():
    for source in Path(calibration.__file__).parent.glob("*.py"):
        text = source.read_text(encoding="utf-8")
        assert not re.search(r"\.simulation\b|\btruth\b|\bmocks\b", text), source


def test_a_response_is_a_value(calibrated):
    with pytest.raises(AttributeError):
        calibrated.calibration.response.patch = "B"
    assert replace(calibrated.calibration.response, patch="B").patch == "B"


@pytest.mark.usefixtures("unproved")
def test_a_contact_that_fails_once_is_noticed_before_anything_is_measured(open):
    """The first play erases the patch's memory; without it, the next one's motion is another."""
    rig = open(faults=[{"kind": "relay-welded", "times": 1}])
    raises(InstrumentError, r"drive monitor shows 0\.?\d* V for each volt that patch A", settle, rig, ["A"])
    rig.make_safe()
    assert settle(rig, ["A"]) < 1.5
