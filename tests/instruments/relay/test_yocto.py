"""The Yocto-MaxiCoupler: the logic of a box on its twin, and the hub's protocol on the wire."""

import json
import socket
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import hypothesis
import hypothesis.strategies as st
import pytest
from pydantic import ValidationError

from haploop.base.clock import RealClock, VirtualClock
from haploop.base.errors import ConfigurationError, InstrumentError
from haploop.instruments.relay.yocto import Yocto
from haploop.mocks.relay import BoxFault, RelayTwin, SimulatedBox, box_in
from haploop.mocks.relay.yocto_hub import YoctoHub
from haploop.mocks.transport import Loopback, ReplyFault
from tests.instruments.relay.contacts import Contacts
from tests.raising import raises

PATCHES = {"A": 1, "B": 2, "C": 3, "D": 8}


@dataclass
class Setup:
    bench: Contacts
    box: SimulatedBox
    relay: Yocto


@dataclass
class Wired(Setup):
    hub: YoctoHub


def settings(**changes: object) -> Yocto.Settings:
    return Yocto.Settings.model_validate({"patches": PATCHES, "timeout": 0.5, **changes})


@pytest.fixture
def setup() -> Setup:
    bench = Contacts(PATCHES)
    twin: Any = RelayTwin(settings(), bench)
    return Setup(bench, twin.box, twin)


@pytest.fixture
def wired() -> Iterator[Wired]:
    bench = Contacts(PATCHES)
    box = box_in(bench, PATCHES)
    with YoctoHub(box) as hub:
        yield Wired(bench, box, Yocto.open(settings(hub=hub.url), bench.clock), hub)


def test_breaks_before_it_makes(setup):
    setup.relay.connect(["A"])
    setup.relay.connect(["B"])
    assert setup.bench.closed() == {"B"}
    events = sorted(setup.bench.events)
    assert [(p, c) for _, p, c in events] == [("A", True), ("A", False), ("B", True)]
    assert events[2][0] - events[1][0] > 0.01


def test_a_box_opens_by_itself_in_time_unless_it_is_renewed(setup):
    setup.relay.connect(["A", "B"])
    for _ in range(20):
        setup.bench.clock.sleep(1.9)
        setup.relay.renew()
    assert setup.bench.closed() == {"A", "B"}
    assert len(setup.bench.events) == 2, "no contact bounced"
    renewed = setup.bench.clock.now()
    setup.bench.clock.sleep(10)
    assert setup.bench.closed() == set()
    opened = [at for at, _, closed in setup.bench.events if not closed]
    assert len(opened) == 2
    assert all(1.95 < at - renewed < 2.02 for at in opened)


def test_renewing_does_not_close_again_what_opened_by_itself(setup):
    setup.relay.connect(["A"])
    setup.bench.clock.sleep(2.5)
    raises(InstrumentError, r"channel 1 \(patch A\) reads open .*renewed for 2 s", setup.relay.renew)
    setup.relay.renew()
    setup.bench.clock.sleep(1)
    assert setup.bench.closed() == set()


def test_renewing_notices_a_channel_that_somebody_else_closed(setup):
    setup.relay.connect(["A"])
    setup.box.set_state(2, True)
    setup.bench.clock.sleep(0.1)
    raises(InstrumentError, r"channel 2 \(patch B\) reads closed .*another program", setup.relay.renew)


def test_no_renewal_outlasts_the_longest_time(setup):
    setup.relay.connect(["A"])
    start = setup.bench.clock.now()
    with pytest.raises(InstrumentError, match="channel 1"):
        for _ in range(200):
            setup.bench.clock.sleep(1)
            setup.relay.renew()
    assert setup.bench.clock.now() - start == pytest.approx(120, abs=1.1)


@pytest.mark.parametrize("kind", ["lost", "stuck"])
@pytest.mark.parametrize(("first", "then", "channel", "says", "left"), [
    # What had closed is left to the dead-man.
    ([], ["A", "B"], 2, r"channel 2 \(patch B\) was told to close but reads open", set()),
    (["A"], ["B"], 1, r"channel 1 \(patch A\) was told to open but reads closed", {"A"}),
], ids=["close", "open"])  # fmt: skip
def test_a_channel_that_does_not_follow_is_told_before_another_closes(
    setup, kind, first, then, channel, says, left
):
    setup.relay.connect(first)
    fault = BoxFault(kind, channel=channel)
    setup.box.faults.append(fault)
    raises(InstrumentError, says, setup.relay.connect, then)
    assert fault.fired
    setup.bench.clock.sleep(0 if left else 3)
    assert setup.bench.closed() == left


