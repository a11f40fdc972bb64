"""What docs/how-to/adding-an-instrument.md shows is the example package, word by word."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
EXAMPLE = ROOT / "examples" / "haploop-acme-relay"
ROLES = ROOT / "examples" / "haploop-acme-thermometer"
GUIDE = (ROOT / "docs" / "how-to" / "adding-an-instrument.md").read_text(encoding="utf-8")
DRIVER_PART, ROLE_PART = GUIDE.split("## Adding a role")


def shown(guide: str) -> list[tuple[str, str]]:
    """The blocks that begin with a file's name: the name, and the rest."""
    return re.findall(r"^```\w+\n# (\S+)\n(.*?)^```$", guide, re.MULTILINE | re.DOTALL)


BLOCKS = shown(DRIVER_PART)


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


@pytest.mark.parametrize(("name", "block"), shown(ROLE_PART))
def test_a_block_is_in_the_example_with_roles(name: str, block: str) -> None:
    assert block in (ROLES / name).read_text(encoding="utf-8")


def test_a_role_with_driver_and_twin_is_short() -> None:
    texts = [path.read_text(encoding="utf-8") for path in (ROLES / "haploop_acme_thermometer").glob("*.py")]
    assert sum(len(text.splitlines()) for text in texts) < 200


def test_driver_and_twin_are_short() -> None:
    texts = [
        (EXAMPLE / "haploop_acme" / name).read_text(encoding="utf-8") for name in ("relay.py", "twin.py")
    ]
    assert sum(len(text.splitlines()) for text in texts) < 100
