"""Test of the camera that sees the finger: frames arrive, at the stated rate, neither dark nor too bright."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from ...instruments import Camera, Rig
from .finding import Finding

_FRAMES = 20
_BRIGHT, _DARK = 200.0, 2.0
"""Grey levels: above, a finger saturates; below, the lamps are off or the lens is covered."""


def check_camera(rig: Rig) -> Iterator[Finding]:
    """Yield findings about frames, rate and light; nobody touches the surface meanwhile."""
    camera = rig.role(Camera)
    camera.start()
    try:
        frames = [camera.read() for _ in range(_FRAMES)]
    finally:
        camera.stop()
    taken = frames[-1].number - frames[0].number
    of = frames[-1].number + 1  # numbers count from the start
    lost = of - _FRAMES
    rate_hz = taken / (frames[-1].time - frames[0].time)
    if lost:
        sentence = f"{lost} of {of} frames were lost: use a shorter cable, or another port."
        yield Finding("Frames", "camera", "yellow", sentence)
    elif abs(rate_hz / camera.rate_hz - 1) > 0.05:
        sentence = f"{rate_hz:.1f} frames/s arrive, not {camera.rate_hz:g}: change 'rate_hz' in [camera]."
        yield Finding("Frames", "camera", "red", sentence)
    else:
        yield Finding("Frames", "camera", "green", f"{rate_hz:.1f} frames/s, none lost of {_FRAMES}.")
    brightest = float(np.percentile(np.mean([frame.pixels for frame in frames], axis=0), 99))
    if brightest > _BRIGHT:
        sentence = f"The image reaches {brightest:.0f} of 255 without a finger: lower the exposure."
        yield Finding("Light", "camera", "red", sentence)
    elif brightest < _DARK:
        yield Finding("Light", "camera", "red", "The image is dark: open the lens, and switch the lamps on.")
    else:
        yield Finding(
            "Light", "camera", "green", f"The image reaches {brightest:.0f} of 255 without a finger."
        )
