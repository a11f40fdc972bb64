"""What the rooms on top of the core own, and the core must find: console, experiments, exchange.

Their commands, the folders that they write, and what is said of these. The core names those rooms here and
nowhere else, in strings: a room that is not used is not loaded. It stands in the lowest room that asks.
"""

from __future__ import annotations

from collections.abc import Mapping
from pkgutil import resolve_name
from types import MappingProxyType
from typing import Any

_OWNED: Mapping[str, str] = MappingProxyType(
    {
        "command serve": "haploop.console.command:serve",
        "command experiment": "haploop.experiments.commands.experiment:experiment",
        "command analyse": "haploop.experiments.commands.analyse:analyse",
        "command export": "haploop.exchange.commands.export:export",
        "command import": "haploop.exchange.commands.importing:import_",
        "folder experiment": "haploop.experiments:load_experiment",
        "section experiment": "haploop.experiments.shown:experiment_section",
        "section answers": "haploop.experiments.shown:answers_section",
        "due experiment": "haploop.experiments.session:due_sessions",
    }
)


def owned(name: str) -> Any:
    """Import what a room on top owns: a command; what loads a folder, makes its section of a report, or tells
    whose sessions are due.
    """
    return resolve_name(_OWNED[name])
