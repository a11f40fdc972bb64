"""The relay role: connects the amplifier's output to patches; and the wire in place of a relay."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Collection
from typing import final

from ...base.errors import ConfigurationError
from ..interlock import Interlocked


class Relay(Interlocked, ABC):
    """A relay box between the amplifier and the patches.

    Safe state: every channel open. Opening the driver changes no channel. Switch only while the
    drive is at zero: a charged patch that is switched clicks. A driver implements `_connect` and `_renew`,
    which only `connect` and `renew` call; while a drive is played, and without a rig, it only opens.
    """

    identity: str
    patches: tuple[str, ...]
    """Names of the patches that it can connect."""
    rating: float
    """Highest voltage (V peak) that its channels may switch."""
    dead_man: float
    """Seconds after which the box opens by itself unless `connect` or `renew` is called."""

    @final
    def connect(self, patches: Collection[str]) -> None:
        """Connect exactly these patches, all others open, and read that back.

        Returns when the contacts have settled. Raises ConfigurationError for an unknown patch,
        LimitError while the rig plays a drive that is not for these patches, and for any patch without a
        rig; InstrumentError when the box does not answer or reads back anything else, or when volts stand
        on an output that leads to it.
        """
        wanted = frozenset(patches)
        self._interlock.authorise_patches(wanted)
        self._connect(patches)
        self._interlock.switched(wanted)

    @abstractmethod
    def _connect(self, patches: Collection[str]) -> None:
        """Do the driver's part of `connect`."""

    @abstractmethod
    def connected(self) -> frozenset[str]:
        """The patches that the box itself reports as connected."""

    def power_on_complaint(self) -> str:
        """Describe a channel that may close by itself when the box gets power; "" without one.

        Also "" for a product that does not report it. Raises InstrumentError.
        """
        return ""

    @final
    def renew(self) -> None:
        """Restart the dead-man time; does nothing when no patch is connected.

        Raises InstrumentError when the box is not as `connect` left it, and, with every patch open by then,
        when volts stand on an output that leads to it.
        """
        self._interlock.authorise_renewal()
        self._renew()

    @abstractmethod
    def _renew(self) -> None:
        """Do the driver's part of `renew`."""

    @abstractmethod
    def close(self) -> None:
        """Disconnect from the box without changing a channel. May be called again."""


# The wire in place of a relay: one actuator on one amplifier, always connected (`wiring = "direct"`).
#
# It stands in the relay's role so that every play takes the same steps: outputs at zero and held, the drive,
# zero again, read back. It opens nothing. What that costs is said by `LOST`.

LOST = (
    "This rig has no relay, so nothing opens by itself: if this program is killed, the computer stops or the "
    "amplifier fails, the actuator keeps what the amplifier puts out, which may be any value of the drive, "
    "until the rig is opened again or somebody switches the amplifier off."
)
"""What is lost without a relay: for doctor and the audit log."""


class DirectWire(Relay):
    """See `Relay`. Its patch is always connected, whatever `connect` is asked for."""

    def __init__(self, patches: Collection[str]) -> None:
        """Raises ConfigurationError for anything but one patch."""
        if len(patches) != 1:
            raise ConfigurationError(
                f"Direct wiring is one actuator on one amplifier, and [table] names {len(patches)} patches: "
                "name one, or use a relay."
            )
        self.patches = tuple(patches)
        self.identity = f"no relay: {self.patches[0]} is wired to the amplifier"
        self.rating = float("inf")
        self.dead_man = float("inf")

    def _connect(self, patches: Collection[str]) -> None:
        for patch in patches:
            if patch not in self.patches:
                raise ConfigurationError(
                    f"There is no patch {patch!r} on this rig: {self.patches[0]!r} is wired to its amplifier."
                )

    def connected(self) -> frozenset[str]:
        """See `Relay.connected`: always its patch."""
        return frozenset(self.patches)

    def _renew(self) -> None:
        pass

    def close(self) -> None:
        """Do nothing: there is no connection."""
