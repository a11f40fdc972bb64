"""What one `recalibrate` found and did, and its entry in the history."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, field
from datetime import UTC, datetime
from typing import Any, Literal

from ...base.errors import ConfigurationError, HaploopError
from ..drive import Check, DigitalButton
from ..model import Calibration
from .adoption import calibrations_of
from .drift import Verdict
from .history import Generation, History
from .look import Look

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
