"""Create calls of counters as one table: what each measures or puts out, and the property of each field."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Literal

from nidaqmx.constants import CounterFrequencyMethod, UsageTypeCI, UsageTypeCO

I, O = UsageTypeCI, UsageTypeCO  # noqa: E741


@dataclass(frozen=True)
class Counter:
    """One create call of counters."""

    kind: Literal["ci", "co"]
    usage: UsageTypeCI | UsageTypeCO
    properties: dict[str, str]
    """Property that each field of the call sets."""


_LIMITS = {"min_val": "CI_MIN", "max_val": "CI_MAX"}
_SCALE = {"custom_scale_name": "CI_CUSTOM_SCALE_NAME"}
_INDEX = {
    "zidx_enable": "CI_ENCODER_Z_INDEX_ENABLE",
    "zidx_val": "CI_ENCODER_Z_INDEX_VAL",
    "zidx_phase": "CI_ENCODER_Z_INDEX_PHASE",
}
_SOURCE = {"source_terminal": "CI_CTR_TIMEBASE_SRC"}


def _method(name: str) -> dict[str, str]:
    return {
        "units": f"CI_{name}_UNITS",
        "edge": f"CI_{name}_STARTING_EDGE",
        "meas_method": f"CI_{name}_MEAS_METH",
        "meas_time": f"CI_{name}_MEAS_TIME",
        "divisor": f"CI_{name}_DIV",
        **_LIMITS,
        **_SCALE,
    }


def _pulse(units: str, first: str, second: str, delay: str) -> dict[str, str]:
    return {
        first: f"CO_PULSE_{first.upper()}",
        second: f"CO_PULSE_{second.upper()}",
        "idle_state": "CO_PULSE_IDLE_STATE",
        "initial_delay": delay,
        **({"units": units} if units else {"source_terminal": "CO_CTR_TIMEBASE_SRC"}),
    }


COUNTERS: dict[str, Counter] = {
    "CreateCICountEdgesChan": Counter("ci", I.COUNT_EDGES, {
        "edge": "CI_COUNT_EDGES_ACTIVE_EDGE",
        "initial_count": "CI_COUNT_EDGES_INITIAL_CNT",
        "count_direction": "CI_COUNT_EDGES_DIR",
    }),
    "CreateCIFreqChan": Counter("ci", I.FREQUENCY, _method("FREQ")),
    "CreateCIPeriodChan": Counter("ci", I.PERIOD, _method("PERIOD")),
    "CreateCIPulseWidthChan": Counter("ci", I.PULSE_WIDTH_DIGITAL, {
        "units": "CI_PULSE_WIDTH_UNITS", "starting_edge": "CI_PULSE_WIDTH_STARTING_EDGE", **_LIMITS, **_SCALE
    }),
    "CreateCISemiPeriodChan": Counter("ci", I.PULSE_WIDTH_DIGITAL_SEMI_PERIOD, {
        "units": "CI_SEMI_PERIOD_UNITS", **_LIMITS, **_SCALE
    }),
    "CreateCITwoEdgeSepChan": Counter("ci", I.PULSE_WIDTH_DIGITAL_TWO_EDGE_SEPARATION, {
        "units": "CI_TWO_EDGE_SEP_UNITS",
        "first_edge": "CI_TWO_EDGE_SEP_FIRST_EDGE",
        "second_edge": "CI_TWO_EDGE_SEP_SECOND_EDGE",
        **_LIMITS,
        **_SCALE,
    }),
    "CreateCIDutyCycleChan": Counter("ci", I.DUTY_CYCLE, {
        "edge": "CI_DUTY_CYCLE_STARTING_EDGE", "min_freq": "CI_MIN", "max_freq": "CI_MAX", **_SCALE
    }),
    "CreateCIPulseChanFreq": Counter("ci", I.PULSE_FREQ, {"units": "CI_PULSE_FREQ_UNITS", **_LIMITS}),
    "CreateCIPulseChanTime": Counter("ci", I.PULSE_TIME, {"units": "CI_PULSE_TIME_UNITS", **_LIMITS}),
    "CreateCIPulseChanTicks": Counter("ci", I.PULSE_TICKS, {**_SOURCE, **_LIMITS}),
    "CreateCIAngEncoderChan": Counter("ci", I.POSITION_ANGULAR_ENCODER, {
        "decoding_type": "CI_ENCODER_DECODING_TYPE",
        "units": "CI_ANG_ENCODER_UNITS",
        "pulses_per_rev": "CI_ANG_ENCODER_PULSES_PER_REV",
        "initial_angle": "CI_ANG_ENCODER_INITIAL_ANGLE",
        **_INDEX,
        **_SCALE,
    }),
    "CreateCILinEncoderChan": Counter("ci", I.POSITION_LINEAR_ENCODER, {
        "decoding_type": "CI_ENCODER_DECODING_TYPE",
        "units": "CI_LIN_ENCODER_UNITS",
        "dist_per_pulse": "CI_LIN_ENCODER_DIST_PER_PULSE",
        "initial_pos": "CI_LIN_ENCODER_INITIAL_POS",
        **_INDEX,
        **_SCALE,
    }),
    "CreateCIAngVelocityChan": Counter("ci", I.VELOCITY_ANGULAR_ENCODER, {
        "decoding_type": "CI_VELOCITY_ENCODER_DECODING_TYPE",
        "units": "CI_VELOCITY_ANG_ENCODER_UNITS",
        "pulses_per_rev": "CI_VELOCITY_ANG_ENCODER_PULSES_PER_REV",
        **_LIMITS,
        **_SCALE,
    }),
    "CreateCILinVelocityChan": Counter("ci", I.VELOCITY_LINEAR_ENCODER, {
        "decoding_type": "CI_VELOCITY_ENCODER_DECODING_TYPE",
        "units": "CI_VELOCITY_LIN_ENCODER_UNITS",
        "dist_per_pulse": "CI_VELOCITY_LIN_ENCODER_DIST_PER_PULSE",
        **_LIMITS,
        **_SCALE,
    }),
    "CreateCIGPSTimestampChan": Counter("ci", I.TIME_GPS, {
        "units": "CI_TIMESTAMP_UNITS", "sync_method": "CI_GPS_SYNC_METHOD", **_SCALE
    }),
    "CreateCOPulseChanFreq": Counter("co", O.PULSE_FREQUENCY, {
        "freq": "CO_PULSE_FREQ",
        "duty_cycle": "CO_PULSE_DUTY_CYC",
        "idle_state": "CO_PULSE_IDLE_STATE",
        "initial_delay": "CO_PULSE_FREQ_INITIAL_DELAY",
        "units": "CO_PULSE_FREQ_UNITS",
    }),
    "CreateCOPulseChanTime": Counter(
        "co", O.PULSE_TIME,
        _pulse("CO_PULSE_TIME_UNITS", "low_time", "high_time", "CO_PULSE_TIME_INITIAL_DELAY"),
    ),
    "CreateCOPulseChanTicks": Counter(
        "co", O.PULSE_TICKS, _pulse("", "low_ticks", "high_ticks", "CO_PULSE_TICKS_INITIAL_DELAY")
    ),
}  # fmt: skip
"""Create calls of counters, by name."""


@dataclass(frozen=True)
class Input:
    """Where a measurement takes its signal from, and what it reports."""

    term: str
    """Property that names the terminal."""
    socket: Literal["source", "gate", "aux"]
    """Input of the counter that it is at by default."""
    units: str = ""
    """Property that holds the units; empty for a measurement in counts."""
    edge: str = ""
    """Property that holds the edge that begins a measurement."""

    def at(self, values: Mapping[str, Any]) -> Literal["source", "gate", "aux"]:
        """Input of the counter that it is at with a channel's `values`: the source, if two counters measure.

        NI-DAQmx Device Considerations, "Connecting Counter Signals".
        """
        two = values.get(self.term.replace("_TERM", "_MEAS_METH")) in _TWO_COUNTERS
        return "source" if two else self.socket


_TWO_COUNTERS = (
    CounterFrequencyMethod.HIGH_FREQUENCY_2_COUNTERS.value,
    CounterFrequencyMethod.LARGE_RANGE_2_COUNTERS.value,
)

INPUTS: dict[int, Input] = {
    I.COUNT_EDGES.value: Input("CI_COUNT_EDGES_TERM", "source", "", "CI_COUNT_EDGES_ACTIVE_EDGE"),
    I.FREQUENCY.value: Input("CI_FREQ_TERM", "gate", "CI_FREQ_UNITS", "CI_FREQ_STARTING_EDGE"),
    I.PERIOD.value: Input("CI_PERIOD_TERM", "gate", "CI_PERIOD_UNITS", "CI_PERIOD_STARTING_EDGE"),
    I.PULSE_WIDTH_DIGITAL.value: Input(
        "CI_PULSE_WIDTH_TERM", "gate", "CI_PULSE_WIDTH_UNITS", "CI_PULSE_WIDTH_STARTING_EDGE"
    ),
    I.PULSE_WIDTH_DIGITAL_SEMI_PERIOD.value: Input(
        "CI_SEMI_PERIOD_TERM", "gate", "CI_SEMI_PERIOD_UNITS", "CI_SEMI_PERIOD_STARTING_EDGE"
    ),
    I.PULSE_WIDTH_DIGITAL_TWO_EDGE_SEPARATION.value: Input(
        "CI_TWO_EDGE_SEP_FIRST_TERM", "aux", "CI_TWO_EDGE_SEP_UNITS", "CI_TWO_EDGE_SEP_FIRST_EDGE"
    ),
    I.DUTY_CYCLE.value: Input("CI_DUTY_CYCLE_TERM", "gate", "", "CI_DUTY_CYCLE_STARTING_EDGE"),
    I.PULSE_FREQ.value: Input(
        "CI_PULSE_FREQ_TERM", "gate", "CI_PULSE_FREQ_UNITS", "CI_PULSE_FREQ_START_EDGE"
    ),
    I.PULSE_TIME.value: Input(
        "CI_PULSE_TIME_TERM", "gate", "CI_PULSE_TIME_UNITS", "CI_PULSE_TIME_START_EDGE"
    ),
    I.PULSE_TICKS.value: Input("CI_PULSE_TICKS_TERM", "gate", "", "CI_PULSE_TICKS_START_EDGE"),
    I.POSITION_ANGULAR_ENCODER.value: Input("CI_ENCODER_A_INPUT_TERM", "source", "CI_ANG_ENCODER_UNITS"),
    I.POSITION_LINEAR_ENCODER.value: Input("CI_ENCODER_A_INPUT_TERM", "source", "CI_LIN_ENCODER_UNITS"),
    I.VELOCITY_ANGULAR_ENCODER.value: Input(
        "CI_VELOCITY_ENCODER_A_INPUT_TERM", "source", "CI_VELOCITY_ANG_ENCODER_UNITS"
    ),
    I.VELOCITY_LINEAR_ENCODER.value: Input(
        "CI_VELOCITY_ENCODER_A_INPUT_TERM", "source", "CI_VELOCITY_LIN_ENCODER_UNITS"
    ),
    I.TIME_GPS.value: Input("CI_TIMESTAMP_TERM", "gate", "CI_TIMESTAMP_UNITS"),
}
"""Signals of counter inputs, by the number of the measurement."""
