"""A computer with things to make a rig of, for tests and `haploop rig new --simulate`."""

from __future__ import annotations

from ..instruments.describing import Found, FoundCard


def simulated_computer() -> Found:
    """What a lab's computer might list."""
    return Found(
        cards=(FoundCard("Dev1", "USB-6211", 16, 2),),
        ports=(("COM3", "USB serial device"), ("COM5", "relay board")),
        visa=(("USB0::0x0957::0x2807::MY52400000::INSTR", ""),),
        sounds=(("USB audio interface", "2 in, 2 out"),),
    )
