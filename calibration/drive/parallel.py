"""Patches in parallel on one amplifier channel: how loud each wiring would be, from the calibrations.

Model: all get the same volts, a reversed one their negative, and the table adds their motions. Modes that two
patches drive with opposite signs cancel, and add once the wires of one are swapped. The channel drives the
sum of their capacitances, within its own current. One law compensates all, the first patch's: what the
others' differ from it is left, and is counted. All play the press that the patches would play with a channel
for each, on the same carrier. Assumption: a load changes the amplifier by its limits only. Wirings are ranked
by regularised inverses, and the first few are planned as the drive of one patch is.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import combinations
from typing import TYPE_CHECKING

import numpy as np
import scipy

from ...instruments import Limits
from ...instruments.arrays import FloatArray
from ..band import BAND
from ..model import Calibration
from ..perception import LabThreshold, levels_of, pressing_act
from .actuation import Actuation
from .inversion import Plan, max_output, min_peak
from .planning import distorted, plan_for, slew_of
from .targets import Method, TargetGrid, target_grid

if TYPE_CHECKING:
    from ...acquisition import Representative

_PLANNED = 3
"""Wirings that are planned, of those as wired and of all."""
COMPARED_AT = 0.05
"""Error that wirings are planned for; what the patches' laws leave is more."""


@dataclass(frozen=True)
class Wiring:
    """Patches on one channel; `reversed` are those of them whose wires are swapped."""

    patches: tuple[str, ...]
    reversed: tuple[str, ...] = ()


@dataclass(frozen=True)
class Wired:
    """What a wiring would play within the limits."""

    wiring: Wiring
    error: float
    """Expected of the motion as calibrated, before corrections."""
    level: float
    """dB above the threshold of a finger that presses."""
    scale: float
    """Size over that of the recorded press."""
    peak: float
    """Largest voltage (V)."""
    louder: float
    """Scale over that of the first patch alone."""


def parallel_wirings(
    press: Representative,
    calibrations: Sequence[Calibration],
    limits_for: Callable[[int], Limits],
    method: Method,
    lab: LabThreshold | None = None,
) -> tuple[Wired, ...]:
    """All patches as wired, the loudest two or more as wired, and the loudest with wires swapped, each once.

    `limits_for` has the limits of the channel into so many patches. Raises what `Actuation.of` raises.
    """
    channel = _Channel.of(press, calibrations, limits_for, method)
    patches = channel.table.patches
    alone = channel.planned(Wiring(patches[:1]), lab).scale
    ranked = sorted(_wirings(patches), key=channel.ranked, reverse=True)
    as_wired = [one for one in ranked if not one.reversed]
    first = dict.fromkeys((Wiring(patches), *as_wired[:_PLANNED], *ranked[:_PLANNED]))
    planned = [replace(one, louder=one.scale / alone) for one in (channel.planned(w, lab) for w in first)]
    loudest = [
        max((one for one in planned if swapped or not one.wiring.reversed), key=lambda one: one.scale)
        for swapped in (False, True)
    ]
    return tuple(dict.fromkeys((planned[0], *loudest)))


@dataclass(frozen=True, eq=False)
class _Channel:
    """The plan of a press for patches that have a channel each, from which those of wirings are made."""

    table: Actuation
    grid: TargetGrid
    target: FloatArray
    """(grid,) m/s^2, unscaled."""
    plan: Plan
    limits_for: Callable[[int], Limits]

    @classmethod
    def of(
        cls,
        press: Representative,
        calibrations: Sequence[Calibration],
        limits_for: Callable[[int], Limits],
        method: Method,
    ) -> _Channel:
        table = Actuation.of(calibrations)
        grid, band = target_grid([press], table, method), table.measured_well(BAND, table.points)
        [target], _ = grid.within(band)
        plan = plan_for(table, target[None], grid, band, limits_for(len(table.patches)))
        return cls(table, grid, target, plan, limits_for)

    def ranked(self, wiring: Wiring) -> float:
        """About the scale that a wiring reaches."""
        [linear], _ = min_peak(self.of_one(wiring), COMPARED_AT)
        return self.scaled(linear, wiring)

    def scaled(self, linear: FloatArray, wiring: Wiring) -> float:
        """The scale at which linear volts of the unscaled target keep within the limits of the channel."""
        limits = self.limits_for(len(wiring.patches))
        reach = float(self.table.reach(limits)[self.rows(wiring)[0]])
        return min(reach / float(np.abs(linear).max()), limits.headroom(linear, self.grid.rate_hz)[0])

    def planned(self, wiring: Wiring, lab: LabThreshold | None) -> Wired:
        """What a wiring would play."""
        own, plan = self.rows(wiring), self.of_one(wiring)
        linear, error = max_output(plan, COMPARED_AT)
        scale = self.scaled(linear[0], wiring)
        law = self.table.own[own[0]].hysteresis
        volts = law.from_linear_volts(scale * linear[0])
        some = Actuation.of([self.table.own[k] for k in own])
        each = scipy.fft.rfft(np.repeat(linear, len(own), axis=0))
        [distortion] = distorted(some, replace(self.plan, spread=self.plan.spread[:, own]), each)
        signs = _signs(wiring)
        laws = [
            signs[k] * self.table.own[row].hysteresis.to_linear_volts(signs[k] * volts)
            for k, row in enumerate(own)
        ]
        left = scipy.fft.rfft(np.array(laws) / scale - linear)
        unlike = np.linalg.norm((signs[:, None] * self.plan.gain[0, own] * left).sum(axis=0)) / np.sqrt(
            plan.wanted
        )
        played = self.grid.on_drive(scale * self.target)
        level = levels_of(played, self.table.rate_hz).pressing - pressing_act(lab).shift
        return Wired(
            wiring,
            float(np.linalg.norm([error, distortion, unlike])),
            level,
            scale,
            float(np.abs(volts).max()),
            1.0,
        )

    def of_one(self, wiring: Wiring) -> Plan:
        """The plan of a wiring as if it were one patch."""
        own, limits = self.rows(wiring), self.limits_for(len(wiring.patches))
        gain = _signs(wiring) @ self.plan.gain[0, own]
        return replace(
            self.plan,
            gain=gain[None, None],
            covariance=np.einsum("ppl->l", self.plan.covariance[0][np.ix_(own, own)])[None, None, None],
            reach=np.ones(1),
            slew=slew_of(limits, self.grid.rate_hz),
        )

    def rows(self, wiring: Wiring) -> list[int]:
        return [self.table.patches.index(patch) for patch in wiring.patches]


def _signs(wiring: Wiring) -> FloatArray:
    """(patches,): 1, or -1 for a reversed one."""
    return np.array([-1.0 if patch in wiring.reversed else 1.0 for patch in wiring.patches])


def _wirings(patches: tuple[str, ...]) -> Iterator[Wiring]:
    """Every wiring of two or more patches, whose first is not reversed: swapping all changes nothing."""
    for count in range(2, len(patches) + 1):
        for some in combinations(patches, count):
            for swapped in range(count):
                for others in combinations(some[1:], swapped):
                    yield Wiring(some, others)
