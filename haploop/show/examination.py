"""Findings of `haploop doctor` on standard output."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict
from typing import get_args

from rich.markup import escape
from rich.table import Table

from haploop.calibration.examination import Finding, Status
from haploop.progress import print_json, print_table

__all__ = ["show_findings"]

_STATUSES = get_args(Status)


def show_findings(findings: Sequence[Finding], rig: str, simulated: bool, as_json: bool) -> None:
    """Print findings on standard output: a table, or one JSON object."""
    worst = max((finding.status for finding in findings), key=_STATUSES.index)
    if as_json:
        found = [asdict(finding) for finding in findings]
        print_json({"rig": rig, "simulated": simulated, "status": worst, "findings": found})
        return
    table = Table(
        "",
        "instrument",
        "what",
        "finding",
        title=f"The rig {rig}{', simulated' if simulated else ''}: {worst}",
    )
    for finding in findings:
        mark = f"[{finding.status}]{finding.status}[/{finding.status}]"
        table.add_row(mark, finding.instrument, finding.name, escape(finding.sentence))
    print_table(table)
