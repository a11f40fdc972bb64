import signal
import subprocess
import sys
import textwrap
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from haploop.acquisition import record
from haploop.base.errors import ConfigurationError, InstrumentError, LimitError
from haploop.base.signals import uninterrupted
from haploop.instruments import Arbitrary, Burst, Rig, Sweep, open_rig
from haploop.instruments.conformance import bypass_interlock
from tests.conftest import OpenRig
from tests.raising import raises, raising


def tone(rig: Rig, peak: float = 40, duration: float = 0.4) -> np.ndarray:
    t = np.arange(round(duration * rig.table.rate_hz)) / rig.table.rate_hz
    return peak * np.sin(2 * np.pi * 263.5 * t) * np.sin(np.pi * t / duration) ** 2


def assert_safe(rig: Rig) -> None:
    """Measured at the plant, not in our own code."""
    truth = rig.simulation.truth
    rig.clock.sleep(0.1)
    assert truth.closed == frozenset()
    assert max(map(abs, truth.patch_voltages.values())) < 0.02


def test_the_relay_opens_a_while_after_zero(open, monkeypatch):
    """Several time constants of the amplifier: no contact switches under voltage."""
    rig = open()
    rig.relay.connect(["A"])
    held, opened = [], []
    hold, connect = rig.daq.hold, rig.relay.connect
    monkeypatch.setattr(rig.daq, "hold", lambda: (hold(), held.append(rig.clock.now())))
    monkeypatch.setattr(rig.relay, "connect", lambda to: (opened.append(rig.clock.now()), connect(to)))
    rig.make_safe()
    assert opened[0] - held[0] > 0.04


def test_a_drive_reaches_the_patch_and_moves_the_table(open):
    rig = open()
    capture = rig.excite(tone(rig), ["A"], ["drive", "laser"], tail=0.1)
    assert capture.volts.shape == (2, round(0.5 * rig.table.rate_hz))
    assert not capture.overload.any()
    drive = capture.volts[0] * 100
    assert np.abs(drive).max() == pytest.approx(40, rel=0.02)
    assert np.abs(capture.volts[1]).max() > 0.1
    assert_safe(rig)


def test_connecting_and_leaving_changes_no_output(mode):
    if mode not in ("twin", "wire"):
        pytest.skip("the plant is asked")
    with open_rig("simulated", simulate="wire" if mode == "wire" else "twin") as rig:
        assert_safe(rig)
    assert rig.simulation.truth.peak == 0


def test_an_interrupted_drive_leaves_the_rig_safe(open):
    rig = open()
    for error in (KeyboardInterrupt, ValueError):

        def interrupt(*_: object, error: type[BaseException] = error) -> None:
            assert rig.simulation.truth.closed == {"A"}
            raise error

        raises(error, "", rig.excite, tone(rig), ["A"], ["drive", "laser"], progress=interrupt)
        assert_safe(rig)


def test_a_drive_beyond_a_limit_is_refused_before_anything_is_written(open):
    rig = open()
    for sample, says in ((60.0, "rises to"), (np.nan, "nan at sample 5"), (np.inf, "inf at sample 5")):
        drive = tone(rig)
        drive[5] = sample
        raises(LimitError, says, rig.excite, drive, ["A"], ["drive", "laser"])
    assert rig.simulation.truth.peak == 0


def test_the_strictest_rating_is_the_limit(open):
    rig = open()
    assert rig.limits.peak == 48  # the relay's, below the paper's 50 V
    assert rig.limits_for(4).capacitance == pytest.approx(4 * 90e-9)


def test_what_cannot_be_recorded_is_named_and_nothing_else_is(open):
    rig = open()
    for says, patch, channel, tail in (
        ("E", "E", "drive", 0.0),
        ("lasr", "A", "lasr", 0.0),
        *(("Recording can go on", "A", "laser", tail) for tail in (-1.0, np.nan, np.inf)),
    ):
        raises(ConfigurationError, says, rig.excite, tone(rig), [patch], [channel], tail=tail)
    assert_safe(rig)
    assert rig.excite(tone(rig), ["A"], ["laser"]).channels == ("laser",)


