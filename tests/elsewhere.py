"""Another program that has a rig's hardware, as far as this one can tell."""

import time
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path

from haploop.base.marks import InUse
from haploop.instruments import load_rig_file
from haploop.instruments.rig.opening import hardware
from haploop.instruments.safety.machine import _locked


@contextmanager
def in_use_elsewhere(rig: Path) -> Iterator[None]:
    """The locks themselves, without this program's own knowledge that it holds them.

    A computer has one lock of a piece, for the tests of another worker as well: their end is waited for.
    """
    latest = time.monotonic() + 60
    with ExitStack() as stack:
        for piece in sorted(hardware(load_rig_file(rig), None)):
            while True:
                try:
                    stack.enter_context(_locked(piece, "The other program's rig"))
                    break
                except InUse:
                    if time.monotonic() > latest:
                        raise
                    time.sleep(0.05)
        yield
