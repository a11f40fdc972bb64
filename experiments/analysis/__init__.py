"""Statistics of experiments: identification, ratings, and the power of a plan."""

from .anova import Effect, Sphericity, anova
from .confusion import METRICS, Confusion, confusion_of, confusions_by
from .effect_size import eta_squared_interval
from .identification import Identification, Performance, analyse_identification
from .lab import lab_threshold_of, people_table
from .manova import (
    MultivariateEffect,
    eta_squared_of_f,
    manova_independent,
    manova_repeated,
)
from .pairs import Comparison, compare_levels
from .power import Power, PowerPlan, load_power_plan, power_of
from .prediction import PAPER, Prediction, participant_model, predict_answers
from .proportions import clustered_interval, wilson_interval
from .ratings import PairRatings, Ratings, analyse_ratings, normalise
from .table import Rows, read_rows
from .threshold import Threshold, analyse_thresholds

__all__ = [
    "METRICS",
    "PAPER",
    "Comparison",
    "Confusion",
    "Effect",
    "Identification",
    "MultivariateEffect",
    "PairRatings",
    "Performance",
    "Power",
    "PowerPlan",
    "Prediction",
    "Ratings",
    "Rows",
    "Sphericity",
    "Threshold",
    "analyse_identification",
    "analyse_ratings",
    "analyse_thresholds",
    "anova",
    "clustered_interval",
    "compare_levels",
    "confusion_of",
    "confusions_by",
    "eta_squared_interval",
    "eta_squared_of_f",
    "lab_threshold_of",
    "load_power_plan",
    "manova_independent",
    "manova_repeated",
    "normalise",
    "participant_model",
    "people_table",
    "power_of",
    "predict_answers",
    "read_rows",
    "wilson_interval",
]
