"""Room (bytes) that results may take on a disk, held before a voltage is put out.

Upper bounds: twice what the shipped rigs need, or more (measured; a test compares). A result that is larger
still is written if the disk has the room then.
"""

from __future__ import annotations

CALIBRATION = 2_000_000
WAVEFORMS = 48_000_000
"""Of one calibration, as measured; a third of it, packed."""
CHECK = 4_000_000
"""A check without its plays, with press, drive and picture."""
PLAY = 200_000
"""One play of a check."""
MORE_PLAYS = 8
"""Times as many plays as were asked for that a check makes at most, to come to a verdict."""
BUTTON = 12_000_000
"""A digital button without what it learned from."""
STEP = 2_000_000
"""One iteration of learning."""


def of_button(iterations: int, elsewhere: int = 0) -> int:
    """A digital button with at most so many corrections, and something wanted at so many other points."""
    return BUTTON + (iterations + 1) * STEP + elsewhere * CHECK


def of_check(plays: int) -> int:
    """A check that was asked for so many plays."""
    return CHECK + MORE_PLAYS * plays * PLAY
