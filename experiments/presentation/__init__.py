"""The rig's part in an experiment: a touch surface that measures fingers and plays digital buttons."""

from haploop.experiments.presentation.new_experiment import new_experiment
from haploop.experiments.presentation.presenter import Logged, Presenter, fingers_in
from haploop.experiments.presentation.surface import TouchSurface, prepare_surface

__all__ = ["Logged", "Presenter", "TouchSurface", "fingers_in", "new_experiment", "prepare_surface"]
