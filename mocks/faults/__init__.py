"""haploop's own kinds of fault, one module for each group of places, by the names that rig files give them.

Other packages add kinds by entry points: see `haploop.mocks.plant.kinds`.
"""

from __future__ import annotations

from collections.abc import Mapping

from ..plant import Fault
from .daq import ClockDrift, DaqOverflow, DaqOverrun, PlayCutOff, RtsiMissing, SourceImpedance
from .laser import (
    AmbientLight,
    Defocus,
    FramesLost,
    LaserAskew,
    LaserBlocked,
    LaserDropout,
    LaserSpikes,
    SecondFinger,
    VibrometerRange,
)
from .lines import Reply, SamplesLost, StreamLost
from .relay import AmplifierGain, AmplifierTrip, RelayLost, RelayStuck, RelaySwapped, RelayWelded
from .sensors import (
    AccelerometerInverted,
    FlickerNoise,
    ForceCalibration,
    MainsHum,
    RotatingMachine,
    SensorCreep,
    SensorDisconnected,
    SensorSaturated,
)
from .table import (
    FrequencyDrift,
    HandOnTable,
    ModeDrift,
    PatchAsymmetry,
    PatchDead,
    PatchGain,
    PatchHysteresis,
)

__all__ = ["OWN"]

OWN: Mapping[str, type[Fault]] = {
    "relay-swapped": RelaySwapped,
    "relay-lost": RelayLost,
    "relay-stuck": RelayStuck,
    "relay-welded": RelayWelded,
    "patch-dead": PatchDead,
    "patch-gain": PatchGain,
    "patch-asymmetry": PatchAsymmetry,
    "patch-hysteresis": PatchHysteresis,
    "mode-drift": ModeDrift,
    "hand-on-table": HandOnTable,
    "frequency-drift": FrequencyDrift,
    "amplifier-gain": AmplifierGain,
    "amplifier-trip": AmplifierTrip,
    "force-calibration": ForceCalibration,
    "accelerometer-inverted": AccelerometerInverted,
    "sensor-disconnected": SensorDisconnected,
    "mains-hum": MainsHum,
    "sensor-creep": SensorCreep,
    "sensor-saturated": SensorSaturated,
    "rotating-machine": RotatingMachine,
    "flicker-noise": FlickerNoise,
    "rtsi-missing": RtsiMissing,
    "source-impedance": SourceImpedance,
    "clock-drift": ClockDrift,
    "daq-overrun": DaqOverrun,
    "play-cut-off": PlayCutOff,
    "daq-overflow": DaqOverflow,
    "vibrometer-range": VibrometerRange,
    "laser-askew": LaserAskew,
    "laser-spikes": LaserSpikes,
    "laser-dropout": LaserDropout,
    "laser-blocked": LaserBlocked,
    "reply": Reply,
    "ambient-light": AmbientLight,
    "defocus": Defocus,
    "frames-lost": FramesLost,
    "second-finger": SecondFinger,
    "stream-lost": StreamLost,
    "samples-lost": SamplesLost,
}
