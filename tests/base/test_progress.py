"""One shape of progress: what is being done, how much of it, of how much, and in which unit."""

import numpy as np
import pytest

from haploop.base.progress import part_of, prefixed, silent
from haploop.instruments import open_rig
from haploop.terminal.progress import Steps


def test_a_play_is_told_in_seconds_up_to_its_end():
    told: list[tuple[str, float, float, str]] = []
    with open_rig("simulated") as rig:
        drive = np.zeros(round(0.25 * rig.table.rate_hz))
        rig.excite(drive, ["A"], ["drive"], tail=0.1, progress=lambda *what: told.append(what))
    assert {(doing, unit) for doing, _, _, unit in told} == {("Play into patch A", "s")}
    done = [done for _, done, _, _ in told]
    assert done == sorted(done) and len(done) > 2
    assert done[-1] == pytest.approx(0.35) and {total for _, _, total, _ in told} == {done[-1]}


def test_a_nested_step_says_where_it_belongs():
    told: list[tuple[object, ...]] = []

    def note(*what: object) -> None:
        told.append(what)

    prefixed(note, "latch-A")("Check", 1, 8, "plays")
    part_of(note, "Record", 10, 20)("P02, latch", 3, 10, "presses")
    part_of(note, "Record", 10, 20)("P02, latch", 11, 10, "presses")
    assert told == [
        ("latch-A: Check", 1, 8, "plays"),
        ("Record", 13, 20, "presses"),
        ("Record", 20, 20, "presses"),
    ]
    silent("Record", 1, 2, "presses")


def test_a_step_is_one_line_where_there_is_no_terminal(capsys):
    with Steps() as steps:
        steps("Check [/x]", 0, 8, "plays")
        steps("Check [/x]", 8, 8, "plays")
        steps("Report", 0, 1, "")
    assert capsys.readouterr().err == "Check [/x]\nReport\n"
