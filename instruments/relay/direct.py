"""The wire in place of a relay: one actuator on one amplifier, always connected (`wiring = "direct"`).

It stands in the relay's role so that every play takes the same steps: outputs at zero and held, the drive,
zero again, read back. It opens nothing. What that costs is said by `LOST`.
"""

from __future__ import annotations

from collections.abc import Collection

from ...base.errors import ConfigurationError
from .role import Relay

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
