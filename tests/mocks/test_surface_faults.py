"""Surfaces that are not the calibrated one, and signals that are not the surface's, on twin and wire."""

from typing import Any

import numpy as np
import pytest
import scipy

from haploop.instruments import Rig, open_rig
from haploop.instruments.operator.role import Place, Remove
from tests.conftest import OpenRig

STEP = 1 / 50_000
GAUGES = [f"gauge{i}" for i in range(6)]


def sine(hz: float, volts: float, seconds: float) -> np.ndarray:
    t = np.arange(round(seconds / STEP)) * STEP
    return volts * np.sin(2 * np.pi * hz * t) * np.minimum(1, np.minimum(t, seconds - t) / 0.05)


def seen(rig: Rig, drive: np.ndarray) -> np.ndarray:
    return np.asarray(rig.vibrometer.to_si(rig.excite(drive, ["A"], ["laser"]).volts[0]))


def modes_of(rig: Rig) -> tuple[np.ndarray, np.ndarray]:
    modes = rig.simulation.truth.surface.modes(rig.clock.now())
    return modes.natural_hz, modes.damping


def changed(open: OpenRig, **settings: Any) -> tuple[np.ndarray, np.ndarray]:
    """Relative changes of frequency and damping, mode by mode."""
    fault = {"kind": "mode-drift", **settings}
    before, after = (modes_of(open(faults=faults)) for faults in ([], [fault]))
    return after[0] / before[0] - 1, after[1] / before[1] - 1


def test_modes_drift_alike_or_each_by_its_own_or_one_alone(open):
    frequency, damping = changed(open, frequency=0.03)
    np.testing.assert_allclose(frequency, 0.03)
    np.testing.assert_allclose(damping, 0, atol=1e-12)
    frequency, damping = changed(open, frequency_each=0.02, damping_each=0.3)
    assert 0.01 < frequency.std() < 0.03 and np.abs(np.corrcoef(frequency, damping)[0, 1]) < 0.9
    assert 0.1 < np.log(1 + damping).std() < 0.5
    frequency, damping = changed(open, frequency=0.02, damping=-0.5, near=264)
    assert np.count_nonzero(frequency) == np.count_nonzero(damping) == 1
    assert frequency.max() == pytest.approx(0.02) and damping.min() == pytest.approx(-0.5)


def test_the_surface_moves_with_its_new_modes_and_says_that_it_did(open):
    rig = open(faults=[{"kind": "mode-drift", "frequency": 0.02, "near": 263.5}], vibrometer_noise_scale=0)
    assert rig.simulation.faults[0].fired == 0
    ringing = seen(rig, sine(rig.simulation.truth.resonance_hz, 20, 0.4))
    assert rig.simulation.faults[0].fired == 1
    plain = open(vibrometer_noise_scale=0)
    assert rig.simulation.truth.resonance_hz == pytest.approx(1.02 * plain.simulation.truth.resonance_hz)
    assert np.abs(seen(plain, sine(rig.simulation.truth.resonance_hz, 20, 0.4))).max() < 0.7 * ringing.max()


def test_frequencies_drift_while_a_measurement_runs(open):
    drift = {"kind": "frequency-drift", "rate": 0.004, "after": 1.0, "limit": 0.01}
    rig, plain = open(faults=[drift]), open()
    tone = sine(plain.simulation.truth.resonance_hz, 20, 4.0)
    level = []
    for each in (rig, plain):
        each.clock.sleep(1.0 - each.clock.now())
        velocity = seen(each, tone)
        level.append([np.std(velocity[k : k + 5000]) for k in range(10_000, 190_000, 20_000)])
    ratio = np.divide(*level)
    assert ratio[0] > 0.9 and ratio[-1] < 0.75
    assert rig.simulation.faults[0].fired == 1
    shift = rig.simulation.truth.resonance_hz / plain.simulation.truth.resonance_hz - 1
    assert shift == pytest.approx(0.01, rel=1e-6), "it ends at its limit"


