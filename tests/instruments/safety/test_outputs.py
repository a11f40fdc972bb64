"""What is at zero, and known to be, before a contact closes; and what was played, by hand."""

import os
from types import SimpleNamespace
from typing import Any

import pytest

from haploop.base.errors import DataError, InstrumentError
from haploop.base.json_files import as_file
from haploop.instruments.safety import Outputs, machine
from haploop.instruments.safety.duty import clear_old, count_plays, plays_of
from tests.raising import raises, raising


class Rig(dict[str, Any]):
    """Instruments that tell what was done to them."""

    def __init__(self, fed: Any = "one", **standing: float) -> None:
        self.done: list[str] = []
        inputs = fed if isinstance(fed, dict) else {}
        super().__init__(
            daq=SimpleNamespace(
                hold=lambda: self.done.append("zero"),
                let_go=lambda: self.done.append("let go"),
                outputs_read=lambda: standing,
            ),
            amplifier=SimpleNamespace(input="" if inputs else fed, inputs=inputs),
        )

    def add(self, role: str, output: str, on: bool = False) -> None:
        stop = lambda: self.done.append(f"{role} stopped")  # noqa: E731
        self[role] = SimpleNamespace(output=output, is_on=on, identity=f"The {role}", stop=stop)


def test_outputs_are_set_to_zero_and_read_back():
    for volts in (0.0, 0.02, -0.02):
        rig = Rig(one=0.0, two=volts)
        Outputs(rig).rest()
        assert rig.done == ["zero"]
    for volts in (0.021, -0.021, float("nan"), 10.0):
        rig = Rig(one=0.0, two=volts)
        raises(InstrumentError, "the output 'two' was set to zero and reads", Outputs(rig).rest)
        assert rig.done == ["zero", "let go"]


def test_an_output_that_cannot_be_set_keeps_the_relay_open():
    rig = Rig()
    rig["daq"].hold = raising(InstrumentError("Dev2 is in use."))
    raises(InstrumentError, r"not known to be at zero volts: Dev2 is in use\.", Outputs(rig).rest)


@pytest.mark.parametrize("fed", ["one", {"A": "zero", "B": "one"}])
def test_what_feeds_the_amplifier_is_looked_at_and_stopped(fed):
    for output, wired in (("one", True), ("elsewhere", False)):
        rig = Rig(fed)
        rig.add("generator", output, on=True)
        rig.add("player", output)
        if wired:
            for look in (Outputs(rig).no_sweep, Outputs(rig).rest):
                raises(InstrumentError, "The generator is on, and this rig has not", look)
            rig["generator"].is_on = False
        Outputs(rig).no_sweep()
        assert not rig.done
        Outputs(rig).rest()
        assert rig.done == ["player stopped"] * wired + ["zero"]


def test_without_an_amplifier_every_output_counts():
    rig = Rig()
    del rig["amplifier"]
    rig.add("generator", "elsewhere", on=True)
    raises(InstrumentError, "is on", Outputs(rig).no_sweep)


# What was played


def test_plays_are_of_the_last_minute_and_of_any_piece_in_order(tmp_path):
    now = 1000.0
    count_plays(tmp_path, {"a"}, [(930.0, 940.0), (938.0, 940.5), (980.0, 990.0)])
    count_plays(tmp_path, {"b"}, [(937.0, 951.0), (980.0, 990.0)])
    assert plays_of(tmp_path, {"a", "b", "c"}, now) == [(938.0, 940.5), (937.0, 951.0), (980.0, 990.0)]
    assert plays_of(tmp_path, {"c"}, now) == []
    # Of a killed program, or of a clock that was set back: as if it had just ended.
    count_plays(tmp_path, {"a"}, [(995.0, 1005.0)])
    assert plays_of(tmp_path, {"a"}, now) == [(990.0, 1000.0)]


@pytest.mark.parametrize("content", [
    [[5.0, 4.0]], [[1.0]], [[1.0, 2.0, 3.0]], [["1", 2.0]], [[True, 2.0]], [None], {}, "x", 1.0, None,
    [[1.0, 2.0], 3], b"", b"[[1", b"{}", b"[[NaN, NaN]]", b"[" * 9999, b"\xff",
    as_file("lockout", [[1.0, 2.0]])[0].encode(),
])  # fmt: skip
def test_a_count_without_sense_is_a_full_minute_and_replaced_by_that(content, tmp_path):
    path = tmp_path / machine.file_for("a", "duty")
    path.write_bytes(content if isinstance(content, bytes) else as_file("duty", content)[0].encode())
    assert plays_of(tmp_path, {"a"}, 1000.0) == [(940.0, 1000.0)]
    assert plays_of(tmp_path, {"a"}, 1030.0) == [(940.0, 1000.0)]


def test_what_cannot_be_counted_is_said(tmp_path):
    (tmp_path / machine.file_for("a", "duty")).mkdir()
    raises(DataError, "What is played cannot be counted in", count_plays, tmp_path, {"a"}, [(1.0, 2.0)])


def test_counts_of_pieces_that_were_not_used_for_a_day_are_removed(tmp_path):
    now = 10.0**6
    for piece, age in (("old", 86_401), ("new", 86_399), ("of a longer uptime", -(10**5))):
        count_plays(tmp_path, {piece}, [(now - age - 1, now - age)])
        os.utime(tmp_path / machine.file_for(piece, "duty"), (0, 0))
    (tmp_path / "damaged.duty").touch()
    (tmp_path / "old.lockout").touch()
    clear_old(tmp_path, now)
    left = {path.name for path in tmp_path.iterdir()}
    kept = {machine.file_for(piece, "duty") for piece in ("new", "of a longer uptime")}
    assert left == {"damaged.duty", "old.lockout"} | kept
