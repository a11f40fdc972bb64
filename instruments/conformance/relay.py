"""Promises of the relay role."""

from __future__ import annotations

import math
from collections.abc import Collection
from typing import ClassVar

import pytest

from ...base.clock import Clock, RealClock
from ...base.errors import ConfigurationError, InstrumentError, LimitError
from ..relay import Relay
from .suite import Conformance, bypass_interlock, one_sentence, refused

_LONGEST_WAIT = 30.0
"""Real seconds that a test may wait for a dead-man."""


class RelayConformance(Conformance):
    """Give a fixture `relay`: a driver that has just been opened, every channel open."""

    optional: ClassVar = {
        "reopen": "give reopen(), which opens a second driver on the same box",
        "contacts": "give contacts(), the patches whose contacts are closed, asked of the box itself",
    }

    def reopen(self) -> Relay:
        """Return a second driver on the same box, opened as the first one was."""
        raise NotImplementedError

    def contacts(self) -> Collection[str]:
        """Patches whose contacts are closed now, measured independently of the driver."""
        raise NotImplementedError

    def clock(self) -> Clock:
        """The clock that the dead-man runs on; a twin's is virtual."""
        return RealClock()

    @pytest.fixture(autouse=True)
    def _switching(self, _skip_what_is_not_offered: None, request: pytest.FixtureRequest) -> None:
        bypass_interlock(request.getfixturevalue("relay"))

    def test_without_a_rig_it_only_opens(self, relay: Relay) -> None:
        """A driver of its own does not know what stands on the amplifier's input: it closes no contact."""
        vars(relay).pop("_interlock")
        with refused(LimitError, naming="without a rig"):
            relay.connect(relay.patches)
        self.in_time(lambda: relay.connect(()))
        assert self.in_time(relay.connected) == frozenset()

    def test_says_what_it_is(self, relay: Relay) -> None:
        """Identity, patches, rating and dead-man have valid values."""
        assert relay.identity.strip() and "\n" not in relay.identity
        assert relay.patches and len(set(relay.patches)) == len(relay.patches)
        assert 0 < relay.rating < math.inf
        assert relay.dead_man > 0

    def test_connects_exactly_these_patches(self, relay: Relay) -> None:
        """`connect` connects the patches it is given and opens all others."""
        for patches in ({relay.patches[0]}, set(relay.patches), {relay.patches[-1]}, set[str]()):
            self.in_time(lambda p=patches: relay.connect(p))  # type: ignore[misc]
            assert self.in_time(relay.connected) == patches

    @pytest.mark.requires("contacts")
    def test_contacts_have_settled_when_connect_returns(self, relay: Relay) -> None:
        """When `connect` returns, the contacts themselves are in the commanded state."""
        for patches in ({relay.patches[0]}, set(relay.patches), {relay.patches[-1]}, set[str]()):
            relay.connect(patches)
            assert set(self.contacts()) == patches

    def test_any_collection_of_patches_will_do(self, relay: Relay) -> None:
        """`connect` takes a list or a tuple, and a patch named twice is one patch."""
        first = relay.patches[0]
        relay.connect([first, first])
        assert relay.connected() == frozenset({first})
        relay.connect(())

    def test_the_safe_state_can_be_asked_for_again(self, relay: Relay) -> None:
        """Connecting nothing is the safe state, and is idempotent."""
        relay.connect(relay.patches)
        for _ in range(2):
            relay.connect(())
            assert relay.connected() == frozenset()

    def test_an_unknown_patch_changes_nothing(self, relay: Relay) -> None:
        """An unknown patch is a ConfigurationError that names it, and no channel is switched."""
        first = relay.patches[0]
        relay.connect({first})
        with refused(ConfigurationError, naming="no-such-patch"):
            relay.connect({"no-such-patch", relay.patches[-1]})
        assert relay.connected() == {first}

    @pytest.mark.requires("reopen")
    def test_opening_changes_no_channel(self, relay: Relay) -> None:
        """Opening the driver changes no channel: what is connected stays so."""
        relay.connect({relay.patches[0]})
        other = self.reopen()
        assert other.connected() == {relay.patches[0]}
        other.close()
        assert relay.connected() == {relay.patches[0]}

    @pytest.mark.requires("reopen")
    def test_closing_changes_no_channel(self, relay: Relay) -> None:
        """`close` disconnects from the box without changing a channel."""
        relay.connect({relay.patches[0]})
        relay.close()
        other = self.reopen()
        assert other.connected() == {relay.patches[0]}
        other.close()

    def test_close_may_be_called_again(self, relay: Relay) -> None:
        """`close` is idempotent, and a closed driver refuses to connect."""
        relay.close()
        relay.close()
        with refused(InstrumentError):
            self.in_time(lambda: relay.connect({relay.patches[0]}))

    def test_renewing_nothing_does_nothing(self, relay: Relay) -> None:
        """`renew` does nothing when no patch is connected."""
        relay.renew()
        relay.connect(())
        relay.renew()
        assert relay.connected() == frozenset()

    def test_the_dead_man_opens_a_box_that_is_left_alone(self, relay: Relay) -> None:
        """Without `renew` the box opens by itself after `dead_man` seconds, and says so."""
        relay.connect(relay.patches)
        self._let_pass(relay, 1.2 * relay.dead_man + 0.5)
        assert relay.connected() == frozenset(), "does clock() give the clock that the box runs on?"
        if "contacts" in self.capabilities:
            assert set(self.contacts()) == set()

    def test_renewing_puts_the_dead_man_off(self, relay: Relay) -> None:
        """A box that is renewed in time stays connected beyond its dead-man time."""
        relay.connect({relay.patches[0]})
        for _ in range(3):
            self._let_pass(relay, 0.6 * relay.dead_man)
            relay.renew()
        assert relay.connected() == {relay.patches[0]}
        relay.connect(())

    def test_a_fault_is_one_error_in_time(self, relay: Relay, kind: str) -> None:
        """A misbehaving box raises InstrumentError within the deadline, in one sentence.

        The command never counts as done. Afterwards the driver reaches the safe state, or raises
        InstrumentError.
        """
        with self.fault(kind) as fault, refused(InstrumentError):
            self.in_time(lambda: relay.connect(relay.patches))
        assert fault.fired, f"the fault {kind!r} never fired"
        try:
            self.in_time(lambda: relay.connect(()))
        except InstrumentError as error:
            one_sentence(str(error))
        else:
            assert relay.connected() == frozenset()

    def _let_pass(self, relay: Relay, duration: float) -> None:
        if math.isinf(relay.dead_man):
            pytest.skip("this box cannot open by itself: its dead-man is infinite")
        clock = self.clock()
        if isinstance(clock, RealClock) and relay.dead_man > _LONGEST_WAIT:
            pytest.skip(f"a dead-man of {relay.dead_man:g} s is too long to wait for")
        clock.sleep(duration)
