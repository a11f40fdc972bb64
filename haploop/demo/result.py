"""What one run of the demo found."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from haploop.acquisition import ButtonPress, Recording, Representative
from haploop.calibration import Calibration, Check
from haploop.instruments.arrays import ComplexArray

__all__ = ["BUTTONS", "PRESSES", "ButtonResult", "Demo"]

BUTTONS = ("latch", "toggle", "push")
"""The paper's three (figure 2)."""
PRESSES = 10
"""Of each button by each participant; paper, "Data Collection"."""


@dataclass(frozen=True, eq=False)
class ButtonResult:
    """What the loop found for one button."""

    button: str
    recordings: tuple[Recording, ...]
    presses: tuple[tuple[ButtonPress, ...], ...]
    """Of each recording."""
    press: Representative
    check: Check
    true_forces: tuple[float, ...]
    """Force (N) at each activation, as the plant knows it."""


@dataclass(frozen=True, eq=False)
class Demo:
    """One run of the loop, whole."""

    out: Path
    rig: str
    rig_file: str
    mode: str
    simulation: Mapping[str, Any]
    limits: tuple[float, float]
    buttons: tuple[ButtonResult, ...]
    calibration: Calibration
    true_response: ComplexArray
    true_resonance_hz: float
    notes: tuple[str, ...]
    """What the rig cannot record or render, as sentences."""
    simulated_s: float
    wall_s: float

    @property
    def passed(self) -> bool:
        """Whether every button passed its check."""
        return all(result.check.passed for result in self.buttons)
