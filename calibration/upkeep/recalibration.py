"""Test whether the active calibration still holds; if the table has drifted, remake every digital button.

Unattended: a quick response at each place, a verdict, and then nothing, or new calibrations, drives
and checks, which become active all together or not at all.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import asdict, dataclass, field, replace
from datetime import UTC, datetime
from typing import Any, Literal, cast

import numpy as np

from haploop.calibration.drive import Check, DigitalButton, Method, build_button, check
from haploop.calibration.model import Calibration, fit
from haploop.calibration.response import Response, quick_response
from haploop.calibration.upkeep.drift import Kind, PlaceMetrics, Verdict, compare
from haploop.calibration.upkeep.history import Generation, History
from haploop.calibration.upkeep.sensor_health import laser_noise, laser_or_patch, loose_accelerometer
from haploop.instruments import (
    Aim,
    ConfigurationError,
    DataError,
    InstrumentError,
    LimitError,
    Rig,
    RigFile,
)
from haploop.instruments.progress import Progress, prefixed, silent
from haploop.instruments.safety import Audit, state_folder

__all__ = ["Outcome", "activate", "adopt", "buttons_of", "calibrations_of", "checks_before", "recalibrate"]

Place = tuple[str, str]
"""Patch and point."""

_RECENT = 9
"""Looks whose median noise is the laser's usual noise."""
_PLAYS_BEFORE = 4
"""Plays of each old drive on the drifted table, enough to measure its error."""


@dataclass(frozen=True, eq=False)
class Outcome:
    """Findings and actions of `recalibrate`.

    `unchanged`: the active calibration holds. `restored`: the table had drifted, and another calibration,
    in which every button passed, is active. `drifted`: the table had drifted, and not every button could
    be restored. `broken`: a place or an instrument has failed. Only `restored` changes anything.
    """

    kind: Literal["unchanged", "restored", "drifted", "broken"]
    when: datetime
    active: Generation
    """The generation that is active now."""
    verdicts: tuple[Verdict, ...]
    sentences: tuple[str, ...]
    """Findings, places not measured, and what to do."""
    before: Mapping[str, Check] = field(default_factory=dict)
    """By button: its old drive, played on the table as it was found."""
    after: Mapping[str, DigitalButton] = field(default_factory=dict)
    simulated: bool = True

    def summary(self) -> dict[str, Any]:
        """Plain values for JSON, without the waveforms."""
        return {
            "outcome": self.kind,
            "when": self.when.isoformat(timespec="seconds"),
            "simulated": self.simulated,
            "active": self.active.name,
            "places": [asdict(verdict) for verdict in self.verdicts],
            "buttons": {
                name: {
                    "before": self.before[name].summary() if name in self.before else None,
                    "after": self.after[name].check.summary() if name in self.after else None,
                }
                for name in sorted({*self.before, *self.after})
            },
            "sentences": list(self.sentences),
        }


def recalibrate(
    rig: Rig,
    history: History,
    *,
    actor: str = "haploop recalibrate",
    when: datetime | None = None,
    iterations: int = 3,
    progress: Progress = silent,
) -> Outcome:
    """Test whether the active calibration of a rig still holds, and restore a drifted one.

    Every look is noted in the history. A new generation is activated only if every one of its buttons
    passed its check on the table as it is. Nothing waits for an absent person: a point that the operator
    does not aim at is reported as not measured.

    Raises DataError for a history without a whole active calibration or one that cannot be written,
    ConfigurationError for another rig's, InstrumentError when another program recalibrates or the safe
    state was not confirmed. An instrument that fails otherwise is an outcome: broken.
    """
    when = when or datetime.now(UTC)
    with history.hold():
        active = history.active()
        calibrations = calibrations_of(active)
        _refuse_other(rig, active, calibrations)
        look = _look(rig, calibrations, _usual_noise(history), progress)
        outcome = Outcome(look.kind, when, active, look.verdicts, look.sentences, simulated=rig.simulated)
        if look.kind == "drifted" and look.unmeasured:
            outcome = _with(
                outcome,
                "Nothing was changed, because a button at a point that was not measured cannot be made anew: "
                "run it with somebody there to aim the laser (--attended).",
            )
        elif look.kind == "drifted":
            try:
                renewed = _renewed(calibrations, look)
            except DataError as error:
                outcome = _with(replace(outcome, kind="broken"), str(error))
            else:
                outcome = _bring_back(rig, history, outcome, renewed, iterations, actor, progress)
        history.note({"compared_with": active.name, **outcome.summary(), "laser_noise": look.laser_noise})
    return outcome


