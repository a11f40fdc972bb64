"""Questions with answers that are remembered: asked again, an answer given before is the default."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from contextlib import suppress

from ..errors import ConfigurationError

Ask = Callable[[str, str], str]
"""Asks a person: the question, and the answer that Enter gives."""


class Interview:
    """Asks `ask`, and keeps the answers; a wrong one is asked again, at most a few times."""

    def __init__(self, ask: Ask, tell: Callable[[str], object]) -> None:
        self._ask, self.tell = ask, tell
        self.answers: dict[str, str] = {}

    def text(self, key: str, question: str, default: str = "") -> str:
        """An answer as it is; empty where nothing was said and nothing is the default."""
        self.answers[key] = self._ask(question, self.answers.get(key, default)).strip()
        return self.answers[key]

    def one_of(self, key: str, question: str, choices: Sequence[tuple[str, str]], default: str = "") -> str:
        """One of `choices`, each with what it says; by name, or by its number from 1."""
        listed = "\n".join(
            f"  {number}  {name}{f': {said}' if said else ''}"
            for number, (name, said) in enumerate(choices, 1)
        )
        names = [name for name, _ in choices]
        for _ in range(5):
            answer = self.text(key, f"{question}\n{listed}\n", default or names[0])
            if answer.isdecimal() and 1 <= int(answer) <= len(names):
                answer = names[int(answer) - 1]
            if answer in names:
                self.answers[key] = answer
                return answer
            self.tell(f"{answer!r} is none of them.")
            self.answers.pop(key)
        raise ConfigurationError(f"{question} was not answered with one of {', '.join(names)}.")

    def needed(self, key: str, question: str) -> str:
        """An answer that only the person knows: there is no default, and empty is asked again."""
        for _ in range(5):
            if answer := self.text(key, question):
                return answer
            self.tell("It is needed: look at the data sheet, or leave with Ctrl-C.")
        raise ConfigurationError(f"{question} was not answered.")

    def figure(self, key: str, question: str) -> str:
        """A number that only the person knows, of either sign, as it was written."""
        for _ in range(5):
            answer = self.needed(key, question).replace(",", ".")
            with suppress(ValueError):
                if math.isfinite(float(answer)):
                    return answer
            self.tell(f"{answer!r} is no number: write it without its unit.")
            self.answers.pop(key)
        raise ConfigurationError(f"{question} was not answered with a number.")

    def number(self, key: str, question: str, default: str = "", least: float = 0.0) -> float | None:
        """A number above `least`; None where nothing was said."""
        for _ in range(5):
            answer = self.text(key, question, default)
            try:
                value = float(answer.replace(",", ".")) if answer else None
            except ValueError:
                value = least
            if value is None or least < value < 1e15:
                return value
            self.tell(f"{answer!r} is no number above {least:g}.")
            self.answers.pop(key)
        raise ConfigurationError(f"{question} was not answered with a number.")