@pytest.mark.skipif(sys.platform == "win32", reason="signals of another process are POSIX")
@pytest.mark.parametrize("kind", [signal.SIGINT, signal.SIGTERM])
def test_signals_during_clean_up_do_not_cut_it_short(tmp_path, kind):
    script = tmp_path / "script.py"
    script.write_text(
        textwrap.dedent(f"""
        import os
        from haploop.instruments import open_rig
        with open_rig("simulated") as rig:
            rig.relay.connect(["A"])
            close = rig.relay.connect
            def slow(patches):
                for _ in range(3):
                    os.kill(os.getpid(), {int(kind)})
                close(patches)
            rig.relay.connect = slow
            try:
                rig.close()
            except KeyboardInterrupt:
                pass
            finally:
                print(sorted(rig.simulation.truth.closed), flush=True)
        """)
    )
    done = subprocess.run([sys.executable, script], check=False, capture_output=True, text=True, timeout=60)
    assert done.stdout.splitlines() == ["[]"]
    assert done.returncode == (0 if kind is signal.SIGINT else 128 + kind)


# A generator at the amplifier's input


SWEEP = Sweep(start_hz=1, stop_hz=625, duration=1.0, amplitude=40)  # V at the patch


@pytest.fixture
def swept(open: OpenRig, tmp_path: Path) -> Rig:
    file = tmp_path / "generator.toml"
    file.write_text(
        textwrap.dedent("""
        base = "simulated"
        [amplifier]
        input = "generator"
        [generator]
        driver = "keysight-33500"
        resource = "TCPIP::127.0.0.1::5025::SOCKET"
        output = "generator"
        """)
    )
    return open(str(file))


@pytest.mark.requires("simulation")
def test_a_generator_sweeps_a_patch_while_the_daq_records(swept):
    capture = swept.generate(SWEEP, ["A"], ["drive", "laser"], tail=0.2)
    assert capture.volts.shape == (2, round(1.7 * swept.table.rate_hz))
    drive = capture.volts[0] * 100
    assert np.abs(drive).max() == pytest.approx(40, rel=0.02)
    assert np.abs(capture.volts[1]).max() > 0.1
    # Zeros that are crossed faster than 0.5 V a sample are those above 99.5 Hz, at a pace of 624 Hz/s.
    crossed = np.diff(np.signbit(drive)) & (np.abs(np.diff(drive)) > 0.5)
    assert crossed.sum() == pytest.approx((625**2 - 99.5**2) / 624, abs=2)
    assert np.abs(drive[: round(0.09 * swept.table.rate_hz)]).max() < 0.1  # recording began before it
    assert not swept.generator.is_on
    assert_safe(swept)


@pytest.mark.usefixtures("unproved")
@pytest.mark.requires("simulation")
@pytest.mark.parametrize("waveform", [
    Burst(263.5, 40, 30), Arbitrary(30 * np.sin(np.arange(2001) * np.pi / 50) * np.hanning(2001), 20_000),
], ids=str)  # fmt: skip
def test_a_generator_plays_other_waveforms_too(swept, waveform):
    record = swept.simulation.truth.record()
    capture = swept.generate(waveform, ["A"], ["drive", "laser"], tail=0.1)
    assert np.abs(capture.volts[0] * 100).max() == pytest.approx(30, rel=0.02)
    assert np.abs(capture.volts[1]).max() > 0.05
    at_patch = np.concatenate([run.volts for run in record if run.closed])
    assert swept.simulation.truth.peak == pytest.approx(30, rel=0.02)
    sounding = np.flatnonzero(np.abs(at_patch) > 0.3)
    assert np.ptp(sounding) * 20e-6 == pytest.approx(waveform.duration, rel=0.1)
    assert_safe(swept)