def adopt(
    history: History,
    buttons: Sequence[DigitalButton],
    *,
    actor: str,
    reason: str,
    when: datetime | None = None,
    rig: RigFile | None = None,
) -> Generation:
    """Make verified buttons, together with the active ones of other names, the active generation.

    That is how a history begins, and how a button is added to it or replaced. The audit log of their rig
    is told first: of `rig`, or of the rig file that is stored in the calibrations. Raises ConfigurationError
    for buttons of another rig than `rig`, and DataError for a button that did not pass its check, for two
    of one name, for one of another rig than the rest, and for a log that cannot be written.
    """
    when = when or datetime.now(UTC)
    _refuse_made_elsewhere(rig, [button.calibration for button in buttons])
    named = {_name(button): button for button in buttons}
    if len(named) < len(buttons) or not buttons:
        raise DataError("Give one button or more, and each name (button, patch and point) only once.")
    for name, button in named.items():
        if not button.passed:
            raise DataError(f"The button {name} did not pass its check, so that it is not adopted.")
    with history.hold():
        parent = history.active() if history.activations else None
        every = (buttons_of(parent) if parent else {}) | named
        rigs = {(b.calibration.response.rig, b.simulated) for b in every.values()}
        if len(rigs) > 1:
            told = ", ".join(f"{rig}{' (simulated)' if simulated else ''}" for rig, simulated in sorted(rigs))
            raise DataError(f"These buttons were made on different rigs ({told}): keep a history for each.")
        audit = _audit(rig, [button.calibration for button in every.values()])
        newest = sorted((b.calibration for b in every.values()), key=lambda c: c.response.created)
        generation = history.add(
            _parts({_place(c): c for c in newest}.values(), every, {}),
            when=when,
            reason=reason,
            details={"adopted": sorted(named)},
            parent=parent.name if parent else "",
        )
        audit.note("adopted", calibration=generation.name, buttons=sorted(named), reason=reason)
        history.activate(generation, when=when, actor=actor, reason=reason)
    return generation


def activate(
    history: History,
    name: str,
    *,
    actor: str,
    reason: str,
    when: datetime | None = None,
    rig: RigFile | None = None,
) -> Generation:
    """Make an earlier generation, by its name or number, the active one again. Nothing is played.

    The audit log of its rig is told first: of `rig`, or of the rig file that is stored in the calibrations.
    Raises ConfigurationError for calibrations of another rig than `rig`, and DataError for one that is not
    there or is damaged, and for a log that cannot be written.
    """
    when = when or datetime.now(UTC)
    with history.hold():
        generation = history.find(name)
        generation.verify()
        calibrations = calibrations_of(generation)
        _refuse_made_elsewhere(rig, calibrations)
        _audit(rig, calibrations).note("activated", calibration=generation.name, reason=reason)
        history.activate(generation, when=when, actor=actor, reason=reason)
    return generation


def _audit(rig: RigFile | None, calibrations: Sequence[Calibration]) -> Audit:
    response = calibrations[0].response
    file = rig or RigFile.model_validate_json(response.rig_file)
    return Audit(file, state_folder(file, response.simulated), response.simulated)


