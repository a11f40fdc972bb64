"""Channels of NI's input tasks as a rig file describes them: coupling, excitation, bridges, counters.

Whatever an input supplies, its rows are volts at the terminal: a bridge is read as a ratio and multiplied by
its excitation, and the sensor's own description says what the volts mean.
"""

from __future__ import annotations

from typing import Any

from nidaqmx.constants import (
    AngleUnits,
    BridgeConfiguration,
    BridgeUnits,
    Coupling,
    EncoderType,
    ExcitationSource,
    TerminalConfiguration,
)

from .ni_settings import Channel

_CONFIGS = {
    "default": TerminalConfiguration.DEFAULT,
    "diff": TerminalConfiguration.DIFF,
    "rse": TerminalConfiguration.RSE,
    "nrse": TerminalConfiguration.NRSE,
    "pseudodiff": TerminalConfiguration.PSEUDO_DIFF,
}
_COUPLINGS = {"ac": Coupling.AC, "dc": Coupling.DC}
_BRIDGES = {
    "full": BridgeConfiguration.FULL_BRIDGE,
    "half": BridgeConfiguration.HALF_BRIDGE,
    "quarter": BridgeConfiguration.QUARTER_BRIDGE,
}


def factor(channel: Channel) -> float:
    """Volts at the terminal for one unit that the driver reads."""
    return channel.bridge_excitation if channel.bridge is not None else 1.0


def add_input(task: Any, channel: Channel) -> None:
    """Give a task an analog input."""
    limit = channel.range / factor(channel)
    if channel.bridge is not None:
        added = task.ai_channels.add_ai_bridge_chan(
            channel.terminal,
            min_val=-limit,
            max_val=limit,
            units=BridgeUnits.VOLTS_PER_VOLT,
            bridge_config=_BRIDGES[channel.bridge],
            voltage_excit_source=ExcitationSource.INTERNAL,
            voltage_excit_val=channel.bridge_excitation,
            nominal_bridge_resistance=channel.bridge_resistance,
        )
    else:
        added = task.ai_channels.add_ai_voltage_chan(
            channel.terminal, terminal_config=_CONFIGS[channel.config], min_val=-limit, max_val=limit
        )
    if channel.coupling is not None:
        added.ai_coupling = _COUPLINGS[channel.coupling]
    if channel.excitation is not None:
        added.ai_excit_src = ExcitationSource.INTERNAL
        added.ai_excit_val = channel.excitation


def add_counter(task: Any, channel: Channel) -> None:
    """Give a task a counter."""
    if channel.counter == "encoder":
        # In ticks: quarter periods, whatever a turn has of them.
        task.ci_channels.add_ci_ang_encoder_chan(
            channel.terminal, decoding_type=EncoderType.X_4, units=AngleUnits.TICKS
        )
    else:
        task.ci_channels.add_ci_count_edges_chan(channel.terminal)
