"""The representative press of a button: the average press of all participants.

Model: each press of a button sheds the same events, at times and with strengths of its own. Presses are
brought to one time at the activation and, if the contact opens again, at the opening; what remains is a
warp of time, which the methods of `averaging.py` estimate: a barycentre under dynamic time warping, as the
paper does, or a registration by smooth warps. The average is taken per participant and then over
participants, so that nobody counts for more by having pressed more often.

Assumptions: the vertical acceleration shows the events, and the sensor's stated response is its own;
the contact, or the snap without one, marks the same event in each press; presses unlike the others are few.
What breaks them: events that come in another order or not in each press (an average of two kinds of press is
neither); an axis that points down or is disturbed in all presses alike, which no comparison between presses
shows; a slow accelerometer, unless its low-pass is undone, and then its noise. Source: the paper, figure 5;
Petitjean et al., Pattern Recognition 44(3), 2011.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import NamedTuple

import numpy as np

from ...base import hdf5
from ...base.arrays import BoolArray, FloatArray
from ...base.errors import ConfigurationError, DataError
from ...base.files import paths_of
from ...base.progress import Progress, silent
from ..recording import Recording
from .averaging import AverageMethod, average
from .choice import Activated, Cuttable, common_opening, cut_out, few, held, single, usable
from .filtering import bandwidth_of, high_pass, noise_gain, undone
from .quality import Protocol
from .registration import WarpModel
from .representative import KIND, Representative
from .segmentation_settings import Segmentation, require_rate, segmentation_for
from .sensor_faults import upside_down
from .spool import Spool

_TURNED = "the accelerometer was upside down, as gravity shows; the sign of its acceleration was changed"


@dataclass(frozen=True)
class Window:
    """The part of a press, about its activation, that the representative holds (s)."""

    before: float = 0.15
    """A latch's first click comes 30 to 100 ms before its activation (docs/hardware.md, "Buttons and
    people")."""
    after: float = 0.35
    """Shortest time; for a momentary button that opens later, the window ends `ring` after the opening."""
    ring: float = 0.1
    longest: float = 1.0
    taper: float = 0.03
    """Length of the cosine taper at both ends of the acceleration, so that it begins and ends at zero."""
    high_pass_hz: float = 10.0
    """Cut-off from the paper; removes gravity, drift and the motion of the hand."""

    def __post_init__(self) -> None:
        """Raises ConfigurationError."""
        times = (self.before, self.after, self.ring, self.longest, self.taper)
        shortest = self.before + min(self.after, self.longest)
        if not (min(times) >= 0 and sum(times) < np.inf and shortest > 2 * self.taper):
            raise ConfigurationError(
                f"{self} is no window of a press: times are not negative, and the window is longer than its "
                "two tapers."
            )
        if not (min(self.after, self.longest) > 0 and 0 < self.high_pass_hz < np.inf):
            raise ConfigurationError(
                f"{self} is no window of a press: it ends after the activation, and high_pass_hz is above 0."
            )


def load_press(
    files: str | Path | Sequence[str | Path], method: AverageMethod = "automatic"
) -> Representative:
    """The press that one file of a representative press holds, or the average of recordings' presses.

    Raises DataError for a file of another kind, and the errors of `representative`.

    For example:

        >>> press = haploop.load_press("data/P01-latch.h5", method="mean")
        >>> press.button, press.members
        ('latch', 2)
    """
    paths = paths_of(files)
    if len(paths) == 1 and hdf5.kind_of(paths[0]) == KIND:
        return Representative.load(paths[0])
    return representative([Recording.open(path) for path in paths], method=method)


