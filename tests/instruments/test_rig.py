from __future__ import annotations

import signal
import subprocess
import sys
import textwrap
from pathlib import Path

import numpy as np
import pytest

from instruments import ConfigurationError, InstrumentError, LimitError, Rig, open_rig
from tests.conftest import OpenRig


def tone(rig: Rig, peak: float = 40, duration: float = 0.4) -> np.ndarray:
    t = np.arange(round(duration * rig.table.rate_hz)) / rig.table.rate_hz
    return peak * np.sin(2 * np.pi * 263.5 * t) * np.sin(np.pi * t / duration) ** 2


def assert_safe(rig: Rig) -> None:
    """Measured at the plant, not in our own code."""
    truth = rig.simulation.truth
    rig.clock.sleep(0.1)
    assert truth.closed == frozenset()
    assert max(map(abs, truth.patch_voltages.values())) < 0.02


def test_a_drive_reaches_the_patch_and_moves_the_table(open: OpenRig) -> None:
    rig = open()
    capture = rig.excite(tone(rig), ["A"], ["drive", "laser"], tail=0.1)
    assert capture.volts.shape == (2, round(0.5 * rig.table.rate_hz))
    assert not capture.overload.any()
    drive = capture.volts[0] * 100
    assert np.abs(drive).max() == pytest.approx(40, rel=0.02)
    assert np.abs(capture.volts[1]).max() > 0.1
    assert_safe(rig)


def test_connecting_and_leaving_changes_no_output(mode: str) -> None:
    if mode not in ("twin", "wire"):
        pytest.skip("the plant is asked")
    with open_rig("simulated", simulate="wire" if mode == "wire" else "twin") as rig:
        assert_safe(rig)
    assert rig.simulation.truth.peak == 0


@pytest.mark.parametrize("error", [KeyboardInterrupt, ValueError])
def test_an_interrupted_drive_leaves_the_rig_safe(open: OpenRig, error: type[BaseException]) -> None:
    rig = open()

    def interrupt(seconds: float) -> None:
        assert rig.simulation.truth.closed == {"A"}
        raise error

    with pytest.raises(error):
        rig.excite(tone(rig), ["A"], ["drive", "laser"], progress=interrupt)
    assert_safe(rig)


@pytest.mark.parametrize(
    ("sample", "says"), [(60.0, "rises to"), (np.nan, "nan at sample 5"), (np.inf, "inf at sample 5")]
)
def test_a_drive_beyond_a_limit_is_refused_before_anything_is_written(
    open: OpenRig, sample: float, says: str
) -> None:
    rig = open()
    drive = tone(rig)
    drive[5] = sample
    with pytest.raises(LimitError, match=says):
        rig.excite(drive, ["A"], ["drive", "laser"])
    assert rig.simulation.truth.peak == 0


def test_the_strictest_rating_is_the_limit(open: OpenRig) -> None:
    rig = open()
    assert rig.limits.peak == 48  # the relay's, below the paper's 50 V
    assert rig.limits_for(4).capacitance == pytest.approx(4 * 90e-9)


def test_an_unknown_patch_or_channel_is_named(open: OpenRig) -> None:
    rig = open()
    with pytest.raises(ConfigurationError, match="E"):
        rig.excite(tone(rig), ["E"], ["drive"])
    with pytest.raises(ConfigurationError, match="lasr"):
        rig.excite(tone(rig), ["A"], ["lasr"])
    assert_safe(rig)


def test_the_safe_state_is_reached_even_when_one_part_fails(
    open: OpenRig, monkeypatch: pytest.MonkeyPatch
) -> None:
    rig = open()
    rig.relay.connect(["A"])

    def dead() -> None:
        raise InstrumentError("the card is gone.")

    with monkeypatch.context() as patch:
        patch.setattr(rig.daq, "zero", dead)
        with pytest.raises(InstrumentError, match="safe state was not confirmed: the card is gone"):
            rig.make_safe()
    assert_safe(rig)


@pytest.mark.skipif(sys.platform == "win32", reason="signals of another process are POSIX")
@pytest.mark.parametrize("kind", [signal.SIGINT, signal.SIGTERM])
def test_signals_during_clean_up_do_not_cut_it_short(tmp_path: Path, kind: signal.Signals) -> None:
    script = tmp_path / "script.py"
    script.write_text(
        textwrap.dedent(f"""
        import os
        from instruments import open_rig
        from instruments.rig import uninterrupted
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
    assert done.stdout.splitlines() == (["[]"] if kind is signal.SIGINT else [])
