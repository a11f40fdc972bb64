"""`rig.toml`: the tables of the file that describes a rig, as values (`rig_reading` reads them)."""

from __future__ import annotations

import hashlib
from pathlib import Path
from typing import Annotated, Any, Literal, Self

from pydantic import (
    BaseModel,
    ConfigDict,
    Field,
    ValidationError,
    ValidationInfo,
    field_validator,
    model_validator,
)
from pydantic_core import InitErrorDetails

from ...base import entry_points
from ...base.bounded import Fraction, Negative, NotNegative, Positive, Seed, Strict
from ..limits import Limits
from ..sensors import Sensors
from .actuator import Actuator

RatingSource = Annotated[str, Field(min_length=5, max_length=200, pattern=r"\S")] | None
"""Where a figure beyond the product's own is from: a data sheet of another version, or who measured it."""


def require_source(product: str, key: str, value: float, own: float, source: str | None) -> None:
    """Refuse a figure that is not the product's own without its source. Raises ValueError."""
    if source is None:
        raise ValueError(
            f"{key} = {value:g} is not what the {product} has ({own:g}): correct it, or say where it is from "
            "in rating_source"
        )


class Device(BaseModel):
    """One instrument: the name of its driver, and settings that the driver itself validates."""

    model_config = ConfigDict(frozen=True, extra="allow")

    driver: str

    @property
    def settings(self) -> dict[str, Any]:
        """Everything but the driver's name."""
        return dict(self.model_extra or {})


class TableSettings(Strict):
    """The touch table: its grid of measuring points, row by row, the button point, and its patches."""

    rows: Annotated[int, Field(strict=True, ge=1, le=1000)] = 7
    columns: Annotated[int, Field(strict=True, ge=1, le=1000)] = 12
    button_point: Annotated[int, Field(strict=True, ge=0, lt=1_000_000)]
    patches: tuple[str, ...] = ("A", "B", "C", "D")
    """Names of its driven places; what drives them is in `[actuator]`."""
    rate_hz: Positive = 50_000.0
    """Sample rate of drives and of the vibrometer: ten times the recording's, so that the steps of
    the drive lie far above the table's band."""
    patch_places: dict[str, tuple[Fraction, Fraction]] = Field(default_factory=dict)
    """Places of the patches, as fractions of the table's width and height from the corner at its first
    grid point: `haploop doctor` finds swapped relay channels by them."""
    force: bool = False
    """Whether the rig's force sensor carries the table, and so feels a finger that presses it."""

    @field_validator("patch_places")
    @classmethod
    def _known(
        cls, places: dict[str, tuple[float, float]], info: ValidationInfo
    ) -> dict[str, tuple[float, float]]:
        unknown = sorted(set(places) - set(info.data.get("patches", places)))
        if unknown:
            raise ValueError(f"there is no patch {unknown[0]!r} in patches")
        return places

    @model_validator(mode="after")
    def _on_the_grid(self) -> Self:
        if self.button_point >= self.rows * self.columns:
            raise ValueError(
                f"button_point = {self.button_point} is beyond the grid, whose {self.rows} rows of "
                f"{self.columns} are numbered 0 to {self.rows * self.columns - 1}"
            )
        return self

    def nearest(self, place: tuple[float, float]) -> int:
        """Number of the grid point nearest to a place (fractions of width and height)."""
        column = min(int(place[0] * self.columns), self.columns - 1)
        row = min(int(place[1] * self.rows), self.rows - 1)
        return row * self.columns + column


class DriveLimits(Strict):
    """The `[limits]` table: the rig's own limits, besides those of its parts (see `Limits`).

    Where the defaults are from: docs/hardware.md, "Limits and loss of the host".
    """

    peak_to_peak: Positive = 100.0
    min: Negative = -50.0
    max: Positive = 50.0
    slew: Positive = 0.5e6
    max_duration: Positive = 60.0
    duty: Annotated[float, Field(strict=True, gt=0, le=1)] = 1.0
    max_offset: NotNegative = 0.5
    max_end: NotNegative = 0.5

    def limits(self) -> Limits:
        """Convert to `Limits`, which checks drives."""
        return Limits(**self.model_dump())


_NORMAL = 1.96
"""Half of a normal distribution's interval of 95 %, over its standard deviation: Student's is wider."""
_ROUNDED = 0.15
"""What rounding to 0.1 dB can take from an uncertainty, and add to that of a spread (dB)."""


