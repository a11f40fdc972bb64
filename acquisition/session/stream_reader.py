"""The stream reader: a thread that only takes blocks from a stream and puts them on a queue.

It never waits for a disk, a plot or a person. The blocks are consumed in the thread that made the
`StreamReader`, normally the main one, where Ctrl-C arrives.
"""

from __future__ import annotations

import threading
from collections import deque
from collections.abc import Iterator
from types import TracebackType
from typing import Self

from haploop.instruments import Block, Clock, InstrumentError, Stream

__all__ = ["GapError", "OverrunError", "StreamReader"]

_POLL = 0.1
"""Seconds of one wait for the other thread: on Windows a wait without an end does not see Ctrl-C."""
_STOP_DEADLINE = 10.0
"""Seconds for the thread to come back from the driver; a driver's own time-outs are shorter."""


class GapError(InstrumentError):
    """Samples were lost between two blocks."""


class OverrunError(InstrumentError):
    """Blocks came faster than they were written, until no more could wait."""


class StreamReader:
    """A context that reads a stream; iterate over it for the blocks, in order and without a gap.

    `depth` is how many blocks may wait for their consumer. Iteration raises InstrumentError when
    the stream does, when a block does not follow the one before (GapError), or when the queue was
    full (OverrunError): in each case only after every block that came before it. After `stop`, `left`
    hands out what has been read and may not have been consumed.
    """

    def __init__(self, stream: Stream, clock: Clock, depth: int = 400) -> None:
        self._stream = stream
        self._clock = clock
        self._depth = depth
        # The block being consumed stays at the head until its consumer comes back for the next, so
        # that an interrupt between any two instructions loses none.
        self._queue: deque[Block | BaseException | None] = deque()
        self._available = threading.Event()
        self._stopping = threading.Event()
        self._handled = threading.Event()
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
            item = self._head()
            if item is None:
                return
            if isinstance(item, BaseException):
                raise item
            if item.first != self._next:
                raise GapError(
                    f"Samples {self._next} to {item.first - 1} were lost: a block was expected at sample "
                    f"{self._next} and begins at {item.first}. Close other programs, or use a larger buffer."
                )
            self._next = item.end
            yield item
            self._queue.popleft()
            self._handled.set()

    @property
    def waiting(self) -> int:
        """How many blocks have been read and not yet consumed."""
        return len(self._queue)

    def stop(self) -> None:
        """End the thread; the stream itself stays open. May be called again.

        Raises InstrumentError when the driver does not come back.
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
        """After `stop`: the block that was being consumed, and all that follow it without a gap.

        Its consumer may have handled the first of them already, and must know by its index.
        """
        for item in self._queue:
            if not isinstance(item, Block) or self._next not in (item.first, item.end):
                return
            self._next = item.end
            yield item

    def _head(self) -> Block | BaseException | None:
        """What stands first in the queue, once anything does."""
        while True:
            if self._queue:
                return self._queue[0]
            self._available.clear()
            if not self._queue:
                self._available.wait(_POLL)

    def _read(self) -> None:
        try:
            for block in self._stream:
                self._handled.clear()
                if len(self._queue) >= self._depth:
                    raise OverrunError(
                        f"The recorder fell behind: {self._depth} blocks wait to be written, and reading "
                        f"stopped at sample {block.first}. Use a faster or less busy disk."
                    )
                self._put(block)
                self._clock.hold(self._consumed)
                if self._stopping.is_set():
                    return
            self._put(None)
        except BaseException as error:  # handed to the consumer, whose thread raises it
            self._put(error)

    def _put(self, item: Block | BaseException | None) -> None:
        self._queue.append(item)
        self._available.set()

    def _consumed(self) -> None:
        """Return when the consumer comes back for the next block, or nobody consumes any more."""
        while not self._handled.wait(_POLL) and not self._stopping.is_set():
            pass
