"""Whether what varies between sessions, groups and orders is balanced."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from math import lcm

from ...acquisition import williams_row
from .experiment_file import ExperimentFile
from .steps import counterbalanced_count, group_of_slot


@dataclass(frozen=True)
class Balance:
    """How the participants so far fill the design."""

    groups: Mapping[str, int]
    """Participants in each group."""
    balanced: bool
    """True when groups are equally large and each counterbalanced order is used equally often."""
    multiple_of: int
    """A number of participants that is balanced is a multiple of this."""


def balance_of(file: ExperimentFile, slots: Sequence[int]) -> Balance:
    """Balance of the participants that have these places in the design."""
    groups = Counter(group_of_slot(file, slot) for slot in slots)
    counts = [counterbalanced_count(file, block) for block in file.block]
    orders = [Counter(tuple(williams_row(count, slot)) for slot in slots) for count in counts if count]
    numbers = [_orders(count) for count in counts if count]
    used = [[groups[name] for name in file.groups]]
    used += [[*some.values(), *[0] * (n - len(some))] for some, n in zip(orders, numbers, strict=True)]
    return Balance(
        {name: groups[name] for name in file.groups},
        all(len(set(some)) == 1 for some in used),
        lcm(len(file.groups), *numbers),
    )


def _orders(count: int) -> int:
    """Number of different rows of the square: Williams' design needs twice as many for an odd count."""
    return len({tuple(williams_row(count, row)) for row in range(2 * count)})
