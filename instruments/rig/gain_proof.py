"""Proof of the amplifier's gain before the first play of a session, at a volt and by the drive monitor.

A gain in the rig file that is a tenth of the true one would put ten times the drive on the patch until the
abort monitor stops the play, two blocks later. One volt shows it first. A gain and a divider that are wrong
by the same factor agree, and prove nothing: a gain that is not the product's own asks for its source, and
doctor says where both differ by one factor.
"""

from __future__ import annotations

import numpy as np

from ...base.arrays import FloatArray
from ...base.errors import InstrumentError
from ..limits import Limits

UNPROVED = (
    "The gain of the amplifier cannot be proved on this rig, because it has no [sensors.drive]: nothing "
    "shows what a patch really gets, and the rig cannot be calibrated."
)
"""Sentence for a rig without a drive monitor."""

_LEVEL = 1.0
"""Amplitude (V at the patch)."""
TOO_MUCH = 1.25
"""Volts measured per volt asked for at which the gain is not what the rig file says. Amplifiers of one type
differ by 1 % (docs/hardware.md, "Amplifier"), and a volt of hum on the monitor adds less than 0.15 V."""
SHOWN = 0.5
"""Volts measured per volt asked for below which a monitor counts as dead: it could show no volt too many."""
HZ = 225.0
"""Frequency, as far from the harmonics of 50 and 60 Hz as the window can tell."""
_SECONDS, _RAMP = 0.07, 0.01
_WINDOW = 0.04
"""Length over which the amplitude is measured (s): whole periods of the tone and of 50 Hz."""


class UnshownError(InstrumentError):
    """The monitor of a patch does not show the volts of the proof, or of a play, so nothing else was played.

    `share` is what it showed of them, and `elsewhere` the monitors that did show them.
    """

    def __init__(
        self, patch: str, share: float, elsewhere: tuple[str, ...], when: str = "the gain was proved"
    ) -> None:
        self.share, self.elsewhere = share, elsewhere
        found = f", and {' and '.join(elsewhere)} shows it" if elsewhere else ""
        super().__init__(
            f"The drive monitor shows {share:.2g} V for each volt that patch {patch} was to get when {when}"
            f"{found}, so nothing else was played: check the amplifier, the contact, and the "
            "monitor's cable and scale."
        )


def level_of(limits: Limits) -> float:
    """Amplitude of the proof (V at the patch)."""
    return min(_LEVEL, limits.peak / 4)


def tone(level: float, rate_hz: float) -> FloatArray:
    """The drive of the proof: (samples,) V at the patch."""
    t = np.arange(round(_SECONDS * rate_hz)) / rate_hz
    ramp = np.clip(np.minimum(t, t[-1] - t) / _RAMP, 0.0, 1.0)
    return np.asarray(level * ramp * np.sin(2 * np.pi * HZ * t))


def loudest(volts: FloatArray, rate_hz: float) -> float:
    """Amplitude of the tone in (samples,) V where it is loudest, without hum and offset."""
    count = min(round(_WINDOW * rate_hz), len(volts))
    turned = (volts - np.median(volts)) * np.exp(-2j * np.pi * HZ * np.arange(len(volts)) / rate_hz)
    total = np.cumsum(np.concatenate([[0.0], turned]))
    return float(2 * np.abs(total[count:] - total[:-count]).max() / count)
