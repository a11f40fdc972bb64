"""Which of NI's properties and calls the twin serves, so that nothing is left out in silence.

A property is *served* when the twin computes it or acts on it, and *kept* when a program can set it and read
it back, and nothing follows from it. A task that starts with a kept property at another value than its
default says so. Any other is *refused* before a program sets it.
"""

from __future__ import annotations

import re
from typing import Any

from .defaults import default_value
from .tasks import Task

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
