"""Instruments of tables in a program's own process, for its tests."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from contextlib import ExitStack
from pathlib import Path
from types import TracebackType
from typing import Any, Self

from ...nidaqmx_twin.redirect import redirected
from .instrument import Instrument, table_of
from .serving import Served, add


class InstrumentTwins:
    """A context in which pyserial, PyVISA and sockets find instruments of tables.

    pyserial and PyVISA open no other.
    """

    def __init__(self, folder: Path) -> None:
        """Files of tables lie in `folder`."""
        self._folder = folder
        self._stack, self._redirection = ExitStack(), ExitStack()
        self._found = Served()
        self._instruments: dict[str, Instrument] = {}

    def serve(
        self, name: str, answers: Mapping[str, str | Sequence[str]] | str | Path, **more: Any
    ) -> Instrument:
        """Serve an instrument under a name (see `serving`): its answers, state, error and end, or a file.

        Raises ConfigurationError.
        """
        table, place = table_of(answers, self._folder, **more)
        instrument = Instrument(table, place)
        add(self._stack, self._found, name, instrument)
        self._instruments[name] = instrument
        self._redirect()
        return instrument

    def unknown(self) -> list[str]:
        """A sentence about each instrument whose table lacks commands that came, and an `error` for them."""
        return [
            f"{name} was sent {', '.join(map(repr, one.unknown))}, which its table does not have, or whose "
            "value does not fit: add it, or give the table an error."
            for name, one in self._instruments.items()
            if one.unknown and one.table.error is None
        ]

    def __enter__(self) -> Self:
        self._redirect()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._redirection.close()
        self._stack.close()

    def _redirect(self) -> None:
        self._redirection.close()
        found = self._found
        self._redirection.enter_context(redirected(found.serial, found.visa, found.hosts))
