"""NI's properties: the default of each, and which the twin serves, so that nothing is left out in silence.

A property is *served* when the twin computes it or acts on it, and *kept* when a program can set it and read
it back, and nothing follows from it. A task that starts with a kept property at another value than its
default says so. Any other is *refused* before a program sets it.
"""

from __future__ import annotations

import re
from datetime import UTC, datetime
from typing import Any

from nidaqmx import constants as c

from .tasks import Task

_ZERO: dict[str, Any] = {
    "Bool": False,
    "Double": 0.0,
    "UInt32": 0,
    "UInt64": 0,
    "String": "",
    "Timestamp": datetime(1904, 1, 1, tzinfo=UTC),
    "DoubleArray": [],
    "Int32Array": [],
    "UInt32Array": [],
    "Bytes": b"",
}

_DEFAULTS: list[tuple[str, str, Any]] = [
    ("Read", "OVERWRITE", c.OverwriteMode.DO_NOT_OVERWRITE_UNREAD_SAMPLES.value),
    ("Read", "RELATIVE_TO", c.ReadRelativeTo.CURRENT_READ_POSITION.value),
    ("Read|Write", "OFFSET", 0),
    ("Read|Write", "WAIT_MODE", c.WaitMode.POLL.value),
    ("Read|Write", "SLEEP_TIME", 0.001),
    ("Read", "AUTO_START", True),
    ("Read", "READ_ALL_AVAIL_SAMP", False),
    ("Read", "LOGGING_MODE", c.LoggingMode.OFF.value),
    ("Read", "LOGGING_TDMS_OPERATION", c.LoggingOperation.OPEN_OR_CREATE.value),
    ("Read", "LOGGING_.*", None),
    ("Read|Write", r"\w*_EXIST|CHANGE_DETECT_HAS_OVERFLOWED|\w*_REMOVAL_DETECTED", False),
    ("Read|Write", r"\w*_CHANS", ""),
    ("Write", "REGEN_MODE", c.RegenerationMode.ALLOW_REGENERATION.value),
    ("Write", "RELATIVE_TO", c.WriteRelativeTo.CURRENT_WRITE_POSITION.value),
    ("Write", "NEXT_WRITE_IS_LAST", False),
    ("Timing", "SAMP_TIMING_TYPE", c.SampleTimingType.ON_DEMAND.value),
    ("Timing", "SAMP_QUANT_SAMP_MODE", c.AcquisitionType.CONTINUOUS.value),
    ("Timing", "SAMP_CLK_ACTIVE_EDGE|SAMP_CLK_TIMEBASE_ACTIVE_EDGE|AI_CONV_ACTIVE_EDGE", c.Edge.RISING.value),
    ("Timing", "SAMP_CLK_UNDERFLOW_BEHAVIOR", c.UnderflowBehavior.HALT_OUTPUT_AND_ERROR.value),
    ("Timing", "DELAY_FROM_SAMP_CLK_DELAY_UNITS", c.DigitalWidthUnits.SECONDS.value),
    ("Timing", r"\w*TIMESCALE", c.Timescale.USE_HOST.value),
    ("Timing", "FIRST_SAMP_TIMESTAMP_ENABLE", True),
    ("Timing", r"ON_DEMAND_SIMULTANEOUS_AO_ENABLE|\w*DIG_FLTR\w*|\w*DIG_SYNC\w*|DELAY_FROM\w*", None),
    ("Timing", r"REF_CLK_SRC|CHANGE_DETECT\w*|SYNC_\w*|FIRST_SAMP_CLK\w*", None),
    ("Trig", r"(START|REF|PAUSE|ARM_START|ADV|HSHK)_TRIG_TYPE", c.TriggerType.NONE.value),
    ("Trig", "TRIGGER_SYNC_TYPE", c.SyncType.NONE.value),
    ("Trig", r"DIG_EDGE_\w*_EDGE", c.Edge.RISING.value),
    ("Trig", r"\w*_SLOPE", c.Slope.RISING.value),
    ("Trig", "REF_TRIG_PRETRIG_SAMPLES", 2),
    ("Trig", r"\w*TIMESCALE", c.Timescale.USE_HOST.value),
    ("Trig", r"\w*_COUPLING", c.Coupling.DC.value),
    ("Trig", r"DIG_LVL_PAUSE_TRIG_WHEN", c.Level.HIGH.value),
    ("Trig", r"START_TRIG_DELAY_UNITS", c.DigitalWidthUnits.SAMPLE_CLOCK_PERIODS.value),
    ("Trig", r"(?!.*(WHEN|TYPE)$)\w*|START_TRIG_TRIG_WHEN|ARM_START_TRIG_TRIG_WHEN", None),
    ("RealTime", "WAIT_FOR_NEXT_SAMP_CLK_WAIT_MODE", c.WaitMode.WAIT_FOR_INTERRUPT.value),
    ("RealTime", r"\w*", None),
    ("ExportedSignal", r"\w*_OUTPUT_TERM|\w*_ENABLE|\w*_DELAY|\w*_DELAY_OFFSET|\w*_PULSE_WIDTH", None),
    ("ExportedSignal", r"\w*_PULSE_POLARITY", c.Polarity.ACTIVE_HIGH.value),
    ("ExportedSignal", r"\w*_ACTIVE_LVL", c.Polarity.ACTIVE_HIGH.value),
    ("ExportedSignal", r"\w*_OUTPUT_BEHAVIOR", c.ExportAction.PULSE.value),
    ("Chan", "AI_COUPLING", c.Coupling.DC.value),
    ("Chan", "AI_RESOLUTION_UNITS|AO_RESOLUTION_UNITS", c.ResolutionType.BITS.value),
    ("Chan", "AI_RAW_SAMP_JUSTIFICATION", c.DataJustification.RIGHT.value),
    ("Chan", "AI_DATA_XFER_MECH|AO_DATA_XFER_MECH", c.DataTransferActiveTransferMode.DMA.value),
    ("Chan", "AI_LOSSY_LSB_REMOVAL_COMPRESSED_SAMP_SIZE", 16),
    ("Chan", "AI_EXCIT_USE_FOR_SCALING", False),
    ("Chan", "AI_EXCIT_SRC", c.ExcitationSource.NONE.value),
    ("Chan", "AI_AUTO_ZERO_MODE", c.AutoZeroType.NONE.value),
    ("Chan", "AI_RAW_DATA_COMPRESSION_TYPE", c.RawDataCompressionType.NONE.value),
    ("Chan", "(AI|CI)_DATA_XFER_REQ_COND", c.InputDataTransferCondition.ON_BOARD_MEMORY_NOT_EMPTY.value),
    (
        "Chan",
        "(AO|CO)_DATA_XFER_REQ_COND",
        c.OutputDataTransferCondition.ON_BOARD_MEMORY_LESS_THAN_FULL.value,
    ),
    ("Chan", "(CI|CO)_DATA_XFER_MECH", c.DataTransferActiveTransferMode.DMA.value),
    ("Chan", r"CI_\w*_LOGIC_LVL_BEHAVIOR", c.LogicLvlBehavior.NONE.value),
    ("Chan", "(CI|CO)_CTR_TIMEBASE_DIG_FLTR_TIMEBASE_SRC", "100MHzTimebase"),
    ("Chan", "CI_COUNT_EDGES_GATE_WHEN", c.Level.LOW.value),
    ("Chan", "CI_COUNT_EDGES_COUNT_RESET_ACTIVE_EDGE", c.Edge.RISING.value),
    ("Chan", "PWR_IDLE_OUTPUT_BEHAVIOR", c.PowerIdleOutputBehavior.MAINTAIN_EXISTING_VALUE.value),
    ("Chan", "PWR_REMOTE_SENSE", c.Sense.LOCAL.value),
    ("Chan", r"AI_BRIDGE_(POLY|TABLE)_\w*|AI_BRIDGE_INITIAL_\w*|AI_ROSETTE_\w*", None),
    ("Chan", r"(CI|CO)_\w*(DIG_FLTR|DIG_SYNC|LOGIC_LVL|COUNT_RESET|GATE|HYST|THRESH|PRESCALER)\w*", None),
    ("Chan", r"(CI|CO)_\w*(MEM_MAP|DUP|AUTO_INCR|ENABLE|DATA_XFER|USB_XFER|TC_REACHED|OVERRUN)\w*", None),
    ("Chan", r"CI_\w*(STARTING|START|ACTIVE|FIRST|SECOND)_EDGE", c.Edge.RISING.value),
    ("Chan", r"CI_\w*_MEAS_METH", c.CounterFrequencyMethod.LOW_FREQUENCY_1_COUNTER.value),
    ("Chan", r"CI_\w*_MEAS_TIME|AI_ADC_CUSTOM_TIMING_MODE", None),
    ("Chan", r"CI_\w*_DIV", 4),
    ("Chan", r"C[IO]_CTR_TIMEBASE_SRC", "100MHzTimebase"),
    ("Chan", r"C[IO]_CTR_TIMEBASE_ACTIVE_EDGE", c.Edge.RISING.value),
    ("Chan", r"CI_CUSTOM_SCALE_NAME|CI_\w*_TERM", ""),
    (
        "Chan",
        r"AI_AC_EXCIT_\w*|AI_EXCIT_(SRC|VAL|USE_\w*)|AI_BRIDGE_(SHUNT|BALANCE)_\w*|PWR_\w*|AO_FUNC_GEN_\w*",
        None,
    ),
    (
        "Chan",
        r"AI_(LEAD_WIRE|DIG_FLTR|FILTER|LOWPASS|HIGHPASS|NOTCH|BANDPASS|SENSOR_POWER|OPEN_CHAN)_?\w*",
        None,
    ),
    (
        "Chan",
        r"AI_(AUTO_ZERO|DATA_XFER|MEM_MAP|RAW_DATA|USB_XFER|REMOVE_FILTER|ENHANCED|AVERAGING|PROBE)_?\w*",
        None,
    ),
    ("Chan", "AI_RTD_A", 0.00381),
    ("Chan", "AI_RTD_B", -6.02e-7),
    ("Chan", "AI_RTD_C", -6.0e-12),
    ("Chan", "AI_IS_TEDS|CHAN_IS_GLOBAL|AI_CHAN_CAL_ENABLE_CAL", False),
    ("Chan", "CHAN_DESCR|AI_TEDS_UNITS|AI_CUSTOM_SCALE_NAME|AO_CUSTOM_SCALE_NAME", ""),
    ("Chan", r"AI_(LOWPASS|HIGHPASS|BANDPASS|NOTCH|FILTER|DIG_FLTR)_ENABLE|AI_DITHER_ENABLE", False),
    ("Chan", r"(DI|DO)_(TRISTATE|INVERT_LINES|DIG_FLTR_ENABLE|DIG_SYNC_ENABLE)|AO_\w*ENABLE", False),
    ("Chan", "AO_TERM_CFG", c.TerminalConfiguration.RSE.value),
    ("Chan", "AO_IDLE_OUTPUT_BEHAVIOR", c.AOIdleOutputBehavior.MAINTAIN_EXISTING_VALUE.value),
    ("Chan", "AO_LOAD_IMPEDANCE|AO_OUTPUT_IMPEDANCE|AO_DAC_OFFSET_VAL", 0.0),
    ("Chan", "AO_DAC_REF_VAL", 10.0),
    ("Chan", "AO_GAIN|AI_GAIN", 1.0),
    ("Chan", r"CI_\w*TIMEBASE_SRC", "100MHzTimebase"),
    ("Chan", r"CI_\w*_TERM", ""),
    ("Chan", "DI_LOGIC_FAMILY|DO_LOGIC_FAMILY", c.LogicFamily.FIVE_V.value),
]
"""(kind of property, pattern of its name, value); None means zero, empty or false. The first match counts.

An Int32 is one of an enumeration's values, which 0 hardly ever is: without a value it has no default.
"""