def _refuse_made_elsewhere(rig: RigFile | None, calibrations: Sequence[Calibration]) -> None:
    others = [c.response.rig for c in calibrations if rig and c.response.rig != rig.name]
    if rig and others:
        raise ConfigurationError(
            f"The calibration was made on the rig {others[0]!r}, not on {rig.name!r}: use that rig's --rig."
        )


def calibrations_of(generation: Generation) -> tuple[Calibration, ...]:
    """The calibration of each place of a generation. Raises DataError for what is damaged."""
    return tuple(Calibration.load(path) for path in generation.paths("calibrations"))


def buttons_of(generation: Generation) -> dict[str, DigitalButton]:
    """A generation's digital buttons by name. Raises DataError for what is damaged."""
    return {path.stem: DigitalButton.load(path) for path in generation.paths("buttons")}


def checks_before(generation: Generation) -> dict[str, Check]:
    """By button: the check of its previous drive on the drifted table."""
    return {path.stem: Check.load(path) for path in generation.paths("before")}


def _parts(
    calibrations: Iterable[Calibration], buttons: Mapping[str, DigitalButton], before: Mapping[str, Check]
) -> dict[str, Any]:
    """The parts of a generation, by file name."""
    return {
        **{f"calibrations/{'-'.join(_place(c))}.h5": c for c in calibrations},
        **{f"buttons/{name}.h5": button for name, button in buttons.items()},
        **{f"before/{name}.h5": check for name, check in before.items()},
    }


def _place(calibration: Calibration) -> Place:
    return calibration.response.patch, calibration.response.point


def _name(button: DigitalButton) -> str:
    name = f"{button.press.button}-{button.drive.patch}-{button.drive.point}"
    # A button may be called anything, and its name becomes a file's.
    return re.sub(r"[^\w.-]+", "_", name)


def _refuse_other(rig: Rig, active: Generation, calibrations: Sequence[Calibration]) -> None:
    for response in (calibration.response for calibration in calibrations):
        if (response.rig, response.simulated) != (rig.name, rig.simulated):
            kinds = {True: "simulated", False: "real"}
            raise ConfigurationError(
                f"The calibration {active.name} is of the {kinds[response.simulated]} rig "
                f"{response.rig!r}, and this is the {kinds[rig.simulated]} rig {rig.name!r}: "
                "name the folder of its own history."
            )


def _renewed(calibrations: Sequence[Calibration], look: _Look) -> dict[Place, Calibration]:
    """Calibrations from the new responses; hysteresis belongs to the patch and does not drift with the table.

    Raises DataError when no model fits.
    """
    renewed = {}
    for old in calibrations:
        seen = look.responses[_place(old)]
        # One period cannot separate noise from residual hysteresis, and drives would be planned with more
        # output than the table can follow (error 13 to 16 % instead of 6 %, measured). At rest there is
        # nothing but noise.
        response = replace(seen, noise=np.full(len(seen.frequencies), look.laser_noise))
        renewed[_place(old)] = replace(old, response=response, model=fit(response))
    return renewed


def _bring_back(
    rig: Rig,
    history: History,
    found: Outcome,
    calibrations: Mapping[Place, Calibration],
    iterations: int,
    actor: str,
    progress: Progress,
) -> Outcome:
    """New drives for every button of the active generation, and the outcome."""
    before: dict[str, Check] = {}
    after: dict[str, DigitalButton] = {}
    failed: list[str] = []
    for name, old in buttons_of(found.active).items():
        place = old.drive.patch, old.drive.point
        try:
            old_drive = prefixed(progress, f"{name}, old drive")
            before[name] = check(rig, old.drive, plays=_PLAYS_BEFORE, progress=old_drive)
            after[name] = build_button(
                rig,
                old.press,
                calibrations[place],
                method=cast(Method, old.drive.method),
                iterations=iterations,
                progress=prefixed(progress, name),
            )
        except (DataError, LimitError) as error:
            failed.append(f"{name}: {error}")
        except InstrumentError as error:
            rig.make_safe()
            return _with(replace(found, kind="broken", before=before, after=after), f"{name}: {error}")
        else:
            failed += [f"{name}: {reason}" for reason in after[name].check.reasons]
    found = replace(found, before=before, after=after)
    if failed:
        return _with(found, *failed, f"Nothing was changed: {found.active.name} stays the active one.")
    reason = " ".join(found.sentences)
    generation = history.add(
        _parts(calibrations.values(), after, before),
        when=found.when,
        reason=reason,
        details=found.summary(),
        parent=found.active.name,
    )
    # Log first: an activation that is not in the audit log must not happen.
    rig.audit.note("activated", calibration=generation.name, reason=reason)
    history.activate(generation, when=found.when, actor=actor, reason=reason)
    return _with(
        replace(found, kind="restored", active=generation),
        f"Every button was made anew and passed; {generation.name} is the active calibration now.",
    )


