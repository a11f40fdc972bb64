"""Published fields of AHAP, .haptic, Android's waveform and MPEG hjif, as models that refuse the rest.

Written from the publications named, and not from what haploop writes: each field with its type, its range
and whether it is needed. A field that a publication does not name is refused, but where readers ignore it by
rule. The programs that read these formats (iOS, Android, Meta's SDK) do not run here, and no package with a
reader of them is to be had; docs/how-to/phone.md says which readers were built once from their source.
"""

import itertools
from typing import Annotated, Any, Literal, Self

from pydantic import BaseModel, ConfigDict, Field, model_validator

Unit = Annotated[float, Field(ge=0, le=1)]
Time = Annotated[float, Field(ge=0, le=3.4e38)]


class Strict(BaseModel):
    model_config = ConfigDict(strict=True, extra="forbid", allow_inf_nan=False)


# Apple, "Representing haptic patterns in AHAP files": the only top-level keys are Pattern and Version; "the
# framework ignores unsupported keys" (Metadata is one, which Apple's own samples have).


class AhapParameter(Strict):
    ParameterID: Literal["HapticIntensity", "HapticSharpness"]
    ParameterValue: Unit  # "from weak (0.0) to strong (1.0)", "from dull (0.0) to sharp (1.0)"


class AhapEvent(Strict):
    Time: Time
    EventType: Literal["HapticContinuous", "HapticTransient"]
    EventDuration: Annotated[float, Field(gt=0, le=30)]  # "a maximum duration of 30 seconds"
    EventParameters: list[AhapParameter]


class AhapPoint(Strict):
    Time: Time
    ParameterValue: float


class AhapCurve(Strict):
    ParameterID: Literal["HapticIntensityControl", "HapticSharpnessControl"]
    Time: Time
    # A curve of more points does not play: Meta's converter to AHAP (core/datamodel/src/ios) splits at 16.
    ParameterCurveControlPoints: Annotated[list[AhapPoint], Field(min_length=1, max_length=16)]

    @model_validator(mode="after")
    def ranges(self) -> Self:
        # "The range for all parameters except haptic intensity is -1 to 1", which is a factor.
        low = 0.0 if self.ParameterID == "HapticIntensityControl" else -1.0
        assert all(low <= point.ParameterValue <= 1 for point in self.ParameterCurveControlPoints)
        assert ordered([point.Time for point in self.ParameterCurveControlPoints])
        return self


class AhapPattern(Strict):
    Event: AhapEvent | None = None
    ParameterCurve: AhapCurve | None = None

    @model_validator(mode="after")
    def one(self) -> Self:
        assert (self.Event is None) != (self.ParameterCurve is None)
        return self


class Ahap(Strict):
    Version: Annotated[float, Field(ge=1)]
    Metadata: dict[str, Any] = {}
    Pattern: Annotated[list[AhapPattern], Field(min_length=1)]


# Meta (Lofelt), "Haptic Data Model", version 1.0.0 (the README of core/datamodel in
# github.com/Lofelt/NiceVibrations): its tables of fields, types and ranges, and its list of validation rules.


class MetaVersion(Strict):
    major: Literal[1]
    minor: int = 0
    patch: int = 0


class MetaMetadata(Strict):
    editor: str = ""
    author: str = ""
    source: str = ""
    project: str = ""
    tags: list[str] = []
    description: str = ""


class Emphasis(Strict):
    amplitude: Unit
    frequency: Unit


class AmplitudePoint(Strict):
    time: Time
    amplitude: Unit
    emphasis: Emphasis | None = None


class FrequencyPoint(Strict):
    time: Time
    frequency: Unit


class Envelopes(Strict):
    amplitude: Annotated[list[AmplitudePoint], Field(min_length=1)]  # "Cannot be Empty"
    frequency: list[FrequencyPoint] | None = None

    @model_validator(mode="after")
    def consecutive(self) -> Self:
        for points in (self.amplitude, self.frequency or []):
            assert ordered([point.time for point in points])
        return self


class Continuous(Strict):
    envelopes: Envelopes


class Signals(Strict):
    continuous: Continuous


class Haptic(Strict):
    version: MetaVersion
    metadata: MetaMetadata = MetaMetadata()
    signals: Signals


# Android, VibrationEffect.createWaveform(long[] timings, int[] amplitudes, int repeat), API level 26.


