"""haploop: from a physical button to a verified digital one.

The rooms' public names, handed on lazily, so that a script needs one import and that import is cheap.
"""

from __future__ import annotations

from importlib import import_module, metadata
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from acquisition import (
        ButtonPress,
        Recording,
        Representative,
        find_presses,
        high_pass,
        record,
        representative,
    )
    from calibration import (
        Calibration,
        Check,
        Drive,
        Model,
        Response,
        calibrate,
        check,
        drive_for,
        fit,
        linear_sweep,
        measure_response,
        modulate,
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
    "Drive",
    "HaploopError",
    "InstrumentError",
    "LimitError",
    "Limits",
    "Model",
    "Recording",
    "Representative",
    "Response",
    "Rig",
    "__version__",
    "calibrate",
    "check",
    "drive_for",
    "find_presses",
    "fit",
    "high_pass",
    "linear_sweep",
    "measure_response",
    "modulate",
    "open_rig",
    "record",
    "representative",
]

_ROOMS = {
    "acquisition": (
        "ButtonPress",
        "Recording",
        "Representative",
        "find_presses",
        "high_pass",
        "record",
        "representative",
    ),
    "calibration": (
        "Calibration",
        "Check",
        "Drive",
        "Model",
        "Response",
        "calibrate",
        "check",
        "drive_for",
        "fit",
        "linear_sweep",
        "measure_response",
        "modulate",
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
