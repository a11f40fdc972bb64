"""What may be played: limits as read at opening, a coil's heat and the duty, with all that was played.

Drives are judged in volts at the patch, sample by sample, against the strictest of the ratings of
amplifier, relay, patch and rig file. What was played, and what it left in a coil, is counted for every
program that plays on this hardware, before a play begins and again at its end.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Mapping
from contextlib import suppress
from dataclasses import dataclass, replace
from functools import reduce
from pathlib import Path

import numpy as np

from ...base.arrays import FloatArray
from ...base.clock import Clock
from ...base.errors import ConfigurationError, DataError, LimitError
from ..generator import Waveform
from ..limits import Limits, sounding
from .duty import MINUTE, Heat, Span, clear_old, count_plays, plays_of
from .lockout import Lockouts

Ratings = Mapping[str, Limits]
"""Limits by owner: the amplifier's, the relay's, a patch's, the rig file's own."""


class ReadRatings:
    """The ratings of a rig, read when it was opened; none before that, and of a rig that cannot play."""

    def __init__(self) -> None:
        self._each: tuple[Ratings, ...] = ()
        self._why_none = "Nothing is played before the rig is open."

    def __bool__(self) -> bool:
        return bool(self._each)

    def keep(self, each: tuple[Ratings, ...], why_none: str = "") -> None:
        """Keep ratings by the number of patches in parallel from 0 on, or why there are none."""
        self._each, self._why_none = each, why_none

    def of(self, patches: int) -> Ratings:
        """The ratings for so many patches in parallel. Raises ConfigurationError where there are none."""
        if not self._each:
            raise ConfigurationError(self._why_none)
        # More patches than there are will be refused by the relay.
        return self._each[min(patches, len(self._each) - 1)]


_ROUNDING = 1e-9


@dataclass(frozen=True)
class Heating:
    """What a play leaves of the coil's smoothed dissipation at its end (W), besides what it found.

    `seconds` are from its first sample to its last, zeros among them.
    """

    limits: Limits
    own: float
    seconds: float


def combined(ratings: Ratings) -> Limits:
    """The strictest of all ratings."""
    return reduce(Limits.within, ratings.values())


class Judge:
    """Judges drives for the limiter, and counts what is played. Raises LimitError for what is not played."""

    def __init__(self, clock: Clock, lockouts: Lockouts, counted: Path | None) -> None:
        """`counted` is the folder of what was played, shared by all programs; None to forget it."""
        self._clock, self._lockouts, self._counted = clock, lockouts, counted
        self._hardware = lockouts.hardware
        self._played: deque[Span] = deque()
        self.heat = Heat(clock, lockouts.hardware, counted)

    def recall(self) -> None:
        """Take over what other programs have played on this hardware, once the rig has its lock."""
        if self._counted is None:
            return
        self.heat.recall()
        now = self._clock.now()
        clear_old(self._counted, now)
        self._played.extend(plays_of(self._counted, self._hardware, now))

    def judge(self, waveform: Waveform, gain: float, rest: float, ratings: Ratings) -> float:
        """Check a waveform at an amplifier's input, and return for how long it sounds (s).

        What is judged are its samples, and that they keep to what it states: the amplitude is what its
        generator is set to.
        """
        try:
            samples, rate_hz = waveform.sampled(rest)
            volts = gain * np.asarray(samples, dtype=np.float64)
            stated, longest = gain * waveform.amplitude, waveform.duration * waveform.duty
            if waveform.goes_on:
                longest += rest
            first, stop = sounding(volts)
            peak, seconds = float(np.abs(volts).max()), (stop - first) / rate_hz
        except Exception as error:  # of another package's waveform
            raise LimitError(
                f"A {type(waveform).__name__} was refused, because it cannot be judged "
                f"({type(error).__name__}: {error}): ask its author."
            ) from error
        if not (peak <= stated * (1 + _ROUNDING) and seconds <= longest + 2 / rate_hz):
            raise LimitError(
                f"A {waveform} was refused: it states {stated:.4g} V and {longest:.4g} s, and its samples "
                f"reach {peak:.4g} V and {seconds:.4g} s. Ask the author of {type(waveform).__name__}."
            )
        if not waveform.goes_on:
            self.check(volts, rate_hz, ratings)
            return longest
        # It cannot fade out, nor remove its mean: only the part up to its last whole half wave is checked.
        crossed = np.flatnonzero(np.diff(np.signbit(volts)))
        whole = volts[: int(crossed[-1]) + 1] if len(crossed) else volts
        longer = longest - len(whole) / rate_hz
        self.check(whole, rate_hz, ratings, longer=longer, max_end=np.inf, max_offset=np.inf)
        return longest

    def check(
        self, drive: FloatArray, rate_hz: float, ratings: Ratings, longer: float = 0.0, **waived: float
    ) -> None:
        """Refuse a drive ((samples,) V at the patch) beyond a limit, or while the rig is locked out.

        It sounds `longer` (s) than its samples; `waived` are limits that are other than in `ratings`.
        """
        lockout = self._lockouts.present
        if lockout is not None:
            raise LimitError(lockout.sentence)
        strictest = combined(ratings)
        warm = self.heat.left(strictest)
        try:
            left = {"max_duration": strictest.max_duration - longer, **waived}
            replace(strictest, **left).check(drive, rate_hz, warm=warm)  # type: ignore[arg-type]
        except LimitError as error:
            if warm:
                self._refuse_warm(drive, rate_hz, replace(strictest, **left), warm)  # type: ignore[arg-type]
            # The owner of the limit is looked up only for the message.
            for whose, rating in ratings.items():
                own = {"max_duration": rating.max_duration - longer, **waived}
                load = replace(rating, capacitance=strictest.capacitance, coil=strictest.coil)
                try:
                    replace(load, **own).check(drive, rate_hz, whose, warm)  # type: ignore[arg-type]
                except LimitError as named:
                    if str(named).removesuffix(f"{whose}.") == str(error).removesuffix("the rig."):
                        raise named from None
            raise

    def _refuse_warm(self, drive: FloatArray, rate_hz: float, limits: Limits, warm: float) -> None:
        """Refuse a drive that the coil would take if it were cold, with the time after which it does."""
        try:
            limits.check(drive, rate_hz)
        except LimitError:
            return
        assert limits.coil is not None
        first, stop = sounding(drive)
        own = float(limits.coil.heat(drive[first:stop], rate_hz).max())
        wait = limits.coil.thermal_time * np.log(warm / max(limits.power - own, 1e-3 * limits.power))
        raise LimitError(
            f"The drive heats the coil by {own:.3g} W, earlier plays have left {warm:.3g} W in it, and it "
            f"takes {limits.power:.3g} W: wait {np.ceil(max(10 * wait, 1.0)) / 10:g} s."
        )

    def check_duty(self, seconds: float, ratings: Ratings) -> None:
        """Refuse a drive that would exceed the duty in the minute that ends with it."""
        duty, now = combined(ratings).duty, self._clock.now()
        begin = now + seconds - MINUTE
        while self._played and self._played[0][1] <= now - MINUTE:
            self._played.popleft()
        before = [(max(start, begin), stop) for start, stop in self._played if stop > begin]
        excess = sum(stop - start for start, stop in before) + min(seconds, MINUTE) - duty * MINUTE
        if excess <= 1e-9 * MINUTE:
            return
        sentence = (
            f"The drive would make {duty * MINUTE + excess:.3g} s of a minute in which something is played, "
            f"{excess:.3g} s beyond the {duty * MINUTE:.3g} s that 'duty' in [limits] allows"
        )
        for start, stop in before:
            left = min(stop - start, excess)
            excess -= left
            if excess <= 0:
                raise LimitError(f"{sentence}: wait {start + left - begin:.3g} s.")
        raise LimitError(f"{sentence}: play a shorter one.")

    def begin(self, begun: float, seconds: float, heating: Heating) -> float:
        """Count a play that begins now; returns what earlier ones left in the coil (W). Raises DataError."""
        self._count((begun, begun + seconds))
        warm = self.heat.left(heating.limits)
        self.heat.count(heating.limits, heating.own, heating.seconds)
        return warm

    def end(self, begun: float, seconds: float) -> None:
        """Count a play that has ended now."""
        now = self._clock.now()
        self._played.append((max(begun, now - seconds), now))

    def keep(self, heating: Heating) -> None:
        """Keep what was played, for every program; if it cannot be written, the full length stays counted."""
        with suppress(DataError):
            self._count()
            self.heat.ended(heating.limits)

    def _count(self, *to_come: Span) -> None:
        """Keep what was played, and what is about to be, for every program. Raises DataError."""
        if self._counted is None:
            return
        now = self._clock.now()
        spans = [span for span in (*self._played, *to_come) if span[1] > now - MINUTE]
        count_plays(self._counted, self._hardware, spans)
