"""Faults of the touch table and its patches, and changes of a surface since it was calibrated."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Annotated, Literal

import numpy as np
from pydantic import Field

from ...base.arrays import FloatArray
from ...base.bounded import NotNegative, Positive
from ...base.errors import ConfigurationError
from ...instruments.config import RigFile
from ..plant import (
    AMPLITUDE,
    BoucWen,
    FaultSettings,
    Fingertip,
    Hand,
    Hysteresis,
    Modes,
    OnSurface,
    Palm,
    PatchLaw,
    ScheduledFault,
    TimedFault,
    place_of,
)

_LAG = 0.36
"""Width of the loop of the even part of a patch whose even part lags."""
Share = Annotated[float, Field(strict=True, gt=-0.9, lt=9, allow_inf_nan=False)]


class _Dead:
    def follow(self, volts: FloatArray) -> FloatArray:
        return np.zeros(len(volts))


class PatchDead(OnSurface):
    """A cracked or detached patch: it takes its voltage but moves nothing."""

    class Settings(FaultSettings):
        patch: str = "A"

    settings: Settings

    def law(self, patch: str, law: PatchLaw) -> PatchLaw:
        return _Dead() if patch == self.settings.patch else law

    def patches(self, volts: Mapping[str, FloatArray], start: float) -> Mapping[str, FloatArray]:
        if volts[self.settings.patch].any():
            self.mark(start)
        return volts


class _Changed(OnSurface):
    """A surface that is not as it was. The first drive is its first effect."""

    def patches(self, volts: Mapping[str, FloatArray], start: float) -> Mapping[str, FloatArray]:
        if not self.at and any(v.any() for v in volts.values()):
            self.mark(start)
        return volts


class PatchGain(_Changed):
    """A patch moves the surface by another amount per volt: part of it is depolarised, cracked or unglued."""

    class Settings(FaultSettings):
        gain: Positive = 0.85
        """Motion over that of a patch as it was."""
        patches: tuple[str, ...] | None = None
        """Names of the patches; None for all."""

    settings: Settings

    def law(self, patch: str, law: PatchLaw) -> PatchLaw:
        s = self.settings
        return law if s.patches is not None and patch not in s.patches else _Weaker(law, s.gain)


@dataclass(frozen=True, eq=False)
class _Weaker:
    inner: PatchLaw
    gain: float

    def follow(self, volts: FloatArray) -> FloatArray:
        return np.asarray(self.gain * self.inner.follow(volts))


class PatchAsymmetry(_Changed):
    """Patches expand more at a positive voltage than they shrink at the negative one: an even order."""

    class Settings(FaultSettings):
        share: Annotated[float, Field(strict=True, gt=-0.5, lt=0.5)] = 0.04
        """Expansion at +50 V over shrinking at -50 V, less 1; it adds to the default law's 0.02."""
        shape: Literal["square", "kink", "lagging"] = "square"
        """Even part of the motion. square: grows with the square of the linear volts. kink: two slopes that
        meet at zero. lagging: the square of volts that lag by three times the default hysteresis."""
        patches: tuple[str, ...] | None = None
        """Names of the patches; None for all."""

    settings: Settings

    def law(self, patch: str, law: PatchLaw) -> PatchLaw:
        s = self.settings
        return law if s.patches is not None and patch not in s.patches else _Uneven(law, s.share, s.shape)


class _Uneven:
    def __init__(self, inner: PatchLaw, share: float, shape: str) -> None:
        self._inner, self._shape, self._half = inner, shape, share / 2
        self._lag = Hysteresis(_LAG)

    def follow(self, volts: FloatArray) -> FloatArray:
        moved = self._inner.follow(volts)
        if self._shape == "kink":
            return np.asarray(moved + self._half * np.abs(moved))
        base = self._lag.follow(volts) if self._shape == "lagging" else moved
        return np.asarray(moved + self._half / AMPLITUDE * base**2)


