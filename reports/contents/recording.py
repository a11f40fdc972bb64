"""What a recording says: its presses, and the data recorded along with them."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import Any

import numpy as np

from ...acquisition import ButtonPress, Recording, accepted_presses, activation_forces, find_presses
from ...acquisition.presses import LEAST_RATES, fast_enough
from ...acquisition.recording import AlongFile, AlongReading
from ...base.arrays import FloatArray
from ...base.parts import PART, Parted
from .. import figures
from . import words
from .parts import Contents, Drawing, Fact, Verdict, fact
from .words import counted, sentence, told_by

Forces = Mapping[str, Mapping[str, FloatArray]]
"""Force at activation (N) of each press: button -> participant -> (presses,)."""


def forces_in(recordings: Sequence[Recording]) -> Forces:
    """Collect the force at activation of every accepted press. Raises DataError."""
    found: dict[str, dict[str, list[float]]] = {}
    for recording in recordings:
        mine = found.setdefault(recording.button, {}).setdefault(recording.participant, [])
        mine += activation_forces(recording)
    return {
        button: {participant: np.array(mine) for participant, mine in sorted(by.items()) if mine}
        for button, by in found.items()
        if any(by.values())
    }


def forces_drawing(recordings: Sequence[Recording], of: str = "") -> Drawing:
    """The figure of the forces of recordings; `of` is added to its title."""
    return Drawing(
        "forces",
        f"Force at activation{of}",
        words.FORCES,
        recordings,
        lambda some, columns: figures.activation_forces(forces_in(some), columns=columns),
        lambda some: sentence(
            [
                f"{button}, n = {sum(map(len, by.values()))} presses by {counted(by, 'participant')}"
                for button, by in forces_in(some).items()
            ]
        ),
        several=1000,
    )


def recording_contents(recording: Recording) -> Contents:
    """What a recording says. Raises DataError for damaged data."""
    found = find_presses(recording)
    counting = accepted_presses(recording, found)
    bad = [press for press in recording.verdicts if not press.accepted]
    complete, subject = bool(recording.complete), f"{recording.participant}, {recording.button}"
    verdicts = [
        Verdict(
            subject,
            "complete" if complete else "incomplete",
            complete,
            f"{len(recording.accepted)} presses accepted, {len(bad)} not",
        )
    ]
    for p in bad:
        attempt = f"press {p.number}, attempt {p.attempt}"
        verdicts.append(Verdict(subject, "not accepted", False, attempt, p.reason))
    picture = _pressed(recording, counting)
    measured = any(p.force_at_activation is not None for p in counting)
    return Contents(
        f"Recording {recording.path.name}",
        [
            *_about(recording),
            *_ended(recording),
            _presses(recording, found, counting),
            *_activated(recording, found, counting),
            *_along(recording),
            fact("Content", f"SHA-256 {recording.content_hash}", content_hash=recording.content_hash),
        ],
        kind="recording",
        simulated=recording.simulated,
        rig=recording.rig,
        verdicts=verdicts,
        figures=[
            *([forces_drawing([recording])] if measured else []),
            *([picture] if _has_activation(counting) else []),
            *_travelled(recording, counting),
        ],
        picture=picture,
    )


def _about(recording: Recording) -> Iterator[Fact]:
    """Who pressed what, in which study, and what was noted."""
    header, rate_hz = recording.header, recording.rate_hz
    yield fact(file=recording.path, channels=recording.channels, participant_columns=recording.about)
    yield fact(
        "Button",
        f"{recording.button}, pressed by {recording.participant}",
        button=recording.button,
        participant=recording.participant,
    )
    study = header.study and f"{header.study}, session {header.session}"
    yield fact("Study", study, study=header.study, session=header.session)
    for column, value in recording.about.items():
        yield fact(column, str(value))
    yield fact("Notes", header.notes, notes=header.notes)
    noted = [(event.sample / rate_hz, event.text) for event in recording.events if event.kind == "note"]
    yield fact(
        "Operator",
        [f"at {at:.1f} s: {text}" for at, text in noted],
        operator_notes=[{"at_s": at, "text": text} for at, text in noted],
    )
    yield fact("Rig", recording.rig, rig=recording.rig)
    yield _imported(recording)


def _ended(recording: Recording) -> Iterator[Fact]:
    """How long a recording is, and how it ended."""
    rate_hz, complete = recording.rate_hz, bool(recording.complete)
    length = f"{recording.duration:.2f} s, {len(recording.channels)} channels at {rate_hz:g} Hz"
    yield fact("Length", length, duration_s=recording.duration, rate_hz=rate_hz)
    why = ("gap", "overrun", "error", "interrupted", "recovered")
    ended = next((event.text for event in reversed(recording.events) if event.kind in why), None)
    state = "complete" if complete else f"incomplete: {ended or 'the recording ended early.'}"
    yield fact(
        "State",
        "in progress" if recording.in_progress else state,
        complete=complete,
        in_progress=recording.in_progress,
        ended=ended,
    )


def _presses(recording: Recording, found: Sequence[ButtonPress], counting: Sequence[ButtonPress]) -> Fact:
    """The presses that were found, and why others do not count."""
    bad, accepted = [press for press in recording.verdicts if not press.accepted], set(counting)
    return fact(
        "Presses found",
        [
            f"{len(found)}, {len(counting)} of them accepted",
            *(f"press {p.number}, attempt {p.attempt}: {p.reason}" for p in bad),
        ],
        presses_detected=len(found),
        presses_accepted=len(counting),
        presses=[_press(p, recording.rate_hz, p in accepted) for p in found],
        bad_presses=[
            {"press": p.number, "attempt": p.attempt, "flags": p.flags, "reason": p.reason} for p in bad
        ],
    )


def _activated(
    recording: Recording, found: Sequence[ButtonPress], counting: Sequence[ButtonPress]
) -> Iterator[Fact]:
    """What told the activation, the force at it, and what left its range."""
    yield fact("Sensors", ", ".join(recording.sensors.of_presses), sensors=list(recording.sensors.of_presses))
    by = counting[0].activated_by if counting else None
    yield fact(
        "Activation", None if recording.has("activation") or by is None else told_by(by), activated_by=by
    )
    yield _forces(recording, counting)
    saturated = [number for number, p in enumerate(found, 1) if p.saturated]
    yield fact(
        "Saturated",
        f"in presses {', '.join(map(str, saturated))}" if saturated else "never while pressed",
        saturated_presses=saturated,
    )


def _forces(recording: Recording, counting: Sequence[ButtonPress]) -> Fact:
    """The force at activation of the presses, and how far each may be off."""
    forces = [p.force_at_activation for p in counting if p.force_at_activation is not None]
    within = max((p.force_uncertainty for p in counting if p.force_uncertainty is not None), default=None)
    mean = float(np.mean(forces)) if forces else None
    deviation = float(np.std(forces, ddof=1)) if len(forces) > 1 else None
    said: str | None = "none"
    if not recording.has("force"):
        said = None
    elif not fast_enough("force at activation", recording.measured_hz):
        least = LEAST_RATES["force at activation"]
        said = (
            f"not told: it was measured at {recording.measured_hz:g} samples/s, and {least.hz:g} are needed, "
            f"because {least.why}"
        )
    elif mean is not None:
        spread = "" if deviation is None else f" ± {deviation:.3f}"
        said = f"{mean:.3f}{spread} N, each within {within or 0:.2g} N"
    return fact(
        "Force at activation",
        said,
        activation_force_n=mean,
        activation_force_sd_n=deviation,
        activation_force_uncertainty_n=within,
    )


def _imported(recording: Recording) -> Fact:
    """Where a recording of another program comes from."""
    origin = recording.imported
    if not origin:
        return fact()
    said = f"{origin['file']}, {origin['rate_hz']:g} samples/s, SHA-256 {origin['sha256']}"
    return fact("Imported from", [said, *origin["notes"]], imported=origin)


def _press(press: ButtonPress, rate_hz: float, accepted: bool) -> dict[str, Any]:
    return {
        "onset_s": press.onset / rate_hz,
        "activation_s": None if press.activation is None else press.activation / rate_hz,
        "force_at_activation_n": press.force_at_activation,
        "force_uncertainty_n": press.force_uncertainty,
        "release_s": press.release / rate_hz,
        "saturated": press.saturated,
        "accepted": accepted,
    }


def _has_activation(presses: Sequence[ButtonPress]) -> bool:
    return any(p.activation is not None for p in presses)


def _travelled(recording: Recording, presses: Sequence[ButtonPress]) -> list[Drawing]:
    """The figure of force over travel, of a recording that has both."""
    if not (presses and recording.has("force") and recording.has("displacement")):
        return []
    return [
        Drawing.alone(
            "travel",
            f"Force over travel of the {recording.button} button",
            words.TRAVEL,
            lambda columns: figures.travel_figure(recording, presses, columns),
            f"{recording.button} by {recording.participant}, n = {len(presses)} presses",
        )
    ]


def _pressed(recording: Recording, presses: tuple[ButtonPress, ...]) -> Drawing:
    return Drawing(
        "pressed",
        "One press of each recording",
        words.PRESSES,
        [(recording, presses)],
        lambda some, columns: figures.recording_figure(some, columns),  # noqa: PLW0108 - loads matplotlib
        lambda some: sentence(
            [f"{one.button} by {one.participant}, {_which(one)} of n = {len(mine)}" for one, mine in some]
        ),
    )


def _which(recording: Recording) -> str:
    """Which press a figure is of, and what told its activation where no contact did."""
    which = "the press with the median force at activation" if recording.has("force") else "the middle press"
    if recording.has("activation"):
        return which
    quantity = "force" if recording.has("force") else recording.motion
    return f"{which}, its activation {told_by(quantity or 'force')}"


def _along(recording: Recording) -> Iterator[Fact]:
    """Extra channels, readings, files, and failures to read them; times are seconds from the first sample."""
    rate_hz = recording.rate_hz
    extra: dict[str, dict[str, Any]] = {}
    for name, sensor in recording.sensors.extra.items():
        spread, called = _spread(recording.in_parts(f"extra.{name}")), sensor.name or name
        extra[name] = {"name": called, "channel": sensor.channel, "unit": sensor.unit, **spread}
        yield fact(
            called, f"{spread['mean']:.5g} {sensor.unit}, {_range(spread)}" if spread else "no samples"
        )

    read: dict[tuple[str, str], list[float]] = {}
    for one in recording.readings:
        read.setdefault((f"{one.instrument}: {one.name}", one.unit), []).append(one.value)
    for (label, unit), values in read.items():
        spread = _spread(Parted.of(np.array(values)))
        among = "" if len(values) == 1 else f", {_range(spread)} in {counted(values, 'reading')}"
        yield fact(label, f"{spread['mean']:.5g} {unit}{among}")

    written: dict[str, list[str]] = {}
    for file in recording.files:
        written.setdefault(f"{file.instrument}: {file.name}", []).append(file.file)
    for label, names in written.items():
        yield fact(
            label, names[0] if len(names) == 1 else f"{counted(names, 'file')}, {names[0]} to {names[-1]}"
        )

    failures = [event for event in recording.events if event.kind in ("along-error", "along-full")]
    yield fact(
        "",
        [f"at {event.sample / rate_hz:.2f} s: {event.text}" for event in failures],
        extra=extra,
        readings=[_timed(one, rate_hz) for one in recording.readings],
        files=[_timed(file, rate_hz) for file in recording.files],
        along_errors=[{"time_s": event.sample / rate_hz, "error": event.text} for event in failures],
    )


def _timed(one: AlongReading | AlongFile, rate_hz: float) -> dict[str, Any]:
    values = one._asdict()
    return {"time_s": values.pop("sample") / rate_hz, **values}


def _spread(signal: Parted) -> dict[str, float]:
    """Mean, smallest and largest value; empty without samples."""
    if not len(signal):
        return {}
    ends = [(float(part.min()), float(part.max())) for part in map(signal.__getitem__, signal.parts())]
    lows, highs = zip(*ends, strict=True)
    return {"mean": _sum(signal, 0, len(signal)) / len(signal), "min": min(lows), "max": max(highs)}


def _sum(signal: Parted, begin: int, end: int) -> float:
    """The sum of samples as NumPy forms it of all at once: by halves, each of a multiple of eight samples."""
    count = end - begin
    if count <= PART:
        return float(np.add.reduce(signal[begin:end]))
    half = begin + count // 2 // 8 * 8
    return _sum(signal, begin, half) + _sum(signal, half, end)


def _range(spread: Mapping[str, float]) -> str:
    return f"from {spread['min']:.5g} to {spread['max']:.5g}"
