"""Results of one run of the demo."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from ...acquisition import Recording, Representative
from ...base.arrays import ComplexArray, FloatArray
from ...calibration import Calibration, Check, worst

BUTTONS = ("latch", "toggle", "push")
"""Buttons of the paper (figure 2)."""
PRESSES = 10
"""Presses of each button by each participant (paper, "Data Collection")."""


@dataclass(frozen=True, eq=False)
class ButtonResult:
    """Results of the workflow for one button."""

    button: str
    recordings: tuple[Recording, ...]
    forces: Mapping[str, FloatArray]
    """Force at activation (N) of each press, by participant."""
    press: Representative
    check: Check
    true_forces: tuple[float, ...]
    """True force (N) at each activation, from the plant."""


@dataclass(frozen=True, eq=False)
class Demo:
    """Results of a complete run."""

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
    """Limitations of the rig in recording or rendering, one sentence each."""
    simulated_s: float
    wall_s: float

    @property
    def patches(self) -> str:
        """Names of the patches that played, for people."""
        return self.buttons[0].check.drive.patch

    @property
    def verdict(self) -> str:
        """The worst of all buttons' verdicts."""
        return worst(result.check.verdict for result in self.buttons)

    @property
    def passed(self) -> bool:
        """True when every button passed its check."""
        return all(result.check.passed for result in self.buttons)
