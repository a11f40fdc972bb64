"""The band of the drives, by itself: the command line asks for it, and loads no arrays for that."""

from __future__ import annotations

BAND = (75.0, 600.0)
"""Hz: the band of a press that a drive reproduces, and in which its carrier lies. Below its first mode a
table hardly moves, and the paper's sweep ends at 625 Hz. The band is the same for every press and table, so
that an error is never small because the target is small."""
