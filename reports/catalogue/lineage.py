"""What a file was made from and what was made from it, as a graph of the files that a catalogue found.

A file is found by the content hash that another states, whatever it is called today. Where no file has that
content, this is said, and no other file is taken for it.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple

from .entry import Entry, Source, stated

_SEVERAL = 5
"""Files of one kind with the same neighbours that are drawn as one."""
_HOLDERS = ("button", "learning", "waveforms")
"""Kinds that are named by what they hold, in the order in which they are taken."""


class Member(NamedTuple):
    """A file of a node."""

    name: str
    file: str
    """Absolute path; empty for what no file here is."""
    note: str
    """What is to be said of it, as a clause: that it is missing, was renamed, or is here more than once."""


@dataclass(frozen=True)
class Node:
    """A file, or several of one kind with the same neighbours."""

    kind: str
    level: int
    """Column: the first is 0, and each node stands to the right of what it was made from."""
    members: tuple[Member, ...]
    here: bool
    """True for the file that was asked for."""


@dataclass(frozen=True)
class Lineage:
    """Nodes, each behind what it was made from, and pairs of numbers: the second was made from the first."""

    nodes: tuple[Node, ...]
    edges: tuple[tuple[int, int], ...]


def lineage(entries: Sequence[Entry], file: str) -> Lineage:
    """What a file was made from, and what was made from it, both as far as files say.

    `entries` are all files of a folder (`list_files`), `file` is the absolute path of one of them. A file
    that is not among them has no nodes.
    """
    found = _Files(entries, file)
    own = found.keys.get(file)
    if own is None:
        return Lineage((), ())
    after: dict[str, set[str]] = defaultdict(set)
    for key, some in found.by_key.items():
        for source in found.before(stated(some[0].made_from)):
            after[source].add(key)
    before = _turned(after)
    shown = _reached(own, before) | _reached(own, after)
    inside = {key: after[key] & shown for key in shown}
    levels = _levels(inside)
    groups: dict[tuple[object, ...], list[str]] = defaultdict(list)
    named = sorted(shown, key=lambda key: (found.kind(key), found.member(key).name, key))
    for key in _ordered(named, before):
        near = frozenset(inside[key]), frozenset(before.get(key, set()) & shown)
        groups[found.kind(key), key if key == own else near].append(key)
    parts = [
        part
        for group in groups.values()
        for part in ([group] if len(group) >= _SEVERAL else [[key] for key in group])
    ]
    numbers = {key: number for number, part in enumerate(parts) for key in part}
    nodes = tuple(
        Node(found.kind(part[0]), levels[part[0]], tuple(map(found.member, part)), own in part)
        for part in parts
    )
    edges = {(numbers[key], numbers[one]) for key in shown for one in inside[key]}
    return Lineage(nodes, tuple(sorted(edges)))


class _Files:
    """Files by what they hold, copies together, and what is missing, by a key for each."""

    def __init__(self, entries: Sequence[Entry], own: str) -> None:
        self.own = own
        self.entries = entries
        self.by_key: dict[str, list[Entry]] = defaultdict(list)
        for one in entries:
            self.by_key[f"{one.kind} {one.content_hash or one.file}"].append(one)
        self.keys = {one.file: key for key, some in self.by_key.items() for one in some}
        self.holders: dict[str, list[str]] = defaultdict(list)
        for kind in _HOLDERS:
            for key, some in self.by_key.items():
                if some[0].kind == kind:
                    for content in some[0].holds.split():
                        self.holders[content].append(key)
        self.missing: dict[str, Source] = {}
        self.named: dict[str, str] = {}
        """The name of a file when it was used."""

    def before(self, sources: Iterable[Source]) -> set[str]:
        """Keys of sources; of one that is no file itself, those of what it was made from."""
        found: set[str] = set()
        for one in sources:
            if key := self._key(one):
                found.add(key)
            elif one.sources:
                found |= self.before(one.sources)
            elif one.kind != "waveforms":  # which are kept beside a calibration, or not
                key = f"missing {one.content or one.name}"
                if not self.missing.setdefault(key, one).name:
                    self.missing[key] = one
                found.add(key)
        return found

    def _key(self, one: Source) -> str | None:
        if not one.content:
            return self.keys.get(one.name)
        if one.kind == "map":
            fitted = f"modes-{one.content}.h5"
            maps = (e.file for e in self.entries if e.kind == "map" and (Path(e.file) / fitted).is_file())
            return self.keys.get(next(maps, ""))
        key = f"{one.kind} {one.content}"
        if key in self.by_key:
            self.named.setdefault(key, one.name if one.kind == "recording" else "")
            return key
        kinds = ("waveforms",) if one.kind == "waveforms" else _HOLDERS[:2]
        return next((k for k in self.holders[one.content] if k.split()[0] in kinds), None)

    def kind(self, key: str) -> str:
        return self.missing[key].kind if key in self.missing else self.by_key[key][0].kind

    def member(self, key: str) -> Member:
        if key in self.missing:
            return self._absent(self.missing[key])
        files, then = [Path(one.file) for one in self.by_key[key]], self.named.get(key, "")
        chosen = min(
            files, key=lambda path: (str(path) != self.own, path.name != then, len(path.parts), path)
        )
        said = [f"called {then} when it was used"] if then and chosen.name != then else []
        copies = sorted(str(path) for path in files if path != chosen)
        said += [f"the same contents are in {', '.join(copies)}"] if copies else []
        name = chosen.parent.name if chosen.suffix == ".toml" else chosen.name
        return Member(name, str(chosen), "; ".join(said))

    def _absent(self, one: Source) -> Member:
        name = Path(one.name).name if not one.content else one.name
        stated_hash = f" (content {one.content[:12]}…)" if one.content else ""
        if one.kind == "original":
            return Member(name, "", f"imported; a file of another program{stated_hash}")
        if one.kind == "calibrations":
            return Member(name, "", f"one hash over several, which names no single file{stated_hash}")
        other = [e for e in self.entries if Path(e.file).name == name and e.kind in (one.kind, "damaged")]
        if other:
            damaged = all(e.kind == "damaged" for e in other)
            what = "is damaged" if damaged else "has other contents"
            return Member(name, "", f"{other[0].file} {what}; those that were used{stated_hash} are not here")
        return Member(name or f"a {one.kind}", "", f"not in this folder{stated_hash}")


def _turned(edges: Mapping[str, set[str]]) -> dict[str, set[str]]:
    turned: dict[str, set[str]] = defaultdict(set)
    for first, seconds in edges.items():
        for second in seconds:
            turned[second].add(first)
    return turned


def _reached(start: str, edges: Mapping[str, set[str]]) -> set[str]:
    found, next_ones = {start}, [start]
    while next_ones:
        next_ones = [key for one in next_ones for key in edges.get(one, set()) - found]
        found |= {*next_ones}
    return found


def _ordered(keys: Sequence[str], before: Mapping[str, set[str]]) -> list[str]:
    """Keys, each as soon as all that it was made from has come: what belongs together stands together."""
    order, ranks = dict[str, None](), {key: rank for rank, key in enumerate(keys)}

    def visit(key: str) -> None:
        for one in sorted(before.get(key, set()) & ranks.keys(), key=ranks.__getitem__):
            if one not in order:
                visit(one)
        order[key] = None

    used = {one for key in keys for one in before.get(key, ())}
    for key in keys:
        if key not in used:
            visit(key)
    return [*order]


def _levels(after: Mapping[str, set[str]]) -> dict[str, int]:
    """Of each key: right of all that it was made from; what was made from nothing, next to its use."""
    before, levels = _turned(after), dict[str, int]()

    def level(key: str) -> int:
        if key not in levels:
            levels[key] = 1 + max(map(level, before.get(key, set())), default=-1)
        return levels[key]

    for key in after:
        level(key)
    for key in after:
        if not before.get(key) and after[key]:
            levels[key] = min(levels[one] for one in after[key]) - 1
    return levels
