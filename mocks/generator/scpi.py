"""Parser of an instrument that speaks SCPI: long and short headers, an error queue, common commands.

It follows SCPI-99 and IEEE 488.2 as instruments implement them: any case, an optional leading colon,
numeric suffixes, and several commands on a line, each relative to the one before it.
"""

from __future__ import annotations

import re
from collections import deque
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from ...base.arrays import FloatArray

_QUEUE = 20
"""Capacity of the error queue (docs/hardware.md, "Generators")."""
_SUFFIXES = {
    "HZ": ("HZ", "KHZ", "MHZ"),
    "S": ("S", "MS", "US"),
    "V": ("V", "MV", "VPP", "MVPP", "VRMS", "MVRMS", "DBM"),
    "DEG": ("DEG", "RAD", "S", "MS", "US"),
}
"""Units of each kind of quantity."""
_UNITS = {
    "": 1.0, "HZ": 1.0, "KHZ": 1e3, "MHZ": 1e6, "V": 1.0, "MV": 1e-3, "VPP": 1.0, "MVPP": 1e-3,
    "VRMS": 1.0, "MVRMS": 1e-3, "RAD": 1.0, "DBM": 1.0,
    "S": 1.0, "MS": 1e-3, "US": 1e-6, "OHM": 1.0, "KOHM": 1e3, "DEG": 1.0,
    "PCT": 1.0, "SA/S": 1.0, "KSA/S": 1e3, "MSA/S": 1e6,
}  # fmt: skip


_REGISTERS = ("OPER", "QUES")
_STATUS = re.compile(
    r":?STAT(?:US)?:(?:(?P<preset>PRES(?:ET)?)|(?P<which>OPER(?:ATION)?|QUES(?:TIONABLE)?)"
    r"(?::(?P<what>COND(?:ITION)?|ENAB(?:LE)?|EVEN(?:T)?))?)"
)
_BLOCK = re.compile(r"(?<=[, ])#([1-9])")


class ScpiError(Exception):
    """An entry of the error queue."""

    def __init__(self, number: int, text: str) -> None:
        super().__init__(number, text)
        self.number, self.text = number, text


Fail = Callable[[ScpiError], None]
"""Puts an error into the queue; the command goes on."""


@dataclass(frozen=True)
class Entry:
    """Actions of a header; each gets the header's numeric suffix (1 without one) and the argument."""

    get: Callable[[int, str], str] | None = None
    """Answer a query; the argument is usually empty."""
    put: Callable[[int, str], None] | None = None
    """Apply a setting. Raises ScpiError for a wrong argument."""


