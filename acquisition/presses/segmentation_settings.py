"""Parameters of the press detection, those of the paper's buttons, and the least sample rates of steps."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from types import MappingProxyType
from typing import Literal, NamedTuple

from ...base.errors import ConfigurationError


@dataclass(frozen=True)
class Segmentation:
    """Parameters of the press detection. Forces (N) are relative to the rest, whose drift is tracked."""

    pressed: float = 0.30
    """A press begins when the force, averaged over `bin`, rises above this."""
    released: float = 0.15
    """A press ends when the force has stayed below this for `quiet`."""
    quiet: float = 0.10
    """s. A shorter absence of the finger does not end the press. While recording, the longer
    `haploop.acquisition.presses.quality.Protocol.quiet` applies."""
    least_peak: float = 0.5
    """Smallest peak of a press; a lower peak is a touch."""
    onset: float = 0.06
    """The onset is the last sample at which the force was below this: ten sigma of the average over `bin`,
    with 0.03 N of noise."""
    bin: float = 0.005
    """s: averaging time of the force before it is compared with these thresholds."""
    follow: float = 1.0
    """s: time constant of the tracking of the rest between presses. A drift of 0.05 N/min
    (docs/hardware.md, "Force sensor") leaves an error of 0.001 N."""
    settle: float = 0.005
    """s: a contact has switched when it is in the new state for most of this time; the instant of switching
    lies at most this long before. Contacts bounce for 0.1 to 5 ms (docs/hardware.md, "Buttons and
    people")."""
    fit: float = 0.0015
    """s: length of the force fit on each side of the activation; two samples at least (`force_at.py`)."""
    margin: float = 0.25
    """s: margin of a press's window before its onset and after its release; less when a neighbour is near."""
    stage_lead: float = 0.15
    """s: longest search before the activation for a first click, which comes 30 to 100 ms before in a latch
    (docs/hardware.md, "Buttons and people")."""
    stage_gap: float = 0.012
    """s: shortest time between a first click and the activation; later motion belongs to the main click."""
    stage_share: float = 0.15
    """Smallest peak acceleration of a first click, as a fraction of the main click's; only noise
    (`stage_noise`) moves the cap otherwise."""
    stage_noise: float = 8.0
    """Smallest peak acceleration of a first click, in multiples of the rms before the onset."""
    stage_force: float = 0.25
    """Smallest force at a first click, as a fraction of the force at activation: a finger that lands on the
    cap also knocks, but at almost no force."""
    stage_high_pass: float = 60.0
    """Hz: above the motion of a hand and below a click (100 to 500 Hz)."""
    travel_pressed: float = 1e-4
    """m: as `pressed`, for a cap's travel where no force is measured; buttons travel 1 to 3 mm."""
    travel_released: float = 5e-5
    """m: as `released`, and the largest peak-to-peak travel at rest."""
    travel_peak: float = 3e-4
    """m: as `least_peak`."""
    travel_onset: float = 2e-5
    """m: as `onset`."""
    shaken_pressed: float = 0.5
    """m/s^2: as `pressed`, for the mean magnitude of the vibration where neither force nor travel is
    measured; raised to five times that of the rest."""
    shaken_released: float = 0.25
    """m/s^2: as `released` and `onset`."""
    shaken_peak: float = 1.0
    """m/s^2: as `least_peak`."""
    shaken_quiet: float = 0.6
    """s: longest time between two clicks of one press, such as a momentary button's two (a choice)."""
    snap_share: float = 0.04
    """Smallest fall of the force at a snap, as a fraction of the press's largest force."""


SEGMENTATIONS: Mapping[str, Segmentation] = MappingProxyType(
    {"latch": Segmentation(least_peak=1.0), "toggle": Segmentation(least_peak=0.4), "push": Segmentation()}
)
"""The parameters of the paper's buttons. A latch takes 5 to 10 N, a toggle 1 to 4 N and a push button 2 to
5 N to switch (docs/hardware.md, "Buttons and people"): a peak below about a quarter of that is a touch."""


def segmentation_for(button: str) -> Segmentation:
    """Parameters of a button; the defaults for a button that is not in `SEGMENTATIONS`."""
    return SEGMENTATIONS.get(button, Segmentation())


# The least sample rates of steps that need one. docs/how-to/recording.md shows this table.
#
# A rate counts as it was measured: an import is resampled, which adds nothing. A clock that is a percent slow
# is no other rate.

Step = Literal["recording", "force at activation", "representative press"]
_MARGIN = 0.99


class Least(NamedTuple):
    """The least rate (samples/s) of a step, and what is lost below it, as a clause."""

    hz: float
    why: str


LEAST_RATES: Mapping[Step, Least] = MappingProxyType(
    {
        "recording": Least(500.0, "it records the force at activation and what a press is felt by"),
        "force at activation": Least(500.0, "two samples on each side of it last as long as the snap, 4 ms"),
        "representative press": Least(500.0, "the skin feels vibration best near 250 Hz, half of it"),
    }
)


def fast_enough(step: Step, rate_hz: float) -> bool:
    """True when `rate_hz` (samples/s) is enough for a step."""
    return rate_hz >= _MARGIN * LEAST_RATES[step].hz


def require_rate(step: Step, rate_hz: float, whose: str, remedy: str) -> None:
    """Raise ConfigurationError when `rate_hz` (samples/s) of `whose` is too low for a step."""
    least = LEAST_RATES[step]
    if not fast_enough(step, rate_hz):
        raise ConfigurationError(
            f"{whose} has {rate_hz:g} samples/s, and a {step} needs {least.hz:g}, because {least.why}: "
            f"{remedy}."
        )
