"""Following the worker: its newest snapshot, its blocks for the live scope, and another when it has died."""

from __future__ import annotations

import asyncio
import threading
from collections import deque
from collections.abc import Callable, Mapping
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import scipy
from numpy.typing import NDArray

from ...base.arrays import FloatArray
from ...base.clock import RealClock
from ...base.errors import DataError, HaploopError, InstrumentError
from ...base.threads import Flag
from ...instruments import LiveBlock, RigFile, Tap, watch_live
from ...instruments.driver import Mode
from ...instruments.live import Run, quantities
from ..worker import Address, WorkerLink

_RETRY = 1.0


class Follower:
    """Keeps `snapshot` new in a task of the server's loop. `again` starts a worker, or finds one."""

    def __init__(self, link: WorkerLink, again: Callable[[], WorkerLink], scope: LiveScope) -> None:
        self.link = link
        self._again, self.scope = again, scope
        self.snapshot: dict[str, Any] = {}
        self.heard: Callable[[dict[str, Any]], None] = lambda _: None
        """Called with each snapshot, in a thread, before the pages are told of it."""
        self._changed = asyncio.Condition()
        self.count = 0
        """Number of snapshots so far."""
        self._begun: tuple[Address, int] | None = None
        """The job that was begun here last, and its worker."""

    def command(self, name: str, values: Mapping[str, Any]) -> tuple[int, dict[str, Any]]:
        """Send a command of a page. See `WorkerLink.command`."""
        link = self.link
        status, answer = link.command(name, values)
        if "job" in answer:
            self._begun = link.address, answer["job"]
        return status, answer

    def leave(self, others: bool) -> bool:
        """End the worker, which reaches the safe state; return whether it goes on.

        With `others` who serve its pages it does: only a job that was begun here is stopped.
        """
        if not others:
            self.link.end()
            return False
        with suppress(InstrumentError, ValueError):
            job = self.link.state()["job"] or {}
            runs = job.get("state") in ("waiting", "running")
            if runs and self._begun == (self.link.address, job["number"]):
                self.link.stop()
        return True

    async def run(self, origins: list[str]) -> None:
        """Follow until cancelled."""
        await self._allow(origins)
        after = 0
        while True:
            try:
                state = await asyncio.to_thread(self.link.state, after)
            except (HaploopError, ValueError) as error:
                await self._show(
                    {**self.snapshot, "gone": str(error), "job": None, "request": None, "live": None}
                )
                after = 0
                await self._replace(origins)
                continue
            if state["version"] != after:
                after = state["version"]
                await self._show({**state, "gone": ""})

    async def newer(self, count: int, timeout: float) -> int:
        """Wait until more than `count` snapshots came, at most `timeout` s; return how many came."""
        try:
            async with asyncio.timeout(timeout), self._changed:
                await self._changed.wait_for(lambda: self.count > count)
        except TimeoutError:
            pass
        return self.count

    async def tell(self) -> None:
        """Have all pages told again, because something beside the worker changed."""
        async with self._changed:
            self.count += 1
            self._changed.notify_all()

    async def _show(self, snapshot: dict[str, Any]) -> None:
        await asyncio.to_thread(self.heard, snapshot)
        async with self._changed:
            self.snapshot = snapshot
            self.count += 1
            self._changed.notify_all()
        self.scope.follow(snapshot.get("live"))

    async def _replace(self, origins: list[str]) -> None:
        """Start another worker in place of one that has died, and have it reach the safe state.

        One that lives has its rig, and is followed again when it answers.
        """
        try:
            before, self.link = self.link, await asyncio.to_thread(self._again)
            await self._allow(origins)
            if self.link.address != before.address:
                await asyncio.to_thread(self.link.stop)
        except HaploopError as error:
            await self._show({**self.snapshot, "gone": str(error)})
            await asyncio.sleep(_RETRY)

    async def _allow(self, origins: list[str]) -> None:
        await asyncio.to_thread(self.link.allow, origins)


# Minimum and maximum of each bucket of samples, for a scope that shows every click.
#
# Bucket k holds the samples k * size to (k + 1) * size - 1 of the run, whenever the blocks arrive: every n-th
# sample would hide a click of 2 ms, and buckets that move with the picture shimmer.


