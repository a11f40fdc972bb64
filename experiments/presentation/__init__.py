"""The rig's part in an experiment: a touch surface that measures fingers and plays digital buttons."""

from .new_experiment import new_experiment
from .presenter import Logged, Presenter, fingers_in
from .surface import TouchSurface, prepare_surface

__all__ = ["Logged", "Presenter", "TouchSurface", "fingers_in", "new_experiment", "prepare_surface"]
