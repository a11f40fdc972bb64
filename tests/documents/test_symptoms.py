"""What the page "When it does not work" quotes is what haploop says."""

import re

from tests.documents.pages import ROOT

ROOMS = ("instruments", "acquisition", "calibration", "exchange", "reports", "terminal", "console",
    "commands")  # fmt: skip
NOT_OURS = {"haploop: command not found"}


def test_each_sentence_that_is_quoted_is_said_by_the_code():
    page = (ROOT / "docs" / "how-to" / "when-it-does-not-work.md").read_text(encoding="utf-8")
    quoted = {one for row in re.findall(r"^\| (.*?) \|", page, re.M) for one in re.findall(r"`(.+?)`", row)}
    source = "\n".join(
        path.read_text(encoding="utf-8")
        for room in ROOMS
        for path in sorted((ROOT / room).rglob("*"))
        if path.suffix in (".py", ".js")
    )
    # Sentences go over several lines of the source, each a string of its own.
    source = re.sub(r'"\s+f?"', "", source)
    assert len(quoted) > 10
    assert [said for said in sorted(quoted - NOT_OURS) if said not in source] == []
