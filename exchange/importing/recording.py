"""A whole recording of another program: segmented, judged and represented like one's own.

Samples are kept in SI: a channel's volt is one newton, m/s^2 or metre, at 5000 samples/s and 16 bits of the
largest value, so that what follows reads it like any other. The file says where it comes from: its name and
hash, the mapping, and what was resampled or filled. A press in which more than a millisecond was filled is
not accepted.
"""

from __future__ import annotations

import json
import math
from collections.abc import Mapping, Sequence
from datetime import UTC, datetime
from importlib import metadata
from pathlib import Path
from typing import Any, Literal

import numpy as np

from ...acquisition import Protocol, Recording, file_name, segmentation_for
from ...acquisition.presses import judged
from ...acquisition.recording import Event, Header, PressVerdict, write_recording
from ...base.arrays import FloatArray
from ...base.errors import ConfigurationError, DataError
from ...instruments import LinearSensor, Sensors, Switch
from .press import RATE_HZ, presses_in, ratio_of, resampled
from .understanding import understand
from .understood import FileMapping, Signal, Understanding, rest_of

_REST = 0.5
"""s: hands off, as in a session."""
_FILLED = 1e-3
"""s: longest part of a press that may have been filled."""
_ROOM = 1.02
"""Full scale over the largest value, which the converter's last code would call clipped."""
_MEASURES: dict[str, Literal["force", "acceleration", "displacement"]] = {
    "force": "force",
    "acceleration": "acceleration",
    "displacement": "displacement",
}
_G, _NEAR_G = 9.80665, 0.35
_AT_REST = 0.05
"""Share of a signal's span within which it is at rest."""
_FLAT = 5
"""Samples in a row at the largest value, from a steep rise, that show a clipped signal."""


def import_recording(path: str | Path, mapping: FileMapping, out: str | Path) -> Recording:
    """Make a recording of a file with presses, into the new file `out`.

    `mapping` says what the file does not, with participant and button. Each press is judged as in a session.
    Raises ConfigurationError for a missing or wrong choice, DataError for a file that cannot be read.
    """
    found = understand(path, mapping)
    found.require()
    return recording_of(found, Path(out))


def recording_of(found: Understanding, out: Path) -> Recording:
    """As `import_recording`, of a file that is understood."""
    who, button = _who(found)
    file_name(who, button)
    signals = {role: s for role, s in found.signals.items() if role != "time"}
    volts = np.stack([_even(signal, found.rate_hz) for signal in signals.values()])
    of = {r: _sensor(s, row) for (r, s), row in zip(signals.items(), volts, strict=True)}
    sensors = Sensors.model_validate(of)
    protocol = Protocol(segmentation=segmentation_for(button))
    rest = min(_REST, 0.1 * volts.shape[1] / RATE_HZ)
    started, dated = _dated(found)
    origin = {
        "file": found.path.name,
        "sha256": found.sha256,
        "rate_hz": found.rate_hz,
        "mapping": found.mapping.model_dump(exclude_none=True),
        "notes": [*found.notes, *_resampling(found.rate_hz), *dated],
        **({} if found.start is None else {"started": found.start.contents}),
    }
    rig = {"name": "imported", "imported": origin, "sensors": sensors.model_dump(mode="json")}
    header = Header(
        button=button,
        participant=who,
        presses=max(1, len(presses_in(found))),
        rig_name="imported",
        simulated=bool(found.table.about.get("simulated", False)),
        rate_hz=RATE_HZ,
        channels=tuple(signals),
        full_scale=np.array([_ROOM * max(float(np.abs(row).max()), 1e-9) for row in volts]),
        delays=np.zeros(len(volts)),
        rest=rest,
        rig=json.dumps(rig),
        daq=f"imported from {found.path.name}",
        software=f"haploop {metadata.version('haploop')}",
        started=started,
        protocol=protocol.to_json(),
    )
    ratio = RATE_HZ / found.rate_hz
    holes = [(round(h.first * ratio), max(round(h.end * ratio), round(h.first * ratio) + 1), h.what)
             for h in found.holes]  # fmt: skip
    events = [
        Event(0, "imported", f"Imported from {found.path.name}, SHA-256 {origin['sha256']}."),
        Event(_still(found, signals, volts, rest), "rest", "Hands were off."),
        *(Event(a, "filled", f"{what}: {_ms(b - a)} were not measured.") for a, b, what in holes),
    ]

    def judge(recording: Recording) -> Sequence[PressVerdict]:
        found_there = judged(recording, protocol)
        if not found_there:
            raise DataError(
                f"{found.path} shows no press in {recording.duration:.3g} s: look at its columns and units "
                "without --out, or import it as one press (--as press)."
            )
        return [_whole(one, holes) for one in found_there]

    return write_recording(out, header, volts, sorted(events), judge)


