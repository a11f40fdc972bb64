"""Faults: a seeded schedule of misbehaviours of plant, twins and wires, each of which says whether it fired.

A rig file asks for them in `[[simulation.faults]]`. There are three sorts. A miswired or misset rig is
wrong from the beginning. A spell begins at a moment and lasts. A stroke befalls single events: a
command to the relay, a read of the DAQ, a reply on a line. Moments are seconds of the plant's clock
since the rig was opened; `within` lets the seed choose one.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Annotated, Any, Generic, Literal, TypeVar

import numpy as np
from pydantic import BaseModel, ConfigDict, Field

from instruments.arrays import BoolArray, FloatArray
from instruments.clock import Clock
from instruments.errors import ConfigurationError
from instruments.rig_file import ROLES, RigFile, validate_kind
from mocks.relay import BoxFault

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
    """One table of `[[simulation.faults]]`; `kind` says which. By itself: wrong from the beginning."""

    model_config = ConfigDict(frozen=True, extra="forbid")

    kind: str


class _Begins(FaultSettings):
    after: NotNegative = 0.0
    """Seconds since the rig was opened."""
    within: NotNegative = 0.0
    """Seconds after `after` among which the seed chooses the moment."""


class _Spell(_Begins):
    duration: Annotated[float, Field(gt=0)] = math.inf
    """Seconds that it lasts; infinite until the rig is closed."""
    times: Annotated[int, Field(ge=1)] = 1
    every: Positive = 1.0
    """Seconds from one begin to the next on average, when there are several."""


class _Stroke(_Begins):
    times: Annotated[int, Field(ge=1)] | None = None
    """How many events it befalls; None is all of them."""


class _OfCard(_Stroke):
    times: Annotated[int, Field(ge=1)] | None = 1
    device: str | None = None
    """None takes every card."""


class _OfRelay(_Stroke):
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
    """The force sensor is another one than the matrix in the rig file was made for."""

    kind: Literal["force-calibration"] = "force-calibration"
    gain: Positive = 1.15
    """What the gauges give, over what those of the matrix would give."""
    crosstalk: NotNegative = 0.05
    """Standard deviation of what one gauge's load adds to another."""


class AccelerometerInverted(FaultSettings):
    """The accelerometer is mounted upside down: turned about its x axis."""

    kind: Literal["accelerometer-inverted"] = "accelerometer-inverted"


class PatchDead(FaultSettings):
    """A patch takes its voltage and moves nothing: it is cracked, or came off."""

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
    """Nothing is connected to a channel of the DAQ, and its terminal rests at ground."""

    kind: Literal["sensor-disconnected"] = "sensor-disconnected"
    channel: str


class SensorSaturated(_Spell):
    """A channel of the DAQ is driven beyond every range."""

    kind: Literal["sensor-saturated"] = "sensor-saturated"
    channel: str


class LaserDropout(_Spell):
    """Too little light comes back for moments, and the vibrometer's output jumps from end to end."""

    kind: Literal["laser-dropout"] = "laser-dropout"
    duration: Annotated[float, Field(gt=0)] = 5e-3


class LaserBlocked(_Spell):
    """Something stands in the laser's way: no velocity, and ten times the noise."""

    kind: Literal["laser-blocked"] = "laser-blocked"


class AmplifierTrip(_Spell):
    """The amplifier's protection trips: its output falls to zero."""

    kind: Literal["amplifier-trip"] = "amplifier-trip"


class ClockDrift(_Begins):
    """A card samples on a clock of its own, which is slower than the other card's."""

    kind: Literal["clock-drift"] = "clock-drift"
    drift: Annotated[float, Field(gt=0, le=0.5)] = 500e-6
    """How much slower, as a fraction. Two free clocks differ by 5 to 50e-6 (hardware.md, section 13);
    an input that counts noise instead of clock edges, by any amount."""
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
    """A channel keeps its state, and says so."""

    kind: Literal["relay-stuck"] = "relay-stuck"


class RelayWelded(_OfRelay):
    """A contact stays as it is, while the box reports what it was told."""

    kind: Literal["relay-welded"] = "relay-welded"


class Reply(_Stroke):
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
    """One fault of a simulated rig: what was asked for, and when it had an effect."""

    def __init__(self, settings: Settings, rng: np.random.Generator) -> None:
        self.settings = settings
        self.at: list[float] = []
        """When it fired (s of the plant's clock)."""
        self._begins = np.zeros(0)
        if isinstance(settings, _Begins):
            first = settings.after + settings.within * rng.uniform()
            gaps = np.zeros(0)
            if isinstance(settings, _Spell):
                gaps = settings.every * rng.uniform(0.5, 1.5, settings.times - 1)
            self._begins = first + np.concatenate([np.zeros(1), np.cumsum(gaps)])

    @property
    def kind(self) -> str:
        """Its name in rig files."""
        return self.settings.kind

    @property
    def fired(self) -> int:
        """How often it had an effect: once for what is wrong all the time, else once a spell or event."""
        return len(self.at)

    @property
    def begin(self) -> float:
        """The moment (s of the plant's clock) before which it does nothing."""
        return float(self._begins[0]) if len(self._begins) else 0.0

    def notes(self, now: float) -> None:
        """It is wrong all the time, and has now had an effect."""
        if not self.at:
            self.at.append(now)

    def strikes(self, now: float) -> bool:
        """Whether it befalls an event that happens now; counts itself."""
        assert isinstance(self.settings, _Stroke)
        times = math.inf if self.settings.times is None else self.settings.times
        if now < self.begin or self.fired >= times:
            return False
        self.at.append(now)
        return True

    def lasts(self, times: FloatArray) -> BoolArray:
        """(times,): whether a spell is on at each of `times` (s, rising); counts itself."""
        assert isinstance(self.settings, _Spell)
        on = np.zeros(len(times), dtype=np.bool_)
        for begin in self._begins:
            spell = (times >= begin) & (times < begin + self.settings.duration)
            if spell.any() and begin not in self.at:
                self.at.append(float(begin))
            on |= spell
        return on

    def __repr__(self) -> str:
        return f"<fault {self.kind}, fired {self.fired} times>"


class Faults(Sequence[Fault[Any]]):
    """All faults of a plant, in the order in which they were asked for."""

    def __init__(self, faults: Sequence[Fault[Any]]) -> None:
        self._faults = tuple(faults)

    @classmethod
    def of_file(cls, file: RigFile) -> Faults:
        """Those that a rig file asks for. Raises ConfigurationError for what that rig cannot have."""
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
class _BoxStroke(BoxFault):
    """A fault of the relay box that waits for its moment."""

    fault: Fault[Any] = field(kw_only=True)
    clock: Clock = field(kw_only=True)

    def strikes(self, kind: str, channel: int) -> bool:
        """See `BoxFault.strikes`."""
        return (kind, channel) == (self.kind, self.channel) and self.fault.strikes(self.clock.now())


def box_faults(faults: Faults, patches: Mapping[str, int], clock: Clock) -> list[BoxFault]:
    """Those of a relay box whose channels are wired to `patches` as given."""
    kinds: dict[type[_OfRelay], Literal["lost", "stuck", "welded"]] = {
        RelayLost: "lost",
        RelayStuck: "stuck",
        RelayWelded: "welded",
    }
    return [
        _BoxStroke(kind, patches[fault.settings.patch], fault=fault, clock=clock)
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
