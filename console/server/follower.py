"""Following the worker: its newest snapshot for all pages, and another worker when it has died."""

from __future__ import annotations

import asyncio
from collections.abc import Callable, Mapping
from contextlib import suppress
from typing import Any

from ...base.errors import HaploopError, InstrumentError
from ..worker import Address, WorkerLink
from .live_scope import LiveScope

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