class People(Strict):
    """The `[people]` table: the detection threshold that a lab measured with its own people.

    `haploop analyse thresholds --of BUTTON.h5` writes it. It replaces the estimate by which a check says
    whether a person who presses feels a motion.
    """

    number: Annotated[int, Field(strict=True, ge=3, le=100_000)]
    """People who took part."""
    threshold: Annotated[float, Field(strict=True, ge=-60, le=60)]
    """Threshold of the mean person, over the table's for a finger that presses (dB)."""
    uncertainty: Annotated[float, Field(strict=True, gt=0, le=60)]
    """Half of its interval of 95 % (dB)."""
    spread: Annotated[float, Field(strict=True, gt=0, le=60)]
    """Standard deviation between people (dB)."""
    button: Annotated[str, Field(min_length=1, max_length=80)]
    """Button that was played."""
    force: Annotated[float, Field(strict=True, gt=0, le=100)] | None = None
    """Force at its activation (N)."""
    simulated: bool = False
    """Whether simulated participants answered."""

    @field_validator("button")
    @classmethod
    def _shown(cls, button: str) -> str:
        if not button.isprintable():
            raise ValueError("use characters that can be printed")
        return button

    @model_validator(mode="after")
    def _as_sure_as_it_can_be(self) -> Self:
        least = _NORMAL * self.spread / self.number**0.5
        if self.uncertainty < least - _ROUNDED:
            raise ValueError(
                f"{self.number} people who differ by {self.spread:g} dB tell their mean to {least:.1f} dB "
                "at best, "
                f"and not to uncertainty = {self.uncertainty:g}: take the table that haploop analyse "
                "thresholds wrote"
            )
        return self


_BEYOND = 1.25
"""Largest [abort] drive over the limits: what the errors of a drive monitor and its divider can ask for."""


class AbortLimits(Strict):
    """The `[abort]` table: measured values that stop a play, in any of its blocks, and lock the rig out."""

    drive: Positive | None = None
    """Largest voltage at the patch (V); None: a tenth beyond `rig.limits`."""
    drive_source: RatingSource = None
    """Why `drive` may lie further beyond the limits than the monitor's error asks for, and who says so."""
    velocity: Positive | None = None
    """Largest surface velocity at the laser (m/s), within the vibrometer's range; None: not tested."""
    displacement: Positive | None = None
    """The same (m) where the vibrometer shows displacement."""
    acceleration: Positive | None = None
    """The same (m/s^2) where an accelerometer is the vibrometer."""
    force: Annotated[float, Field(strict=True, gt=0, le=100)] | None = None
    """Largest change of the normal force during a play (N), at most what a finger can press; None: not
    tested. A limit needs the force sensor's channels sampled at the table's rate, which the card must
    support."""

    def too_high(self, peak: float) -> str:
        """What is wrong with `drive` where the limits' largest voltage is `peak` (V), as a clause; or ""."""
        if self.drive is None or self.drive_source is not None or self.drive <= _BEYOND * peak:
            return ""
        return (
            f"drive = {self.drive:g} V stops no play that goes wrong, because the limits are {peak:g} V: "
            f"leave it out, write {_BEYOND * peak:g} or less, or say in drive_source why it must be higher"
        )


class SimulationSettings(Strict):
    """The `[simulation]` table: the plant of a simulated rig, and settings that this plant validates."""

    model_config = ConfigDict(frozen=True, extra="allow")

    plant: str = "table"
    """Name of an installed plant."""
    seed: Seed = 0
    vibrometer_noise_scale: NotNegative = 1.0
    hysteresis: Annotated[float, Field(strict=True, ge=0, le=0.5)] = 0.12
    """Width of the patches' loop over its height; 10 to 15 % is an estimate (docs/hardware.md, "Patches")."""
    bad_press_rate: Fraction = 0.0
    """Fraction of presses that go wrong: too soft, too hard, double, or with a hand resting on the button."""
    faults: tuple[dict[str, Any], ...] = ()
    """Faults of the plant, one table each: `kind`, and that kind's settings (docs/reference/faults.md)."""

    @property
    def settings(self) -> dict[str, Any]:
        """Settings of the plant itself."""
        return dict(self.model_extra or {})


