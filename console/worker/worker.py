"""The worker: runs one job at a time in its main thread, and reaches the safe state on STOP (`stopping`)."""

from __future__ import annotations

import sys
import threading
import traceback
from collections.abc import Callable, Mapping
from contextlib import ExitStack, suppress
from datetime import UTC, datetime, timedelta
from typing import Any, cast

from ...base.clock import RealClock
from ...base.errors import ConfigurationError, HaploopError, InstrumentError
from ...base.marks import is_marked
from ...base.signals import uninterrupted
from ...base.threads import Flag, Inbox
from ...instruments import Rig, RigFile, open_rig
from ...instruments.driver import Mode
from ..data_folder import DataFolder, clean
from .board import Board, Observer
from .job import Tools, Work
from .jobs import JOBS
from .link import address_path
from .page_operator import PageOperator
from .presenting import Stimuli
from .stopping import Stopping

_ORPHANED = 60.0
"""s without a server after which an idle worker ends."""
_ABANDONED = 600.0
"""s without a server after which nobody is there to answer a question, and the job ends."""
_FRESH = timedelta(hours=12)
"""Time for which a preflight, or its override, counts."""


class Worker:
    """Runs jobs on the rig of one rig file. Commands come from other threads."""

    def __init__(
        self, file: RigFile, simulate: Mode | None, data: DataFolder, real_time: bool = True
    ) -> None:
        self.file, self.data = file, data
        self._simulate, self._real_time = simulate, real_time
        self._clock = RealClock()
        self._jobs: Inbox[tuple[int, str, Work, bool, int]] = Inbox()
        """Number, kind, work, whether it needs the rig, and the number of STOPs when it was asked for."""
        self._changing = threading.Lock()
        self._running = 0
        """Number of the running job; 0 without one."""
        self._count = 0
        self._rig: Rig | None = None
        self._operator: PageOperator | None = None
        self._left_safe = False
        """Whether the rig was opened and left in the safe state, confirmed, by the job that runs."""
        self._ended = Flag()
        self._abandoned = Flag()
        self._heard = self._clock.now()
        mode = simulate or file.simulate
        self.board = Board(
            rig=file.name,
            mode=mode,
            simulated=mode is not None,
            data=str(data.root),
            calibrations=str(data.history.folder),
            worker={
                "place": str(address_path(file, simulate)),
                "begun": datetime.now(UTC).isoformat(timespec="microseconds"),
            },
            table=None if file.table is None else _table(file),
            job=None,
            progress=None,
            request=None,
            session=None,
            run=None,
            live=None,
            map=None,
            surface=None,
            held=None,
            saturated={},
            preflight=None,
            paused=False,
            auto=True,
            step=False,
            stop={"state": "none", "sentence": "", "number": 0},
        )
        self._stopping = Stopping(
            self.board,
            self._changing,
            lambda: (self._running, self._rig),
            # Behind a job that waits, which is not begun any more.
            lambda: self._add("safe", {}),
            file.at_rest,
        )
        self._stimuli = Stimuli(self.board, self._abandoned)
        self._looking = Flag()
        self._tools = Tools(self.board, data, file, self._stimuli, self._looking)

    def run(self) -> None:
        """Run jobs until `end`, or until nobody has asked for the snapshot for long. In the main thread."""
        while not self._ended.is_set():
            # An interrupt that was meant for a job may arrive just behind it.
            with suppress(KeyboardInterrupt):
                silent_for = self._clock.now() - self._heard
                if not self._jobs.wait():
                    if silent_for > _ORPHANED:
                        self._ended.set()
                    continue
                self._run(*self._jobs.take())

    def end(self) -> None:
        """End the worker after the safe state was reached. For any thread."""
        if self._running:
            self.stop()
        self._ended.set()

    def end_soon(self) -> None:
        """End the worker when its job has ended: for a signal's handler, which interrupts the job."""
        self._ended.set()

    def heard(self) -> None:
        """Note that a server is there."""
        self._heard = self._clock.now()
        self._abandoned.clear()

    def watch(self) -> None:
        """Look whether a server is still there. Called now and then by the listening thread."""
        if self._clock.now() - self._heard > _ABANDONED:
            self._abandoned.set()
        if self.board["held"] is not None and not is_marked(self.data.sitting):
            self.board.set(held=None)  # the server that conducted the session has died

    # Commands; each returns JSON values, or raises a HaploopError

    def command(self, name: str, values: Mapping[str, Any]) -> dict[str, Any]:
        """Do one command of a page. Raises ConfigurationError for an unknown one."""
        commands: dict[str, Callable[[Mapping[str, Any]], dict[str, Any] | None]] = {
            "start": self._start,
            "answer": self._answer,
            "reject": self._reject,
            "pause": self._pause,
            "note": self._note,
            "press": self._press,
            "auto": lambda v: self.board.set(auto=bool(v.get("on"))),
            "step": lambda v: self.board.set(step=bool(v.get("on"))),
            "acknowledge": lambda _: self.board.set(saturated={}),
            "override": self._override,
            "hold": self._hold,
            "let_go": lambda _: self.board.set(held=None),
            "present": self._stimuli.present,
            "release": lambda _: self._stimuli.release(),
            "leave": lambda _: self._looking.clear(),
            "end": lambda _: self.end(),
        }
        if name not in commands:
            raise ConfigurationError(f"The console has no command {name[:40]!r}.")
        return {"done": True, **(commands[name](values) or {})}

    def stop(self) -> dict[str, Any]:
        """Reach the safe state, and return what came of it: see `stopping`. For any thread."""
        return self._stopping.stop()

    def _start(self, values: Mapping[str, Any]) -> dict[str, Any]:
        kind = str(values.get("kind", ""))
        if kind not in JOBS or kind == "safe":
            raise ConfigurationError(f"The console has no job {kind[:40]!r}.")
        job = JOBS[kind]
        wanted = values.get("parameters") or {}
        if not isinstance(wanted, Mapping):
            raise ConfigurationError("The parameters of a job are an object of names and values.")
        if job.gated:
            self._refuse_without_preflight()
        return {"job": self._add(kind, wanted), "worker": self.board["worker"]}

    def _hold(self, values: Mapping[str, Any]) -> None:
        """Keep the rig for a session of an experiment, {experiment, participant}, until `let_go`.

        It lasts while the server that conducts the session has `DataFolder.sitting` marked.
        """
        held = {name: str(values.get(name, "")) for name in ("experiment", "participant")}
        with self._changing:
            self._refuse_taken("surface", held)
            job = self.board["job"]
            if self._busy and not (job["kind"] == "surface" and job["experiment"] == held["experiment"]):
                raise ConfigurationError(_busy(job["title"]))
            self.board.set(held=held)

    @property
    def _busy(self) -> bool:
        # Between the queue and `_running` a job is in neither, and on the board.
        state = (self.board["job"] or {}).get("state")
        return bool(self._running or len(self._jobs) or state in ("waiting", "running"))

    def _refuse_taken(self, kind: str, wanted: Mapping[str, Any]) -> None:
        """Refuse a job while a session of an experiment holds the rig, except for the rig's part in it."""
        held = self.board["held"]
        if held is None or (kind == "surface" and wanted.get("experiment") == held["experiment"]):
            return
        raise ConfigurationError(
            f"{held['participant']}'s session of the experiment {held['experiment']} holds the rig: end it "
            "on the page Experiment first."
        )

    def _refuse_without_preflight(self) -> None:
        preflight = self.board["preflight"]
        fresh = preflight is not None and (
            datetime.now(UTC) - datetime.fromisoformat(preflight["when"]) < _FRESH
        )
        if not fresh or not (preflight["status"] == "green" or preflight["override"]):
            raise ConfigurationError(
                "The preflight is not green: run it, or give a reason on its page why it does not matter "
                "today."
            )

    def _override(self, values: Mapping[str, Any]) -> None:
        reason = clean(values.get("reason", ""), "The reason", 3)
        before = self.board["preflight"] or {"status": "not done", "findings": []}
        when = datetime.now(UTC).isoformat(timespec="seconds")
        self.board.set(preflight={**before, "when": when, "override": reason})

    def _add(self, kind: str, wanted: Mapping[str, Any]) -> int:
        job = JOBS[kind]
        with self._changing:
            stops = self.board["stop"]["number"]
            if kind != "safe":
                self._refuse_busy(kind, wanted)
        work = job.prepare(self._tools, wanted)
        with self._changing:
            if kind != "safe":
                self._refuse_busy(kind, wanted)
                self._stopping.refuse_after(stops)
            self._count += 1
            number = self._count
            shown = {
                "number": number,
                "kind": kind,
                "title": job.title(wanted),
                "experiment": str(wanted.get("experiment", "")),
                "state": "waiting",
                "sentence": "",
                "result": {},
                "ended": "",
            }
            if job.gated:
                self.board.set(session=None)
            if kind != "look":
                self._looking.clear()
            self.board.set(job=shown, progress=None)
            self._jobs.put((number, kind, work, job.needs_rig, stops))
        return number

    def _refuse_busy(self, kind: str, wanted: Mapping[str, Any]) -> None:
        # Whoever looks gives way: the job waits until the rig is closed.
        if self._busy and not (kind != "look" and self.board["job"]["kind"] == "look"):
            raise ConfigurationError(_busy(self.board["job"]["title"]))
        self._refuse_taken(kind, wanted)

    def _answer(self, values: Mapping[str, Any]) -> dict[str, Any]:
        operator, number = self._operator, values.get("number")
        if (
            operator is None
            or not isinstance(number, int)
            or not operator.answer(number, bool(values.get("yes")))
        ):
            raise ConfigurationError("That question was answered already, or is asked no more.")
        return {}

    def _reject(self, values: Mapping[str, Any]) -> None:
        """Reject the last press: named, so that two tabs do not reject two."""
        session = self.board["session"]
        last = session["verdicts"][-1] if session and session["verdicts"] else None
        named = (values.get("number"), values.get("attempt"))
        if self._operator is None or last is None or (last["number"], last["attempt"]) != named:
            raise ConfigurationError("That press is not the last one, or is rejected already.")
        if not last["accepted"]:
            raise ConfigurationError("That press was not accepted, and is asked for again anyway.")
        self._operator.reject()

    def _pause(self, values: Mapping[str, Any]) -> None:
        if self._operator is None or self.board["session"] is None:
            raise ConfigurationError("There is no session to pause.")
        self.board.set(paused=bool(values.get("on")))

    def _note(self, values: Mapping[str, Any]) -> None:
        text = clean(values.get("text", ""), "A note", 1)
        if self._operator is None or (self.board["run"] or {}).get("doing") != "record":
            raise ConfigurationError("Nothing is being recorded that could hold the note.")
        self._operator.note(text)

    def _press(self, _: Mapping[str, Any]) -> None:
        looking = (self.board["job"] or {}).get("kind") == "look"
        if self._operator is None or not self._operator.press(looking):
            raise ConfigurationError("No press of the simulated participant is waited for.")

    # The main thread

    def _run(self, number: int, kind: str, work: Work, needs_rig: bool, stops: int) -> None:
        outcome: tuple[str, str, dict[str, Any]] = ("stopped", "Stopped by the operator.", {})
        self._left_safe = False
        try:
            with self._changing:
                if kind != "safe":
                    self._stopping.refuse_after(stops)
                self._running = number
            self._show_job(number, state="running")
            outcome = self._outcome(kind, work, needs_rig)
        except ConfigurationError as error:
            outcome = ("stopped", str(error), {})
        finally:
            # STOP may come once more, at any line: the board must show the end of the job all the same.
            with uninterrupted():
                if needs_rig and kind != "safe":
                    self.board.set(auto=True, **({"step": False} if JOBS[kind].gated else {}))
                self._finish(number, *outcome)

    def _outcome(self, kind: str, work: Work, needs_rig: bool) -> tuple[str, str, dict[str, Any]]:
        """Do a job, and return its state, sentence and result. Raises KeyboardInterrupt."""
        try:
            return "done", "", self._on_rig(kind, work) if needs_rig else work(cast(Rig, None))
        except HaploopError as error:
            unconfirmed = isinstance(error, _UnconfirmedError) or kind == "safe"
            return "unconfirmed" if unconfirmed else "failed", str(error), {}
        except Exception as error:
            traceback.print_exc(file=sys.stderr)
            sentence = f"Internal error in haploop ({type(error).__name__}: {error}). Please report it."
            return "failed", sentence, {}

    def _finish(self, number: int, state: str, sentence: str, result: dict[str, Any]) -> None:
        self.board.set(request=None, run=None, live=None, progress=None, paused=False)
        with self._changing:
            self._running = 0
            waits = self._stopping.job_ended(state, sentence, self._left_safe)
            # STOP met a job before it had opened the rig, or one that has no use for it.
            unread = waits and not len(self._jobs)
            now = datetime.now(UTC).isoformat()
            self._show_job(number, state=state, sentence=sentence, result=result, ended=now)
        if unread:
            self._add("safe", {})

    def _on_rig(self, kind: str, work: Work) -> dict[str, Any]:
        """Open the rig, work, and leave it in the safe state. Raises _UnconfirmedError when that failed."""
        failure: BaseException | None = None
        rig = open_rig(self.file, self._simulate, real_time=self._real_time)
        try:
            with rig, ExitStack() as stack:
                try:
                    person = rig.operator if rig.mode is not None else None
                    self._operator = PageOperator(self.board, person, self._abandoned)
                    rig.adopt("operator", self._operator)
                    self._rig = rig
                    with suppress(InstrumentError):  # without a live view the work goes on
                        self.board.set(live=str(stack.enter_context(rig.publish_live()).path))
                    stack.enter_context(Observer(rig, self.board))
                    overridden = (self.board["preflight"] or {}).get("override", "")
                    rig.audit.note("console", doing=kind, preflight_overridden=overridden)
                    done = work(rig)
                except BaseException as error:
                    failure = error
                    raise
        except InstrumentError as error:
            if error is failure:
                self._left_safe = True
                raise
            raise _UnconfirmedError(str(error)) from error
        except BaseException as error:
            self._left_safe = error is failure
            raise
        else:
            self._left_safe = True
            return done
        finally:
            self._rig = self._operator = None

    def _show_job(self, number: int, **values: Any) -> None:
        # Another job may wait already for the end of a look.
        self.board.change("job", lambda job: {**job, **values} if job["number"] == number else job)


class _UnconfirmedError(InstrumentError):
    """The safe state was not confirmed when a job left the rig."""


def _busy(title: str) -> str:
    return f"The rig is busy ({title}): wait until that has ended, or stop it."


def _table(file: RigFile) -> dict[str, Any]:
    assert file.table is not None
    return {"rows": file.table.rows, "columns": file.table.columns, "patches": list(file.table.patches)}
