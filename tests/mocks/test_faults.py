"""Faults fire on schedule, on twin and wire alike, and the product notices each."""

from pathlib import Path

import numpy as np
import pytest

from haploop.acquisition import record
from haploop.base.errors import ConfigurationError, DataError, InstrumentError, LimitError
from haploop.calibration import LinearSweep, linear_sweep, measure_response
from haploop.instruments import Rig, open_rig
from haploop.instruments.operator.role import Place, Remove
from haploop.mocks.faults import OWN
from tests.raising import raises

SWEEP = linear_sweep(50_000.0, 0.5, 625.0, 10.0)


def played(rig: Rig) -> np.ndarray:
    """(2, samples): V at the patch and m/s of a short sweep into patch A."""
    volts = rig.excite(SWEEP, ("A",), ("drive", "laser"), 0.1).volts
    return np.array([volts[0] * 100, rig.vibrometer.to_si(volts[1])])


def listened(rig: Rig, channel: str, seconds: float = 0.5) -> np.ndarray:
    with rig.daq.stream((channel,), 5000, 500, round(5000 * seconds)) as stream:
        return stream.capture().volts[0]


def fired(rig: Rig) -> list[int]:
    return [fault.fired for fault in rig.simulation.faults]


def test_every_kind_is_in_the_guide():
    guide = (Path(__file__).parents[2] / "docs" / "reference" / "faults.md").read_text(encoding="utf-8")
    assert len(OWN) >= 25
    assert [kind for kind in OWN if f"`{kind}`" not in guide] == []


@pytest.mark.parametrize(
    ("fault", "says"),
    [
        ({"kind": "relay-swaped"}, "did you mean 'relay-swapped'"),
        ({}, "unknown fault kind"),
        ({"kind": "patch-dead", "path": "A"}, "unknown key 'path'; did you mean 'patch'"),
        ({"kind": "patch-dead", "patch": "Z"}, "has A, B, C, D"),
        ({"kind": "relay-swapped", "patches": ["A", "A"]}, "two different patches"),
        ({"kind": "sensor-saturated", "channel": "gauge9"}, "gauge0, gauge1"),
        ({"kind": "daq-overrun", "device": "Dev9"}, "Dev1, Dev2"),
        ({"kind": "amplifier-trip", "after": -1}, "after"),
        ({"kind": "laser-dropout", "times": 0}, "times"),
        ({"kind": "reply", "instrument": "relay"}, "none when it is simulated as twin"),
    ],
    ids=lambda value: str(value.get("kind")) if isinstance(value, dict) else "",
)
def test_a_fault_that_cannot_be_is_refused_in_one_sentence(fault, says):
    raises(ConfigurationError, says, open_rig, "haptable", simulate="twin", simulation={"faults": [fault]})


def test_a_fault_waits_for_its_moment_and_says_when_it_fired(open):
    rig = open(faults=[{"kind": "sensor-saturated", "channel": "gauge0", "after": 1.0, "duration": 0.5}])
    assert np.abs(listened(rig, "gauge0")).max() < 5
    assert fired(rig) == [0]
    rig.clock.sleep(1.1 - rig.clock.now())
    assert np.abs(listened(rig, "gauge0", 0.2)).min() > 9.9
    assert rig.simulation.faults[0].at == [1.0]
    rig.clock.sleep(2.0 - rig.clock.now())
    assert np.abs(listened(rig, "gauge0")).max() < 5
    assert fired(rig) == [1]


def test_the_seed_chooses_the_moment_and_chooses_it_again():
    moments = []
    for seed in (1, 1, 2):
        fault = {"kind": "amplifier-trip", "after": 5, "within": 10, "times": 3}
        with open_rig("haptable", "twin", {"seed": seed, "faults": [fault]}) as rig:
            moments.append(rig.simulation.faults[0].begin)
    assert moments[0] == moments[1] != moments[2]
    assert all(5 <= moment <= 15 for moment in moments)


@pytest.mark.parametrize(
    ("fault", "kind", "says"),
    [
        ({"kind": "amplifier-trip", "after": 0.3}, InstrumentError, "check the amplifier"),
        ({"kind": "laser-dropout", "after": 1.0, "within": 1.0}, InstrumentError, "left its range"),
        ({"kind": "laser-blocked"}, DataError, "does not follow"),
    ],
)
def test_what_is_no_measurement(open, fault, kind, says):
    rig = open(faults=[fault])
    if fault["kind"] == "amplifier-trip":
        assert np.abs(played(rig)[0, -10_000:]).max() < 0.1
    raises(kind, says, measure_response, rig, excitation=LinearSweep(seconds=2.0))
    assert fired(rig) == [1]


