"""A TOML file that describes one thing, as a validated model."""

from __future__ import annotations

from functools import partial
from pathlib import Path
from typing import TypeVar

from pydantic import BaseModel

from ...base.toml_lines import key_lines, parse_toml, place, read_text
from ...base.validation import validate

Model = TypeVar("Model", bound=BaseModel)


def load_model(path: Path, model: type[Model], absent: str) -> Model:
    """Read and validate a file; `absent` says what to do when there is none.

    Raises ConfigurationError: file, line, key, and what is wrong.
    """
    text = read_text(path, absent)
    return validate(model, parse_toml(text, path), partial(place, [(str(path), key_lines(text))]))
