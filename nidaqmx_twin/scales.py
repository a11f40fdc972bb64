"""Custom scales: conversion from volts at a terminal to a program's units, and back."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any, Self

import numpy as np
from nidaqmx.constants import ScaleType, UnitsPreScaled
from numpy.polynomial.polynomial import polyfit, polyval

from ..base.arrays import FloatArray
from .errors import DaqmxError, DAQmxErrors

_OWN = {
    "LIN": ScaleType.LINEAR,
    "MAP": ScaleType.MAP_RANGES,
    "POLY": ScaleType.POLYNOMIAL,
    "TABLE": ScaleType.TABLE,
}
"""Kind of scale that has the properties with a prefix."""
_COMMON: dict[str, Any] = {
    "DESCR": "",
    "AUTHOR": "",
    "SCALED_UNITS": "",
    "PRE_SCALED_UNITS": UnitsPreScaled.VOLTS.value,
    "ALLOW_INTERACTIVE_EDITING": True,
    "ALLOW_INTERACTIVE_DELETION": True,
}


@dataclass
class Scale:
    """One custom scale of NI-DAQmx: its kind, and its properties by NI's names."""

    type: ScaleType
    values: dict[str, Any]

    def copy(self) -> Self:
        """Return an independent copy."""
        return replace(self, values=dict(self.values))

    def get(self, name: str) -> Any:
        """Return a property. Raises DaqmxError for a property of another kind of scale."""
        if name == "TYPE":
            return self.type.value
        self._refuse_foreign(name)
        return self.values[name] if name in self.values else _COMMON[name]

    def set(self, name: str, value: Any) -> None:
        """Set a property. Raises DaqmxError for a property of another kind of scale."""
        self._refuse_foreign(name)
        self.values[name] = value

    def to_units(self, volts: FloatArray) -> FloatArray:
        """Convert volts (any shape) to the scale's units."""
        if self.type is ScaleType.POLYNOMIAL:
            return np.asarray(polyval(volts, self.values["POLY_FORWARD_COEFF"]))
        if self.type is ScaleType.TABLE:
            return np.asarray(
                np.interp(volts, self.values["TABLE_PRE_SCALED_VALS"], self.values["TABLE_SCALED_VALS"])
            )
        slope, intercept = self._line()
        return np.asarray(slope * volts + intercept)

    def to_volts(self, values: FloatArray) -> FloatArray:
        """Convert values in the scale's units (any shape) to volts."""
        if self.type is ScaleType.POLYNOMIAL:
            return np.asarray(polyval(values, self.values["POLY_REVERSE_COEFF"]))
        if self.type is ScaleType.TABLE:
            pairs = sorted(
                zip(self.values["TABLE_SCALED_VALS"], self.values["TABLE_PRE_SCALED_VALS"], strict=True)
            )
            return np.asarray(np.interp(values, [p[0] for p in pairs], [p[1] for p in pairs]))
        slope, intercept = self._line()
        return np.asarray((values - intercept) / slope)

    def _line(self) -> tuple[float, float]:
        v = self.values
        if self.type is ScaleType.LINEAR:
            return float(v["LIN_SLOPE"]), float(v["LIN_Y_INTERCEPT"])
        slope = (v["MAP_SCALED_MAX"] - v["MAP_SCALED_MIN"]) / (
            v["MAP_PRE_SCALED_MAX"] - v["MAP_PRE_SCALED_MIN"]
        )
        return float(slope), float(v["MAP_SCALED_MIN"] - slope * v["MAP_PRE_SCALED_MIN"])

    def _refuse_foreign(self, name: str) -> None:
        if _OWN.get(name.partition("_")[0], self.type) is not self.type:
            raise DaqmxError(
                DAQmxErrors.PROPERTY_NOT_SUPPORTED_FOR_SCALE_TYPE,
                f"Specified property is not supported by this type of scale: {name} by a scale of type "
                f"{self.type.name}.",
            )


