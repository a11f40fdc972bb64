"""The finger's contact area, and the digital buttons that it activates."""

from .area import (
    Background,
    Contact,
    ContactMeter,
    SeenSurface,
    calibrate_meter,
    drop_old_frames,
    learn_background,
)
from .button import (
    BUDGET,
    Activator,
    Latency,
    Played,
    Rendering,
    VerifiedButton,
    latency_of,
    run_button,
    verify_button,
    without_lead_in,
)
from .finger import (
    FingerCalibration,
    activation_areas,
    calibrate_finger,
    press_area,
    watch_touch,
)

__all__ = [
    "BUDGET",
    "Activator",
    "Background",
    "Contact",
    "ContactMeter",
    "FingerCalibration",
    "Latency",
    "Played",
    "Rendering",
    "SeenSurface",
    "VerifiedButton",
    "activation_areas",
    "calibrate_finger",
    "calibrate_meter",
    "drop_old_frames",
    "latency_of",
    "learn_background",
    "press_area",
    "run_button",
    "verify_button",
    "watch_touch",
    "without_lead_in",
]
