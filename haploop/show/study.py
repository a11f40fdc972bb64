"""Console output for a study, while it is recorded and afterwards, and for several recordings."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from rich.box import SIMPLE
from rich.progress import MofNCompleteColumn, TextColumn
from rich.table import Table
from rich.text import Text

from haploop.acquisition import PressVerdict, Recording, Study, StudyProgress, accepted_presses, load_study
from haploop.destinations import check_new_picture
from haploop.figures import figures
from haploop.instruments import DataError
from haploop.instruments.arrays import FloatArray
from haploop.progress import Bars, print_json, print_line, print_table
from haploop.show.show import save

__all__ = ["Counters", "forces_in", "rejection_line", "show_forces", "status"]

Forces = Mapping[str, Mapping[str, FloatArray]]
"""Force at activation (N) of each press: button -> participant -> (presses,)."""


class Counters(Bars):
    """Progress of a study, on standard error.

    A terminal shows two bars. A terminal that takes answers (`typed_at`) shows a line for each press
    instead, because bars would garble the input. Anything else shows a line for each button.
    """

    def __init__(self, name: str, entries: Sequence[StudyProgress], typed_at: bool) -> None:
        super().__init__(
            MofNCompleteColumn(), TextColumn("{task.fields[bad]}", style="yellow"), wanted=not typed_at
        )
        self._done = {(one.participant, one.button): len(one.accepted) for one in entries}
        self._of = sum(one.of for one in entries)
        self._bad = 0
        self._each = typed_at and self._console.is_terminal
        self._whole = self._progress.add_task(f"Study {name}", total=self._of, bad="")
        self._now = self._progress.add_task("", total=None, bad="", visible=False)
        self._key: tuple[str, str] = ("", "")

    def progress(self, participant: str, button: str, done: int, of: int) -> None:
        """See `run_study`."""
        key = (participant, button)
        if key != self._key:
            self._key, self._bad = key, 0
            self._progress.reset(
                self._now, description=f"{participant}, {button}", total=of, visible=True, bad=""
            )
        self._done[key] = done
        self._progress.update(self._now, completed=done, bad=f"{self._bad} not accepted" if self._bad else "")
        self._progress.update(self._whole, completed=sum(self._done.values()))
        if done == of:
            again = f", {self._bad} not accepted and repeated" if self._bad else ""
            self._say(Text(f"{participant}, {button}: {done} of {of} presses{again}.", style="green"))
        elif self._each and done:
            self._say(
                Text(f"{done} of {of}, {sum(self._done.values())} of {self._of} in all.", style="green")
            )

    def on_verdict(self, participant: str, button: str, press: PressVerdict) -> None:
        """See `run_study`."""
        if press.accepted:
            return
        self._bad += 1
        # At this terminal the next prompt states the reason.
        if not self._each or "rejected" in press.flags:
            self._say(Text(f"{participant}, {button}: {rejection_line(press)}", style="yellow"))

    def _say(self, line: Text) -> None:
        self._console.print(line, highlight=False, soft_wrap=True)


def rejection_line(press: PressVerdict) -> str:
    """One line for the operator about a press that was not accepted."""
    return f"Press {press.number}, attempt {press.attempt}: {press.reason} It is kept and will be repeated."


def status(study: Study, entries: Sequence[StudyProgress], as_json: bool) -> None:
    """Print the progress of a study, by participant."""
    done, of = sum(len(one.accepted) for one in entries), sum(one.of for one in entries)
    by: dict[str, dict[str, StudyProgress]] = {}
    for one in entries:
        by.setdefault(one.participant, {})[one.button] = one
    consented = {name: any(one.consented for one in mine.values()) for name, mine in by.items()}
    following = next((one for one in entries if not one.complete), None)
    if as_json:
        print_json(
            {
                "study": study.file.name,
                "file": str(study.path),
                "simulated": any(r.simulated for one in entries for r in one.recordings),
                "accepted": done,
                "of": of,
                "complete": done == of,
                "participants": [
                    {
                        "participant": name,
                        "consented": consented[name],
                        "order": list(study.file.order_for(name)),
                        "buttons": {button: _as_values(one) for button, one in mine.items()},
                    }
                    for name, mine in by.items()
                ],
            }
        )
        return
    # As Text: names may look like rich markup.
    title = Text(f"Study {study.file.name}: {done} of {of} presses")
    table = Table(box=SIMPLE, title=title, title_justify="left")
    table.add_column("Participant")
    if study.file.consent:
        table.add_column("Consent")
    for button in study.file.buttons:
        table.add_column(button.capitalize())
    table.add_column("Order", style="dim")
    for name, mine in by.items():
        cells: list[str | Text] = [name]
        if study.file.consent:
            cells.append(Text("yes", style="green") if consented[name] else Text("not yet", style="dim"))
        cells += [_cell(mine[button]) for button in study.file.buttons]
        table.add_row(*cells, ", ".join(study.file.order_for(name)))
    print_table(table)
    if any(recording.simulated for one in entries for recording in one.recordings):
        print_line("Simulated: no real instrument measured this.")
    now = next((one for one in entries if one.in_progress), None)
    if now is not None:
        print_line(f"{now.participant}, {now.button} is being recorded now.")
    elif following is None:
        print_line("Every press has been recorded. Plot the forces with `haploop show STUDY --plot OUT.png`.")
    else:
        press = f"press {following.missing[0][0]}"
        print_line(
            f"`haploop study run` continues with {following.participant}, {following.button}, {press}."
        )


def _as_values(one: StudyProgress) -> dict[str, Any]:
    return {
        "accepted": len(one.accepted),
        "of": one.of,
        "missing": [number for number, _ in one.missing],
        "bad": one.bad,
        "rejected": one.rejected,
        "sessions": len(one.recordings),
        "interrupted": one.interrupted,
        "in_progress": one.in_progress,
        "files": [str(recording.path) for recording in one.recordings],
    }


def _cell(one: StudyProgress) -> Text:
    if not one.recordings:
        return Text("-", style="dim")
    cell = Text(f"{len(one.accepted)}/{one.of}", style="green" if one.complete else "yellow")
    asides = [
        f"{count} {word}"
        for count, word in ((one.bad, "bad"), (one.rejected, "rejected"), (one.interrupted, "interrupted"))
        if count
    ]
    asides += ["in progress"] if one.in_progress else []
    return cell.append(f" ({', '.join(asides)})" if asides else "", style="dim")


def forces_in(recordings: Sequence[Recording]) -> Forces:
    """The force at activation of every accepted press. Raises DataError."""
    found: dict[str, dict[str, list[float]]] = {}
    for recording in recordings:
        mine = found.setdefault(recording.button, {}).setdefault(recording.participant, [])
        mine += [
            press.force_at_activation
            for press in accepted_presses(recording)
            if press.force_at_activation is not None
        ]
    return {
        button: {participant: np.array(mine) for participant, mine in sorted(by.items()) if mine}
        for button, by in found.items()
        if any(by.values())
    }


def show_forces(paths: Sequence[Path], as_json: bool, plot: Path | None) -> None:
    """Print and plot (the paper's figure 7) the force at activation by participant and button.

    `paths` are recordings, or studies with all their recordings. Raises DataError when they hold no
    accepted press, and ConfigurationError when `plot` cannot be written.
    """
    if plot is not None:
        check_new_picture(plot)
    recordings = [recording for path in paths for recording in _recordings(path)]
    by_button = forces_in(recordings)
    if not by_button:
        raise DataError(
            "The recordings hold no accepted press with an activation, so there is no force to show."
        )
    simulated = any(recording.simulated for recording in recordings)
    if plot is not None:
        save(figures.activation_forces(by_button), plot, simulated)
    if as_json:
        print_json(
            {
                "kind": "recordings",
                "simulated": simulated,
                "files": [str(recording.path) for recording in recordings],
                "buttons": {
                    button: {
                        **_summary(np.concatenate(list(by.values()))),
                        "participants": {name: _summary(mine) for name, mine in by.items()},
                    }
                    for button, by in by_button.items()
                },
                **({"plot": str(plot)} if plot else {}),
            }
        )
        return
    table = Table(box=SIMPLE, title="Force at activation", title_justify="left")
    table.add_column("Participant")
    for button in by_button:
        table.add_column(button.capitalize(), justify="right", no_wrap=True)
    for name in sorted({name for by in by_button.values() for name in by}):
        table.add_row(name, *(_force(by.get(name)) for by in by_button.values()))
    table.add_section()
    table.add_row("All", *(_force(np.concatenate(list(by.values()))) for by in by_button.values()))
    print_table(table)
    if simulated:
        print_line("Simulated: no real instrument measured this.")
    if plot is not None:
        print_line(f"Plot: {plot}")


def _recordings(path: Path) -> list[Recording]:
    """A recording, or all recordings of a study."""
    if not path.is_dir() and path.suffix != ".toml":
        return [Recording.open(path)]
    study = load_study(path)
    return [recording for button in study.file.buttons for recording in study.recordings(button)]


def _summary(mine: FloatArray) -> dict[str, Any]:
    return {
        "presses": len(mine),
        "activation_force_n": float(np.mean(mine)),
        "activation_force_sd_n": float(np.std(mine, ddof=1)) if len(mine) > 1 else None,
    }


def _force(mine: FloatArray | None) -> str:
    if mine is None or not len(mine):
        return "-"
    spread = f" ± {np.std(mine, ddof=1):.2f}" if len(mine) > 1 else ""
    return f"{np.mean(mine):.2f}{spread} N ({len(mine)})"
