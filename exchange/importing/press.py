"""One press of a file, as a representative press."""

from __future__ import annotations

from fractions import Fraction
from pathlib import Path

import numpy as np
import scipy

from ...acquisition import Representative, Window, file_name, high_pass
from ...acquisition.presses import Detector, require_rate, segmentation_for
from ...base.arrays import FloatArray
from ...base.errors import ConfigurationError, DataError
from .understanding import understand
from .understood import FileMapping, Understanding, rest_of

RATE_HZ = 5000.0
"""Samples per second of what is imported: the paper's, of which the drives' rate is a multiple."""
_LONGEST = Window().longest
_BOUNCE = 0.01
"""s: a contact that closes again within this time bounced."""
_TOLD_BY = ("activation", "force", "acceleration", "velocity", "displacement")
"""What an exported press can say of its activation (`Representative.activated_by`)."""
_APART, _LOUD, _SHAKEN_HZ = 0.3, 0.5, 60.0
"""Clicks of two presses: as far apart (s), as loud over the loudest, above a hand's motion (Hz)."""


def presses_in(found: Understanding) -> tuple[float, ...]:
    """Instants (s) of the presses that the force shows, or else travel, contact or vibration."""
    rate_hz, signals = found.rate_hz, found.signals
    if "force" in signals or "displacement" in signals:
        signal = signals.get("force") or signals["displacement"]
        rest = rest_of(signal.values, rate_hz).at(found.mapping.rest.get(signal.role))
        values = signal.values - rest
        if signal.role == "displacement":  # as a force of 4 N: the detector's thresholds are a force's
            values = 4 * values / max(float(values.max()), 1e-9)
        detector = Detector(rate_hz, segmentation_for(found.mapping.button or ""))
        detector.feed(values)
        detector.finish()
        return tuple(
            (span.first + int(np.argmax(values[span.first : span.end]))) / rate_hz for span in detector.spans
        )
    if "activation" in signals:
        return tuple(edge / rate_hz for edge in _rises(signals["activation"].values, rate_hz))
    if "acceleration" not in signals:
        return ()
    values = signals["acceleration"].values
    loud = np.abs(high_pass(values - np.median(values), rate_hz, min(_SHAKEN_HZ, rate_hz / 4)))
    places = np.flatnonzero(loud > _LOUD * loud.max())
    first = np.concatenate([[True], np.diff(places) > _APART * rate_hz])
    return tuple((places[first] / rate_hz).tolist())


def import_press(
    path: str | Path, mapping: FileMapping | None = None, *, activation: float | None = None
) -> Representative:
    """Make a representative press of a press that another program recorded.

    `mapping` says what the file does not: which columns, in which units, at which rate, of which button
    (by default as the file states, or "imported"). `activation` is the time (s) at which the button switched,
    by default as the file states, where a column of activation rises, or the time of the largest
    acceleration. Of a file longer than a second the representative's window about the activation is taken.
    The press is resampled to 5000 samples/s, high-passed and tapered as any other.

    Raises ConfigurationError for a missing or wrong choice and for a file of several presses, DataError for a
    file that cannot be read.
    """
    found = understand(path, mapping)
    found.require()
    return press_of(found, activation)


def press_of(found: Understanding, activation: float | None = None) -> Representative:
    """As `import_press`, of a file that is understood."""
    path, about = found.path, found.table.about
    button = found.mapping.button or str(about.get("button", "imported"))
    file_name("P01", button)
    taken = found.signals.get("acceleration")
    if taken is None:
        raise ConfigurationError(
            f"{path} has no vertical acceleration, by which a press is felt: name its column "
            "(--acceleration)."
        )
    values = taken.values
    several = presses_in(found) if activation is None else ()
    if len(several) > 1 and _number(path, found, "activation_s") is None:
        raise ConfigurationError(
            f"{path} holds {len(several)} presses: import them all as a recording (--as recording), or say "
            "when the one press switched (--at SECONDS)."
        )
    require_rate("representative press", found.rate_hz, path.name, "export it with a higher rate")
    cut, switched, after, by = _window(found, values, activation)
    acceleration = _taper(high_pass(resampled(values[cut], found.rate_hz), RATE_HZ))
    length = len(acceleration)
    force, travel = (_beside(found, role, cut, length) for role in ("force", "displacement"))
    stated = _number(path, found, "bandwidth_hz") or np.inf
    return Representative(
        button=button,
        rate_hz=RATE_HZ,
        acceleration=acceleration,
        force=force,
        travel=travel,
        activated_by=by,
        activation=np.asarray(np.arange(length) >= switched, dtype=np.float64),
        activation_index=min(switched, length - 1),
        members=1,
        spread=np.zeros(length),
        bandwidth_hz=min(found.rate_hz / 2, RATE_HZ / 2, stated),
        sources=((path.name, found.sha256),),
        left_out=(),
        method="imported",
        simulated=bool(about.get("simulated", False)),
        reason=f"from {taken.heading} of {path.name}, {after}{_started(found)}",
        parameters={"import": {"rate_hz": found.rate_hz, "scale": taken.factor}},
    )


