"""The serial relay board: its codec, and its lines through a socket."""

import math
import socket
from collections.abc import Iterator
from dataclasses import dataclass

import pytest

from haploop.base.clock import VirtualClock
from haploop.base.errors import ConfigurationError, InstrumentError
from haploop.instruments.relay.role import Relay
from haploop.instruments.relay.serial_relay import SerialRelay, answer_in
from haploop.mocks.relay import SimulatedBox, box_in
from haploop.mocks.relay.serial_relay import SerialRelayWire
from haploop.mocks.transport import Loopback, ReplyFault
from tests.instruments.relay.contacts import Contacts
from tests.raising import raises

PATCHES = {"A": 0, "B": 1, "D": 7}


@pytest.mark.parametrize(("received", "command", "answer"), [
    (b"relay on 3\n\r>", "relay on 3", ""),
    (b"relay read 3\n\ron\n\r>", "relay read 3", "on"),
    (b"relay read 3\r\noff\r\n>", "relay read 3", "off"),
    (b"\n\rver\n\r00000008\n\r>", "ver", "00000008"),
])  # fmt: skip
def test_answers_of_real_boards(received, command, answer):
    assert answer_in(received, command) == answer


@pytest.mark.parametrize("received", [
    b">",
    b"on\n\r>",
    b"relay read 4\n\ron\n\r>",
    b"relay read 3\n\ron\n\roff\n\r>",
    b"relay read 3\n\r\xff\n\r>",
    b"relay read 3\n\ron\n\r",
])  # fmt: skip
def test_what_is_no_answer_to_this_command_is_refused(received):
    raises(ValueError, "'", answer_in, received, "relay read 3")


@dataclass
class Setup:
    bench: Contacts
    box: SimulatedBox
    relay: Relay
    wire: SerialRelayWire


def settings(**changes: object) -> SerialRelay.Settings:
    return SerialRelay.Settings.model_validate(
        {"patches": PATCHES, "rating": 60, "port": "COM5", "timeout": 0.2, **changes}
    )


@pytest.fixture
def wired() -> Iterator[Setup]:
    bench = Contacts(PATCHES)
    box = box_in(bench, PATCHES, range(8))
    with SerialRelayWire(box) as board:
        relay = SerialRelay.open(settings(port=board.url), bench.clock)
        yield Setup(bench, box, relay, board)
        relay.close()


def test_says_that_it_cannot_open_by_itself(wired):
    assert wired.relay.dead_man == math.inf
    wired.relay.connect(["A"])
    wired.bench.clock.sleep(1000)
    wired.relay.renew()
    assert wired.bench.closed() == {"A"}


def test_close_frees_the_port(wired):
    wired.relay.close()
    raises(InstrumentError, "open the rig again", wired.relay.connected)
    again = SerialRelay.open(settings(port=wired.wire.url), wired.bench.clock)
    assert again.identity == f"The relay board at {wired.wire.url} (firmware 00000008)"
    again.close()


@pytest.mark.parametrize(("fault", "sentence"), [
    (ReplyFault("silence"), "did not answer .* within 0.2 s"),
    (ReplyFault("disconnect"), "cannot be talked to"),
    (ReplyFault("garbled"), "no such board does"),
    (ReplyFault("truncated"), "cannot be talked to|no such board does"),
    (ReplyFault("terminator"), "and no prompt, which no such board does"),
    (ReplyFault("drip", delay=0.15), "no such board does"),
], ids=lambda value: value.kind if isinstance(value, ReplyFault) else "")  # fmt: skip
def test_every_bad_answer_is_one_sentence_and_passes(wired, fault, sentence):
    wired.wire.faults.append(fault)
    raises(InstrumentError, sentence, wired.relay.connected)
    assert fault.fired
    wired.wire.faults.clear()
    wired.relay.connect(["A"])
    assert wired.relay.connected() == {"A"}


def test_a_late_answer_is_not_taken_for_the_next_ones(wired):
    """The command that timed out is answered after the next has been sent."""
    wired.relay.connect(["A"])
    wired.wire.faults.append(ReplyFault("delay", asked="relay read 0", delay=0.25, times=1))
    raises(InstrumentError, "did not answer 'relay read 0'", wired.relay.connected)
    wired.relay.connect([])
    assert wired.relay.connected() == set()


def test_what_a_board_says_unasked_is_not_taken_for_an_answer():
    box = box_in(Contacts(PATCHES), PATCHES, range(8))
    with SerialRelayWire(box) as board:

        def talkative(link: socket.socket) -> None:
            with socket.create_connection(("127.0.0.1", int(board.url.split(":")[-1]))) as quiet:
                while asked := link.recv(256):
                    quiet.sendall(asked)
                    answer = b""
                    while not answer.endswith(b">"):
                        answer += quiet.recv(256)
                    link.sendall(answer + b"relay read 0\n\ron\n\r>")

        with Loopback(talkative) as port:
            relay = SerialRelay.open(settings(port=f"socket://{port.address}"), VirtualClock())
            assert relay.connected() == set()
            relay.close()


def test_a_channel_that_the_board_has_not_and_a_board_that_is_unplugged_are_told(wired):
    with pytest.raises(InstrumentError, match=r"'relay read C' with '', which no such board does"):
        SerialRelay.open(settings(port=wired.wire.url, patches={"A": 12}), wired.bench.clock)
    wired.relay.connect(["A"])
    wired.wire.close()
    for action in (wired.relay.renew, lambda: wired.relay.connect([])):
        raises(InstrumentError, "cannot be talked to", action)


def test_nobody_at_the_port():
    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        taken = f"socket://127.0.0.1:{free.getsockname()[1]}"
        for port, error, says in (
            (taken, InstrumentError, rf"{taken} cannot be talked to \(connection refused\): plug"),
            ("nonsense://x", ConfigurationError, r"'port' in .* 'nonsense://x': it is no name"),
        ):
            raises(error, says, SerialRelay.open, settings(port=port), VirtualClock())


def test_the_other_commands_of_a_board():
    """As public programs for these modules send them, also those that the driver has no use for."""
    bench = Contacts(PATCHES)
    with (
        SerialRelayWire(box_in(bench, PATCHES, range(8))) as board,
        socket.create_connection(board.url.removeprefix("socket://").split(":"), 5) as link,
    ):

        def ask(command: str) -> str:
            link.sendall(f"{command}\r".encode())
            received = b""
            while not received.endswith(b">"):
                received += link.recv(100)
            bench.clock.sleep(0.1)
            return answer_in(received, command)

        assert (ask("relay readall"), ask("id get"), ask("adc read 0")) == ("00", "00000000", "0")
        assert ask("relay writeall 82") == ""
        assert (ask("relay readall"), ask("relay read 7"), ask("relay read 0")) == ("82", "on", "off")
        assert bench.closed() == {"B", "D"}
        assert ask("reset") == ""  # opens all contacts, says the vendor's table of commands
        ask("id set LAB00001")
        ask("gpio set 3")
        assert (ask("id get"), ask("gpio read 3"), ask("gpio read 4")) == ("LAB00001", "on", "off")
        ask("gpio clear 3")
        assert ask("gpio read 3") == "off"
        # What is no command has no answer and no effect.
        for wrong in (
            "relay writeall 123",
            "relay writeall xy",
            "id set toolongaword",
            "gpio set Z",
            "adc read",
        ):
            assert ask(wrong) == ""
        assert (ask("relay readall"), ask("id get")) == ("00", "LAB00001")
