"""Faults of the relay box and of the wiring behind it."""

from __future__ import annotations

from typing import ClassVar

from pydantic import field_validator

from ..plant import FaultSettings, OnRelay, PerEventFault, RelayFailure


class RelaySwapped(OnRelay):
    """The wires of two patches are swapped at the relay's output."""

    class Settings(FaultSettings):
        patches: tuple[str, str] = ("A", "B")

        @field_validator("patches")
        @classmethod
        def _two(cls, patches: tuple[str, str]) -> tuple[str, str]:
            if patches[0] == patches[1]:
                raise ValueError(f"name two different patches (found {patches[0]!r} twice)")
            return patches

    settings: Settings

    def contact(self, patch: str, at: float) -> str:
        one, other = self.settings.patches
        if patch not in (one, other):
            return patch
        self.mark(at)
        return other if patch == one else one


class _OfRelay(PerEventFault, OnRelay):
    class Settings(PerEventFault.Settings):
        patch: str = "A"

    settings: Settings
    how: ClassVar[RelayFailure]

    def relay(self, how: RelayFailure, patch: str, now: float) -> bool:
        return (how, patch) == (self.how, self.settings.patch) and self.fires(now)


class RelayLost(_OfRelay):
    """A command to a patch's channel never reaches the box."""

    how = "lost"


class RelayStuck(_OfRelay):
    """A channel does not switch, and reports the state that it really has."""

    how = "stuck"


class RelayWelded(_OfRelay):
    """A contact does not switch, but the box reports the commanded state."""

    how = "welded"
