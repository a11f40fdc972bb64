"""The text of a file, and what one of its cells holds: nothing, a number, or a number with its unit."""

from __future__ import annotations

import codecs
import math
import re
from pathlib import Path

from ...base.errors import DataError
from .units import units_of

_GROUPED = r"[1-9]\d{0,2}(?:,\d{3})+\.\d*"
"""A number with its thousands apart, and a point that says which sign is which."""
_POINT = re.compile(rf"\s*[-+]?\s*(?:{_GROUPED}|\d+\.?\d*|\.\d+)(?:[eEdD][-+]?\d+)?\s*\Z")
_COMMA = re.compile(r"\s*[-+]?\s*(?:[1-9]\d{0,2}(?:\.\d{3})+,\d*|\d+(?:,\d+)?|,\d+)(?:[eEdD][-+]?\d+)?\s*\Z")
_MEASURED = re.compile(
    r"\s*(?P<number>[-+]?\d[\d.,]*(?:[eE][-+]?\d+)?)(?P<space>\s*)(?P<unit>[^\s\d.,:;+-].{0,15}?)\s*\Z"
)
_BLANKS = {"", *"- -- --- nan na n/a #n/a #nv null none 1.#qnan -1.#ind inf -inf".split()}  # noqa: SIM905
_BLANKS |= {"#div/0!", "#num!", "#zahl!", "#value!", "#wert!", "#ref!", "#bezug!", "#name?"}


def decoded(path: Path) -> str:
    """Text in UTF-8, UTF-16 with its mark, or Windows-1252, as spreadsheets write. Raises DataError.

    A minus sign (U+2212) and blanks between thousands (U+00A0, U+202F), of some languages, become plain.
    """
    text = _decoded(path)
    if "\u2212" in text:
        text = text.replace("\u2212", "-")
    if "\u00a0" in text or "\u202f" in text:
        text = re.sub("(?<=\\d)[\u00a0\u202f](?=\\d{3}(?!\\d))", "", text)
    return text


def _decoded(path: Path) -> str:
    raw = path.read_bytes()
    try:
        if raw.startswith((codecs.BOM_UTF16_LE, codecs.BOM_UTF16_BE)):
            return raw.decode("utf-16")
        if b"\0" in raw[:4096]:
            raise DataError(f"{path} is no text: say what it is (--from).")
        return raw.decode("utf-8-sig").replace("\r\r\n", "\n")  # written twice through a text mode
    except UnicodeDecodeError:
        return raw.decode("cp1252", errors="replace")


def is_blank(cell: str) -> bool:
    """True for a cell without a value."""
    return cell.strip().lower() in _BLANKS


def is_number(cell: str, decimal: str = ".") -> bool:
    """True for a number with this decimal sign."""
    if decimal == "." and "_" not in cell:
        try:  # most cells, quickly
            return math.isfinite(float(cell))
        except ValueError:
            pass
    return (_COMMA if decimal == "," else _POINT).match(cell) is not None


def plain_number(cell: str, decimal: str) -> str:
    """As Python has it: a number of Fortran's, with blanks behind its sign, or with its thousands apart."""
    thousands = "," if decimal == "." else "."
    return cell.upper().replace("D", "E").replace(" ", "").replace(thousands, "").replace(decimal, ".")


def measured(cell: str, decimal: str = ".") -> tuple[str, str] | None:
    """Number and unit of a cell that holds both, as `2.31 N`; None for another. `2A` may be a name."""
    match = _MEASURED.match(cell)
    if match is None or not is_number(match["number"], decimal) or not units_of(match["unit"]):
        return None
    told = match["space"] or len(match["unit"]) > 1 or decimal in match["number"]
    return (match["number"], match["unit"]) if told else None