def linear(slope: float, intercept: float, **common: Any) -> Scale:
    """Create the scale `slope * volts + intercept`. Raises DaqmxError for a slope of zero."""
    if slope == 0:
        raise DaqmxError(
            DAQmxErrors.INVALID_ATTRIBUTE_VALUE, "A linear scale needs a slope that is not zero."
        )
    return Scale(ScaleType.LINEAR, {"LIN_SLOPE": slope, "LIN_Y_INTERCEPT": intercept, **common})


def mapped(low: float, high: float, to_low: float, to_high: float, **common: Any) -> Scale:
    """Create the scale that maps `low` to `to_low` and `high` to `to_high`. Raises DaqmxError for an empty
    range.
    """
    if low == high or to_low == to_high:
        raise DaqmxError(
            DAQmxErrors.INVALID_ATTRIBUTE_VALUE, "A map scale needs two different values on each side."
        )
    names = ("MAP_PRE_SCALED_MIN", "MAP_PRE_SCALED_MAX", "MAP_SCALED_MIN", "MAP_SCALED_MAX")
    return Scale(ScaleType.MAP_RANGES, dict(zip(names, (low, high, to_low, to_high), strict=True)) | common)


def polynomial(forward: list[float], reverse: list[float], **common: Any) -> Scale:
    """Create a polynomial scale; coefficients of both directions start with the constant."""
    return Scale(
        ScaleType.POLYNOMIAL, {"POLY_FORWARD_COEFF": forward, "POLY_REVERSE_COEFF": reverse, **common}
    )


def tabulated(before: list[float], after: list[float], **common: Any) -> Scale:
    """Create a scale that interpolates linearly between pairs; `before` must rise.

    Raises DaqmxError for tables that do not match.
    """
    if len(before) != len(after) or len(before) < 2:
        raise DaqmxError(
            DAQmxErrors.INVALID_ATTRIBUTE_VALUE,
            f"A table scale needs pairs of values: there are {len(before)} before and {len(after)} after.",
        )
    return Scale(ScaleType.TABLE, {"TABLE_PRE_SCALED_VALS": before, "TABLE_SCALED_VALS": after, **common})


def reverse_coefficients(
    forward: list[float], low: float, high: float, points: int, order: int
) -> list[float]:
    """Fit the polynomial of `order` that best inverts `forward` from `low` to `high`.

    A negative `order` means the order of `forward`; fewer than 2 `points` mean 1000.
    """
    x = np.linspace(low, high, points if points > 1 else 1000)
    wanted = order if order >= 0 else len(forward) - 1
    return [float(c) for c in polyfit(polyval(x, forward), x, wanted)]


def scale_from_export(entry: Mapping[str, str]) -> Scale | None:
    """Create a scale from an entry of an NI MAX text export; None for an unknown kind."""
    common = {
        "DESCR": entry.get("Descr", ""),
        "AUTHOR": entry.get("Author", "").strip('"'),
        "SCALED_UNITS": entry.get("ScaledUnits") or "",
        "ALLOW_INTERACTIVE_EDITING": entry.get("AllowInteractiveEditing", "False") == "True",
        "ALLOW_INTERACTIVE_DELETION": entry.get("AllowInteractiveDeletion", "False") == "True",
    }
    units = entry.get("PreScaledUnits", "Volts").replace(" ", "_").upper()
    if units in UnitsPreScaled.__members__:
        common["PRE_SCALED_UNITS"] = UnitsPreScaled[units].value
    if entry.get("ScaleType") == "Linear":
        return linear(float(entry["Lin.Slope"]), float(entry["Lin.YIntercept"]), **common)
    if entry.get("ScaleType") == "Polynomial":
        ways = (entry["Poly.ForwardCoeff"], entry["Poly.ReverseCoeff"])
        forward, reverse = ([float(c) for c in way.split(",")] for way in ways)
        return polynomial(forward, reverse, **common)
    return None


def scale_named(scales: Mapping[str, Scale], name: str) -> Scale:
    """Return a custom scale by its name. Raises DaqmxError for one that does not exist."""
    if name not in scales:
        raise DaqmxError(
            DAQmxErrors.CUSTOM_SCALE_DOES_NOT_EXIST, f"Custom scale specified does not exist: {name!r}."
        )
    return scales[name]