def test_one_lost_renewal_does_no_harm(setup):
    setup.relay.connect(["A"])
    setup.box.faults.append(BoxFault("lost", channel=1, times=1))
    for _ in range(10):
        setup.bench.clock.sleep(0.9)
        setup.relay.renew()
    assert setup.bench.closed() == {"A"}
    assert setup.box.faults[0].fired == 1


def test_a_welded_contact_is_hidden_from_the_read_back(setup):
    """Why the rig measures the drive at the patches: the box has no auxiliary contact to ask."""
    setup.relay.connect(["A"])
    setup.box.faults.append(BoxFault("welded", channel=1))
    setup.relay.connect([])
    assert setup.relay.connected() == set()
    assert setup.bench.closed() == {"A"}


@pytest.mark.parametrize(("fault", "sentence"), [
    (ReplyFault("silence"), "did not answer within 0.5 s"),
    (ReplyFault("drip"), "did not answer within 0.5 s"),
    (ReplyFault("disconnect"), "cannot be talked to"),
    (ReplyFault("not found"), "answered .* with status 404"),
    (ReplyFault("password"), "asks for a password"),
    (ReplyFault("garbled", asked="api.json"), "something else than whole JSON"),
    (ReplyFault("truncated", asked="api.json"), "something else than whole JSON"),
], ids=lambda value: value.kind if isinstance(value, ReplyFault) else "")  # fmt: skip
def test_every_bad_reply_is_one_sentence_in_time(wired, fault, sentence):
    wired.hub.faults.append(fault)
    clock = RealClock()
    for action in (wired.relay.connected, lambda: wired.relay.connect(["A"])):
        start = clock.now()
        raises(InstrumentError, sentence, action)
        assert clock.now() - start < 3
    assert fault.fired >= 2
    wired.hub.faults.clear()
    wired.relay.connect(["A"])
    assert wired.relay.connected() == {"A"}, "the driver recovers with the hub"


def test_one_refused_command_does_not_keep_the_others_closed(wired):
    wired.relay.connect(["A", "B", "C"])
    wired.hub.faults.append(ReplyFault("not found", asked="ctx=relay1"))
    raises(InstrumentError, "404", wired.relay.connect, [])
    wired.bench.clock.sleep(0.1)
    assert wired.bench.closed() == {"A"}


def test_a_killed_hub_is_noticed_and_the_box_opens_by_itself(wired):
    wired.relay.connect(["A"])
    wired.hub.close()
    for action in (wired.relay.renew, lambda: wired.relay.connect([])):
        raises(InstrumentError, "cannot be talked to", action)
    wired.bench.clock.sleep(2.5)
    assert wired.bench.closed() == set()


def test_opening_fails_when_the_time_limit_did_not_arrive():
    bench = Contacts(PATCHES)
    box = box_in(bench, PATCHES)
    box.faults.append(BoxFault("lost", channel=3))
    with (
        YoctoHub(box) as hub,
        pytest.raises(InstrumentError, match="channel 3 was given a time limit of 120000 ms but reads 0"),
    ):
        Yocto.open(settings(hub=hub.url), bench.clock)


def test_finds_the_only_box_or_says_what_there_is(wired, monkeypatch):
    hub = wired.hub
    assert wired.relay.identity == f"Yocto-MaxiCoupler {hub.serial}"
    other = settings(hub=hub.url, serial="MXCOUPL1-FFFFF")
    raises(InstrumentError, r"MXCOUPL1-FFFFF.* with status 404", Yocto.open, other, wired.bench.clock)
    listing = hub._listing()
    modules = listing["services"]["whitePages"]
    monkeypatch.setattr(hub, "_listing", lambda: listing)
    modules.append({**modules[1], "serialNumber": "MXCOUPL1-00002"})
    with pytest.raises(
        ConfigurationError, match=r"has 2 Yocto-MaxiCouplers .*-00002\): name one by 'serial'"
    ):
        Yocto.open(settings(hub=hub.url), wired.bench.clock)
    assert Yocto.open(settings(hub=hub.url, serial=hub.serial), wired.bench.clock).connected() == set()
    del modules[1:]
    with pytest.raises(ConfigurationError, match=r"no Yocto-MaxiCoupler \(it lists VirtualHub VIRTHUB0-"):
        Yocto.open(settings(hub=hub.url), wired.bench.clock)


