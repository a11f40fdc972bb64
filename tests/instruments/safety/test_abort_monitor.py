"""A play that exceeds an abort limit is stopped, logged and locked out; only a person clears the lockout."""

import json
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from haploop.base.errors import InstrumentError, LimitError
from haploop.instruments import Block, Limits, Rig, RigFile, load_rig_file, open_rig
from haploop.instruments.config.rig_file import AbortLimits
from haploop.instruments.safety.abort_monitor import AbortMonitor
from haploop.instruments.safety.audit import entries
from haploop.instruments.safety.lockout import Lockout, clear_lockout, lockout_of, set_lockout
from tests.instruments.safety.at_the_patch import bursts
from tests.raising import raises, raising
from tests.rig_files import changed

pytestmark = pytest.mark.usefixtures("unproved")

SECONDS = 1.5
TWO_BLOCKS = 0.2


def tone(rig: Rig, peak: float = 40) -> np.ndarray:
    t = np.arange(round(SECONDS * rig.table.rate_hz)) / rig.table.rate_hz
    return np.asarray(peak * np.sin(2 * np.pi * 263.5 * t) * np.sin(np.pi * t / SECONDS) ** 2)


def file(base: str = "simulated", rate_hz: float = 50_000.0, faults: Any = (), **abort: Any) -> RigFile:
    simulation = {"faults": tuple(faults)}
    return changed(
        load_rig_file(base), abort=AbortLimits(**abort), table={"rate_hz": rate_hz}, simulation=simulation
    )


DOUBLED = file(faults=[{"kind": "amplifier-gain", "gain": 100.0}])


def kinds(rig: Rig) -> list[str]:
    return [str(entry["kind"]) for entry in entries(rig.audit.folder)]


@pytest.mark.parametrize("allowed", [None, 45.0])
def test_more_volts_on_one_channel_stop_the_plays_of_all(allowed):
    fault = {"kind": "amplifier-gain", "patch": "C", "gain": 100.0}
    with open_rig(file("four-channel", faults=[fault], drive=allowed)) as rig:
        record = rig.simulation.truth.record()
        with pytest.raises(InstrumentError, match=r"The patch on drive_c got .* The play was stopped"):
            rig.excite_each(dict.fromkeys("ABCD", tone(rig)), ["laser"])
        assert rig.lockout is not None and "on drive_c" in rig.lockout.why
        assert not rig.simulation.truth.closed
    beyond = next(f.start for f in record if np.abs(f.volts).max() > (allowed or 1.1 * 48))
    last = max(f.start for f in record if np.abs(f.volts).max() > 1)
    assert last - beyond < TWO_BLOCKS


def test_more_volts_than_are_allowed_stop_the_play_within_two_blocks():
    with open_rig(DOUBLED) as rig:
        record = rig.simulation.truth.record()
        with pytest.raises(InstrumentError, match=r"The patch got .* The play was stopped.*haploop reset"):
            rig.excite(tone(rig), ["A"], ["laser"])
    (burst,) = bursts(record)
    assert burst.high > 1.1 * 48
    beyond = next(
        f.start + float(np.argmax(np.abs(f.volts) > 1.1 * 48)) * f.period
        for f in record
        if np.abs(f.volts).max() > 1.1 * 48
    )
    assert burst.stop - beyond < TWO_BLOCKS < SECONDS - beyond


@pytest.mark.parametrize(("abort", "says"), [
    ({"drive": 30.0}, r"The patch got .* V, and \[abort\] allows 30 V"),
    ({"velocity": 2e-3}, r"The surface moved at .* m/s, and \[abort\] allows 0\.002 m/s"),
])  # fmt: skip
def test_every_abort_limit_is_tested_whatever_is_recorded(abort, says):
    with open_rig(file(**abort)) as rig:
        record = rig.simulation.truth.record()
        raises(InstrumentError, says, rig.excite, tone(rig), ["A"], ["switch"])
        assert rig.simulation.truth.closed == frozenset()
        with np.load(rig.lockout.samples) as file_of_trip:
            kept = dict(file_of_trip)
        assert kept["volts"].shape[0] == len(kept["channels"]) and kept["volts"].shape[1] > 4000
        assert str(kept["why"]) == rig.lockout.why and {"drive", "switch"} <= set(kept["channels"].tolist())
    (burst,) = bursts(record)
    assert burst.seconds < SECONDS - TWO_BLOCKS


def test_a_finger_that_presses_too_hard_stops_the_play():
    with open_rig(file(rate_hz=20_000.0, force=20.0)) as rig:
        put: list[float] = []

        def press(*_: object) -> None:
            if rig.clock.now() > 0.8 and not put:
                put.append(rig.clock.now())
                rig.simulation.plant.put(2.5)

        record = rig.simulation.truth.record()
        with pytest.raises(
            InstrumentError, match=r"The finger was pressed with 2\d\.\d* N, and \[abort\] allows 20"
        ):
            rig.excite(tone(rig, 10), ["A"], ["laser"], progress=press)
        (burst,) = bursts(record)
        assert 0 < burst.stop - put[0] < TWO_BLOCKS


def test_the_weight_that_rests_on_the_sensor_is_no_finger():
    with open_rig(file(rate_hz=20_000.0, force=20.0)) as rig:
        rig.simulation.plant.put(5.0)
        rig.excite(tone(rig, 10), ["A"], ["laser"])
        assert rig.lockout is None


