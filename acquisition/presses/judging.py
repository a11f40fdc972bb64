"""Judge every press of a recording that is there already, as a session judges each as it ends."""

from __future__ import annotations

from ..recording import PressVerdict, Recording
from .protocol import Protocol
from .quality import QualityCheck
from .segmentation import Span, find_presses

_BEFORE = 1.0
"""s before a press that are looked at, unless another press is nearer."""


def judged(recording: Recording, protocol: Protocol) -> tuple[PressVerdict, ...]:
    """The verdict on each press, numbered in order, each at its first attempt. Raises DataError."""
    check = QualityCheck(recording.path, recording.header, recording.sensors, protocol)
    for quantity, sensor in recording.sensors.linear.items():
        rows = [recording.channels.index(name) for name in sensor.channels]
        check.rests[quantity] = recording.volts[rows][:, recording.rest].mean(axis=1)
    found = find_presses(recording, protocol.segmentation)
    rate_hz, volts = recording.rate_hz, recording.volts
    verdicts = []
    for number, press in enumerate(found, 1):
        low = found[number - 2].release + 1 if number > 1 else 0
        high = found[number].onset if number < len(found) else volts.shape[1]
        first = max(low, press.onset - round(_BEFORE * rate_hz))
        end = min(high, press.release + 1 + round(protocol.quiet * rate_hz))
        span = Span(press.onset, press.release + 1, 0.0)
        verdicts.append(check(volts[:, first:end], first, span, number, 1))
    return tuple(verdicts)
