"""Compare what the sensors pass with what is recorded: half the sample rate, and the band that is felt.

A converter without a filter folds what lies above half its rate back into the record (aliasing). Good sensors
pass more than that, so it is told and not refused. A pick-up of motion that passes less than the skin feels
best records a dull press, and the button made of it is dull. A force is not compared with the skin: it times
presses, and its snap is slow.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence

from ...instruments import Rig
from .finding import Finding

_FELT_HZ = 250.0
"""Where the skin of a finger is most sensitive to displacement (Pacinian corpuscles; a textbook's figure)."""


def check_bands(rig: Rig) -> Iterator[Finding]:
    """Tell which pick-ups pass more than half the rate into a card without a filter, or less than is felt."""
    rate_hz = rig.file.rate_hz
    for name, sensor in rig.sensors.linear.items():
        yield from _folded(rig, (name, sensor.channels), (sensor.bandwidth_hz, rate_hz, "rate_hz"))
        if name != "force" and sensor.bandwidth_hz < _FELT_HZ:
            yield Finding(
                f"Bandwidth of {name}",
                name,
                "green",  # as the rig file says, and the paper's own
                f"It passes {sensor.bandwidth_hz:.0f} Hz, and the skin is most sensitive near "
                f"{_FELT_HZ:.0f} Hz: a recorded press, and the button made of it, is dull. Use a smaller "
                "filter capacitor, or a sensor of 500 Hz or more.",
            )
    if rig.file.vibrometer is not None and rig.file.table is not None:
        own = rig.vibrometer
        passes = (own.bandwidth_hz, rig.file.table.rate_hz, "rate_hz in [table]")
        yield from _folded(rig, ("vibrometer", (own.channel,)), passes)


def _folded(rig: Rig, of: tuple[str, Sequence[str]], passes: tuple[float, float, str]) -> Iterator[Finding]:
    (name, channels), (bandwidth_hz, rate_hz, key) = of, passes
    unfiltered = [channel for channel in channels if not rig.daq.filtered(channel)]
    if not unfiltered or not rate_hz / 2 < bandwidth_hz < math.inf:
        return
    yield Finding(
        f"Bandwidth of {name}",
        name,
        "yellow",
        f"It passes {bandwidth_hz:.0f} Hz, and {rate_hz / 2:.0f} Hz, half the sample rate, is recorded: what "
        "lies between folds back into the record, unless a filter stands before the card. Write "
        f"{key} = {2 * bandwidth_hz:.0f} or more, or put a low-pass filter there and state low_pass_hz.",
    )