class Buckets:
    """The newest `kept` buckets of `size` samples of several rows."""

    def __init__(self, rows: int, size: int, kept: int) -> None:
        self.size, self._kept = size, kept
        self._part: FloatArray = np.empty((rows, 0))
        self._extremes: NDArray[np.float32] = np.empty((2, rows, 0), np.float32)
        self._next = 0
        """Sample that should come next."""
        self.end = 0
        """Index behind the last complete bucket."""
        self.missed = 0
        """Samples that did not arrive."""

    def add(self, first: int, values: FloatArray) -> None:
        """Add (rows, samples) from sample `first` on. Buckets with a missing sample are NaN."""
        if first > self._next or self.end == 0 == self._part.shape[1]:
            self._skip_to(first)
        values = values[:, max(0, self._next - first) :]
        self._next += values.shape[1]
        part = np.concatenate([self._part, values], axis=1)
        count = part.shape[1] // self.size
        whole = part[:, : count * self.size].reshape(len(part), count, self.size)
        self._part = part[:, count * self.size :]
        if count:
            self._append(np.stack([whole.min(axis=2), whole.max(axis=2)]).astype(np.float32))

    def since(self, bucket: int) -> tuple[int, NDArray[np.float32]]:
        """Return the first bucket given, from `bucket` on, and (2, rows, buckets) minima and maxima."""
        have = self._extremes.shape[2]
        first = max(bucket, self.end - have)
        return first, self._extremes[:, :, have - max(0, self.end - first) :]

    def _skip_to(self, first: int) -> None:
        """Begin again at sample `first`; the buckets up to the one that holds it are missing."""
        began = self.end > 0 or self._part.shape[1] > 0
        if began:
            self.missed += first - self._next
        whole = -(-first // self.size)
        rows = len(self._part)
        if began and whole - self.end > 0:
            missing = min(whole - self.end, self._kept)
            self.end = whole - missing
            self._append(np.full((2, rows, missing), np.nan, np.float32))
        else:
            self.end = whole
        # The samples of an incomplete bucket are left out, so that each bucket holds all of its samples.
        self._part = np.empty((rows, 0))
        self._next = whole * self.size

    def _append(self, extremes: NDArray[np.float32]) -> None:
        self._extremes = np.concatenate([self._extremes, extremes], axis=2)[:, :, -self._kept :]
        self.end += extremes.shape[2]


_BUCKET = 0.01
"""s in one bucket."""
_KEPT = 2000
"""Buckets that are kept: a page that was reloaded shows the last 20 s."""
_REST = 0.5
"""s at the beginning of a run whose mean is the zero of forces and torques."""
_CAPACITY = 256
_WAIT = 0.25
_AGAIN = 0.2
_PLAYED = 40
"""Blocks of a play that are kept for its coherence: some seconds."""
_SEGMENT = 0.2
"""s of a segment for the live coherence, which is a first look; the response's own is computed after."""
_BAND = (75.0, 600.0)
_DRIVEN = 1e-3
"""Part of the drive's largest spectral density below which a frequency was not driven, as yet, by a sweep."""
_FORCES = {"Fx", "Fy", "Fz", "Tx", "Ty", "Tz"}


@dataclass(frozen=True)
class _Row:
    name: str
    unit: str


class LiveScope:
    """Follows the worker of a rig: `follow` tells it the address of the worker's live blocks."""

    def __init__(self, file: RigFile, simulate: Mode | None) -> None:
        self._file, self._simulate = file, simulate
        self._clock = RealClock()
        self._address: str | None = None
        self._closing = Flag()
        self._lock = threading.Lock()
        self._run: Run | None = None
        self._rows: list[_Row] = []
        self._buckets = Buckets(0, 1, _KEPT)
        self._zero: FloatArray | None = None
        self._seen = 0
        self._origin = 0.0
        self._last = 0.0
        """Time of arrival of the newest block."""
        self._ended = True
        self._generation = 0
        self._played: deque[FloatArray] = deque(maxlen=_PLAYED)
        self._thread = threading.Thread(target=self._work, name="haploop-scope", daemon=True)
        self._thread.start()

    def follow(self, address: str | None) -> None:
        """Follow the blocks at this address file; None for none."""
        self._address = address

    def close(self) -> None:
        """End the thread. May be called again."""
        self._closing.set()
        self._thread.join(2.0)

    def about(self) -> dict[str, Any]:
        """Return rows, rate and counts of samples of the present run, as JSON values."""
        with self._lock:
            run = self._run
            if run is None:
                return {"generation": self._generation, "rows": []}
            now = self._last if self._ended else self._clock.now()
            expected = round((now - self._origin) * run.rate_hz) if self._seen else 0
            rows, played = self._rows, list(self._played)
            found = {
                "generation": self._generation,
                "doing": run.doing,
                "rate_hz": run.rate_hz,
                "bucket_s": self._buckets.size / run.rate_hz,
                "rows": [{"name": row.name, "unit": row.unit} for row in self._rows],
                "received": self._seen,
                "expected": max(expected, self._seen),
                "ended": self._ended,
                "missed_here": self._buckets.missed,
                "about": run.about,
            }
        # Without the lock: it takes longer than the time between two frames may.
        return {**found, "coherence": _coherence_of(rows, played, run.rate_hz)}

    def frame(self, generation: int, since: int) -> tuple[int, int, bytes]:
        """Return the generation, the bucket that follows, and a frame from bucket `since` on, or b"".

        A frame: generation, first bucket, buckets, rows (uint32), then minima and maxima (float32), row by
        row; little-endian.
        """
        with self._lock:
            since = since if generation == self._generation else 0
            first, extremes = self._buckets.since(since)
            count = extremes.shape[2]
            if not count:
                return self._generation, since, b""
            head = np.array([self._generation, first, count, extremes.shape[1]], "<u4").tobytes()
            return self._generation, first + count, head + extremes.astype("<f4").tobytes()

    def _work(self) -> None:
        while not self._closing.is_set():
            address = self._address
            tap = self._connected(address) if address else None
            if tap is None:
                self._closing.wait(_AGAIN)
                continue
            with tap, suppress(DataError):
                while not self._closing.is_set():
                    block = tap.take(_WAIT if self._address == address else 0.0)
                    if block is not None:
                        self._add(block)
                    elif tap.closed or self._address != address:
                        break
            with self._lock:
                self._ended = True
            if self._address == address:
                self._closing.wait(_AGAIN)

    def _connected(self, address: str) -> Tap | None:
        try:
            return watch_live(self._file, self._simulate, _CAPACITY, Path(address))
        except HaploopError:
            return None

    def _add(self, block: LiveBlock) -> None:
        run = block.run
        found = quantities(run, block.volts)
        rows = [
            _Row(name, unit) for names, units, _, _ in found for name, unit in zip(names, units, strict=True)
        ]
        values = (
            np.concatenate([values for *_, values in found]) if found else np.empty((0, block.volts.shape[1]))
        )
        with self._lock:
            if self._run is None or self._run.number != run.number or self._run.about != run.about:
                self._begin(run, rows)
            if self._zero is None or block.end <= _REST * run.rate_hz:
                forces = np.array([row.name in _FORCES for row in rows], bool)[:, np.newaxis]
                self._zero = np.where(forces, values.mean(axis=1, keepdims=True), 0.0)
            self._last = self._clock.now()
            now = self._last - block.end / run.rate_hz
            # The block that came soonest after its last sample tells best when the run began.
            self._origin = min(self._origin, now) if self._seen else now
            self._seen = block.end
            self._buckets.add(block.first, values - self._zero)
            if run.doing == "play":
                self._played.append(values)

    def _begin(self, run: Run, rows: list[_Row]) -> None:
        self._run, self._rows, self._zero, self._seen = run, rows, None, 0
        self._buckets = Buckets(len(rows), max(1, round(_BUCKET * run.rate_hz)), _KEPT)
        self._generation += 1
        self._ended = False
        self._played.clear()


def _coherence_of(rows: list[_Row], blocks: list[FloatArray], rate_hz: float) -> float | None:
    drives = [k for k, row in enumerate(rows) if row.unit == "V"]
    speeds = [k for k, row in enumerate(rows) if row.unit == "m/s"]
    if not (drives and speeds and blocks):
        return None
    played = np.concatenate(blocks, axis=1)
    # The patch that plays is the one with most volts.
    drive = max((played[k] for k in drives), key=lambda volts: float(np.abs(volts).max()))
    return driven_coherence(drive, played[speeds[0]], rate_hz)


def driven_coherence(drive: FloatArray, velocity: FloatArray, rate_hz: float) -> float | None:
    """Median coherence of (samples,) of drive and velocity where there is drive; None of less than 0.8 s."""
    length = round(_SEGMENT * rate_hz)
    if len(drive) < 4 * length:
        return None
    f, found = scipy.signal.coherence(drive, velocity, rate_hz, nperseg=length)
    density = scipy.signal.welch(drive, rate_hz, nperseg=length)[1]
    inside = found[(f > _BAND[0]) & (f < _BAND[1]) & (density > _DRIVEN * density.max())]
    return float(np.median(inside)) if len(inside) and np.isfinite(inside).all() else None
