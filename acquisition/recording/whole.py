"""Write a recording whose samples are all there already: one that another program recorded."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from contextlib import suppress
from pathlib import Path

import numpy as np

from ...base.arrays import FloatArray
from ...base.files import check_destination, private_files
from ...base.marks import marked
from ...instruments import Block
from .file_format import Header
from .recording import Recording
from .rows import Event, PressVerdict
from .salvage import finish
from .writer import Writer

_BLOCK = 0.05
"""s of a block, as when presses are recorded."""


def write_recording(
    path: Path,
    header: Header,
    volts: FloatArray,
    events: Sequence[Event],
    judge: Callable[[Recording], Sequence[PressVerdict]],
) -> Recording:
    """Write (channels, samples) V, with events, and with the verdicts that `judge` gives of what is written.

    Raises ConfigurationError for an existing file or a bad folder or disk, InstrumentError when it fails.
    """
    block = max(1, round(_BLOCK * header.rate_hz))
    samples = volts.shape[1]
    with private_files():
        check_destination(path)
    none = np.zeros(len(volts), dtype=np.bool_)
    created = False
    with marked(path):
        try:
            with Writer(path, header, block, -(-samples // block) + 1, len(events)) as writer:
                created = True
                for first in range(0, samples, block):
                    writer.write(Block(first, volts[:, first : first + block], none), first / header.rate_hz)
                for event in events:
                    writer.note(*event)
                for verdict in judge(Recording.open(path)):
                    writer.write_verdict(verdict)
        except BaseException:
            if created:  # or the file is somebody else's, who was quicker
                with suppress(OSError):
                    path.unlink(missing_ok=True)
            raise
        finish(path)
    return Recording.open(path)