def _dated(found: Understanding) -> tuple[str, list[str]]:
    """The start in UTC, of the file's last change where no instant is stated, and that it is so."""
    if found.start is not None and found.start.utc is not None:
        return found.start.utc.isoformat(), []
    written = datetime.fromtimestamp(found.path.stat().st_mtime, UTC).isoformat(timespec="seconds")
    return written, [f"Dated {written} by the file's last change, which need not be when it was measured."]


def _who(found: Understanding) -> tuple[str, str]:
    about, mapping = found.table.about, found.mapping
    who = mapping.participant or about.get("participant")
    button = mapping.button or about.get("button")
    missing = [f"--{name}" for name, said in (("participant P01", who), ("button NAME", button)) if not said]
    if missing:
        raise ConfigurationError(
            f"{found.path} does not say who pressed what: add {' and '.join(missing)}, or --names where it "
            "stands in the files' names."
        )
    return str(who), str(button)


def _even(signal: Signal, rate_hz: float) -> FloatArray:
    """(samples,) at `RATE_HZ`; a contact as 0 and 1."""
    if signal.role != "activation":
        return resampled(signal.values, rate_hz)
    values = signal.values
    closed = (values > (values.min() + values.max()) / 2).astype(np.float64)
    ratio = ratio_of(rate_hz)
    at = np.arange(math.ceil(len(values) * ratio)) / float(ratio)
    return np.asarray(closed[np.minimum(np.rint(at).astype(np.int64), len(values) - 1)])


def _sensor(signal: Signal, values: FloatArray) -> LinearSensor | Switch:
    """The sensor that a channel in SI is."""
    if signal.role == "activation":
        return Switch(channels=("activation",), threshold=0.5)
    rest = float(np.median(values))
    gravity = signal.role == "acceleration" and abs(rest - _G) < _NEAR_G * _G
    zero = rest if signal.role == "acceleration" and not gravity else 0.0
    said: dict[str, Any] = {"stated": {"column": signal.heading, "unit": signal.unit}}
    if (clipped := _clipped(values)) is not None and signal.role == "acceleration":
        said["range"] = (clipped,)
    return LinearSensor(
        measures=_MEASURES[signal.role], channels=(signal.role,), axes=("z",), matrix=((1.0,),), zero=(zero,),
        vertical="z", gravity=gravity, **said,
    )  # fmt: skip


def _clipped(values: FloatArray) -> float | None:
    """The magnitude at which a signal is cut flat; None for one that is not."""
    size = np.abs(values)
    top = size >= size.max() * (1 - 1e-6)
    edges = np.flatnonzero(np.diff(np.concatenate([[False], top, [False]]).astype(np.int8)))
    longest = max(zip(edges[::2], edges[1::2], strict=True), key=lambda e: int(e[1] - e[0]))
    if longest[1] - longest[0] < _FLAT or longest[0] == 0:
        return None
    steps = np.abs(np.diff(values))
    quantum = steps[steps > 0].min()
    rise = abs(values[longest[0]] - values[longest[0] - 1])
    return float(size.max() * (1 - 1e-3)) if rise > 3 * quantum else None


def _still(found: Understanding, signals: Mapping[str, Signal], volts: FloatArray, rest: float) -> int:
    """End of the part, `rest` long (s), of a signal in which it changes least; force and travel are at rest
    in it, because a button that is held is still as well.
    """
    role = next((one for one in ("force", "displacement") if one in signals), next(iter(signals)))
    signal = volts[list(signals).index(role)]
    length, step = max(1, round(rest * RATE_HZ)), max(1, round(0.05 * RATE_HZ))
    starts = list(range(0, max(1, len(signal) - length + 1), step))
    if role != "acceleration":
        ends = rest_of(signal, RATE_HZ)
        value = ends.at(found.mapping.rest.get(role))
        off = [abs(float(signal[at : at + length].mean()) - value) for at in starts]
        near = max(min(off), _AT_REST * (ends.high - ends.low))
        starts = [at for at, far in zip(starts, off, strict=True) if far <= near]
    return min(starts, key=lambda at: float(np.ptp(signal[at : at + length]))) + length


def _resampling(rate_hz: float) -> list[str]:
    if rate_hz == RATE_HZ:
        return []
    edge = f"; nothing above {rate_hz / 2:g} Hz was measured" if rate_hz < RATE_HZ else ""
    return [f"Resampled from {rate_hz:g} to {RATE_HZ:g} samples/s{edge}."]


def _ms(samples: int) -> str:
    return f"{1e3 * samples / RATE_HZ:.3g} ms"


def _whole(verdict: PressVerdict, holes: Sequence[tuple[int, int, str]]) -> PressVerdict:
    """The verdict on a press, not accepted when too much of it was not measured."""
    lost = [(b - a, what) for a, b, what in holes if a < verdict.end and b > verdict.first]
    longest = max(lost, default=(0, ""))
    if longest[0] <= _FILLED * RATE_HZ:
        return verdict
    reason = f"{_ms(longest[0])} of {longest[1]} are missing in the file."
    return verdict._replace(accepted=False, flags=(*verdict.flags, "sensor"), reason=reason)
