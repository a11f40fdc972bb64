"""Exit codes and errors of every command: an error is one sentence on standard error.

0 done and passed; 1 done, and the result is out of tolerance; 2 invalid request, file or
configuration; 3 instrument failure; 130, 143 or 129 stopped by Ctrl-C, SIGTERM or a closed terminal.
"""

from __future__ import annotations

import difflib
import os
import re
import shutil
import signal
import sys
import textwrap
import threading
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from types import FrameType, MappingProxyType
from typing import Any, NoReturn, cast

import click

from ..base.errors import HaploopError
from ..base.signals import STOPPING, Heard, dropping_none, uninterrupted

# What is wrong with a command line, as one sentence: it names the option, what it takes, and what was found.
#
# click's own messages are made of its own words ("is not in the range 1<=x<=1000"); its errors say what is
# wrong by their class and their parameter, from which the sentences are made here.


def usage_sentence(error: click.UsageError, command: str) -> str:
    """The sentence for an error that click has raised within `command`, such as "haploop record"."""
    return f"{_said(error, command)} Try '{command} --help'."


def _said(error: click.UsageError, command: str) -> str:
    match error:
        case click.MissingParameter():
            return f"{command} needs {_name(error.param, error.ctx).rstrip('.')}.{_example(error.ctx)}"
        case click.BadParameter() if error.param is not None and (takes := _takes(error.param.type)):
            # click's own message begins with the value, or names none where a type of ours has failed.
            found = re.match(r"'.*?'|[^' ]\S*", error.message)
            what = found[0].rstrip(".") if found else error.message.rstrip(".")
            return f"{_name(error.param, error.ctx)} must be {takes} (found {what})."
        case click.NoSuchOption():
            near = _near(error.option_name, error.possibilities or ())
            return f"{command} has no option {error.option_name}{near}"
        case click.BadOptionUsage() if "requires an argument" in error.message:
            return f"{error.option_name} needs a value after it."
    return _said_by_click(error, command)


def _said_by_click(error: click.UsageError, command: str) -> str:
    """A sentence for an error whose class does not say what is wrong, or not in every version of click."""
    said = error.format_message().rstrip(".")
    if found := re.match(r"No such command '(.*?)'", said):
        known = error.ctx.command.commands if error.ctx and isinstance(error.ctx.command, click.Group) else ()
        return f"{command} has no command {found[1]!r}{_near(found[1], tuple(known))}"
    if found := re.match(r"Got unexpected extra arguments? \((.*)\)", said):
        return f"{command} takes fewer arguments: {found[1]} is too many."
    return f"{said}."


def _name(parameter: click.Parameter | None, context: click.Context | None) -> str:
    if isinstance(parameter, click.Option):
        return max(parameter.opts, key=len)
    return parameter.make_metavar(context) if parameter is not None and context is not None else "a value"


def _takes(kind: click.ParamType[Any]) -> str:
    """What a parameter of this type takes; "" where click's or the type's own message says it."""
    match kind:
        case click.IntRange() | click.FloatRange():
            number = "a whole number" if isinstance(kind, click.IntRange) else "a number"
            low = None if kind.min is None else f"{'above' if kind.min_open else 'from'} {kind.min:g}"
            high = None if kind.max is None else f"{'below' if kind.max_open else 'to'} {kind.max:g}"
            if high is None and low is not None and not kind.min_open:
                return f"{number}, {kind.min:g} or more"
            return " ".join(filter(None, (number, low, high)))
        case click.Choice():
            *others, last = map(str, kind.choices)
            return f"{', '.join(others)} or {last}" if others else last
    return {"integer": "a whole number", "float": "a number"}.get(kind.name, "")


def _near(word: str, known: Sequence[str]) -> str:
    close = difflib.get_close_matches(word, known, n=2)
    return f": did you mean {' or '.join(close)}?" if close else "."


def _example(context: click.Context | None) -> str:
    epilog = (context.command.epilog or "") if context is not None else ""
    lines = [line.strip() for line in epilog.splitlines() if line.strip().startswith("haploop ")]
    return f" Example: {lines[0]}." if lines else ""


INTERNAL_ERROR = 70
"""A bug in haploop: EX_SOFTWARE of sysexits."""


class _Terminated(KeyboardInterrupt):
    """SIGTERM or a closed terminal, handled like Ctrl-C: every context exits."""

    def __init__(self, number: int) -> None:
        super().__init__(number)
        self.exit_code = 128 + number


@dataclass
class CommandState:
    """State of a running command, for the message when it is interrupted."""

    rig_opened: bool = False
    at_rest: str = "the output is zero and the relay is open"
    """The safe state of the rig that was opened, as a clause."""
    recordings: Path | None = None