class ModeDrift(_Changed):
    """The modes of the surface have moved, each by its own amount, as boundaries, weights and glue change."""

    class Settings(FaultSettings):
        """See `FaultSettings`. All changes are relative."""

        frequency: Share = 0.0
        """Change of the frequencies."""
        frequency_each: NotNegative = 0.0
        """Standard deviation of a further change of each mode's frequency of its own."""
        damping: Share = 0.0
        """Change of the damping ratios."""
        damping_each: NotNegative = 0.0
        """Standard deviation of a further change of each mode's damping of its own, as a logarithm."""
        near: Positive | None = None
        """Frequency (Hz) of which only the nearest mode changes; None for all modes."""

    settings: Settings

    def __init__(self, settings: Settings, file: RigFile, rng: np.random.Generator) -> None:
        super().__init__(settings, file, rng)
        self._drawn = rng.integers(2**63)

    def modes(self, modes: Modes, time: float) -> Modes:
        s, count = self.settings, len(modes.natural_hz)
        moved = np.ones(count)
        if s.near is not None:
            moved = np.zeros(count)
            moved[np.abs(modes.natural_hz - s.near).argmin()] = 1.0
        each = np.random.default_rng(self._drawn).standard_normal((2, count))
        frequency = (1 + s.frequency) * np.maximum(1 + s.frequency_each * each[0], 0.1)
        damping = (1 + s.damping) * np.exp(s.damping_each * each[1])
        return replace(
            modes,
            natural_hz=modes.natural_hz * np.where(moved, frequency, 1.0),
            damping=np.minimum(modes.damping * np.where(moved, damping, 1.0), 0.9),
        )


class FrequencyDrift(ScheduledFault, _Changed):
    """The frequencies of all modes drift while measurements run, as in a room that warms."""

    class Settings(ScheduledFault.Settings):
        rate: Annotated[float, Field(strict=True, ge=-0.1, le=0.1)] = 1e-5
        """Relative change per second."""
        limit: Annotated[float, Field(strict=True, gt=0, le=0.3)] = 0.02
        """Largest relative change, at which the drift ends."""

    settings: Settings

    def __init__(self, settings: Settings, file: RigFile, rng: np.random.Generator) -> None:
        super().__init__(settings, file, rng)
        # So that a step is at most a hundred-thousandth, if that is not too often.
        self.every = max(1e-5 / max(abs(settings.rate), 1e-9), 0.05)

    def modes(self, modes: Modes, time: float) -> Modes:
        shift = self.settings.rate * max(time - self.begin, 0.0)
        limit = self.settings.limit
        return replace(modes, natural_hz=modes.natural_hz * (1 + min(max(shift, -limit), limit)))

    def patches(self, volts: Mapping[str, FloatArray], start: float) -> Mapping[str, FloatArray]:
        return super().patches(volts, start) if start >= self.begin else volts


class HandOnTable(TimedFault, OnSurface):
    """Somebody leans on the table: a fingertip or a palm rests on it while it is driven or measured."""

    class Settings(TimedFault.Settings):
        point: str = "button"
        """Where it rests: "button" or the number of a grid point."""
        force: Annotated[float, Field(strict=True, gt=0, le=100)] = 1.0
        """N."""
        palm: bool = False
        """A palm, not a fingertip."""
        participant: str = "P01"
        """Whose: people differ."""

    settings: Settings

    def __init__(self, settings: Settings, file: RigFile, rng: np.random.Generator) -> None:
        super().__init__(settings, file, rng)
        try:
            place = place_of(file, settings.point)
        except ValueError as error:
            raise ConfigurationError(
                f'A fault of the kind {settings.kind!r} rests at the point {settings.point!r}: give "button" '
                "or the number of a grid point."
            ) from error
        person = np.random.default_rng([file.simulation.seed, *settings.participant.encode()])
        resting = Palm.of(person) if settings.palm else Fingertip.of(person)
        self._hands = []
        for begin in self._begins.tolist():
            name = f"{settings.participant} from {begin} s"
            end = begin + settings.duration
            self._hands.append(Hand(name, resting, place, settings.force, begin, rng, end))

    def hands(self) -> Sequence[Hand]:
        return self._hands

    def patches(self, volts: Mapping[str, FloatArray], start: float) -> Mapping[str, FloatArray]:
        if any(v.any() for v in volts.values()):
            self.active(np.array([start]))
        return volts


class PatchHysteresis(_Changed):
    """Patches follow another law than the rig file's `hysteresis`."""

    class Settings(FaultSettings):
        law: Literal["play", "bouc-wen"] = "bouc-wen"
        """play: the default law, a sum of play operators. bouc-wen: see `haploop.mocks.plant.BoucWen`."""
        width: Annotated[float, Field(strict=True, ge=0, le=0.5)] = 0.12
        """Width of the loop over its height at 100 Vpp."""
        patches: tuple[str, ...] | None = None
        """Names of the patches; None for all."""

    settings: Settings

    def law(self, patch: str, law: PatchLaw) -> PatchLaw:
        s = self.settings
        if s.patches is not None and patch not in s.patches:
            return law
        return BoucWen(s.width) if s.law == "bouc-wen" else Hysteresis(s.width)