class ScpiDevice:
    """One instrument. `entries` maps headers, written as in manuals (`[:SOURce#]:FREQuency[:CW]`)."""

    def __init__(
        self,
        identity: str,
        entries: Mapping[str, Entry],
        reset: Callable[[], None],
        trigger: Callable[[], None],
        plus: bool = True,
    ) -> None:
        self.identity = identity
        self.errors: deque[ScpiError] = deque()
        self._entries = [(_pattern(header), entry) for header, entry in entries.items()]
        self._reset = reset
        self._trigger = trigger
        self._no_error = f'{"+" if plus else ""}0,"No error"'
        self._blocks: list[bytes] = []
        """Blocks of binary data of the line that is executed."""
        self._save: Callable[[int], None] | None = None
        self._recall: Callable[[int], None] | None = None
        self._registers = dict.fromkeys(_REGISTERS, 0)
        self._events = 0
        self._enabled = {"*ESE": 0, "*SRE": 0}

    def answer(self, line: str) -> Sequence[str]:
        """Execute a line of commands; return one line with the answers to all its queries, or none."""
        replies: list[str] = []
        path = ""
        try:
            line, self._blocks = _without_blocks(line)
        except ValueError:
            self.fail(ScpiError(-161, "Invalid block data"))
            return []
        for part in _split(line):
            try:
                reply, path = self._execute(part.strip(), path)
            except ScpiError as error:
                self.fail(error)
                break  # The rest of a line is dropped after an error.
            if reply is not None:
                replies.append(reply)
        return [";".join(replies)] if replies else []

    def keeping(self, save: Callable[[int], None], recall: Callable[[int], None]) -> None:
        """Let `*SAV` and `*RCL` call these with a place, 0 to 4."""
        self._save, self._recall = save, recall

    def numbers_in(self, text: str, kind: str) -> FloatArray:
        """Numbers separated by commas, or a block of binary data of numpy's type `kind`. Raises ScpiError."""
        text = text.strip()
        if found := re.fullmatch(r"#(\d+)", text):
            block = self._blocks[int(found[1])]
            if len(block) % np.dtype(kind).itemsize:
                raise ScpiError(-161, "Invalid block data")
            return np.frombuffer(block, kind).astype(np.float64)
        try:
            return np.array([float(value) for value in text.split(",")] if text else [], np.float64)
        except ValueError:
            raise ScpiError(-104, "Data type error") from None

    def fail(self, error: ScpiError) -> None:
        """Queue an error; the last entry of a full queue becomes a queue overflow."""
        self._events |= 0x20 if error.number > -200 else 0x10
        if len(self.errors) < _QUEUE:
            self.errors.append(error)
        else:
            self.errors[-1] = ScpiError(-350, "Queue overflow")

    def _execute(self, part: str, path: str) -> tuple[str | None, str]:
        if not part:
            return None, path
        header, argument = (*part.split(maxsplit=1), "")[:2]  # any white space separates (IEEE 488.2, 7.4.1)
        header, argument = header.upper(), argument.strip()
        asked = header.endswith("?")
        if header.startswith("*"):
            return self._common(header, argument), path
        name = header.rstrip("?")
        if status := _STATUS.fullmatch(name):
            return self._status(status, asked, argument), path
        # Tolerant: try the header relative to the command before it, then from the root.
        for full in [name] if name.startswith(":") else [f"{path}:{name}", f":{name}"]:
            for pattern, entry in self._entries:
                if found := pattern.fullmatch(full):
                    suffix = next((int(g) for g in found.groups() if g), 1)
                    return self._use(entry, asked, suffix, argument), full.rpartition(":")[0]
        raise ScpiError(-113, "Undefined header")

    def _use(self, entry: Entry, asked: bool, suffix: int, argument: str) -> str | None:
        if asked and entry.get:
            return entry.get(suffix, argument)
        if asked or entry.put is None:
            raise ScpiError(-113, "Undefined header")
        entry.put(suffix, argument)
        return None

    @staticmethod
    def _keep(step: Callable[[int], None] | None, argument: str) -> None:
        place = number_of(argument)
        if step is None or place not in range(5):
            raise ScpiError(-222, "Data out of range")
        step(int(place))

    def _status(self, found: re.Match[str], asked: bool, argument: str) -> str | None:
        """SCPI's status registers: nothing is questionable here, and each command is done at once."""
        if found["preset"]:
            self._registers = dict.fromkeys(_REGISTERS, 0)
            return None
        register = "OPER" if found["which"].startswith("OPER") else "QUES"
        if (found["what"] or "").startswith("ENAB"):
            if asked:
                return str(self._registers[register])
            self._registers[register] = int(number_of(argument)) & 0x7FFF
            return None
        if not asked:
            raise ScpiError(-113, "Undefined header")
        return "0"

    def next_error(self) -> str:
        """Remove the oldest error from the queue and return it as the instrument writes it."""
        if not self.errors:
            return self._no_error
        error = self.errors.popleft()
        return f'{error.number},"{error.text}"'

    def _common(self, header: str, argument: str) -> str | None:
        if header in (constant := {"*IDN?": self.identity, "*OPC?": "1", "*TST?": "0", "*OPT?": "0"}):
            return constant[header]
        match header:
            case "*ESR?":
                events, self._events = self._events, 0
                return str(events)
            case "*STB?":
                return str(0x04 * bool(self.errors) + 0x20 * bool(self._events & self._enabled["*ESE"]))
            case "*ESE?" | "*SRE?":
                return str(self._enabled[header[:-1]])
            case "*ESE" | "*SRE":
                self._enabled[header] = int(number_of(argument))
            case "*CLS":
                self.errors.clear()
                self._events = 0
            case "*RST":
                self._reset()
            case "*TRG":
                self._trigger()
            case "*OPC":
                self._events |= 0x01
            case "*SAV" | "*RCL":
                self._keep(self._save if header == "*SAV" else self._recall, argument)
            case _ if header != "*WAI":  # every command here completes at once
                raise ScpiError(-113, "Undefined header")
        return None


