"""The operator of the rig: the role, a console, and unattended operation."""

from haploop.instruments.operator.role import (
    Aim,
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
)
from haploop.instruments.operator.unattended import Unattended

__all__ = [
    "Aim",
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
    "Unattended",
]
