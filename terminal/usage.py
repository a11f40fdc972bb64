"""What is wrong with a command line, as one sentence: it names the option, what it takes, and what was found.

click's own messages are made of its own words ("is not in the range 1<=x<=1000"); its errors say what is
wrong by their class and their parameter, from which the sentences are made here.
"""

from __future__ import annotations

import difflib
import re
from collections.abc import Sequence
from typing import Any

import click


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