def unit_of(argument: str) -> str:
    """Return the unit at the end of an argument, in capitals; empty without one."""
    found = re.search(r"[\d.]\s*([A-Za-z/]+)$", argument)
    return found[1].upper() if found else ""


def number_of(argument: str, special: Mapping[str, float] | None = None, kind: str = "") -> float:
    """Parse a number with or without a unit, or one of `special` (MINimum, INFinity).

    A unit is one of the quantity's `kind` ("HZ", "S", "V", "DEG"), or any where it is empty. Raises
    ScpiError.
    """
    for name, value in (special or {}).items():
        if re.fullmatch(_keyword(name), argument.upper()):
            return value
    found = re.fullmatch(r"([+-]?(?:\d+\.?\d*|\.\d+)(?:[eE][+-]?\d+)?)\s*([A-Za-z/]*)", argument)
    if found is None:
        raise ScpiError(-104, "Data type error") if argument else ScpiError(-109, "Missing parameter")
    unit = found[2].upper()
    if unit not in _UNITS or (unit and kind and unit not in _SUFFIXES[kind]):
        raise ScpiError(-131, "Invalid suffix")
    return float(found[1]) * _UNITS[unit]


def word_of(argument: str, words: Sequence[str]) -> str:
    """Return the short form of the keyword among `words` (`LINear`) that matches. Raises ScpiError."""
    if not argument:
        raise ScpiError(-109, "Missing parameter")
    for word in words:
        if re.fullmatch(_keyword(word), argument.upper()):
            return _short(word)
    raise ScpiError(-224, "Illegal parameter value")


def _short(word: str) -> str:
    return re.sub(r"[a-z]+", "", word)


def _keyword(word: str) -> str:
    short = _short(word)
    return f"{short}(?:{word[len(short) :].upper()})?"


def _pattern(header: str) -> re.Pattern[str]:
    groups = header.replace("[", "(?:").replace("]", ")?")
    return re.compile(
        re.sub(r"([A-Z]+[a-z]*)(#?)", lambda m: _keyword(m[1]) + (r"(\d*)" if m[2] else ""), groups)
    )


def _without_blocks(line: str) -> tuple[str, list[bytes]]:
    """A line whose blocks of binary data (`#42000...`) are replaced by their numbers (`#0`), and the blocks.

    Raises ValueError for a block that is not whole.
    """
    blocks: list[bytes] = []
    kept, at = "", 0
    while found := _BLOCK.search(line, at):
        begin = found.end() + int(found[1])
        length = int(line[found.end() : begin])
        if len(line) < begin + length:
            raise ValueError("a block that is not whole")
        kept += f"{line[at : found.start()]}#{len(blocks)}"
        blocks.append(line[begin : begin + length].encode("latin-1"))
        at = begin + length
    return kept + line[at:], blocks


def _split(line: str) -> list[str]:
    """Split a line into its commands, except at semicolons within quotes."""
    return re.findall(r"(?:\"[^\"]*\"|'[^']*'|[^;\"'])+|[\"']", line)