def _with(outcome: Outcome, *sentences: str) -> Outcome:
    return replace(outcome, sentences=(*outcome.sentences, *sentences))


@dataclass(frozen=True, eq=False)
class _Look:
    """Findings before any action."""

    verdicts: tuple[Verdict, ...]
    responses: Mapping[Place, Response]
    broken: tuple[str, ...]
    """Faults that belong to no place."""
    unmeasured: tuple[str, ...]
    laser_noise: float | None
    """m/s per sqrt(Hz), at rest."""

    @property
    def kind(self) -> Kind:
        """The worst finding."""
        kinds = {verdict.kind for verdict in self.verdicts}
        if self.broken or "broken" in kinds or not kinds:
            return "broken"
        return "drifted" if "drifted" in kinds else "unchanged"

    @property
    def sentences(self) -> tuple[str, ...]:
        """All findings, the worst first."""
        told = sorted(self.verdicts, key=lambda v: ("broken", "drifted", "unchanged").index(v.kind))
        return (*self.broken, *(s for verdict in told for s in verdict.sentences), *self.unmeasured)


def _look(rig: Rig, calibrations: Sequence[Calibration], usual: float | None, progress: Progress) -> _Look:
    verdicts: list[Verdict] = []
    responses: dict[Place, Response] = {}
    unmeasured: list[str] = []
    try:
        broken = [told for told in [loose_accelerometer(rig)] if told]
        noise = laser_noise(rig)
    except InstrumentError as error:
        rig.make_safe()
        return _Look((), {}, (str(error),), (), None)
    for calibration in calibrations:
        patch, point = _place(calibration)
        if not rig.operator.confirm(Aim(point)):
            unmeasured.append(
                f"Patch {patch} at the {point} point was not measured: the laser would need to be aimed."
            )
            continue
        try:
            response = quick_response(rig, patch, point, progress, hysteresis=calibration.hysteresis)
        except DataError as error:
            verdicts.append(_broken(calibration, f"{error} {laser_or_patch(noise, usual)}"))
        except (InstrumentError, LimitError) as error:
            # Nothing more is played on a rig that failed. If it is not even safe, that is the message.
            rig.make_safe()
            verdicts.append(_broken(calibration, str(error)))
            break
        else:
            found = compare(calibration, response, rig.file.recalibration)
            if found.now and found.now.coherence < rig.file.recalibration.coherence:
                found = replace(found, sentences=(f"{found.sentences[0]} {laser_or_patch(noise, usual)}",))
            verdicts.append(found)
            responses[patch, point] = response
    return _Look(tuple(verdicts), responses, tuple(broken), tuple(unmeasured), noise)


def _usual_noise(history: History) -> float | None:
    """The laser's median noise at rest in the latest looks without a fault."""
    noises = [float(look["laser_noise"]) for look in history.looks if look["outcome"] != "broken"]
    return float(np.median(noises[-_RECENT:])) if noises else None


def _broken(calibration: Calibration, sentence: str) -> Verdict:
    return Verdict(*_place(calibration), "broken", PlaceMetrics.of(calibration), None, (sentence,))
