"""What a failure of NI's cards means, by its number: one sentence each, with the remedy.

Without NI's library, which takes longer to load than all else that a simulated rig needs.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

from ...base.errors import ConfigurationError, InstrumentError, TakenError

_MOST_DIVIDED = 32
_WHOLE = 1e-6
"""Largest distance of a whole number from what counts as one."""


def refused(device: str, code: int, said: str) -> InstrumentError | ConfigurationError:
    """The error that `device` answered with NI's `code` and message, as one sentence."""
    if code in SENTENCES:
        kind = TakenError if code in _ENDED else InstrumentError
        return kind(SENTENCES[code].format(device=device))
    said = first_line(said)
    if code in CONFIGURATION:
        return ConfigurationError(f"{device} {CONFIGURATION[code]}: {said} Correct [daq] in the rig file.")
    if code in (-201029, -201030):
        return InstrumentError(
            f"{device} cannot use the RTSI bus ({code}): declare the RTSI cable in NI MAX."
        )
    return InstrumentError(f"{device} refused ({code}): {said}")


def cut_off(device: str, played: int) -> TakenError:
    """The error of a play that ended after `played` samples, before its end, without an error of NI's."""
    return TakenError(
        f"{device} was stopped by somebody else when it had played {played} samples: the waveform was not "
        "played whole. Close the other program and try again."
    )


def zeroed(device: str) -> InstrumentError:
    """The error of a play that this program itself has ended, by `Daq.zero`."""
    return InstrumentError(
        f"{device} was set to zero by this program while it played: the waveform was not played whole, and "
        "what was measured is not used."
    )


def unclocked(channels: Sequence[str]) -> ConfigurationError:
    """The error of counters that are streamed alone."""
    return ConfigurationError(
        f"{', '.join(channels)} counts on the clock of analog inputs: stream one of those beside it."
    )


def other_rate(device: str, rate_hz: float, asked: float) -> ConfigurationError:
    """The error for a card that has not the rate that was asked for."""
    return ConfigurationError(
        f"{device} would sample at {rate_hz:g} Hz, and {asked:g} Hz were asked for: choose a rate that it "
        f"has, such as {rate_hz:.10g}."
    )


def unshared(
    device: str, own: float, master: str, rate_hz: float, rates: Sequence[float]
) -> ConfigurationError:
    """The error for a card that cannot follow the clock of another one; `rates` are some that both have."""
    such = f": {', '.join(f'{rate:.10g}' for rate in rates)}" if rates else ""
    return ConfigurationError(
        f"{device} would sample at {own:g} Hz on the clock of {master}, which runs at {rate_hz:g} Hz: choose "
        f"a rate that both cards have{such}."
    )


def shared_rates(timebase_hz: float, fastest_hz: float, asked: float) -> list[float]:
    """The whole rates nearest to `asked`, up to three, of a clock and of a delta-sigma converter on it.

    The clock divides its timebase, the converter its fastest rate, by whole numbers; the latter up to 32.
    """
    divided = [fastest_hz / n for n in range(1, _MOST_DIVIDED + 1)]
    both = [r for r in divided if all(abs(x - round(x)) < _WHOLE for x in (r, timebase_hz / r))]
    return sorted(both, key=lambda rate: abs(math.log(rate / asked)))[:3]


def first_line(text: str) -> str:
    """The first line of a message, with a full stop."""
    line = text.strip().partition("\n")[0]
    return line if line.endswith(".") else f"{line}."


_ENDED = (-200088, -201452, -200473)
"""What a task says that another program has cleared, stopped or aborted."""
_EMPTY = "Close what loads this computer and try again."
SENTENCES = {
    -200290: f"{{device}} ran out of samples to play (-200290): the waveform was not played whole. {_EMPTY}",
    -200621: "{device} ran out of samples to play, because its memory was not "
    f"filled in time (-200621): the waveform was not played whole. {_EMPTY}",
    -200279: "{device} lost samples, because they were not read in time "
    "(-200279): close what loads this computer, or make buffer_s in [daq] larger.",
    -200010: "{device} lost samples, because its own memory overflowed (-200010): "
    "lower the rate, or use fewer channels.",
    -200284: "{device} did not deliver its samples in time (-200284): check "
    "that its sample clock runs, and the cable it comes by.",
    -200278: "{device} has no more samples (-200278): its acquisition has ended.",
    -200088: "The acquisition on {device} was ended by somebody else (-200088): start it again.",
    -201452: "The acquisition on {device} was ended by somebody else (-201452): start it again.",
    -200473: "The acquisition on {device} was ended by somebody else (-200473): start it again.",
    -50103: "{device} is in use by another program or task (-50103): close it and try again.",
    -200220: "There is no NI device {device} (-200220): check its name in NI MAX.",
    -89125: "{device} has no trigger line to the other card (-89125): "
    "connect a RTSI cable, and declare it in NI MAX with both cards.",
    -89136: "{device} cannot be clocked by the other card (-89136): these two products share no such route.",
    -200560: "{device} was not done in time (-200560).",
}
"""Meaning and remedy of each failure (trigger line: docs/hardware.md, "Two cards on one clock")."""

CONFIGURATION = {
    -200170: "does not have a terminal that the rig file names (-200170)",
    -200332: "cannot sample that fast (-200332)",
    -200331: "cannot sample that slowly (-200331)",
    -200077: "does not support what the rig file asks for (-200077)",
    -200561: "cannot put such voltages out (-200561)",
}
"""Failures caused by the rig file; NI's own message follows, because it names the value."""
