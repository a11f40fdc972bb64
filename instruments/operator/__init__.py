"""The operator of the rig: the role, a console, and unattended operation."""

from .role import (
    Aim,
    Cable,
    ConfirmSettings,
    Consent,
    Operator,
    Place,
    Press,
    Ready,
    Remove,
    Request,
    Rest,
    TakeTarget,
    Target,
    Touch,
    UnansweredError,
    Uncable,
)
from .unattended import Unattended

__all__ = [
    "Aim",
    "Cable",
    "ConfirmSettings",
    "Consent",
    "Operator",
    "Place",
    "Press",
    "Ready",
    "Remove",
    "Request",
    "Rest",
    "TakeTarget",
    "Target",
    "Touch",
    "UnansweredError",
    "Unattended",
    "Uncable",
]
