"""A calibration: response and model of one patch at one point, dated and never edited."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from calibration import files
from calibration.hysteresis import Hysteresis, fit_hysteresis
from calibration.model import Model, fit
from calibration.response import Response, measure_response
from instruments import Rig, RigFile

__all__ = ["Calibration", "calibrate"]


@dataclass(frozen=True, eq=False)
class Calibration:
    """What is known of one patch at one point; `rate_hz` is the rate that drives are played at.

    The model holds for swings of the sweep's level, the hysteresis says what changes with the swing.
    """

    response: Response
    model: Model
    hysteresis: Hysteresis
    rate_hz: float

    @classmethod
    def of(cls, response: Response) -> Calibration:
        """Model and hysteresis fitted to a response. Raises what `fit` raises."""
        table = RigFile.model_validate_json(response.rig_file).table
        assert table is not None  # the response was measured on it
        return cls(response, fit(response), fit_hysteresis(response), table.rate_hz)

    @property
    def digest(self) -> str:
        """Content hash of everything that a drive is computed from."""
        return files.digest(files.flatten(self))

    def save(self, path: str | Path) -> None:
        """Write to a new HDF5 file, whole or not at all. Raises DataError if it exists."""
        files.write(path, "calibration", files.flatten(self))

    @classmethod
    def load(cls, path: str | Path) -> Calibration:
        """Read what `save` wrote. Raises DataError, one sentence, for anything else."""
        return files.restore(cls, files.read(path, "calibration"), path)


def calibrate(
    rig: Rig,
    patch: str = "A",
    point: str = "button",
    progress: Callable[[float, float], None] = lambda _done, _total: None,
) -> Calibration:
    """Measure the response of a patch at a point and fit a model to it.

    `progress` is told the seconds measured so far and the seconds that the whole will take.
    Raises what `measure_response` and `fit` raise.
    """
    return Calibration.of(measure_response(rig, patch, point, progress))
