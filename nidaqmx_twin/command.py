"""Another program, run to its end."""

from __future__ import annotations

import signal
import subprocess
from collections.abc import Mapping, Sequence
from contextlib import suppress

from ..base.errors import ConfigurationError
from ..base.signals import STOPPING

_PATIENCE = 3
"""Ctrl-C or SIGTERM as often as this kills the program that is run."""


def run_command(command: Sequence[str], environment: Mapping[str, str]) -> int:
    """Run another program and return its exit code. Raises ConfigurationError when there is none.

    A program that a signal ended has 128 and the signal's number, as a shell says it. Ctrl-C reaches the
    program as well, and SIGTERM is handed on. The program may end by either as it means to: it is waited
    for, and killed at the third.
    """
    try:
        program = subprocess.Popen(command, env=dict(environment))
    except OSError as error:
        raise ConfigurationError(f"{command[0]} cannot be run: {error.strerror}.") from None
    # Counted, not raised: an exception as the program ends would lose its exit code, which is told once.
    stops: list[int] = []

    def stop(number: int, _: object) -> None:
        stops.append(number)
        if len(stops) == _PATIENCE:
            program.kill()
        elif number != signal.SIGINT:
            program.terminate()

    before = ((number, signal.getsignal(number)) for number in STOPPING)
    heeded = {number: handler for number, handler in before if handler != signal.SIG_IGN}
    with program:
        try:
            for number in heeded:
                signal.signal(number, stop)
            code = None
            while code is None:
                # With a time-out, because Ctrl-C does not interrupt an unlimited wait on Windows.
                with suppress(subprocess.TimeoutExpired):
                    code = program.wait(0.25)
        finally:
            for number, handler in heeded.items():
                signal.signal(number, handler)
    return code if code >= 0 else 128 - code
