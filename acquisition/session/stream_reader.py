"""The stream reader: a thread that only moves blocks from a stream to a queue.

It never waits for a disk, a plot or a person. The blocks are consumed in the thread that created the
`StreamReader`, normally the main thread, which receives Ctrl-C.
"""

from __future__ import annotations

import threading
from collections.abc import Iterator
from types import TracebackType
from typing import Self

from ...base.clock import Clock
from ...base.errors import InstrumentError
from ...base.flag import Flag
from ...base.inbox import Inbox
from ...instruments import Block, Stream

_POLL = 0.1
"""Interval at which the reader looks whether it is to stop (s)."""
_STOP_DEADLINE = 10.0
"""Seconds allowed for the thread to return from the driver, whose own time-outs are shorter."""


class GapError(InstrumentError):
    """Samples were lost between two blocks."""


class OverrunError(InstrumentError):
    """The queue was full: blocks arrived faster than they were written."""


class StreamReader:
    """A context manager that reads a stream; iterating over it gives the blocks in order without a gap.

    `depth` is the length of the queue in blocks. Iteration raises the stream's own InstrumentError, a
    GapError when a block does not follow the preceding one, or an OverrunError when the queue was full:
    in each case only after every earlier block. After `stop`, `left` yields the blocks that may not have
    been consumed.
    """

    def __init__(self, stream: Stream, clock: Clock, depth: int = 400) -> None:
        self._stream = stream
        self._clock = clock
        self._depth = depth
        # The block being consumed stays at the head until its consumer asks for the next, so that an
        # interrupt between any two instructions loses no block.
        self._queue: Inbox[tuple[Block, float] | BaseException | None] = Inbox()
        self.arrived = 0.0
        """When the driver gave the block that is being consumed (s of the clock)."""
        self._stopping = Flag()
        self._handled = Flag()
        self._thread = threading.Thread(target=self._read, name="haploop-reader", daemon=True)
        self._next = 0

    def __enter__(self) -> Self:
        self._thread.start()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.stop()

    def __iter__(self) -> Iterator[Block]:
        while True:
            while not self._queue.wait():
                pass
            item = self._queue.head()
            if item is None:
                return
            if isinstance(item, BaseException):
                raise item
            block, self.arrived = item
            if block.first != self._next:
                raise GapError(
                    f"Samples {self._next} to {block.first - 1} were lost: a block was expected at sample "
                    f"{self._next} and begins at {block.first}. Close other programs, or use a larger buffer."
                )
            self._next = block.end
            yield block
            self._queue.take()
            self._handled.set()

    @property
    def waiting(self) -> int:
        """Number of blocks read and not yet consumed."""
        return len(self._queue)

    def stop(self) -> None:
        """Stop the thread; the stream itself stays open. May be called again.

        Raises InstrumentError when the driver does not return.
        """
        self._stopping.set()
        if self._thread.ident is not None:
            self._thread.join(_STOP_DEADLINE)
        if self._thread.is_alive():
            raise InstrumentError(
                f"The DAQ's driver did not return from a read within {_STOP_DEADLINE:g} s: "
                "restart the program, and check the card."
            )

    def left(self) -> Iterator[Block]:
        """Yield, after `stop`, the block being consumed and all that follow it without a gap.

        The consumer may have processed the first of them already; its index tells.
        """
        for item in self._queue:
            if item is None or isinstance(item, BaseException):
                return
            block, self.arrived = item
            if self._next not in (block.first, block.end):
                return
            self._next = block.end
            yield block

    def _read(self) -> None:
        try:
            for block in self._stream:
                self._handled.clear()
                if len(self._queue) >= self._depth:
                    raise OverrunError(
                        f"The recorder fell behind: {self._depth} blocks wait to be written, and reading "
                        f"stopped at sample {block.first}. Use a faster or less busy disk."
                    )
                self._queue.put((block, self._clock.now()))
                self._clock.hold(self._consumed)
                if self._stopping.is_set():
                    return
            self._queue.put(None)
        except BaseException as error:  # raised again in the consumer's thread
            self._queue.put(error)

    def _consumed(self) -> None:
        """Wait until the consumer asks for the next block, or the reader is stopped."""
        while not self._handled.wait(_POLL) and not self._stopping.is_set():
            pass