@pytest.mark.parametrize(("kind", "code"), [("daq-overrun", "-200279"), ("daq-overflow", "-200010")])
def test_lost_samples_end_a_recording(open, tmp_path, kind, code):
    rig = open(faults=[{"kind": kind, "device": "Dev1", "after": 3.0}])
    raises(InstrumentError, rf"Dev1 lost samples.*{code}", record, rig, "push", "P01", 5, tmp_path)
    assert fired(rig) == [1]


@pytest.mark.parametrize(
    ("how", "says"), [("underflow", "-200290"), ("fifo", "-200621"), ("stopped", "by somebody else")]
)
def test_a_play_that_was_not_played_whole_is_an_error(open, how, says):
    rig = open(faults=[{"kind": "play-cut-off", "how": how, "after": 0.2}])
    raises(InstrumentError, rf"Dev2 .*{says}.* was not played whole", played, rig)
    assert fired(rig) == [1] and not rig.simulation.truth.closed
    if how == "stopped":  # whoever did may have written volts
        raises(LimitError, "locked out", played, rig)
    else:
        assert np.abs(played(rig)[0]).max() > 9


def test_a_clock_of_its_own_makes_a_card_late(open):
    rig = open("haptable", faults=[{"kind": "clock-drift", "drift": 0.01, "device": "Dev1"}])
    rig.clock.sleep(10)
    rig.operator.confirm(Place(0.5))
    volts = listened(rig, "gauge0", 0.4)
    late = int(np.argmax(np.abs(volts - volts[:100].mean()) > 0.1)) / 5000
    assert late == pytest.approx(0.1, abs=0.01)
    assert fired(rig) == [1]


def test_a_stream_of_two_clocks_is_refused(open, mode):
    if mode == "wire":
        pytest.skip("NI's wire counts samples by one clock")
    rig = open("haptable", faults=[{"kind": "clock-drift", "drift": 0.1}])
    with (
        pytest.raises(InstrumentError, match=r"Dev1 has taken \d+ samples and Dev2 \d+.*RTSI"),
        rig.daq.stream(("gauge0", "laser"), 5000, 500) as stream,
    ):
        for block in stream:
            assert block.end < 10 * 5000


@pytest.mark.parametrize("kind", ["relay-lost", "relay-stuck"])
def test_a_relay_that_does_not_obey_stops_the_drive(open, kind):
    rig = open("haptable", faults=[{"kind": kind, "patch": "A", "after": 0.5, "times": 1}])
    rig.clock.sleep(1)
    raises(InstrumentError, r"patch A\) was told to close but reads open", played, rig)
    assert fired(rig) == [1]
    assert np.abs(played(rig)[0]).max() > 9, "the next command is obeyed"


def test_a_welded_contact_shows_in_the_drive_alone(open):
    rig = open("haptable", faults=[{"kind": "relay-welded", "patch": "A"}])
    for measure in (played, lambda rig: measure_response(rig, excitation=LinearSweep(seconds=2.0))):
        raises(InstrumentError, r"that patch A was to get .* check .* the contact", measure, rig)


def test_the_known_mass_is_what_stands_on_the_sensor(open):
    rig = open("haptable")
    force = rig.sensors.force
    rest = listened(rig, "gauge0").mean()
    rig.operator.confirm(Place(2.0))
    loaded = listened(rig, "gauge0").mean()
    rig.operator.confirm(Remove())
    assert loaded - rest == pytest.approx(2 * 9.80665 * np.linalg.inv(force.matrix)[0, 2], rel=0.01)
    assert listened(rig, "gauge0").mean() == pytest.approx(rest, abs=2e-3)


@pytest.mark.parametrize("how", ["silence", "garbled", "truncated", "disconnect"])
@pytest.mark.parametrize("instrument", ["relay", "daq"])
def test_an_answer_that_does_not_come_whole_is_an_error(mode, instrument, how, monkeypatch):
    if mode not in ("twin", "wire"):
        pytest.skip("of a simulated line")
    monkeypatch.setattr("haploop.instruments.daq.ni_sessions._SILENCE", 0.5)
    fault = {"kind": "reply", "instrument": instrument, "how": how, "after": 0.5}
    with (
        pytest.raises(InstrumentError, match=r"hub|device server"),
        open_rig("haptable", "wire", {"faults": [fault]}) as rig,
    ):
        rig.clock.sleep(1)
        played(rig)
    assert fired(rig)[0] > 0
    assert rig.simulation.truth.peak < 11
    rig.clock.sleep(2.5)
    assert rig.simulation.truth.closed == frozenset(), "whatever was closed has opened by itself"


def test_a_late_answer_is_an_answer():
    fault = {"kind": "reply", "instrument": "relay", "how": "delay", "delay": 0.02, "times": 4}
    with open_rig("haptable", "wire", {"faults": [fault]}) as rig:
        assert np.abs(played(rig)[0]).max() > 9
        assert fired(rig) == [4]
