"""Faults: a seeded schedule of misbehaviours of plant, twins and wires, each counting how often it fired.

A rig file asks for them in `[[simulation.faults]]`. There are three sorts. A permanent fault is a miswired
or misset rig, wrong from the beginning. A timed fault is active for a while, once or several times. A
per-event fault affects single events: a command to the relay, a read of the DAQ, a reply on a line. Times
are seconds of the plant's clock since the rig was opened; `within` lets the seed choose one.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Annotated, Any, Generic, Literal, TypeVar

import numpy as np
from pydantic import BaseModel, ConfigDict, Field

from haploop.instruments.arrays import BoolArray, FloatArray
from haploop.instruments.clock import Clock
from haploop.instruments.config import ROLES, RigFile, validate_kind
from haploop.instruments.errors import ConfigurationError
from haploop.mocks.relay.box import BoxFault

__all__ = [
    "KINDS",
    "AccelerometerInverted",
    "AmplifierGain",
    "AmplifierTrip",
    "ClockDrift",
    "DaqOverflow",
    "DaqOverrun",
    "Fault",
    "FaultSettings",
    "Faults",
    "ForceCalibration",
    "LaserBlocked",
    "LaserDropout",
    "PatchDead",
    "RelayLost",
    "RelayStuck",
    "RelaySwapped",
    "RelayWelded",
    "Reply",
    "RtsiMissing",
    "SensorDisconnected",
    "SensorSaturated",
    "VibrometerRange",
    "box_faults",
]

Positive = Annotated[float, Field(gt=0, allow_inf_nan=False)]
NotNegative = Annotated[float, Field(ge=0, allow_inf_nan=False)]


class FaultSettings(BaseModel):
    """One table of `[[simulation.faults]]`; `kind` says which. The base class is a permanent fault."""

    model_config = ConfigDict(frozen=True, extra="forbid")

    kind: str


class _Scheduled(FaultSettings):
    after: NotNegative = 0.0
    """Seconds since the rig was opened."""
    within: NotNegative = 0.0
    """Seconds after `after` within which the seed chooses the begin."""


class _Timed(_Scheduled):
    duration: Annotated[float, Field(gt=0)] = math.inf
    """Seconds that it is active; infinite until the rig is closed."""
    times: Annotated[int, Field(ge=1)] = 1
    every: Positive = 1.0
    """Mean seconds from one begin to the next, when there are several."""


class _PerEvent(_Scheduled):
    times: Annotated[int, Field(ge=1)] | None = None
    """How many events it affects; None is all of them."""


class _OfCard(_PerEvent):
    times: Annotated[int, Field(ge=1)] | None = 1
    device: str | None = None
    """None takes every card."""


class _OfRelay(_PerEvent):
    patch: str = "A"


class RelaySwapped(FaultSettings):
    """The wires of two patches are swapped behind the relay."""

    kind: Literal["relay-swapped"] = "relay-swapped"
    patches: tuple[str, str] = ("A", "B")


class VibrometerRange(FaultSettings):
    """The vibrometer is set to another range than the rig file says."""

    kind: Literal["vibrometer-range"] = "vibrometer-range"
    range: Positive = 0.1
    """m/s, full scale."""


class ForceCalibration(FaultSettings):
    """The force sensor is not the one whose matrix is in the rig file."""

    kind: Literal["force-calibration"] = "force-calibration"
    gain: Positive = 1.15
    """Ratio of the true sensor's output to that of the file's matrix."""
    crosstalk: NotNegative = 0.05
    """Standard deviation of the crosstalk from one gauge to another."""


class AccelerometerInverted(FaultSettings):
    """The accelerometer is mounted upside down: turned about its x axis."""

    kind: Literal["accelerometer-inverted"] = "accelerometer-inverted"


class PatchDead(FaultSettings):
    """A patch takes its voltage but moves nothing: it is cracked or detached."""

    kind: Literal["patch-dead"] = "patch-dead"
    patch: str = "A"


class RtsiMissing(FaultSettings):
    """There is no RTSI cable between the cards."""

    kind: Literal["rtsi-missing"] = "rtsi-missing"


class AmplifierGain(FaultSettings):
    """The amplifier's gain is another than the rig file says."""

    kind: Literal["amplifier-gain"] = "amplifier-gain"
    gain: Positive = 25.0
    """V per V."""


