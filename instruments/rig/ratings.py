"""Everybody's limits of what a patch may get: amplifier, relay, patch and rig file."""

from __future__ import annotations

from haploop.instruments.limits import Limits
from haploop.instruments.rig.roles import Instruments

__all__ = ["ratings"]


def ratings(rig: Instruments, patches: int) -> dict[str, Limits]:
    """Collect everybody's limits, with `patches` patches in parallel, by whose they are."""
    table = rig.table
    patch = Limits(min=table.patch_min, max=table.patch_max, capacitance=patches * table.patch_capacitance)
    relay = Limits(min=-rig.relay.rating, max=rig.relay.rating)
    return {
        "the amplifier": rig.amplifier.limits(patches),
        "the relay": relay,
        "the patch": patch,
        "the rig file's [limits]": rig.file.limits.limits(),
    }