class Android(BaseModel):
    model_config = ConfigDict(strict=True)  # not a file format of Android's: its arguments, and ours beside

    timings: Annotated[list[Annotated[int, Field(ge=0, lt=2**63)]], Field(min_length=1)]
    # "must be between 0 and 255, or equal to DEFAULT_AMPLITUDE"
    amplitudes: list[Annotated[int, Field(ge=-1, le=255)]]
    repeat: int

    @model_validator(mode="after")
    def alike(self) -> Self:
        assert len(self.timings) == len(self.amplitudes)
        assert sum(self.timings) > 0
        assert -1 <= self.repeat < len(self.timings)
        return self


# MPEG, ISO/IEC 23090-31:2025, as its reference software loads and checks it: loadFile and the functions
# semanticConformanceCheck... of source/IOHaptics/src/IOJson.cpp (commit 73ffe9b of
# github.com/MPEGGroup/HapticReferenceSoftware). It drops a perception, channel, band or effect without one of
# these fields.


class Keyframe(Strict):
    relative_position: Annotated[int, Field(ge=0)]
    amplitude_modulation: Annotated[float, Field(ge=-1, le=1)]
    frequency_modulation: Annotated[int, Field(ge=0)]


class Effect(Strict):
    effect_type: Literal["Basis"]
    position: int
    phase: float
    base_signal: Literal["Sine", "Square", "Triangle", "SawToothUp", "SawToothDown"]
    keyframes: list[Keyframe]

    @model_validator(mode="after")
    def in_order(self) -> Self:
        assert ordered([keyframe.relative_position for keyframe in self.keyframes])
        return self


class Band(Strict):
    # "The curve type should only be specified for Curve Bands"; a block length only for wavelets.
    band_type: Literal["VectorialWave", "Transient"]
    lower_frequency_limit: Annotated[int, Field(ge=0)]
    upper_frequency_limit: int
    effects: list[Effect]

    @model_validator(mode="after")
    def limits(self) -> Self:
        assert self.lower_frequency_limit <= self.upper_frequency_limit
        for effect in self.effects:
            for keyframe in effect.keyframes:
                assert self.lower_frequency_limit <= keyframe.frequency_modulation
                assert keyframe.frequency_modulation <= self.upper_frequency_limit
        return self


class Channel(Strict):
    id: int
    description: str
    gain: float
    mixing_coefficient: float
    body_part_mask: Annotated[int, Field(ge=0, lt=2**32)]
    bands: Annotated[list[Band], Field(max_length=7)]  # level 1


class Perception(Strict):
    id: int
    avatar_id: Literal[0]  # 0: unspecified; any other names an avatar
    description: str
    perception_modality: Literal["Vibrotactile"]
    unit_exponent: Annotated[int, Field(ge=-128, le=127)]
    perception_unit_exponent: Annotated[int, Field(ge=-128, le=127)]
    reference_devices: Annotated[list[Any], Field(max_length=0)]
    effect_library: Annotated[list[Any], Field(max_length=0)]
    channels: Annotated[list[Channel], Field(min_length=1, max_length=128)]  # level 1


class Sync(Strict):
    timestamp: int
    timescale: Annotated[int, Field(ge=0)]


class Hjif(Strict):
    # "XXXX or XXXX-Y, where XXXX is the year of publication and Y is the amendment number", from 2023 on.
    version: Annotated[str, Field(pattern=r"^(202[3-9]|20[3-9][0-9])(-[1-9])?$")]
    profile: Literal["Main", "Simple Parametric"]
    level: Literal[1, 2]
    # "the date format shall conform to ISO 8601 series": the pattern of dateCheck, of a whole day at least
    date: Annotated[
        str,
        Field(
            pattern=r"^\d{4}-[01]\d-[0-3]\d(T[0-2]\d:[0-5]\d:?([0-5]\d(\.\d+)?)?([+-][0-2]\d:[0-5]\d|Z)?)?$"
        ),
    ]
    description: str
    timescale: Annotated[int, Field(gt=0, le=48000)]  # of the main profile
    avatars: Annotated[list[Any], Field(max_length=0)]
    perceptions: Annotated[list[Perception], Field(min_length=1)]
    syncs: list[Sync]


RULES: dict[str, type[BaseModel]] = {"ahap": Ahap, "haptic": Haptic, "android": Android, "hjif": Hjif}


def ordered(times: list[float] | list[int]) -> bool:
    return all(a < b for a, b in itertools.pairwise(times))