class SensorDisconnected(FaultSettings):
    """A channel of the DAQ is not connected: it reads ground."""

    kind: Literal["sensor-disconnected"] = "sensor-disconnected"
    channel: str


class SensorSaturated(_Timed):
    """A channel of the DAQ is driven beyond every range."""

    kind: Literal["sensor-saturated"] = "sensor-saturated"
    channel: str


class LaserDropout(_Timed):
    """Too little light returns for a short time, and the vibrometer's output jumps from end to end."""

    kind: Literal["laser-dropout"] = "laser-dropout"
    duration: Annotated[float, Field(gt=0)] = 5e-3


class LaserBlocked(_Timed):
    """The laser's path is blocked: no velocity, and ten times the noise."""

    kind: Literal["laser-blocked"] = "laser-blocked"


class AmplifierTrip(_Timed):
    """The amplifier's protection trips: its output falls to zero."""

    kind: Literal["amplifier-trip"] = "amplifier-trip"


class ClockDrift(_Scheduled):
    """A card samples on a clock of its own, which is slower than the other card's."""

    kind: Literal["clock-drift"] = "clock-drift"
    drift: Annotated[float, Field(gt=0, le=0.5)] = 500e-6
    """How much slower, as a fraction. Two free clocks differ by 5 to 50e-6 (estimate; docs/hardware.md, "Two
    cards on one clock"); an input that counts noise instead of clock edges, by any amount."""
    device: str | None = None
    """None takes the first card that has no output."""


class DaqOverrun(_OfCard):
    """Samples are not read in time, and the host's buffer runs over (NI's -200279)."""

    kind: Literal["daq-overrun"] = "daq-overrun"


class DaqOverflow(_OfCard):
    """A card's own memory runs over (NI's -200010)."""

    kind: Literal["daq-overflow"] = "daq-overflow"


class RelayLost(_OfRelay):
    """A command to the channel of a patch never reaches the box."""

    kind: Literal["relay-lost"] = "relay-lost"


class RelayStuck(_OfRelay):
    """A channel keeps its state, and reports it."""

    kind: Literal["relay-stuck"] = "relay-stuck"


class RelayWelded(_OfRelay):
    """A contact keeps its state, while the box reports the commanded one."""

    kind: Literal["relay-welded"] = "relay-welded"


class Reply(_PerEvent):
    """An instrument's answers are disturbed on their way. On a wire only: a twin has no line."""

    kind: Literal["reply"] = "reply"
    instrument: str
    """The role: relay, vibrometer, ..."""
    how: Literal["silence", "delay", "drip", "garbled", "truncated", "disconnect"] = "silence"
    asked: str = ""
    """Only answers to requests that contain this."""
    delay: Annotated[float, Field(gt=0, le=60)] = 0.05
    """Real seconds: before the answer with "delay", between its bytes with "drip"."""


KINDS: dict[str, type[FaultSettings]] = {
    str(settings.model_fields["kind"].default): settings
    for settings in (
        RelaySwapped,
        VibrometerRange,
        ForceCalibration,
        AccelerometerInverted,
        PatchDead,
        RtsiMissing,
        AmplifierGain,
        SensorDisconnected,
        SensorSaturated,
        LaserDropout,
        LaserBlocked,
        AmplifierTrip,
        ClockDrift,
        DaqOverrun,
        DaqOverflow,
        RelayLost,
        RelayStuck,
        RelayWelded,
        Reply,
    )
}
"""Every kind of fault, by the name that rig files give it."""

Settings = TypeVar("Settings", bound=FaultSettings)
Other = TypeVar("Other", bound=FaultSettings)


