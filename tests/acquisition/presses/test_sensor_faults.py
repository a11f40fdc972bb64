"""Signals that are wrong: refused when they are recorded, left out or corrected when they are averaged."""

import json
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

import haploop
from benchmarks.synthetic_presses import FAMILIES, RATE, error
from haploop.acquisition import PressVerdict, Recording, representative
from haploop.acquisition.presses import quality
from haploop.acquisition.presses.averaging import average
from haploop.acquisition.presses.choice import double_clicks, single
from haploop.acquisition.presses.sensor_faults import signal_fault
from haploop.base.errors import DataError
from haploop.base.parts import Parted

INVERTED = {"kind": "accelerometer-inverted"}
FLICKER = {"kind": "flicker-noise", "channel": "acceleration_z", "volts": 0.03}
GAUGES = [f"gauge{number}" for number in range(6)]
BUTTONS = ("latch", "toggle", "push", "rocker", "keypad")


def hum(volts: float, frequency: float = 50.0, channel: str = "acceleration_z") -> dict[str, Any]:
    return {"kind": "mains-hum", "channel": channel, "volts": volts, "frequency": frequency}


def machine(volts: float, **more: Any) -> dict[str, Any]:
    turning = {"kind": "rotating-machine", "channel": "acceleration_z", "volts": volts, "frequency": 87.3}
    return {**turning, **more}


def off(channel: str) -> dict[str, Any]:
    return {"kind": "sensor-disconnected", "channel": channel}


def recorded(
    folder: Path, seed: int, *faults: dict[str, Any], verdicts: list[PressVerdict] | None = None
) -> Recording:
    """Four presses on a simulated rig with faults, by a participant and of a button that follow the seed."""
    file = folder / f"{seed}.toml"
    lines = ['base = "simulated"', "[simulation]", f"seed = {seed}"]
    for fault in faults:
        lines += ["[[simulation.faults]]"] + [f"{key} = {json.dumps(value)}" for key, value in fault.items()]
    file.write_text("\n".join(lines), encoding="utf-8")
    told = (verdicts if verdicts is not None else []).append
    with haploop.open_rig(file) as rig:
        return haploop.record(rig, BUTTONS[seed % 5], f"P{seed % 12 + 1:02}", 4, folder, on_verdict=told)


@pytest.fixture
def unlooked(monkeypatch: pytest.MonkeyPatch) -> None:
    """Recordings of a program that does not look at the sensors."""
    monkeypatch.setattr(quality, "axis_fault", lambda *_: "")
    monkeypatch.setattr(quality, "signal_fault", lambda *_: "")


FAN = machine(0.03)
WRONG = {
    "inverted": (INVERTED, "it is mounted upside down, z must point up: turn it over", 2001),
    "50 mV": (hum(0.05), r"1\.1 m/s² rms at 50 Hz", 2002),
    "60 Hz": (hum(0.05, 60.0), r"1\.1 m/s² rms at 60 Hz", 2003),
    "10 mV": (hum(0.01), r"0\.2[23] m/s² rms at 50 Hz", 2001),
    "fan": (FAN, r"shows 0\.7\d? m/s² rms at rest, \d+% of the press's motion; look for a fan", 2002),
    "wandering fan": (machine(0.02, frequency=131.0, wander=0.003), r"0\.4\d m/s² rms at rest", 2003),
    "slow noise": (FLICKER, r"0\.\d+ m/s² rms at rest", 2001),
    "z off": (off("acceleration_z"), "z must show 9.8", 2002),
    "x off": (off("acceleration_x"), r"-4\d\.\d m/s² along x at rest: check its wires", 2003),
    "gauge off": (off("gauge2"), "gauge2 does not follow the force", 2001),
}


@pytest.mark.parametrize(("fault", "said", "seed"), WRONG.values(), ids=WRONG)
def test_a_wrong_sensor_is_told_at_the_first_press(tmp_path, fault, said, seed, full):
    for number in (2001, 2002, 2003) if full else (seed,):
        verdicts: list[PressVerdict] = []
        (folder := tmp_path / str(number)).mkdir()
        with pytest.raises(DataError, match=said):
            recorded(folder, number, fault, verdicts=verdicts)
        assert len(verdicts) == 5 and all("sensor" in verdict.flags for verdict in verdicts)
        (path,) = folder.glob("*.h5")
        assert [verdict.reason for verdict in Recording.open(path).verdicts] == [v.reason for v in verdicts]


@pytest.mark.parametrize(("fault", "said"), [
    (hum(0.003), "The accelerometer has mains hum"),
    (machine(0.01), "The accelerometer shows 0.25 m/s² rms at rest, 2"),
    ({"kind": "sensor-creep", "channel": GAUGES, "share": 0.3}, "The force sensor creeps: "),
], ids=["3 mV", "fan", "creep"])  # fmt: skip
def test_what_is_doubtful_is_told_once_and_counts(tmp_path, fault, said):
    verdicts: list[PressVerdict] = []
    recorded(tmp_path, 2001, fault, verdicts=verdicts)
    assert all(verdict.accepted and verdict.flags == () for verdict in verdicts)
    (told,) = [verdict.reason for verdict in verdicts if verdict.reason]
    assert told.startswith(said)


def test_a_motor_that_starts_between_presses_is_seen_in_the_rest_of_the_next(tmp_path):
    """The representative press was at r = 0.87, and nothing was said."""
    verdicts: list[PressVerdict] = []
    with pytest.raises(DataError, match=r"m/s² rms at rest, .* look for a fan or a motor"):
        recorded(tmp_path, 31007, machine(0.04, after=3.0, run_up=1.0), verdicts=verdicts)
    assert verdicts[0].accepted and not verdicts[-1].accepted


