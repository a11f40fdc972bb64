"""Look at the sensors before anything is recorded: live views, and no file."""

from __future__ import annotations

from collections.abc import Callable
from itertools import chain

from ...base.errors import ConfigurationError
from ...instruments import Rig
from .stream_reader import StreamReader

_BLOCK = 0.04
"""s: 25 blocks a second, so that a view moves as a person expects."""


def look(rig: Rig, wanted: Callable[[], bool] = lambda: True) -> None:
    """Acquire every channel that a sensor or the laser reads while `wanted`, for live views. Nothing is kept.

    `Rig.tap`, `haploop live` and the console show the blocks as those of a recording. Raises
    ConfigurationError for a rig without any such channel, and InstrumentError.
    """
    laser = (rig.vibrometer.channel,) if rig.has("vibrometer") else ()
    drive = rig.sensors.drive.channels if rig.sensors.drive is not None else ()
    channels = list(dict.fromkeys(chain(rig.sensors.recorded, drive, laser)))
    if not channels:
        raise ConfigurationError(f"The rig {rig.name!r} has no sensors: describe them in [sensors].")
    rate_hz = rig.file.rate_hz
    with (
        rig.daq.stream(channels, rate_hz, round(_BLOCK * rate_hz)) as stream,
        StreamReader(stream, rig.clock) as reader,
    ):
        publish = rig.live_run("look", "", stream.channels, stream.rate_hz)
        for block in reader:
            publish(block)
            if not wanted():
                return