class Recalibration(Strict):
    """The `[recalibration]` table: thresholds of drifted and broken for `haploop recalibrate`.

    The first five let a button's error grow by about a tenth of its target, half of what a check
    accepts, so that a drift is found before a button fails (measured on the simulated table: 0.3 %
    of resonance raises an error of 6.8 % to 12.0 %, 20 % of damping to 10.5 %). A table with less
    damping needs a smaller `resonance`: about a third of the damping ratio.
    """

    resonance: Positive = 0.003
    """Relative shift of the resonances: a third of their half-width, past which phase turns fast."""
    damping: Positive = 0.2
    """Relative change of the damping ratios: resonances grow or shrink by as much."""
    gain: Positive = 0.1
    """Relative change of surface velocity per volt: an error of the same size."""
    factor: Positive = 0.05
    """Relative change, common to all modes, of velocity per volt at the patch: beyond it nothing is made anew
    without a person, because a laser that is askew does the same as a weaker patch."""
    shape: Positive = 0.1
    """Residual, relative to the whole response, that no drift of the modes explains."""
    change: Positive = 0.1
    """Change of the motion that any button's drive makes, predicted from response and hysteresis as they
    are now, over its target: by so much the error grows, or by less."""
    coherence: Fraction = 0.8
    """Lowest median coherence: below it no drive can be computed, and something is broken."""


def roles() -> tuple[str, ...]:
    """Roles of the installed packages, in the order in which a rig opens them.

    Each may be a table of a rig file, which names a driver. The DAQ comes first, then haploop's other
    roles, then those of other packages.
    """
    own = list(RigFile.model_fields)
    found = entry_points.installed(entry_points.ROLES)
    return tuple(sorted(found, key=lambda role: (own.index(role) if role in own else len(own), role)))


class RigFile(Strict):
    """A validated rig file. A role that another package adds is an attribute like haploop's own."""

    model_config = ConfigDict(extra="allow")

    __pydantic_extra__: dict[str, Device] = Field(init=False)

    name: str
    simulate: Literal["twin", "wire"] | None = None
    """Mode of simulation, in a file that describes no hardware."""
    rate_hz: Positive = 5000.0
    """Sample rate of recordings (the paper's 5 kS/s)."""
    daq: Device
    adc: Device | None = None
    """A DAQ on its own clock, recorded along with `daq`."""
    amplifier: Device | None = None
    relay: Device | None = None
    vibrometer: Device | None = None
    generator: Device | None = None
    player: Device | None = None
    operator: Device = Device(driver="console")
    table: TableSettings | None = None
    actuator: Actuator | None = None
    wiring: Literal["relay", "direct"] = "relay"
    """direct: one actuator on one amplifier, always connected (docs/explanation/safety.md)."""
    sensors: Sensors = Sensors()
    limits: DriveLimits = DriveLimits()
    abort: AbortLimits = AbortLimits()
    state: str | None = None
    """Folder of the audit log and the lockouts, for a lab where several people use one rig; None: each
    user's own. The environment variable HAPLOOP_STATE takes precedence."""
    recalibration: Recalibration = Recalibration()
    people: People | None = None
    simulation: SimulationSettings = SimulationSettings()

    @field_validator("state")
    @classmethod
    def _one_place(cls, state: str | None) -> str | None:
        # A lockout that depends on the working directory protects nothing.
        if state is not None and not Path(state).expanduser().is_absolute():
            raise ValueError("use an absolute path, or a path that begins with ~")
        return state

    @model_validator(mode="before")
    @classmethod
    def _known_tables(cls, raw: Any) -> Any:
        known = {*cls.model_fields, *roles()}
        unknown = [key for key in raw if key not in known] if isinstance(raw, dict) else []
        if unknown:
            extra = InitErrorDetails(type="extra_forbidden", loc=(unknown[0],), input=raw[unknown[0]])
            raise ValidationError.from_exception_data(cls.__name__, [extra])
        return raw

    @property
    def devices(self) -> dict[str, Device]:
        """Table of each role of the rig, in the order of opening."""
        # Not attributes: another package may call its role like a table or a method of this class.
        tables = dict(self)
        return {role: tables[role] for role in roles() if isinstance(tables.get(role), Device)}

    @property
    def at_rest(self) -> str:
        """The safe state of this rig, as a clause."""
        if self.relay is not None:
            return "the output is zero and the relay is open"
        return "the output is zero" + (
            ", and the actuator stays connected" if self.wiring == "direct" else ""
        )

    @property
    def digest(self) -> str:
        """SHA-256 of the content of the file and its bases, without comments and order."""
        return hashlib.sha256(self.model_dump_json().encode()).hexdigest()
