"""Console output of a study, during and after recording."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, Self

from rich.box import SIMPLE
from rich.console import Console
from rich.table import Table
from rich.text import Text

from ...acquisition import PressVerdict, Study, StudyProgress
from ...instruments import Request, Rig
from ...terminal.progress import SIMULATED, print_json, print_line, print_table, say
from .meter import Meter, rejection_line

__all__ = ["StudyMeter", "status"]


class StudyMeter(Meter):
    """The meter of a study: shown while presses are recorded, and away while the operator is asked.

    Each button gets a line when it is done, and each press that is repeated.
    """

    def __init__(self, rig: Rig, entries: Sequence[StudyProgress], console: Console | None = None) -> None:
        super().__init__(rig, console)
        self._before = sum(len(one.accepted) for one in entries)
        self._all = sum(one.of for one in entries)
        self._sessions: dict[str, tuple[float, float]] = {}

    def __enter__(self) -> Self:
        super().__enter__()
        self.hide()  # the first thing is a question
        return self

    def on_request(self, request: Request) -> None:
        """See `Meter.on_request`."""
        super().on_request(request)
        self.show()

    def progress(self, doing: str, done: float, of: float, unit: str, /) -> None:
        """Show the progress of a session; see `run_study`."""
        if doing != self._doing:
            self._bad = 0
        self._doing, self._done, self._of = doing, done, of
        first, _ = self._sessions.get(doing, (done, done))
        self._sessions[doing] = first, done
        whole = self._before + sum(now - first for first, now in self._sessions.values())
        self._aside = f"; {whole:g} of {self._all} in all"
        if done == of:
            self.hide()
            again = f", {self._bad} not accepted and repeated" if self._bad else ""
            say(self._console, Text(f"{doing}: {done:g} of {of:g} {unit}{again}.", style="green"))

    def on_study_verdict(self, participant: str, button: str, press: PressVerdict) -> None:
        """Say why a press was not accepted; see `run_study`."""
        if not press.accepted:
            self._bad += 1
            say(self._console, Text(f"{participant}, {button}: {rejection_line(press)}", style="yellow"))


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
        print_line(SIMULATED)
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
