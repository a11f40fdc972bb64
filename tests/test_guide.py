"""What docs/adding-an-instrument.md shows is the example package, word by word."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
EXAMPLE = ROOT / "examples" / "haploop-acme-relay"
GUIDE = (ROOT / "docs" / "adding-an-instrument.md").read_text(encoding="utf-8")
BLOCKS = re.findall(r"^```\w+\n# (\S+)\n(.*?)^```$", GUIDE, re.MULTILINE | re.DOTALL)


def test_the_guide_shows_every_file() -> None:
    files = {name for name, _ in BLOCKS}
    assert files == {
        "pyproject.toml",
        "acme.toml",
        "haploop_acme/relay.py",
        "haploop_acme/twin.py",
        "tests/test_acme_relay.py",
    }


@pytest.mark.parametrize(("name", "block"), BLOCKS)
def test_a_block_is_in_the_example(name: str, block: str) -> None:
    assert block in (EXAMPLE / name).read_text(encoding="utf-8")


def test_driver_and_twin_are_short() -> None:
    texts = [
        (EXAMPLE / "haploop_acme" / name).read_text(encoding="utf-8") for name in ("relay.py", "twin.py")
    ]
    assert sum(len(text.splitlines()) for text in texts) < 100
