"""The figures of a report: each with its name, and a caption that gives n, units and sources."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from typing import TypeVar

from matplotlib.figure import Figure

from ...acquisition import Recording, Representative, Study, accepted_presses
from ...calibration import Calibration, Check, DigitalButton, Drive, check_feeling
from ...calibration.map import VibrationMap
from ...experiments import Identification, Ratings
from ...instruments import DataError
from .. import figures
from ..show import Forces, forces_in
from . import captions
from .sections import Section

__all__ = ["Drawing", "drawings"]

_ROWS = 3
"""Buttons or recordings in one figure."""
_One = TypeVar("_One")


@dataclass(frozen=True, eq=False)
class Drawing:
    """A figure that is still to be drawn."""

    name: str
    """Part of its file's name."""
    title: str
    caption: str
    draw: Callable[[], Figure]
    simulated: bool


def drawings(sections: Sequence[Section]) -> Iterator[Drawing]:
    """Yield the figures of all sections; what several files of one kind show goes into one figure."""
    recordings = [(s, s.loaded) for s in sections if isinstance(s.loaded, Recording)]
    presses = [(s, s.loaded) for s in sections if isinstance(s.loaded, Representative)]
    drives = [(s, s.loaded) for s in sections if isinstance(s.loaded, Drive)]
    buttons = [(s, s.loaded) for s in sections if isinstance(s.loaded, DigitalButton)]
    for s in sections:
        if isinstance(s.loaded, Study):
            yield from _study(s, s.loaded)
    yield from _recordings(recordings)
    for some in _batches(presses):
        yield _presses(some)
    for s in sections:
        if isinstance(s.loaded, VibrationMap):
            yield _map(s, s.loaded)
    for s in sections:
        if isinstance(s.loaded, Calibration):
            yield _response(s, s.loaded)
    known = {s.loaded.response.created for s in sections if isinstance(s.loaded, Calibration)}
    for some_drives in _batches(drives):
        yield _drives(some_drives)
    for s in sections:
        if isinstance(s.loaded, Check):
            yield _check(s, s.loaded)
    for some_buttons in _batches(buttons):
        yield from _buttons(some_buttons, known)
    for s in sections:
        yield from _people(s)


def _batches(items: Sequence[_One]) -> Iterator[Sequence[_One]]:
    return (items[first : first + _ROWS] for first in range(0, len(items), _ROWS))


def _caption(what: str, n: str, sections: Sequence[Section]) -> str:
    rigs = ", ".join(dict.fromkeys(f"“{s.rig}”" for s in sections if s.rig))
    where = f" Rig {rigs}." if rigs else ""
    origin = "; ".join(s.short_hash for s in sections)
    simulated = " Simulated." if any(s.simulated for s in sections) else ""
    return f"{what} {n}{where} Data: {origin}.{simulated}"


def _study(s: Section, study: Study) -> Iterator[Drawing]:
    forces = forces_in([r for button in study.file.buttons for r in study.recordings(button)])
    if not forces:
        return
    yield Drawing(
        "forces",
        f"Force at activation, study {study.file.name}",
        _caption(captions.FORCES, _counts(forces), [s]),
        lambda: figures.activation_forces(forces),
        s.simulated,
    )
    found = [study.representative(button) for button in forces]
    for some in _batches(found):
        yield _presses([(s, press) for press in some])


def _counts(forces: Forces) -> str:
    told = [
        f"{button}, n = {sum(map(len, by.values()))} presses by {len(by)} participant"
        f"{'' if len(by) == 1 else 's'}"
        for button, by in forces.items()
    ]
    return f"{'; '.join(told).capitalize()}."


def _recordings(items: Sequence[tuple[Section, Recording]]) -> Iterator[Drawing]:
    sections = [s for s, _ in items]
    forces = forces_in([recording for _, recording in items])
    if forces:
        yield Drawing(
            "forces",
            "Force at activation",
            _caption(captions.FORCES, _counts(forces), sections),
            lambda: figures.activation_forces(forces),
            any(s.simulated for s in sections),
        )
    for some in _batches([item for item in items if _can_be_drawn(item[1])]):
        yield _pressed(some)


def _can_be_drawn(recording: Recording) -> bool:
    try:
        figures.median_press(recording, accepted_presses(recording))
    except DataError:
        return False
    return True


def _pressed(items: Sequence[tuple[Section, Recording]]) -> Drawing:
    each = [(recording, accepted_presses(recording)) for _, recording in items]
    told = "; ".join(
        f"{recording.button} by {recording.participant}, the press with the median force at activation of "
        f"n = {len(found)}"
        for recording, found in each
    )
    return Drawing(
        "presses",
        "One press of each recording",
        _caption(captions.PRESSES, f"{told[:1].upper()}{told[1:]}.", [s for s, _ in items]),
        lambda: figures.profiles(
            [figures.press_of(recording, figures.median_press(recording, found)) for recording, found in each]
        ),
        any(s.simulated for s, _ in items),
    )