def test_good_recordings_are_neither_refused_nor_doubted(tmp_path, full):
    """`--full`: a hundred seeds, with every button and participant."""
    for seed in range(4000, 4100 if full else 4002):
        verdicts: list[PressVerdict] = []
        folder = tmp_path / str(seed)
        folder.mkdir()
        found = representative([recorded(folder, seed, verdicts=verdicts)])
        assert [(verdict.accepted, verdict.reason) for verdict in verdicts] == [(True, "")] * 4
        assert (found.members, found.left_out, found.corrected) == (4, (), ())


@pytest.mark.usefixtures("unlooked")
def test_the_sign_of_an_accelerometer_upside_down_is_corrected(tmp_path):
    (tmp_path / "right").mkdir()
    right = representative([recorded(tmp_path / "right", 2000)])
    found = representative([recorded(tmp_path, 2000, INVERTED)])
    same = min(len(right.acceleration), len(found.acceleration))
    assert np.corrcoef(right.acceleration[:same], found.acceleration[:same])[0, 1] > 0.98
    (told,) = found.corrected
    assert told.endswith("upside down, as gravity shows; the sign of its acceleration was changed")


@pytest.mark.usefixtures("unlooked")
@pytest.mark.parametrize("fault", [hum(0.05), off("gauge0")], ids=["hum", "gauge"])
def test_presses_with_wrong_signals_are_not_averaged(tmp_path, fault, monkeypatch):
    """Of a recording whose presses were never judged."""
    unjudged = SimpleNamespace(from_json=lambda text: None)
    monkeypatch.setattr("haploop.acquisition.presses.choice.Protocol", unjudged)
    with pytest.raises(DataError, match=r"no usable press .*(mains hum|gauge0).*; and 1 more\)") as told:
        representative([recorded(tmp_path, 2000, fault)])
    assert "\n" not in str(told.value)


def test_a_spike_is_told_in_a_press_and_a_click_is_none(tmp_path):
    recording = recorded(tmp_path, 2000)
    verdict = recording.verdicts[0]
    press, rest = slice(verdict.first, verdict.end), recording.rest
    right = recording.acceleration
    for height, wide, count in ((0.0, 1, 0), (0.4, 1, 0), (2.0, 1, 1), (-20.0, 1, 1), (-20.0, 4, 0)):
        shown = right.copy()
        shown[2, press.start + 300 : press.start + 300 + wide] += height
        recording.__dict__["_parted"] = {"acceleration": Parted.of(shown)}
        said = signal_fault(recording, rest, press, right[2][rest])
        assert said.startswith("the accelerometer's signal has 1 spike;") == bool(count), (height, wide, said)


def test_a_clicks_ringing_that_is_sampled_eight_times_a_period_is_no_spike(tmp_path):
    """One right press in 25 was refused for a spike at 2 kS/s."""
    (tmp_path / "rig.toml").write_text('base = "minimal"\nrate_hz = 2000', encoding="utf-8")
    with haploop.open_rig(tmp_path / "rig.toml", simulate="twin") as rig:
        recording = haploop.record(rig, "latch", "P01", 1, tmp_path)
    assert recording.rate_hz == 2000
    verdict, shown = recording.verdicts[0], recording.acceleration.copy()
    rings = [11.0, 10.43, 10.03, 9.75, 9.75, 10.11, 10.68, 11.1, 11.11, 10.73, 10.36, 10.02, 9.98, 10.01]
    shown[2, verdict.first + 285 : verdict.first + 299] = rings
    recording.__dict__["_parted"] = {"acceleration": Parted.of(shown)}
    still = shown[2][recording.rest]
    assert signal_fault(recording, recording.rest, slice(verdict.first, verdict.end), still) == ""


def doubled(curves: np.ndarray, which: list[int], lag: float) -> np.ndarray:
    """A second click in some presses (presses, samples), 80 % as loud, `lag` s after the first."""
    late, twice = round(lag * RATE), curves.copy()
    twice[which, late:] += 0.8 * curves[which, :-late]
    return twice


@pytest.mark.parametrize("family", ["tempo", "hands", "crowded"])
@pytest.mark.parametrize("lag", [0.06, 0.1])
def test_double_clicks_are_found_and_spoil_no_average(family, lag, full):
    for seed in range(700, 703 if full else 701):
        presses = FAMILIES[family].warped(seed, 1, 8).curves[0]
        twice = doubled(presses, [1, 6], lag)
        once, told = single(twice, RATE, 600, [f"press {number}" for number in range(8)])
        assert np.flatnonzero(~once).tolist() == [1, 6]
        assert [one.partition(":")[0] for one in told] == ["press 1", "press 6"]
        right = np.delete(presses, [1, 6], axis=0)
        found = average([twice[once][:, None]], RATE).template[0]
        assert error(found, average([right[:, None]], RATE).template[0]) < 1e-9


@pytest.mark.parametrize("family", ["tempo", "hands", "crowded"])
def test_presses_that_only_differ_in_tempo_have_clicked_once(family, full):
    for seed in range(800, 820 if full else 802):
        for presses in FAMILIES[family].warped(seed, 2, 10).curves:
            assert np.isnan(double_clicks(presses, RATE)).all()
    assert np.isnan(double_clicks(doubled(presses[:3], [1], 0.1), RATE)).all()  # of three, none is usual
