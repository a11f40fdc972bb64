"""Experiments as files, and what comes next in a session."""

from .design import Balance, balance_of
from .experiment_file import (
    Experiment,
    ExperimentFile,
    example_names,
    load_experiment,
)
from .rating import Rated, Timing, timing_of
from .steps import (
    Answer,
    Assignment,
    Course,
    Step,
    digital_button,
    group_of_slot,
    played_by_rig,
    right_answer,
    session_levels,
    valid,
)

__all__ = [
    "Answer",
    "Assignment",
    "Balance",
    "Course",
    "Experiment",
    "ExperimentFile",
    "Rated",
    "Step",
    "Timing",
    "balance_of",
    "digital_button",
    "example_names",
    "group_of_slot",
    "load_experiment",
    "played_by_rig",
    "right_answer",
    "session_levels",
    "timing_of",
    "valid",
]
