"""Limits of the drive at a patch, from the amplifier, the relay, the patch and the rig file."""

from __future__ import annotations

from ..limits import Limits
from .roles import Instruments

__all__ = ["ratings"]


def ratings(rig: Instruments, patches: int) -> dict[str, Limits]:
    """Collect the limits for `patches` patches in parallel, by owner."""
    table = rig.table
    patch = Limits(min=table.patch_min, max=table.patch_max, capacitance=patches * table.patch_capacitance)
    relay = Limits(min=-rig.relay.rating, max=rig.relay.rating)
    return {
        "the amplifier": rig.amplifier.limits(patches),
        "the relay": relay,
        "the patch": patch,
        "the rig file's [limits]": rig.file.limits.limits(),
    }
