"""`rig.toml`: the one file that describes a rig, validated whole before anything is opened."""

from __future__ import annotations

import difflib
import tomllib
from importlib import resources
from pathlib import Path
from typing import Annotated, Any, Literal, TypeVar

from pydantic import BaseModel, ConfigDict, Field, ValidationError

from instruments.errors import ConfigurationError
from instruments.limits import Limits
from instruments.sensors import Sensors

__all__ = ["Device", "RigFile", "SimulationSettings", "Table", "load_rig_file", "validate"]

Model = TypeVar("Model", bound=BaseModel)
Positive = Annotated[float, Field(gt=0, allow_inf_nan=False)]
NotNegative = Annotated[float, Field(ge=0, allow_inf_nan=False)]


class _Section(BaseModel):
    model_config = ConfigDict(frozen=True, extra="forbid")


class Device(BaseModel):
    """One instrument: the name of its driver, and settings that the driver itself validates."""

    model_config = ConfigDict(frozen=True, extra="allow")

    driver: str

    @property
    def settings(self) -> dict[str, Any]:
        """Everything but the driver's name."""
        return dict(self.model_extra or {})


class Table(_Section):
    """The touch table: its grid of measuring points, row by row, and where the buttons are."""

    rows: Annotated[int, Field(ge=1)] = 7
    columns: Annotated[int, Field(ge=1)] = 12
    button_point: Annotated[int, Field(ge=0)]
    patches: tuple[str, ...] = ("A", "B", "C", "D")
    patch_capacitance: Positive
    patch_low: float
    patch_high: float
    rate_hz: Positive = 50_000.0
    """Sample rate of drives and of the vibrometer: ten times the recording's, so that the steps of
    the drive lie far above the table's band."""


class DriveLimits(_Section):
    """The `[limits]` table: the rig's own limits, below those of its parts (see `Limits`)."""

    swing: Positive = 100.0
    low: float = -50.0
    high: float = 50.0
    slew: Positive = 0.5e6
    burst: Positive = 60.0
    mean: NotNegative = 0.5
    end: NotNegative = 0.5

    def limits(self) -> Limits:
        """As a value that checks drives."""
        return Limits(**self.model_dump())


class SimulationSettings(_Section):
    """The `[simulation]` table: which plant stands in for the world when the rig is simulated."""

    seed: Annotated[int, Field(ge=0)] = 0
    mode_drift: Annotated[float, Field(gt=-0.5, lt=0.5)] = 0.0
    """Relative shift of every mode's frequency."""
    damping_scale: Positive = 1.0
    vibrometer_noise_scale: NotNegative = 1.0
    hysteresis: Annotated[float, Field(ge=0, le=0.5)] = 0.12
    """Width of the patches' loop over its height; 10 to 15 % is an estimate (hardware.md, section 13)."""
    collocated: bool = False
    """Put patch A under the button point, so that the response has no right-half-plane zeros."""


class RigFile(_Section):
    """A validated rig file."""

    name: str
    simulate: Literal["twin", "wire"] | None = None
    """Set in a file that describes no hardware at all."""
    rate_hz: Positive = 5000.0
    """Sample rate of recordings (the paper's 5 kS/s)."""
    daq: Device
    amplifier: Device | None = None
    relay: Device | None = None
    vibrometer: Device | None = None
    operator: Device = Device(driver="console")
    table: Table | None = None
    sensors: Sensors = Sensors()
    limits: DriveLimits = DriveLimits()
    simulation: SimulationSettings = SimulationSettings()


def load_rig_file(path: str | Path) -> RigFile:
    """Read and validate a rig file; the bare name of a rig that haploop ships is found as well.

    A file with `base = "NAME"` says only how it differs from another rig file (a path beside it,
    or the bare name of a shipped rig). A file that holds nothing but `[simulation]` is the
    simulated rig with another plant.
    Raises ConfigurationError, which names the file, the key, and what was expected.
    """
    return validate(RigFile, _raw(Path(path), ()), str(path))


def _raw(path: Path, above: tuple[Path, ...]) -> dict[str, Any]:
    if path in above:
        raise ConfigurationError(f"{above[-1]}: the base {path} builds on this file itself.")
    text = _read(path)
    try:
        raw = tomllib.loads(text)
    except tomllib.TOMLDecodeError as error:
        raise ConfigurationError(f"{path} is not valid TOML: {error}.") from None
    base = "simulated" if set(raw) == {"simulation"} else raw.pop("base", None)
    if base is None:
        return raw
    if not isinstance(base, str):
        raise ConfigurationError(f"{path}: base must be the name of another rig file (found {base!r}).")
    beside = path.parent / base
    return _merged(_raw(beside if beside.is_file() else Path(base), (*above, path)), raw)


def _merged(base: dict[str, Any], own: dict[str, Any]) -> dict[str, Any]:
    """`own` over `base`, table by table."""
    both = {k: _merged(base[k], v) for k, v in own.items() if isinstance(v, dict) and k in base}
    return {**base, **own, **both}


def validate(model: type[Model], raw: object, source: str) -> Model:
    """`raw` as a `model`; the first thing that is wrong becomes one ConfigurationError sentence."""
    try:
        return model.model_validate(raw)
    except ValidationError as error:
        raise ConfigurationError(_sentence(error, model, source)) from None


def _read(path: Path) -> str:
    if path.suffix == "" and path.name == str(path) and not path.exists():
        return _shipped(path.name)
    try:
        return path.read_text(encoding="utf-8")
    except FileNotFoundError:
        raise ConfigurationError(
            f"There is no rig file {path}; name an existing file, or one of: {', '.join(_names())}."
        ) from None
    except (OSError, UnicodeDecodeError) as error:
        raise ConfigurationError(f"The rig file {path} cannot be read: {error}.") from None


def _names() -> list[str]:
    return sorted(p.name[:-5] for p in resources.files("rigs").iterdir() if p.name.endswith(".toml"))


def _shipped(name: str) -> str:
    if name not in _names():
        raise ConfigurationError(f"There is no rig {name!r}; haploop ships: {', '.join(_names())}.")
    return (resources.files("rigs") / f"{name}.toml").read_text(encoding="utf-8")


def _sentence(error: ValidationError, model: type[BaseModel], source: str) -> str:
    first = error.errors()[0]
    key = ".".join(str(part) for part in first["loc"])
    if first["type"] == "extra_forbidden":
        known = _keys_at(model, first["loc"][:-1])
        near = difflib.get_close_matches(str(first["loc"][-1]), known, n=1)
        hint = f"did you mean {near[0]!r}?" if near else f"known keys are {', '.join(sorted(known))}."
        return f"{source}: unknown key {key!r}; {hint}"
    if first["type"] == "missing":
        return f"{source}: the key {key!r} is missing."
    message = first["msg"][:1].lower() + first["msg"][1:]
    return f"{source}: {key or 'the file'}: {message} (found {first['input']!r})."


def _keys_at(model: type[BaseModel], location: tuple[int | str, ...]) -> list[str]:
    for part in location:
        field = model.model_fields.get(str(part))
        kinds = [field.annotation, *getattr(field.annotation, "__args__", ())] if field else []
        inner = [k for k in kinds if isinstance(k, type) and issubclass(k, BaseModel)]
        if not inner:
            return []
        model = inner[0]
    return list(model.model_fields)