@pytest.mark.requires("simulation")
def test_an_interrupted_sweep_leaves_the_rig_safe(swept):
    def interrupt(*_: object) -> None:
        if swept.generator.is_on:
            assert swept.simulation.truth.closed == {"A"}
            raise KeyboardInterrupt

    raises(KeyboardInterrupt, "", swept.generate, SWEEP, ["A"], ["drive"], progress=interrupt)
    assert not swept.generator.is_on
    assert_safe(swept)


@pytest.mark.requires("simulation")
def test_a_sweep_beyond_a_limit_is_refused_before_anything_is_set(swept):
    raises(LimitError, "falls to -60", swept.generate, replace(SWEEP, amplitude=60), ["A"], ["drive"])
    with pytest.raises(LimitError, match="slews at"):
        swept.generate(replace(SWEEP, stop_hz=10_000), ["A", "B", "C", "D"], ["drive"])
    assert swept.simulation.truth.peak == 0 and not swept.generator.is_on


@pytest.mark.requires("simulation")
def test_the_generator_is_off_before_the_relay_opens(swept, monkeypatch):
    order: list[str] = []
    off, connect = swept.generator.off, swept.relay.connect
    swept.relay.connect(["A"])
    bypass_interlock(swept.generator)
    swept.generator.configure(replace(SWEEP, amplitude=0.8))
    swept.generator.arm()
    swept.generator.trigger()
    with monkeypatch.context() as patch:
        patch.setattr(swept.daq, "hold", raising(InstrumentError("the card is gone.")))
        patch.setattr(swept.generator, "off", lambda: (order.append("off"), off())[1])
        patch.setattr(swept.relay, "connect", lambda p: (order.append("open"), connect(p))[1])
        raises(InstrumentError, "safe state was not confirmed: the card is gone", swept.make_safe)
    assert order == ["off", "open"] and not swept.generator.is_on
    assert_safe(swept)


@pytest.mark.requires("simulation")
def test_a_sweep_needs_a_generator_at_the_amplifiers_input(open, tmp_path):
    raises(ConfigurationError, r"no \[generator\]", open().generate, SWEEP, ["A"], ["drive"])
    (tmp_path / "apart.toml").write_text(
        'base = "simulated"\n[generator]\ndriver = "rigol-dg1000z"\n'
        'resource = "TCPIP::127.0.0.1::5555::SOCKET"\noutput = "elsewhere"\n'
    )
    rig = open(str(tmp_path / "apart.toml"))
    with pytest.raises(ConfigurationError, match="wired to 'elsewhere', and its amplifier's input is"):
        rig.generate(SWEEP, ["A"], ["drive"])
    # What is wired to the amplifier is the DAQ, and plays.
    assert np.abs(rig.excite(tone(rig), ["A"], ["drive"]).volts).max() == pytest.approx(0.4, rel=0.02)


def test_that_the_safe_state_failed_matters_more_than_a_second_ctrl_c():
    before = signal.getsignal(signal.SIGINT)
    with pytest.raises(InstrumentError, match="not confirmed"), uninterrupted():
        signal.raise_signal(signal.SIGINT)
        raise InstrumentError("The safe state was not confirmed.")
    assert signal.getsignal(signal.SIGINT) is before
    with pytest.raises(KeyboardInterrupt), uninterrupted():
        signal.raise_signal(signal.SIGINT)


@pytest.mark.requires("simulation")
def test_a_closed_rig_neither_plays_nor_records(open, tmp_path):
    """It has given up its lock: another program may hold the same hardware by now."""
    rig = open()
    simulated = rig.simulated
    rig.close()
    raises(ConfigurationError, "was closed: open it again", rig.excite, np.zeros(100), ["A"], ["laser"])
    raises(ConfigurationError, "was closed: open it again", record, rig, "latch", "P01", 1, tmp_path)
    assert not list(tmp_path.iterdir())
    assert rig.simulated == simulated
    rig.close()
