"""A play that this program itself cuts short, in a callback or a thread, is an error."""

from collections.abc import Callable

import numpy as np
import pytest

from haploop.base.errors import InstrumentError
from haploop.base.progress import Progress
from haploop.instruments import Rig, Sweep, open_rig
from tests.instruments.safety.test_limiter import generator_rig

TONE = 10 * np.sin(2 * np.pi * 250 * np.arange(25_000) / 50_000) * np.hanning(25_000)

WAYS = {
    "zero": (lambda rig: rig.daq.zero(), "Dev2 was set to zero by this program while it played"),
    "open": (lambda rig: rig.relay.connect([]), "The relay disconnected patch A while its drive was played"),
    "safe": (lambda rig: rig.make_safe(), "Dev2 was set to zero by this program"),
}


def at_block(number: int, act: Callable[[Rig], object], rig: Rig) -> Progress:
    calls: list[int] = []

    def progress(*_: object) -> None:
        calls.append(1)
        if len(calls) == number:
            act(rig)

    return progress


@pytest.mark.parametrize(
    ("mode", "way"), [("twin", "zero"), ("twin", "open"), ("wire", "open"), ("wire", "safe")]
)
def test_a_play_that_is_cut_short_is_an_error(mode, way):
    act, says = WAYS[way]
    with open_rig("simulated", simulate=mode) as rig:
        for block in (1, 5):
            with pytest.raises(InstrumentError, match=says):
                rig.excite(TONE, ["A"], ["drive"], progress=at_block(block, act, rig))
        played = rig.excite(TONE, ["A"], ["drive"])
        assert np.ptp(rig.drive_monitor().to_si(played.volts)) > 19


@pytest.mark.parametrize(("act", "says"), [
    (lambda rig: rig.generator.off(), "was switched off while its waveform was played"),
    (lambda rig: rig.relay.connect([]), "disconnected patch A"),
])  # fmt: skip
def test_so_is_a_sweep(act, says):
    with open_rig(generator_rig()) as rig, pytest.raises(InstrumentError, match=says):
        rig.generate(Sweep(10, 300, 0.5, 20), ["A"], ["drive"], progress=at_block(3, act, rig))


def test_and_what_a_player_plays():
    with open_rig("sound-card", simulate="twin") as rig:
        for act, says in ((WAYS["open"]), (lambda rig: rig.player.stop(), "had not played to the end")):
            with pytest.raises(InstrumentError, match=says):
                rig.excite(np.pad(TONE, 100), ["A"], ["drive"], progress=at_block(5, act, rig))
