"""What a generation of calibrations holds, and how one becomes active: buttons are adopted, or an earlier
generation is activated again. Nothing is played. What one `recalibrate` found and did is an `Outcome`, which
gets its entry in the history.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import asdict, dataclass, field
from datetime import UTC, datetime
from typing import Any, Literal

from ...base.errors import ConfigurationError, DataError, HaploopError
from ...instruments import RigFile
from ...instruments.safety import Audit, state_folder
from ..drive import Check, DigitalButton
from ..model import Calibration
from .drift import Verdict
from .history import Generation, History
from .look import Look, place_of
from .sensor_health import MATTERS


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
    for buttons of another rig than `rig`, and DataError for a button that did not pass its check or was
    disturbed in it, for two of one name, for one of another rig than the rest, and for a log that cannot be
    written.

    For example:

        >>> history = haploop.History("lab-calibrations")
        >>> latch = haploop.load("latch.h5")
        >>> first = haploop.calibration.adopt(history, [latch], actor="me", reason="installed")
        >>> history.active() == first
        True
    """
    when = when or datetime.now(UTC)
    _refuse_made_elsewhere(rig, [c for button in buttons for c in button.calibrations])
    named = {_name(button): button for button in buttons}
    if len(named) < len(buttons) or not buttons:
        raise DataError("Give one button or more, and each name (button, patch and point) only once.")
    for name, button in named.items():
        if not button.passed:
            raise DataError(f"The button {name} did not pass its check, so that it is not adopted.")
    disturbed = disturbed_in_check(named)
    if disturbed:
        raise DataError(f"{disturbed[0]} Remove what disturbs it, and make the button anew to adopt it.")
    with history.hold():
        parent = history.active() if history.activations else None
        every = (buttons_of(parent) if parent else {}) | named
        rigs = {(b.drive.rig, b.simulated) for b in every.values()}
        if len(rigs) > 1:
            told = ", ".join(f"{rig}{' (simulated)' if simulated else ''}" for rig, simulated in sorted(rigs))
            raise DataError(f"These buttons were made on different rigs ({told}): keep a history for each.")
        made = [c for button in every.values() for c in button.calibrations]
        audit = _audit(rig, made)
        newest = sorted(made, key=lambda c: c.response.created)
        generation = history.add(
            parts({place_of(c): c for c in newest}.values(), every, {}),
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

    For example:

        >>> history = haploop.History("lab-calibrations")
        >>> again = haploop.calibration.activate(history, "1", actor="me", reason="back to the first")
        >>> again == history.active()
        True
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


def parts(
    calibrations: Iterable[Calibration], buttons: Mapping[str, DigitalButton], before: Mapping[str, Check]
) -> dict[str, Any]:
    """The parts of a generation, by file name."""
    return {
        **{f"calibrations/{'-'.join(place_of(c))}.h5": c for c in calibrations},
        **{f"buttons/{name}.h5": button for name, button in buttons.items()},
        **{f"before/{name}.h5": check for name, check in before.items()},
    }


def _name(button: DigitalButton) -> str:
    drive = button.drive
    others = "".join(f"-{one.button or 'silent'}-{one.point}" for one in drive.elsewhere)
    name = f"{button.press.button}-{'+'.join(drive.patches)}-{drive.point}{others}"
    # A button may be called anything, and its name becomes a file's.
    return re.sub(r"[^\w.+-]+", "_", name)


def disturbed_in_check(buttons: Mapping[str, DigitalButton]) -> list[str]:
    """A sentence on each button in whose check steady tones disturbed the laser more than is activated.

    Written so that NaN is told too.
    """
    return [
        f"{name}: tones of {one.tones.share:.0%} of the target disturbed the laser in its check."
        for name, button in buttons.items()
        for one in (button.check, *button.check.others)
        if not one.tones.share <= MATTERS
    ]


Kind = Literal["unchanged", "restored", "drifted", "touched", "broken", "not shown"]


@dataclass(frozen=True, eq=False)
class Outcome:
    """Findings and actions of `recalibrate`.

    `unchanged`: the active calibration holds, and the button that was played passed its check; none is played
    where each needs the laser at a point that nobody aims it at. `restored`:
    the table had drifted, and another calibration, in which every button passed, is active. `drifted`: the
    table had drifted, and not every button could be restored. `touched`: something seems to rest on it, or
    came or left meanwhile. `broken`: a place or an instrument has failed. `not shown`: the responses are as
    they were, and the plays of a button do not tell whether it is right. Only `restored` changes anything.
    """

    kind: Kind
    when: datetime
    active: Generation
    """The generation that is active now."""
    verdicts: tuple[Verdict, ...]
    sentences: tuple[str, ...]
    """Findings, places not measured, and what to do."""
    before: Mapping[str, Check] = field(default_factory=dict)
    """By button: its old drive on the table as it was found; of one button where nothing seems changed."""
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


def note_outcome(history: History, compared_with: Generation, outcome: Outcome, look: Look | None) -> None:
    """Keep an outcome as an entry of the history. Raises DataError when it cannot be written."""
    laser = look.laser if look else None
    history.note(
        {
            "compared_with": compared_with.name,
            **outcome.summary(),
            "laser_noise": laser.noise if laser else None,
            "laser_spikes": look.spikes if look else 0.0,
            "laser_hum": asdict(laser.hum) if laser and laser.hum else None,
            "played": sorted(outcome.before),
        }
    )


def note_unopened(history: History, error: HaploopError, rig: str, simulated: bool) -> Outcome:
    """Keep a night on which the rig could not be opened: it is broken, and nothing was measured.

    Raises DataError for a history without a whole active calibration or one that cannot be written, and
    ConfigurationError for another rig's.
    """
    active = history.active()
    refuse_other(rig, simulated, active, calibrations_of(active))
    outcome = Outcome("broken", datetime.now(UTC), active, (), (str(error),), simulated=simulated)
    note_outcome(history, active, outcome, None)
    return outcome


def refuse_other(rig: str, simulated: bool, active: Generation, calibrations: Sequence[Calibration]) -> None:
    """Raise ConfigurationError for calibrations of another rig than the one of this name and kind."""
    for response in (calibration.response for calibration in calibrations):
        if (response.rig, response.simulated) != (rig, simulated):
            kinds = {True: "simulated", False: "real"}
            raise ConfigurationError(
                f"The calibration {active.name} is of the {kinds[response.simulated]} rig "
                f"{response.rig!r}, and this is the {kinds[simulated]} rig {rig!r}: "
                "name the folder of its own history."
            )