def test_a_patch_follows_another_law(open):
    """At 20 Hz, whose harmonics the loop makes: the laws differ in them, and one patch alone may have one."""
    slow = sine(20.0, 45, 0.5)
    seen_by = {
        name: seen(open(faults=faults), slow)
        for name, faults in {
            "default": [],
            "same": [{"kind": "patch-hysteresis", "law": "play", "width": 0.12}],
            "wider": [{"kind": "patch-hysteresis", "law": "play", "width": 0.24}],
            "bouc-wen": [{"kind": "patch-hysteresis"}],
            "elsewhere": [{"kind": "patch-hysteresis", "patches": ["B"]}],
        }.items()
    }
    scale = np.linalg.norm(seen_by["default"])
    off = {name: np.linalg.norm(each - seen_by["default"]) / scale for name, each in seen_by.items()}
    assert off["same"] == off["elsewhere"] == 0
    assert off["wider"] > 0.05 and off["bouc-wen"] > 0.05


def test_a_patch_that_is_weaker_and_a_laser_that_is_askew_look_alike(open):
    """The surface's own velocity tells them apart, which no instrument shows."""
    tone = sine(260.0, 30, 0.3)
    shown, own = {}, {}
    for name, faults in {
        "as it was": [],
        "weaker": [{"kind": "patch-gain", "gain": 0.8}],
        "elsewhere": [{"kind": "patch-gain", "gain": 0.8, "patches": ["B"]}],
        "askew": [{"kind": "laser-askew", "scale": 0.8}],
    }.items():
        rig = open(faults=faults, vibrometer_noise_scale=0)
        shown[name] = np.std(seen(rig, tone))
        now = rig.clock.now()
        own[name] = np.std(rig.simulation.truth.velocity("button", np.linspace(now - 0.4, now, 4000)))
        assert all(fault.fired for fault in rig.simulation.faults)
    for name, (by_laser, by_surface) in {
        "weaker": (0.8, 0.8),
        "elsewhere": (1.0, 1.0),
        "askew": (0.8, 1.0),
    }.items():
        assert shown[name] / shown["as it was"] == pytest.approx(by_laser, rel=2e-3)
        assert own[name] / own["as it was"] == pytest.approx(by_surface, rel=2e-2)


@pytest.mark.parametrize("shape", ["square", "kink", "lagging"])
def test_a_patch_that_expands_more_than_it_shrinks(open, shape):
    """A drive and its negative: their mean is the even order, and -0.02 takes the default law's away."""
    drive = sine(40.0, 45, 0.5)
    share = {}
    for size in (-0.02, 0.02, 0.06):
        faults = [{"kind": "patch-asymmetry", "share": size, "shape": "square" if size < 0 else shape}]
        both = [seen(open(faults=faults, vibrometer_noise_scale=0), sign * drive) for sign in (1, -1)]
        line = np.fft.rfft((both[0] + both[1]) * np.hanning(len(both[0])))[40]  # at 80 Hz
        share[size] = float(np.abs(line))
    assert 10 * share[-0.02] < share[0.02] < share[0.06]


def listened(rig: Rig, channel: str, count: int, block: int) -> np.ndarray:
    with rig.daq.stream((channel,), 5000, block, count) as stream:
        return np.asarray(stream.capture().volts[0])


def test_the_mains_hum_in_laser_and_gauges(open):
    fault = {"kind": "mains-hum", "channel": ["laser", *GAUGES], "volts": 0.1, "frequency": 60.0}
    still, humming = open(), open(faults=[fault])
    for channel in ("laser", "gauge3"):
        added = listened(humming, channel, 5000, 500) - listened(still, channel, 5000, 500)
        lines = np.abs(np.fft.rfft(added)) / 2500
        assert lines[60] == pytest.approx(0.1, rel=0.05) and lines[180] == pytest.approx(0.03, rel=0.1)
    assert np.array_equal(*(listened(rig, "switch", 500, 500) for rig in (still, humming)))
    assert humming.simulation.faults[0].fired == 1