def _presses(items: Sequence[tuple[Section, Representative]]) -> Drawing:
    told = "; ".join(
        f"{press.button}, {press.method} of n = {press.members} presses in {len(press.sources)} recordings"
        for _, press in items
    )
    sections = list(dict.fromkeys(s for s, _ in items))
    return Drawing(
        "presses",
        "Representative presses",
        _caption(
            f"{captions.PRESSES} The band is one standard deviation of the aligned presses.",
            f"{told.capitalize()}.",
            sections,
        ),
        lambda: figures.profiles([figures.Profile.of(press) for _, press in items]),
        any(s.simulated for s in sections),
    )


def _map(s: Section, found: VibrationMap) -> Drawing:
    plan = found.plan
    return Drawing(
        "map",
        "Vibration map",
        _caption(
            captions.MAP,
            f"n = {len(found.points)} of {plan.rows * plan.columns} points, at {plan.level:.1f} V peak.",
            [s],
        ),
        lambda: figures.map_figure(found),
        s.simulated,
    )


def _response(s: Section, calibration: Calibration) -> Drawing:
    response = calibration.response
    return Drawing(
        "response",
        f"Response of patch {response.patch} at the {response.point} point",
        _caption(
            captions.RESPONSE,
            f"n = {response.repeats} repeats ({response.excitation}), {response.created}.",
            [s],
        ),
        lambda: figures.response(calibration),
        s.simulated,
    )


def _drives(items: Sequence[tuple[Section, Drive]]) -> Drawing:
    told = "; ".join(
        f"{drive.button}, {drive.method}, {drive.band[0]:.0f} to {drive.band[1]:.0f} Hz" for _, drive in items
    )
    return Drawing(
        "drives",
        "Drives",
        _caption(captions.DRIVES, f"{told[:1].upper() + told[1:]}.", [s for s, _ in items]),
        lambda: figures.drives([drive for _, drive in items]),
        any(s.simulated for s, _ in items),
    )


def _check(s: Section, check: Check) -> Drawing:
    return Drawing(
        "check",
        f"Check of the {check.drive.button} button: {check.verdict}",
        _caption(captions.CHECK, f"n = {check.plays} plays.", [s]),
        lambda: figures.check_figure(check),
        s.simulated,
    )


def _buttons(items: Sequence[tuple[Section, DigitalButton]], known: set[str]) -> Iterator[Drawing]:
    """Yield the figures of buttons; calibrations made at one of the `known` times are drawn already."""
    sections = [s for s, _ in items]
    simulated = any(s.simulated for s in sections)
    plays = "; ".join(f"{b.press.button}, n = {b.check.plays} plays" for _, b in items).capitalize()
    yield _presses([(s, b.press) for s, b in items])
    for s, b in items:
        if b.calibration.response.created not in known:
            known.add(b.calibration.response.created)
            yield _response(s, b.calibration)
    yield _drives([(s, b.drive) for s, b in items])
    yield Drawing(
        "motion",
        "Measured motion of the surface",
        _caption(captions.COMPARISON, f"{plays}.", sections),
        lambda: figures.comparison([(b.press, b.check) for _, b in items]),
        simulated,
    )
    yield Drawing(
        "feeling",
        "What a finger would feel",
        _caption(captions.FEELING, f"{plays}.", sections),
        lambda: figures.feeling_figure([(b.press.button, check_feeling(b.check, b.press)) for _, b in items]),
        simulated,
    )
    for s, b in items:
        yield Drawing(
            f"button-{b.press.button}",
            f"Digital {b.press.button} button: {b.check.verdict}",
            _caption(
                captions.LEARNING,
                f"n = {b.check.plays} plays, {len(b.learning.iterations) - 1} corrections.",
                [s],
            ),
            lambda b=b: figures.button_figure(b),  # type: ignore[misc]
            s.simulated,
        )


def _people(s: Section) -> Iterator[Drawing]:
    match s.loaded:
        case Identification():
            yield _answers(s, s.loaded)
        case Ratings():
            yield _ratings(s, s.loaded)
        case _:
            pass


def _answers(s: Section, found: Identification) -> Drawing:
    trials, people = int(found.pooled.counts.sum()), max((one.people for one in found.performance), default=0)
    by = f" by {people} participants" if people else ""
    return Drawing(
        "confusion",
        "Which button was answered",
        _caption(captions.CONFUSION, f"n = {trials} trials{by}.", [s]),
        lambda: figures.confusion_figure(found),
        s.simulated,
    )


def _ratings(s: Section, found: Ratings) -> Drawing:
    kind = "normalised by geometric means" if found.normalised else "as rated"
    return Drawing(
        "ratings",
        "Adjective ratings",
        _caption(captions.RATINGS, f"Ratings {kind}, n = {len(found.people)} participants.", [s]),
        lambda: figures.ratings_figure(found),
        s.simulated,
    )
