"""Who has answered what in an experiment."""

from __future__ import annotations

from rich.box import SIMPLE
from rich.table import Table

from haploop.experiments import Store
from haploop.progress import print_json, print_line, print_table

__all__ = ["show_experiment"]


def show_experiment(store: Store, as_json: bool) -> None:
    """Show each session that was begun, and each withdrawal."""
    sessions, withdrawals = store.sessions(), store.withdrawals()
    simulated = any(one.simulated for one in sessions)
    if as_json:
        print_json(
            {
                "experiment": store.experiment.file.name,
                "folder": str(store.folder),
                "simulated": simulated,
                "sessions": [
                    {
                        "participant": one.assignment.participant,
                        "group": one.assignment.group,
                        "session": one.assignment.session,
                        "answers": len(one.answers),
                        "complete": one.due is None,
                        "due": one.due and {"block": one.due.block, "trial": one.due.number},
                        "resumed": sum(event.kind == "resumed" for event in one.events),
                        "log": str(one.path),
                    }
                    for one in sessions
                ],
                "withdrawn": [{"participant": one.participant, "time": one.time} for one in withdrawals],
            }
        )
        return
    table = Table(box=SIMPLE, title=f"{store.experiment.file.name} in {store.folder}", title_justify="left")
    for column in ("Participant", "Group", "Session", "Answers", "Due", "Begun"):
        table.add_column(column)
    for one in sessions:
        due = f"{one.due.block} {one.due.number}" if one.due else "complete"
        who = one.assignment
        begun = one.events[0].time[:16].replace("T", " ")
        table.add_row(who.participant, who.group, str(who.session), str(len(one.answers)), due, begun)
    print_table(table)
    for gone in withdrawals:
        print_line(f"{gone.participant} withdrew at {gone.time}.")
    if simulated:
        print_line("Simulated participants answered: no person did.")
