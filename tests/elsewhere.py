"""Another program that has a rig's hardware, as far as this one can tell."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path

from haploop.instruments import load_rig_file
from haploop.instruments.rig.opening import hardware
from haploop.instruments.safety.lock import _locked


@contextmanager
def in_use_elsewhere(rig: Path) -> Iterator[None]:
    """The locks themselves, without this program's own knowledge that it holds them."""
    with ExitStack() as stack:
        for piece in hardware(load_rig_file(rig), None):
            stack.enter_context(_locked(piece, "The other program's rig"))
        yield