def _started(found: Understanding) -> str:
    """A clause on the start of its file."""
    if found.start is None:
        return ""
    instant = "" if found.start.utc is None else f"{found.start.utc.isoformat()}, "
    return f"; measured from {instant}as stated ({found.start.words!r})"


def _beside(found: Understanding, role: str, cut: slice, length: int) -> FloatArray | None:
    """(length,) of a signal beside the acceleration, from its rest; None where it was not measured."""
    signal = found.signals.get(role)
    if signal is None:
        return None
    rest = rest_of(signal.values, found.rate_hz).at(found.mapping.rest.get(role))
    part = resampled(signal.values[cut] - rest, found.rate_hz)[:length]
    return np.pad(part, (0, length - len(part)))


def ratio_of(rate_hz: float) -> Fraction:
    """Samples at `RATE_HZ` for each at another rate."""
    return Fraction(RATE_HZ / rate_hz).limit_denominator(100_000)


def resampled(values: FloatArray, rate_hz: float) -> FloatArray:
    """Values at `RATE_HZ`, low-passed where that is slower."""
    ratio = ratio_of(rate_hz)
    if ratio == 1:
        return values
    # Its low-pass starts from zero: a force that is cut in the middle of a press would ring at both ends.
    return np.asarray(scipy.signal.resample_poly(values, ratio.numerator, ratio.denominator, padtype="line"))


def _window(
    found: Understanding, values: FloatArray, activation: float | None
) -> tuple[slice, int, str, str]:
    """Samples to take, the activation's index among those at `RATE_HZ`, a clause, and what told it."""
    rate_hz, window = found.rate_hz, Window()
    stated = _number(found.path, found, "activation_s")
    if activation is not None:
        at, how, by = activation, "activated where the operator said", "stated"
    elif stated is not None:
        told = str(found.table.about.get("activated_by", ""))
        at, how, by = stated, "activated where the file says", told if told in _TOLD_BY else "stated"
    else:
        largest = int(np.argmax(np.abs(values - np.median(values))))
        contact = found.signals.get("activation")
        rises = [] if contact is None else _rises(contact.values, rate_hz)
        at = min(rises, key=lambda rise: abs(rise - largest), default=largest) / rate_hz
        how = f"activated {'where its contact closed' if rises else 'at its largest acceleration'}"
        by = "activation" if rises else "acceleration"
    if not 0 <= at <= len(values) / rate_hz:
        raise ConfigurationError(
            f"{found.path} lasts {len(values) / rate_hz:.3f} s, so no button can have switched at {at:g} s."
        )
    start, stop = 0, len(values)
    if len(values) > _LONGEST * rate_hz:
        start = max(0, round((at - window.before) * rate_hz))
        stop = min(len(values), round((at + window.after) * rate_hz))
    return slice(start, stop), round((at - start / rate_hz) * RATE_HZ), how, by


def _rises(contact: FloatArray, rate_hz: float) -> list[int]:
    """Samples at which a contact closes; one that bounces, at its first touch."""
    closed = contact >= (contact.min() + contact.max()) / 2
    rises = np.flatnonzero(closed[1:] & ~closed[:-1]) + 1
    first: list[int] = []
    last = -np.inf
    for rise in rises.tolist():
        if rise - last > _BOUNCE * rate_hz:
            first.append(rise)
        last = rise
    return first


def _number(path: Path, found: Understanding, name: str) -> float | None:
    """What the file says about itself; None when it does not. Raises DataError for anything but a number."""
    said = found.table.about.get(name)
    if said is None:
        return None
    if not isinstance(said, int | float) or not 0 <= said < np.inf:
        raise DataError(f"{path} gives {name} as {str(said)[:40]!r}, which is not a number of zero or more.")
    return float(said)


def _taper(values: FloatArray) -> FloatArray:
    share = min(1.0, 2 * Window().taper * RATE_HZ / len(values))
    return np.asarray(values * scipy.signal.windows.tukey(len(values), share))