class Commands(click.Group):
    """A command group that reports every failure as one sentence and an exit code.

    Its help shows the commands in `sections`, each with the commands that belong together, in their order.
    """

    sections: Mapping[str, Sequence[click.Command]] = MappingProxyType({})

    def format_commands(self, ctx: click.Context, formatter: click.HelpFormatter) -> None:
        """Write the commands of each section below its title."""
        width = max((len(name) for name in self.commands), default=0)
        for title, commands in self.sections.items():
            with formatter.section(title):
                limit = formatter.width - formatter.current_indent - 2 - width
                formatter.write_dl(
                    [(f"{one.name:{width}}", one.get_short_help_str(limit)) for one in commands]
                )

    def main(self, *args: Any, **extra: Any) -> NoReturn:
        """Run a command, and exit as the module describes."""
        state = CommandState()
        extra |= {"standalone_mode": False, "obj": state}
        try:
            with _stopping_as_interrupt():
                result = super().main(*args, **extra)
            sys.stdout.flush()
        except click.Abort as stop:
            self._fail(*_interrupted(state, stop.__cause__))
        except KeyboardInterrupt as stop:
            self._fail(*_interrupted(state, stop))
        except click.exceptions.NoArgsIsHelpError as error:
            click.echo(error.format_message())
            result = 0
        except click.UsageError as error:
            command = (
                error.ctx.command_path
                if error.ctx
                else self._named((args[0] if args else extra.get("args")) or sys.argv[1:])
            )
            self._fail(usage_sentence(error, command), 2)
        except click.ClickException as error:
            self._fail(error.format_message(), 2)
        except HaploopError as error:
            self._fail(str(error), error.exit_code)
        except OSError as error:
            what = error.filename or "A file"
            self._fail(
                f"{what} cannot be used ({(error.strerror or str(error)).lower()}): choose another.", 2
            )
        except Exception as error:
            if (behind := _stop_behind(error)) is not None:
                self._fail(*_interrupted(state, behind))
            if os.environ.get("HAPLOOP_TRACEBACK"):
                raise
            self._fail(
                f"Internal error in haploop ({type(error).__name__}: {error}). "
                "Please report it, with the traceback that HAPLOOP_TRACEBACK=1 shows.",
                INTERNAL_ERROR,
            )
        sys.exit(result if isinstance(result, int) else 0)

    def _named(self, arguments: Sequence[str]) -> str:
        """The command that the first arguments name: click's parser does not say which it was."""
        names, group = ["haploop"], cast(click.Command, self)
        for word in arguments:
            if not isinstance(group, click.Group) or word not in group.commands:
                break
            names, group = [*names, word], group.commands[word]
        return " ".join(names)

    @staticmethod
    def _fail(sentence: str, code: int) -> NoReturn:
        # A further Ctrl-C does not suppress the message.
        with uninterrupted():
            told = "Error: " + " ".join(sentence.split())
            if sys.stderr.isatty():
                width = shutil.get_terminal_size().columns - 1
                told = textwrap.fill(told, width, break_long_words=False, break_on_hyphens=False)
            click.echo(told, err=True)
            sys.exit(code)


class _Unread:
    """A standard stream whose reader may leave, as in `haploop schema | head`: the rest goes nowhere.

    The command goes on, and ends with its own exit code.
    """

    def __init__(self, stream: Any) -> None:
        self._stream = stream

    def write(self, text: str) -> int:
        return int(self._whatever(lambda: self._stream.write(text)) or 0)

    def flush(self) -> None:
        self._whatever(self._stream.flush)

    def __getattr__(self, name: str) -> Any:
        return getattr(self._stream, name)

    def _whatever(self, action: Callable[[], Any]) -> Any:
        try:
            return action()
        except BrokenPipeError:
            nowhere = os.open(os.devnull, os.O_WRONLY)
            os.dup2(nowhere, self._stream.fileno())
            os.close(nowhere)
            return action()


def usable_streams() -> None:
    """Make standard streams of those that are closed (`>&-`, pythonw), and let a pipe's reader leave."""
    # No file that is opened later may take the number of a standard stream: what is printed would go there.
    while (descriptor := os.open(os.devnull, os.O_RDWR)) <= 2:
        pass
    os.close(descriptor)
    for name, kind in (("stdin", "r"), ("stdout", "w"), ("stderr", "w")):
        stream = getattr(sys, name)
        if stream is None:
            stream = open(os.devnull, kind, encoding="utf-8")  # noqa: PTH123, SIM115
        setattr(sys, name, _Unread(stream) if kind == "w" else stream)


@contextmanager
def _stopping_as_interrupt() -> Iterator[None]:
    def stop(number: int, _frame: FrameType | None) -> None:
        raise KeyboardInterrupt if number == signal.SIGINT else _Terminated(number)

    if threading.current_thread() is not threading.main_thread():
        yield
        return
    # Not one that whoever started the command has it ignore (`nohup`).
    handled = [kind for kind in STOPPING if signal.getsignal(kind) != signal.SIG_IGN]
    before = {kind: signal.signal(kind, Heard(stop)) for kind in handled}
    try:
        with dropping_none():
            yield
    finally:
        for kind, handler in before.items():
            signal.signal(kind, handler)


def _stop_behind(error: BaseException | None) -> KeyboardInterrupt | None:
    """The stop that an error stands for: a library may make an ImportError of one that comes as it loads."""
    while error is not None and not isinstance(error, KeyboardInterrupt):
        error = error.__cause__ or error.__context__
    return error


def _interrupted(state: CommandState, cause: BaseException | None) -> tuple[str, int]:
    # If the safe state had not been confirmed, its own error would have been raised instead.
    sentence = "Stopped."
    if state.rig_opened:
        sentence = f"Stopped: {state.at_rest}."
    if state.recordings is not None and any(state.recordings.glob("*.h5")):
        sentence += f" The recordings so far are in {state.recordings} and are readable."
    return sentence, cause.exit_code if isinstance(cause, _Terminated) else 130