def test_a_monitored_channel_in_overload_stops_the_play():
    saturated = [{"kind": "sensor-saturated", "channel": "laser", "after": 0.3, "duration": 0.1}]
    says = r"The velocity stood at the end of its channel's range"
    with open_rig(file(faults=saturated, velocity=1.0)) as rig, pytest.raises(InstrumentError, match=says):
        rig.excite(tone(rig), ["A"], ["drive"])


# The lockout


def test_a_locked_out_rig_records_but_plays_nothing_until_a_reset():
    with open_rig(DOUBLED) as rig, pytest.raises(InstrumentError):
        rig.excite(tone(rig), ["A"], ["laser"])
    with open_rig(DOUBLED) as rig:
        record = rig.simulation.truth.record()
        with rig.daq.stream(["laser"], 5000, 500, 1000) as stream:
            stream.capture()
        with pytest.raises(LimitError, match=r"The rig is locked out since 2.*The patch got .*haploop reset"):
            rig.excite(tone(rig, 1), ["A"], ["laser"])
        assert not bursts(record)
        assert kinds(rig).count("tripped") == 1 and kinds(rig)[-1] == "refused"
        clear_lockout(rig.audit.folder, rig.hardware)  # at once, also for a rig that is open
        rig.excite(tone(rig, 1), ["A"], ["laser"])


def test_a_simulated_lockout_holds_whatever_the_plant_is_like():
    """As on a real rig: only a person clears it, and `haploop reset` needs no seed to do so."""
    with open_rig(DOUBLED) as rig, pytest.raises(InstrumentError):
        rig.excite(tone(rig), ["A"], ["laser"])
    with open_rig("simulated") as rig:
        assert rig.lockout is not None
    with open_rig("four-channel", simulate="twin") as rig:
        assert rig.lockout is None


def test_a_lockout_that_cannot_be_saved_holds_the_open_rig(monkeypatch):
    full = raising(OSError(28, "No space left on device"))
    with open_rig(DOUBLED) as rig:
        monkeypatch.setattr("haploop.instruments.safety.lockout.set_lockout", full)
        monkeypatch.setattr("numpy.savez", full)
        raises(InstrumentError, "The play was stopped", rig.excite, tone(rig), ["A"], ["laser"])
        raises(LimitError, "The rig is locked out", rig.excite, tone(rig, 1), ["A"], ["laser"])


@pytest.mark.parametrize("content", ["", "{", "[]", "null", json.dumps({"when": "now"}), "\xff", "[" * 9000])
def test_a_lockout_that_cannot_be_read_is_a_lockout(tmp_path, content):
    set_lockout(tmp_path, {"relay"}, Lockout("now", "why", "who", ""))
    (path,) = tmp_path.glob("*.lockout")
    path.write_text(content, encoding="latin-1")
    found = lockout_of(tmp_path, {"relay"})
    assert found is not None and f"its lockout file {path} is damaged" in found.sentence


def test_the_samples_of_each_trip_are_kept_with_their_index():
    limited = file(drive=30.0)
    seen = []
    for _ in range(2):
        with open_rig(limited) as rig:
            drive = tone(rig)
            raises(InstrumentError, "The patch got", rig.excite, drive, ["A"], ["switch"])
            with np.load(rig.lockout.samples) as file_of_trip:
                kept = dict(file_of_trip)
            clear_lockout(rig.audit.folder, rig.hardware)
        seen.append(rig.lockout)
        first, volts = int(kept["first"]), kept["volts"][list(kept["channels"]).index("drive")]
        assert len(volts) > 5000 and kept["rate_hz"] == rig.table.rate_hz
        np.testing.assert_allclose(100 * volts, drive[first : first + len(volts)], atol=4.0)
    assert len(list((rig.audit.folder / "trips").glob("*.npz"))) == 2


def monitor(limits: Limits, drive: float | None) -> AbortMonitor:
    two = SimpleNamespace(channels=("one", "two"), to_si=lambda volts: 100 * volts)
    sensors: Any = SimpleNamespace(drive=two, force=None)
    return AbortMonitor(AbortLimits(drive=drive), sensors, None, limits)


@pytest.mark.parametrize("row", [0, 1])
@pytest.mark.parametrize("drive", [50.0, None])
def test_each_of_several_drive_monitors_is_tested(row, drive):
    watched = monitor(Limits(min=-50 / 1.1, max=50 / 1.1), drive)
    volts = np.zeros((3, 100))
    volts[2] = 5.0  # a channel that is no drive monitor
    for value in (0.499, -0.499):
        volts[row, 40] = value
        watched.check(Block(0, volts, np.array([True, True, True])), ("one", "two", "other"))
    for value in (0.501, -0.501, np.nan):
        volts[row, 40] = value
        watched, block = (
            monitor(Limits(min=-50 / 1.1, max=50 / 1.1), drive),
            Block(0, volts, np.zeros(3, bool)),
        )
        with pytest.raises(InstrumentError, match=f"The patch on {('one', 'two')[row]} got"):
            watched.check(block, ("one", "two", "other"))


def test_ten_blocks_are_kept():
    watched = monitor(Limits(), 50.0)
    for number in range(25):
        watched.check(Block(7 * number, np.full((2, 7), number / 100), np.zeros(2, bool)), ("one", "two"))
    first, volts = watched.samples()
    assert first == 7 * 15 and volts.shape == (2, 70) and volts[0, 0] == 0.15 and volts[1, -1] == 0.24
    assert watched.tripped is None and watched.channels == ("one", "two")
