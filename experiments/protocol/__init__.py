"""Experiments as files, and what comes next in a session."""

from .experiment_file import Experiment as Experiment
from .experiment_file import ExperimentFile as ExperimentFile
from .experiment_file import example_names as example_names
from .experiment_file import load_experiment as load_experiment
from .rating import Rated as Rated
from .rating import Timing as Timing
from .rating import timing_of as timing_of
from .steps import Answer as Answer
from .steps import Assignment as Assignment
from .steps import Balance as Balance
from .steps import Course as Course
from .steps import Step as Step
from .steps import balance_of as balance_of
from .steps import digital_button as digital_button
from .steps import group_of_slot as group_of_slot
from .steps import played_by_rig as played_by_rig
from .steps import right_answer as right_answer
from .steps import session_levels as session_levels
from .steps import valid as valid
