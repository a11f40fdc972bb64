"""Rows of the one table of `benchmarks/all.py`: what was measured, beside what a user would pick instead."""

from __future__ import annotations

import hashlib
from collections.abc import Sequence
from dataclasses import dataclass
from statistics import mean, median

__all__ = ["Row", "markdown", "ranged", "ratios", "seeds_of"]


@dataclass(frozen=True)
class Row:
    """One figure. `ratios` are ours over the peer's, one for each round in which both had their turn."""

    what: str
    ours: Sequence[float]
    """One for each round, in `unit`."""
    unit: str = ""
    peer: str = ""
    ratios: Sequence[float] = ()
    goal: str = ""
    more: bool = False
    """True where a larger figure is better."""


def ratios(ours: Sequence[float], theirs: Sequence[float]) -> list[float]:
    """Ours over theirs, round by round."""
    # Less the noise, an error may be 0.
    return [a / b if b else float("inf") for a, b in zip(ours, theirs, strict=True)]


def markdown(rows: Sequence[Row]) -> str:
    """The table. Arrows say which way is better."""
    lines = [
        "| what | haploop | beside | ratio, median | range | rounds | goal |",
        "|---|---|---|---|---|---|---|",
    ]
    for row in rows:
        arrow = "\N{UPWARDS ARROW}" if row.more else "\N{DOWNWARDS ARROW}"
        of = f"{_figure(median(row.ratios))} {arrow}" if row.ratios else ""
        spread = f"{_figure(min(row.ratios))} to {_figure(max(row.ratios))}" if row.ratios else ""
        if not row.ratios and len(row.ours) > 1:
            spread = f"{_figure(min(row.ours))} to {_figure(max(row.ours))} {row.unit}"
        ours = f"{_figure(median(row.ours))} {row.unit}".strip()
        lines.append(f"| {row.what} | {ours} | {row.peer} | {of} | {spread} | {len(row.ours)} | {row.goal} |")
    return "\n".join(lines)


def _figure(value: float) -> str:
    """Three digits, without an exponent."""
    return f"{value:,.0f}" if abs(value) >= 100 else f"{value:.3g}"


def seeds_of(word: str, first: int, count: int) -> list[int]:
    """Seeds that nobody chose: hashes of a word and a number."""
    hashed = (hashlib.sha256(f"{word} {number}".encode()) for number in range(first, first + count))
    return [int.from_bytes(one.digest()[:3]) for one in hashed]


def ranged(values: Sequence[float]) -> str:
    """Mean, and the range in brackets."""
    return f"{mean(values):.1f} ({min(values):.1f} to {max(values):.1f})"
