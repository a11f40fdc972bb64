"""haploop: from a physical button to a verified digital one.

The rooms' public names, handed on lazily, so that a script needs one import and that import is cheap.
"""

from __future__ import annotations

from importlib import import_module, metadata
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from acquisition import (
        ButtonPress,
        PressVerdict,
        Protocol,
        Recording,
        Representative,
        Study,
        accepted_presses,
        find_presses,
        high_pass,
        load_study,
        record,
        representative,
        run_study,
    )
    from calibration import (
        Calibration,
        Check,
        DigitalButton,
        Drive,
        Learning,
        LinearSweep,
        Model,
        Multisine,
        Response,
        VibrationMap,
        build_button,
        calibrate,
        check,
        drive_for,
        fit,
        learn,
        linear_sweep,
        map_plan,
        measure_map,
        measure_response,
        modulate,
        paper_drive,
        plan_excitation,
        play_button,
        quick_response,
        read_uff,
        write_uff,
    )
    from instruments import (
        ConfigurationError,
        DataError,
        HaploopError,
        InstrumentError,
        LimitError,
        Limits,
        Rig,
        open_rig,
    )

    __version__: str

__all__ = [
    "ButtonPress",
    "Calibration",
    "Check",
    "ConfigurationError",
    "DataError",
    "DigitalButton",
    "Drive",
    "HaploopError",
    "InstrumentError",
    "Learning",
    "LimitError",
    "Limits",
    "LinearSweep",
    "Model",
    "Multisine",
    "PressVerdict",
    "Protocol",
    "Recording",
    "Representative",
    "Response",
    "Rig",
    "Study",
    "VibrationMap",
    "__version__",
    "accepted_presses",
    "build_button",
    "calibrate",
    "check",
    "drive_for",
    "find_presses",
    "fit",
    "high_pass",
    "learn",
    "linear_sweep",
    "load_study",
    "map_plan",
    "measure_map",
    "measure_response",
    "modulate",
    "open_rig",
    "paper_drive",
    "plan_excitation",
    "play_button",
    "quick_response",
    "read_uff",
    "record",
    "representative",
    "run_study",
    "write_uff",
]

_ROOMS = {
    "acquisition": (
        "ButtonPress",
        "PressVerdict",
        "Protocol",
        "Recording",
        "Representative",
        "Study",
        "accepted_presses",
        "find_presses",
        "high_pass",
        "load_study",
        "record",
        "representative",
        "run_study",
    ),
    "calibration": (
        "Calibration",
        "Check",
        "DigitalButton",
        "Drive",
        "Learning",
        "LinearSweep",
        "Model",
        "Multisine",
        "Response",
        "VibrationMap",
        "calibrate",
        "build_button",
        "check",
        "drive_for",
        "fit",
        "learn",
        "linear_sweep",
        "map_plan",
        "measure_map",
        "measure_response",
        "modulate",
        "paper_drive",
        "plan_excitation",
        "play_button",
        "quick_response",
        "read_uff",
        "write_uff",
    ),
    "instruments": (
        "ConfigurationError",
        "DataError",
        "HaploopError",
        "InstrumentError",
        "LimitError",
        "Limits",
        "Rig",
        "open_rig",
    ),
}
_ROOM_OF = {name: room for room, names in _ROOMS.items() for name in names}


def __getattr__(name: str) -> Any:
    if name == "__version__":
        value: Any = metadata.version("haploop")
    elif name in _ROOM_OF:
        value = getattr(import_module(_ROOM_OF[name]), name)
    else:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__})
