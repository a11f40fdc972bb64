"""Faults of the communication lines to instruments."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field

from ..plant import OnLine, PerEventFault
from ..transport import ReplyFault


class Reply(PerEventFault, OnLine):
    """An instrument's answers are disturbed on the line. For wires only, because a twin has no line."""

    class Settings(PerEventFault.Settings):
        instrument: str
        """Role of the instrument: relay, vibrometer, ..."""
        how: Literal["silence", "delay", "drip", "garbled", "truncated", "disconnect"] = "silence"
        asked: str = ""
        """Text that a request must contain for its answer to be disturbed."""
        delay: Annotated[float, Field(strict=True, gt=0, le=60)] = 0.05
        """Delay in real time (s): before the answer with "delay", between its bytes with "drip"."""

    settings: Settings

    @property
    def line(self) -> str | None:
        return self.settings.instrument

    def answer(self, request: str, now: float) -> ReplyFault | None:
        if self.settings.asked not in request or not self.fires(now):
            return None
        return ReplyFault(self.settings.how, delay=self.settings.delay)
