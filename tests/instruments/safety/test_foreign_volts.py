"""What somebody else has left on an output does not reach a patch when a contact closes."""

from contextlib import suppress
from typing import Any

import numpy as np
import pytest

from haploop.base.errors import InstrumentError
from haploop.instruments import Rig, Sweep, open_rig
from haploop.instruments.safety.audit import entries
from tests.instruments.safety.at_the_patch import bursts
from tests.instruments.safety.foreign import held, leave
from tests.instruments.safety.test_limiter import TONE, generator_rig
from tests.raising import raises

OUTPUTS = ("amplifier", "amplifier_b", "amplifier_c", "amplifier_d")
MODES = pytest.mark.parametrize("mode", ["twin", "wire"])


def reached(rig: Rig) -> float:
    """The largest volts that any patch has got."""
    rig.clock.sleep(0.05)
    rig.simulation.plant.advance(rig.clock.now())
    return float(rig.simulation.truth.peak)


@MODES
def test_volts_left_on_any_output_are_gone_before_a_contact_closes(mode):
    with open_rig("four-channel", simulate=mode) as rig:
        for output, volts in zip(OUTPUTS, (8.0, -8.0, 2.5, 10.0), strict=True):
            leave(rig, output, volts)
            assert rig.daq.outputs_read()[output] == pytest.approx(volts, abs=2e-3)
        rig.relay.connect(rig.relay.patches)
        assert reached(rig) < 0.1
        assert max(map(abs, rig.daq.outputs_read().values())) < 2e-3


@pytest.mark.parametrize(
    ("mode", "output"), [("twin", OUTPUTS[3]), ("wire", OUTPUTS[0]), ("wire", OUTPUTS[3])]
)
def test_an_output_that_another_program_holds_keeps_every_contact_open(mode, output):
    with open_rig("four-channel", simulate=mode) as rig:
        with held(rig, output, 8.0):
            with pytest.raises(InstrumentError, match=r"relay stays open.*not known to be at zero.*-50103"):
                rig.relay.connect(["A"])
            with suppress(InstrumentError):  # nor is the safe state confirmed, and it says so
                rig.excite_each({"A": TONE}, ["drive"])
            assert not rig.simulation.truth.closed and reached(rig) == 0
        assert [e["kind"] for e in entries(rig.audit.folder)].count("refused") == 2
        rig.excite_each({"A": TONE}, ["drive"])
        assert reached(rig) == pytest.approx(10, rel=0.03)


@MODES
def test_an_output_that_does_not_take_its_zero_keeps_the_contacts_open(mode, monkeypatch):
    with open_rig("simulated", simulate=mode) as rig:
        leave(rig, "amplifier", 8.0)
        with monkeypatch.context() as patch:
            patch.setattr(rig.daq, "hold", lambda: None)  # it says that it did
            raises(InstrumentError, r"'amplifier' was set to zero and reads 8 V", rig.relay.connect, ["A"])
        assert not rig.simulation.truth.closed and reached(rig) == 0


@pytest.mark.usefixtures("unproved")
@MODES
def test_plays_begin_from_zero_whatever_was_left(mode):
    with open_rig("simulated", simulate=mode) as rig:
        record = rig.simulation.truth.record()
        leave(rig, "amplifier", 8.0)
        rig.excite(TONE, ["A"], ["drive"])
    (burst,) = bursts(record)
    assert burst.high == pytest.approx(10, rel=0.03)


def on(rig: Rig) -> None:
    """A person has switched the generator's output on, at its front panel."""
    line = rig.generator._line
    line.send("FUNC SIN;:FREQ 100;:VOLT 16;:OUTP ON")
    assert rig.generator.is_on


@pytest.mark.parametrize("way", [
    lambda rig: rig.relay.connect(["A"]),
    lambda rig: rig.generate(Sweep(10, 300, 0.1, 20), ["A"], ["drive"]),
])  # fmt: skip
def test_a_generator_that_was_left_on_keeps_the_contacts_open(way):
    with open_rig(generator_rig()) as rig:
        on(rig)
        raises(InstrumentError, r"is on, and this rig has not started it", way, rig)
        assert reached(rig) == 0
        rig.make_safe()
        rig.generate(Sweep(10, 300, 0.1, 20), ["A"], ["drive"])
        assert reached(rig) == pytest.approx(20, rel=0.05)


def test_a_player_starts_from_outputs_at_zero():
    with open_rig("sound-card", simulate="twin") as rig:
        stopped = []
        stop = rig.player.stop
        rig.player.stop = lambda: (stopped.append(rig.relay.connected()), stop())
        leave(rig, "amplifier", 8.0)
        rig.excite(np.pad(TONE, 100), ["A"], ["drive"])
        assert stopped[0] == frozenset()


def test_a_stream_keeps_its_card_until_its_tasks_are_closed(monkeypatch):
    """Outputs were read of a card whose inputs were still reserved, and the rig said "in use" (-50103)."""
    with open_rig("haptable", simulate="wire") as rig:
        stream = rig.daq.stream(["laser"], 50_000, 500, samples=5_000)
        read: list[Any] = []
        zero = type(rig.daq).zero

        def zeroed(daq: Any) -> None:
            read.append(daq.outputs_read())
            zero(daq)

        monkeypatch.setattr(type(rig.daq), "zero", zeroed)
        stream.close()
        monkeypatch.undo()
        assert read == [{}] and list(rig.daq.outputs_read()) == ["amplifier"]