def default_value(kind: str, type_: str, name: str) -> Any:
    """Return the default of property `name` of a `kind`, in the type of calls `type_`; None if unknown."""
    for kinds, pattern, value in _DEFAULTS:
        if kind in kinds.split("|") and re.fullmatch(pattern, name):
            return _ZERO.get(type_) if value is None else value
    return None


_ACTS = {
    "Chan": r"(CI_(?!\w*(RESET|GATE|TIMEBASE))\w*|DI)_DIG_FLTR_(ENABLE|MIN_PULSE_WIDTH)|D[IO]_INVERT_LINES"
    r"|CO_ENABLE_INITIAL_DELAY_ON_RETRIGGER"
    r"|(?!\w*(COUNT_RESET|GATE|TIMESTAMP|FILTER_DELAY|PATH_DELAY|DIG_FLTR|DIG_SYNC))"
    r"(A[IO]_(MIN|MAX|CUSTOM_SCALE_NAME)|AI_(RNG_HIGH|RNG_LOW|TERM_CFG|COUPLING|EXCIT_(SRC|VAL)|\w*UNITS)"
    r"|AI_\w*SENSITIVITY|AI_RTD_\w+|AI_THRMCPL_CJC_SRC|AI_CURRENT_SHUNT_RESISTANCE|AI_MEAS_TYPE"
    r"|AI_BRIDGE_(TWO_POINT_LIN|TABLE|POLY)_\w*|AI_SOUND_PRESSURE_MAX_SOUND_PRESSURE_LVL|AI_INPUT_SRC"
    r"|CI_MEAS_TYPE|CI_\w*_(UNITS|MEAS_METH|MEAS_TIME|DIV)|CI_\w*(STARTING|ACTIVE|FIRST|SECOND)_EDGE"
    r"|CI_COUNT_EDGES_(DIR|INITIAL_CNT)|CI_\w*_TERM|C[IO]_CTR_TIMEBASE_SRC|CI_CUSTOM_SCALE_NAME"
    r"|CI_ENCODER_DECODING_TYPE|CI_(VELOCITY_)?(ANG|LIN)_ENCODER_\w*|CI_ENCODER_Z_INDEX_ENABLE"
    r"|CO_(OUTPUT_TYPE|PULSE_\w*)|PWR_(VOLTAGE_SETPOINT|CURRENT_SETPOINT|OUTPUT_ENABLE)|AO_OUTPUT_TYPE)",
    "Timing": r"SAMP_(TIMING_TYPE|CLK_(RATE|SRC|ACTIVE_EDGE|TIMEBASE_DIV)|QUANT_\w*)|AI_CONV_RATE"
    r"|CHANGE_DETECT_DI_\w*|SAMP_CLK_DIG_FLTR_(ENABLE|MIN_PULSE_WIDTH)",
    "Trig": r"(START|REF|ARM_START)_TRIG_(TYPE|TIMESTAMP_ENABLE|TERM)|REF_TRIG_PRETRIG_SAMPLES"
    r"|DIG_EDGE_(START|REF|ARM_START)_TRIG_(SRC|EDGE|DIG_FLTR_(ENABLE|MIN_PULSE_WIDTH))"
    r"|START_TRIG_(DELAY|DELAY_UNITS|RETRIGGERABLE)|REF_TRIG_DELAY",
    "Read": r"CHANNELS_TO_READ|RELATIVE_TO|OFFSET|OVERWRITE|READ_ALL_AVAIL_SAMP|AUTO_START"
    r"|LOGGING_(FILE_PATH|MODE|TDMS_GROUP_NAME|TDMS_OPERATION|PAUSE)",
    "Write": r"REGEN_MODE|RELATIVE_TO|OFFSET",
    "Buffer": r"(IN|OUT)PUT_BUF_SIZE",
    "ExportedSignal": r"(SAMP_CLK|START_TRIG|20_MHZ_TIMEBASE|CTR_OUT_EVENT|CHANGE_DETECT_EVENT)_OUTPUT_TERM",
}
"""Properties on which the twin acts, by kind, as patterns of their names."""


def acts(kind: str, name: str) -> bool:
    """Return True when something follows from a property that a program sets."""
    return re.fullmatch(_ACTS.get(kind, ""), name) is not None


def ignored(task: Task) -> list[str]:
    """Return the properties that a program has set in a task, and from which nothing follows."""
    found = [
        name
        for (kind, name), value in task.settings.items()
        if not acts(kind, name) and _differs(kind, name, value)
    ]
    for channel in task.channels:
        found += [
            name
            for name in sorted(channel.written)
            if not acts("Chan", name) and _differs("Chan", name, channel.values.get(name))
        ]
    return list(dict.fromkeys(found))


def _differs(kind: str, name: str, value: Any) -> bool:
    return value not in (None, 0, "", [], default_value(kind, "Int32", name))