def representative(
    recordings: Sequence[Recording] | Recording,
    window: Window | None = None,
    model: WarpModel | None = None,
    undo_low_pass: tuple[float, float] | None = None,
    method: AverageMethod = "automatic",
    progress: Progress = silent,
) -> Representative:
    """Compute the representative press of one button: the average per participant, then over participants
    (the paper, figure 5). Alignment uses the vertical acceleration; force and activation are warped with it.

    The acceleration is the accelerometer's, else a velocity or a displacement of the cap, differentiated
    (`Representative.motion`). Without a contact, the activation is told by the snap (`activated_by`).

    Presses are aligned at the activation, and at the opening of the contact, which is moved to their median
    or to what the shortest can be stretched to. `method` then averages them: "barycentre" as the paper does,
    by dynamic time warping; "registration" by smooth warps; "mean" without any further alignment. "automatic"
    computes a registration and a barycentre at the presses' mean time, and takes the one with the
    smaller error on held-out presses; the result holds both scores.

    `undo_low_pass` is a band (Hz) in which the accelerometer's response stated in the rig file is divided
    out, gain and delay: a stock GY-61 passes 50 Hz, and shows a fifth of a click at 263.5 Hz. The
    correction fades out over a third of an octave beyond the band. It amplifies noise by `noise_gain`.

    The sign of an accelerometer that was upside down is corrected. Presses with hum, spikes or a sensor that
    does not follow, and those that clicked once more than the participant's others, are left out and listed
    (`sensor_faults.py`, `choice.py`).

    Presses that were rejected, saturated a sensor, did not activate the button, were held for less than half
    the median time, or differ from the participant's other presses are left out and listed, as are
    participants whose presses differ from the others'. `progress` is called as recordings are read, and as
    presses are averaged. Raises DataError when no press is left, ConfigurationError for recordings that
    cannot be combined, an invalid band, or an unknown method.

    For example:

        >>> press = haploop.representative(haploop.Recording.open("data/P01-latch.h5"))
        >>> press.save("press.h5")
        >>> press
        <Representative latch: 2 presses, 8.80 m/s² peak, simulated>
    """
    if isinstance(recordings, Recording):
        recordings = [recordings]
    w, m = window or Window(), model or WarpModel()
    first = _check_together(recordings)
    rate_hz = first.rate_hz
    if undo_low_pass is not None and not 0 < undo_low_pass[0] < undo_low_pass[1] < rate_hz / 2:
        raise ConfigurationError(
            f"undo_low_pass is {undo_low_pass[0]:g} to {undo_low_pass[1]:g} Hz: use a band within 0 to "
            f"{rate_hz / 2:g} Hz, its lower edge first."
        )
    got = _gather(recordings, w, undo_low_pass, progress)
    cut = _cut(got, w, rate_hz)
    found = average(cut.curves, rate_hz, m, method, progress)
    left_out = [*got.left_out, *_unlike(cut.names, found.kept)]
    acceleration, *slow, activation = found.template
    by_name = dict(zip(_slow(first), slow, strict=True))
    return Representative(
        button=first.button,
        rate_hz=rate_hz,
        acceleration=acceleration * _taper(len(acceleration), round(w.taper * rate_hz)),
        force=by_name.get("force"),
        activation=np.clip(activation, 0.0, 1.0),
        activation_index=int(np.argmax(activation > 0.5)),
        members=found.members,
        spread=found.spread,
        bandwidth_hz=got.bandwidth_hz,
        sources=tuple((r.path.name, r.content_hash) for r in recordings),
        left_out=tuple(left_out),
        corrected=tuple(got.corrected),
        method=found.method,
        reason=found.reason,
        simulated=any(r.simulated for r in recordings),
        scores=found.scores,
        parameters={"window": asdict(w), "warps": asdict(m)}
        | {_name(recording, recordings): asdict(_segmentation(recording)) for recording in recordings},
        undone_hz=undo_low_pass,
        noise_gain=1.0 if undo_low_pass is None else noise_gain(first, undo_low_pass),
        travel=by_name.get("displacement"),
        motion=first.motion or "",
        activated_by=got.taken[0].presses[0][0].activated_by,
    )


class _Taken(NamedTuple):
    """A recording with usable presses."""

    recording: Recording
    delays: tuple[float, ...]
    presses: list[Activated]


@dataclass
class _Gathered:
    """The usable presses of all recordings, what was left out of them, and what was corrected."""

    taken: list[_Taken]
    signals: Spool
    """Those of each recording in `taken`, on the disk."""
    bandwidth_hz: float
    left_out: list[str]
    corrected: list[str]


def _gather(
    recordings: Sequence[Recording], w: Window, undo_low_pass: tuple[float, float] | None, progress: Progress
) -> _Gathered:
    """Read the signals of each recording that has usable presses. Raises DataError when none has."""
    got = _Gathered([], Spool(), np.inf, [], [])
    for number, recording in enumerate(recordings, 1):
        progress("Read the recordings", number - 1, len(recordings), "recordings")
        if presses := usable(recording, got.left_out):
            vertical = recording.vertical
            if upside_down(recording, recording.rest):
                vertical = -vertical
                got.corrected.append(f"{recording.participant}: {_TURNED}")
            if undo_low_pass is not None:
                vertical = undone(recording, vertical, undo_low_pass)
            whole = Cuttable.of(recording, high_pass(vertical, recording.rate_hz, w.high_pass_hz))
            got.signals.append(whole.signals)
            got.bandwidth_hz = min(got.bandwidth_hz, bandwidth_of(recording), recording.motion_hz or np.inf)
            got.taken.append(_Taken(recording, whole.delays, presses))
        recording.forget()
        progress("Read the recordings", number, len(recordings), "recordings")
    if not got.taken:
        raise DataError(
            f"The recordings hold no usable press of the {recordings[0].button} button "
            f"({few(got.left_out) or 'none was found'}): record more presses."
        )
    return got


