"""Statistics of experiments: identification, ratings, and the power of a plan."""

from haploop.experiments.analysis.anova import Effect, Sphericity, anova
from haploop.experiments.analysis.confusion import METRICS, Confusion, confusion_of, confusions_by
from haploop.experiments.analysis.effect_size import eta_squared_interval
from haploop.experiments.analysis.identification import Identification, Performance, analyse_identification
from haploop.experiments.analysis.manova import (
    MultivariateEffect,
    eta_squared_of_f,
    manova_independent,
    manova_repeated,
)
from haploop.experiments.analysis.pairs import Comparison, compare_levels
from haploop.experiments.analysis.power import Power, PowerPlan, load_power_plan, power_of
from haploop.experiments.analysis.proportions import clustered_interval, wilson_interval
from haploop.experiments.analysis.ratings import PairRatings, Ratings, analyse_ratings, normalise
from haploop.experiments.analysis.table import Rows, read_rows
from haploop.experiments.analysis.threshold import Threshold, analyse_thresholds

__all__ = [
    "METRICS",
    "Comparison",
    "Confusion",
    "Effect",
    "Identification",
    "MultivariateEffect",
    "PairRatings",
    "Performance",
    "Power",
    "PowerPlan",
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
    "load_power_plan",
    "manova_independent",
    "manova_repeated",
    "normalise",
    "power_of",
    "read_rows",
    "wilson_interval",
]