class Fault(Generic[Settings]):
    """One fault of a simulated rig: its settings, and when it fired."""

    def __init__(self, settings: Settings, rng: np.random.Generator) -> None:
        self.settings = settings
        self.at: list[float] = []
        """When it fired (s of the plant's clock)."""
        self._begins = np.zeros(0)
        if isinstance(settings, _Scheduled):
            first = settings.after + settings.within * rng.uniform()
            gaps = np.zeros(0)
            if isinstance(settings, _Timed):
                gaps = settings.every * rng.uniform(0.5, 1.5, settings.times - 1)
            self._begins = first + np.concatenate([np.zeros(1), np.cumsum(gaps)])

    @property
    def kind(self) -> str:
        """Its name in rig files."""
        return self.settings.kind

    @property
    def fired(self) -> int:
        """How often it had an effect: at most once if permanent, else once per active time or event."""
        return len(self.at)

    @property
    def begin(self) -> float:
        """Time (s of the plant's clock) before which it is not active."""
        return float(self._begins[0]) if len(self._begins) else 0.0

    def mark(self, now: float) -> None:
        """Record the first effect of a permanent fault."""
        if not self.at:
            self.at.append(now)

    def fires(self, now: float) -> bool:
        """Whether it affects an event that happens now; if so, record it."""
        assert isinstance(self.settings, _PerEvent)
        times = math.inf if self.settings.times is None else self.settings.times
        if now < self.begin or self.fired >= times:
            return False
        self.at.append(now)
        return True

    def active(self, times: FloatArray) -> BoolArray:
        """(times,): whether a timed fault is active at each of `times` (s, rising); records each begin."""
        assert isinstance(self.settings, _Timed)
        on = np.zeros(len(times), dtype=np.bool_)
        for begin in self._begins:
            during = (times >= begin) & (times < begin + self.settings.duration)
            if during.any() and begin not in self.at:
                self.at.append(float(begin))
            on |= during
        return on

    def __repr__(self) -> str:
        return f"<fault {self.kind}, fired {self.fired} times>"


class Faults(Sequence[Fault[Any]]):
    """All faults of a plant, in the order of the rig file."""

    def __init__(self, faults: Sequence[Fault[Any]]) -> None:
        self._faults = tuple(faults)

    @classmethod
    def of_file(cls, file: RigFile) -> Faults:
        """The faults of a rig file. Raises ConfigurationError for one that the rig cannot have."""
        faults = []
        for index, raw in enumerate(file.simulation.faults):
            settings = validate_kind(KINDS, raw, f"simulation.faults.{index} of {file.name}")
            _refuse(settings, file)
            rng = np.random.default_rng([file.simulation.seed, 0xFA017, index])
            faults.append(Fault(settings, rng))
        return cls(faults)

    def of(self, *settings: type[Other]) -> list[Fault[Other]]:
        """Those of these kinds."""
        return [fault for fault in self._faults if isinstance(fault.settings, settings)]

    def __getitem__(self, index: Any) -> Any:
        return self._faults[index]

    def __len__(self) -> int:
        return len(self._faults)

    def __iter__(self) -> Iterator[Fault[Any]]:
        return iter(self._faults)


@dataclass
class _ScheduledBoxFault(BoxFault):
    """A fault of the relay box that fires on its schedule."""

    fault: Fault[Any] = field(kw_only=True)
    clock: Clock = field(kw_only=True)

    def fires(self, kind: str, channel: int) -> bool:
        """See `BoxFault.fires`."""
        return (kind, channel) == (self.kind, self.channel) and self.fault.fires(self.clock.now())


def box_faults(faults: Faults, patches: Mapping[str, int], clock: Clock) -> list[BoxFault]:
    """The faults of a relay box whose channels are wired to `patches`."""
    kinds: dict[type[_OfRelay], Literal["lost", "stuck", "welded"]] = {
        RelayLost: "lost",
        RelayStuck: "stuck",
        RelayWelded: "welded",
    }
    return [
        _ScheduledBoxFault(kind, patches[fault.settings.patch], fault=fault, clock=clock)
        for settings, kind in kinds.items()
        for fault in faults.of(settings)
        if fault.settings.patch in patches
    ]


def _refuse(settings: FaultSettings, file: RigFile) -> None:
    """Raises ConfigurationError for a fault of something that the rig does not have."""
    daq = file.daq.settings
    known = {
        "patch": file.table.patches if file.table else (),
        "patches": file.table.patches if file.table else (),
        "channel": tuple(daq.get("channels", ())),
        "device": tuple(daq.get("devices", ())),
        "instrument": ROLES,
    }
    for key, names in known.items():
        value = getattr(settings, key, None)
        for name in (value,) if isinstance(value, str) else value or ():
            if name not in names:
                raise ConfigurationError(
                    f"A fault of the kind {settings.kind!r} names the {key} {name!r}, and the rig "
                    f"{file.name!r} has {', '.join(names) or 'none'}."
                )
    if isinstance(settings, RelaySwapped) and settings.patches[0] == settings.patches[1]:
        raise ConfigurationError(f"A fault of the kind {settings.kind!r} swaps two different patches.")
