"""Findings of `haploop doctor` on standard output."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict
from typing import get_args

from rich.box import SIMPLE
from rich.table import Table
from rich.text import Text

from ...calibration.examination import Finding, Status
from ...terminal.progress import print_json, print_table

__all__ = ["show_findings"]

_STATUSES = get_args(Status)


def show_findings(findings: Sequence[Finding], rig: str, simulated: bool, as_json: bool) -> None:
    """Print findings on standard output: a table, or one JSON object."""
    worst = max((finding.status for finding in findings), key=_STATUSES.index)
    if as_json:
        found = [asdict(finding) for finding in findings]
        print_json({"rig": rig, "simulated": simulated, "status": worst, "findings": found})
        return
    title = f"The rig {rig}{', simulated' if simulated else ''}: {worst}"
    table = Table(box=SIMPLE, title=title, title_justify="left", show_header=False)
    table.add_column(no_wrap=True)
    table.add_column()
    table.add_column(overflow="fold")
    for finding in findings:
        mark = Text(finding.status, style=finding.status)
        table.add_row(mark, f"{finding.name} ({finding.instrument})", finding.sentence)
    print_table(table)