def test_spikes_are_counted_and_do_not_depend_on_the_blocks(open):
    fault = {"kind": "laser-spikes", "rate": 20.0, "height": 5e-3, "width": 1e-3, "after": 0.5}
    rigs = [open(faults=[fault], vibrometer_noise_scale=0) for _ in range(2)]
    one, two = (listened(rig, "laser", 15_000, block) for rig, block in zip(rigs, (500, 1500), strict=True))
    assert np.array_equal(one != 0, two != 0) or np.abs(one - two).max() < 2e-3
    counted = [rig.simulation.faults[0].fired for rig in rigs]
    assert counted[0] == counted[1] and 30 < counted[0] < 75
    spiked = np.flatnonzero(np.abs(one) > 0.05)
    assert len(spiked) > 60 and spiked[0] / 5000 >= 0.5 - rigs[0].vibrometer.delay - 1e-3


def test_a_sensor_creeps_under_its_load_and_comes_back(open):
    rig = open(faults=[{"kind": "sensor-creep", "channel": GAUGES, "share": 0.1, "longest": 10.0}])
    listened(rig, "gauge0", 500, 500)
    rest = listened(rig, "gauge0", 500, 500).mean()
    rig.operator.confirm(Place(2.0))
    loaded = listened(rig, "gauge0", 50_000, 500) - rest
    early, late = loaded[:200].mean(), loaded[-2000:].mean()
    assert 1.05 < late / early < 1.11
    rig.operator.confirm(Remove())
    after = listened(rig, "gauge0", 500, 500).mean() - rest
    assert 0.03 < after / early < 0.11
    assert rig.simulation.faults[0].fired == 1


def test_the_same_seed_drifts_in_the_same_way():
    drawn = []
    for seed, name in ((1, "simulated"), (1, "simulated"), (2, "simulated")):
        fault = {"kind": "mode-drift", "frequency_each": 0.02}
        with open_rig(name, "twin", {"seed": seed, "faults": [fault]}) as rig:
            drawn.append(modes_of(rig)[0])
    assert np.array_equal(drawn[0], drawn[1]) and not np.array_equal(drawn[0], drawn[2])


def test_a_machine_turns_at_its_frequency_after_its_run_up_and_flicker_falls_with_frequency():
    rate = 10_000.0

    def heard(**fault):
        with (
            open_rig("simulated", simulation={"faults": [{"channel": "laser", **fault}]}) as rig,
            rig.daq.stream(("laser",), rate, 1000, round(8 * rate)) as stream,
        ):
            return stream.capture().volts[0]

    turned = heard(kind="rotating-machine", volts=0.1, frequency=50.0, after=2.0, run_up=2.0, harmonics=[0.5])
    assert np.std(turned[: round(1.9 * rate)]) < 1e-3
    late = np.abs(np.fft.rfft(turned[round(5 * rate) : round(7 * rate)])) / rate
    assert late[[100, 200]] == pytest.approx([0.1, 0.05], rel=0.02)
    during = np.abs(np.fft.rfft(turned[round(2.9 * rate) : round(3.1 * rate)]))
    assert np.argmax(during[1:]) + 1 == pytest.approx(5, abs=1)  # half of the speed, in lines of 5 Hz
    noise = heard(kind="flicker-noise", volts=0.1)
    assert np.std(noise) == pytest.approx(0.1, rel=0.3)
    f, power = scipy.signal.welch(noise, rate, nperseg=20_000)
    slope = np.polyfit(np.log(f[(f > 2) & (f < 500)]), np.log(power[(f > 2) & (f < 500)]), 1)[0]
    assert slope == pytest.approx(-1, abs=0.15)