class _Cut(NamedTuple):
    """Presses cut out about their activation: an item a participant, in the order of the pseudonyms."""

    curves: Spool
    names: dict[str, list[str]]
    """Name of each press, by participant."""


def _cut(got: _Gathered, w: Window, rate_hz: float) -> _Cut:
    """Cut the presses of each participant out of their recordings; lists those that are left out."""
    every = [press for one in got.taken for press in one.presses]
    opening, least = common_opening([p.opened - at for p, at in every if p.opened is not None])
    after = max(w.after, opening / rate_hz + w.ring)
    before, after = round(w.before * rate_hz), round(min(after, w.longest) * rate_hz)
    names: dict[str, list[str]] = defaultdict(list)
    by: dict[str, list[tuple[int, list[Activated]]]] = defaultdict(list)
    for number, (recording, _, presses) in enumerate(got.taken):
        if long := held(recording, presses, least, got.left_out):
            by[recording.participant].append((number, long))
            names[recording.participant] += [f"press at {at / rate_hz:.2f} s" for _, at in long]
    cut = _Cut(Spool(), {})
    for participant in sorted(by):
        rows = np.concatenate(
            [
                cut_out(
                    Cuttable(got.signals[n], got.taken[n].delays, rate_hz), presses, before, after, opening
                )
                for n, presses in by[participant]
            ]
        )
        named = [f"{participant}, {name}" for name in names[participant]]
        once, told = single(rows[:, 0], rate_hz, before, named)
        got.left_out += told
        cut.names[participant] = [name for name, one in zip(names[participant], once, strict=True) if one]
        cut.curves.append(rows[once])
    return cut


def _unlike(names: Mapping[str, Sequence[str]], kept: Sequence[BoolArray]) -> Iterator[str]:
    """Say which participants, and which presses of the others, the average left out."""
    for (participant, presses), alike in zip(names.items(), kept, strict=True):
        if not alike.any():
            yield f"{participant}: the presses differ from the other participants'"
            continue
        for name, used in zip(presses, alike, strict=True):
            if not used:
                yield f"{participant}, {name}: it differs from this participant's others"


def _check_together(recordings: Sequence[Recording]) -> Recording:
    """The first recording. Raises ConfigurationError when the recordings cannot be combined."""
    if not recordings:
        raise ConfigurationError("A representative press needs at least one recording: name one.")
    first = recordings[0]
    if first.motion is None:
        raise ConfigurationError(
            f"{first.path.name} holds no motion of the cap, which a representative press is made of: record "
            "with [sensors.acceleration], [sensors.velocity] or [sensors.displacement]."
        )
    for recording in recordings:
        require_rate(
            "representative press",
            recording.measured_hz,
            recording.path.name,
            "record or export it with a higher rate",
        )
    for other in recordings[1:]:
        for what, mine, theirs in (
            ("the button", first.button, other.button),
            ("the sample rate", first.rate_hz, other.rate_hz),
            ("the sensor of motion", first.motion, other.motion),
            ("its bandwidth", bandwidth_of(first), bandwidth_of(other)),
            ("force and travel", _slow(first), _slow(other)),
            ("a contact", first.has("activation"), other.has("activation")),
            ("simulated", first.simulated, other.simulated),
        ):
            if mine != theirs:
                raise ConfigurationError(
                    f"{first.path.name} and {other.path.name} cannot be combined: "
                    f"{what} is {mine} in one and {theirs} in the other."
                )
    if len({r.content_hash for r in recordings}) < len(recordings):
        raise ConfigurationError("The same recording is given twice: give each recording once.")
    return first


def _segmentation(recording: Recording) -> Segmentation:
    """Segmentation parameters used while recording, or else the button's defaults."""
    protocol = Protocol.from_json(recording.header.protocol)
    return protocol.segmentation if protocol else segmentation_for(recording.button)


def _name(recording: Recording, among: Sequence[Recording]) -> str:
    """The name of a recording's file, with its hash where another has the same."""
    name = recording.path.name
    alone = sum(other.path.name == name for other in among) == 1
    return name if alone else f"{name} ({recording.content_hash[:12]})"


def _taper(samples: int, length: int) -> FloatArray:
    """Taper (samples,): 1, with a raised cosine to zero at both ends."""
    edge = 0.5 - 0.5 * np.cos(np.pi * np.arange(length) / length)
    return np.concatenate([edge, np.ones(samples - 2 * length), edge[::-1]])


def _slow(recording: Recording) -> list[str]:
    return [name for name in ("force", "displacement") if recording.has(name)]
