"""Settings that no software can read: declared in the rig file, confirmed by the operator."""

from __future__ import annotations

from ...base.errors import InstrumentError
from ..operator import ConfirmSettings
from .roles import Instruments


class DeclaredSettings:
    """The declared settings of a rig's instruments that are already confirmed."""

    def __init__(self) -> None:
        self._confirmed: set[str] = set()

    def confirm(self, rig: Instruments) -> None:
        """See `Rig.confirm_settings`."""
        declared = {rig.vibrometer.identity: rig.vibrometer.declared, rig.daq.identity: rig.daq.declared}
        if rig.feeds_amplifier("player"):
            declared[rig.player.identity] = rig.player.declared
        for identity, sentence in declared.items():
            if not sentence or sentence in self._confirmed:
                continue
            if not rig.operator.confirm(ConfirmSettings(sentence)):
                raise InstrumentError(
                    f"The operator did not confirm the settings of the {identity}: "
                    "set them as the rig file says, or change the rig file."
                )
            self._confirmed.add(sentence)
