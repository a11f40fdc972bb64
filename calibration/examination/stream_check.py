"""Test of the streams of other programs: each is there, once, and its clock can be measured."""

from __future__ import annotations

from collections.abc import Iterator

from ...instruments import Rig
from ...instruments.streams import LslStreams
from .finding import Finding


def check_streams(rig: Rig) -> Iterator[Finding]:
    """Yield a finding for each stream that is recorded along."""
    for name, said in rig.role(LslStreams).look().items():
        yield Finding(f"Stream {name}", "streams", "green" if isinstance(said, str) else "red", str(said))