@pytest.mark.parametrize(("channel", "found"), [
    ({"state": 2}, "state"),
    ({"state": "B"}, "state"),
    ({"state": True}, "state"),
    ({"pulseTimer": -1}, "pulseTimer"),
    ({"pulseTimer": 10**400}, "pulseTimer"),
    ({"pulseTimer": None}, "pulseTimer"),
    ({"pulseTimer": 0, "state": 1}, "dead-man"),
    ({"pulseTimer": 3_600_000, "state": 1}, "dead-man"),
], ids=str)  # fmt: skip
def test_no_value_is_believed_beyond_what_it_can_be(wired, monkeypatch, channel, found):
    tree = wired.hub._tree
    monkeypatch.setattr(wired.hub, "_tree", lambda: {**(t := tree()), "relay1": {**t["relay1"], **channel}})
    raises(InstrumentError, found, wired.relay.connect, ["A"])


@pytest.mark.parametrize(("change", "message"), [
    ({"patches": {"A": 1, "B": 1}}, "channel 1 is given to more than one patch"),
    ({"patches": {"A": 9}}, "less than or equal to 8"),
    ({"patches": {}}, "at least 1"),
    ({"hub": "https://127.0.0.1:4444"}, "http://HOST:PORT"),
    ({"hub": "http://user:secret@127.0.0.1"}, "password is not supported"),
    ({"hub": "http://127.0.0.1:99999"}, "hub"),
    ({"serial": "a/../b"}, "serial"),
    ({"dead_man": 0}, "dead_man"),
    ({"dead_man": 50, "longest": 20}, "longest must not be less than dead_man"),
    ({"rating": float("nan")}, "rating"),
    ({"pathces": {}}, "pathces"),
], ids=str)  # fmt: skip
def test_settings_that_cannot_be_right_are_refused(change, message):
    raises(ValidationError, message, settings, **change)


def test_a_hub_without_a_port_is_on_the_hubs_own_port():
    assert settings(hub="http://lab").hub == "http://lab:4444"
    assert settings(hub="http://[::1]:81").hub == "http://[::1]:81"


KEYS = st.sampled_from(["whitePages", "serialNumber", "productName", "state", "pulseTimer"])
TREES = st.dictionaries(
    st.sampled_from(["module", "services", "relay1"]),
    st.recursive(
        st.none() | st.integers() | st.text(), lambda x: st.lists(x) | st.dictionaries(KEYS, x), max_leaves=5
    ),
).map(lambda tree: json.dumps(tree).encode())
HEADS = [b"", b"Content-Length: 5", b"Content-Length: -1", b"Transfer-Encoding: chunked", b"X" * 70_000]
BODIES = [b"null", b"[]", b"[" * 100_000, b"9" * 5000, b'{"module": []}', b"\xff\xfe"]
REPLIES = st.binary(max_size=200) | st.builds(
    lambda head, body: b"HTTP/1.1 200 OK\r\n" + head + b"\r\n\r\n" + body,
    st.sampled_from(HEADS),
    st.binary(max_size=200) | st.sampled_from(BODIES) | TREES,
)


@hypothesis.settings(max_examples=25, deadline=None)
@hypothesis.given(reply=REPLIES)
@hypothesis.example(b"HTTP/1.1 200 OK\r\n\r\n" + b"[" * 100_000)
@hypothesis.example(b"HTTP/1.1 200 OK\r\n\r\n" + b"9" * 5000)
def test_whatever_answers_at_the_address_is_one_clear_error(reply):
    """Nothing that is not a hub is taken for one, and nothing but our own errors comes out."""

    def serve(link: socket.socket) -> None:
        link.recv(4096)
        link.sendall(reply)

    with Loopback(serve) as somebody, pytest.raises((InstrumentError, ConfigurationError)) as caught:
        Yocto.open(settings(hub=f"http://{somebody.address}", timeout=1), VirtualClock())
    assert somebody.address in str(caught.value)


def test_a_channel_that_closes_or_opens_by_itself_is_told(wired):
    for state, closes in ((0, True), (1, False), (2, True)):
        wired.hub.at_power_on[8] = state
        told = wired.relay.power_on_complaint()
        assert ("channel of patch D may close by itself when the box gets power" in told) == closes
        assert closes or not told
    wired.hub.at_power_on[8] = 1
    wired.box.limit_open(8, 5.0)
    assert "channel of patch D closes by itself after a time" in wired.relay.power_on_complaint()
