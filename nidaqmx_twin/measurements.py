"""What analog inputs measure: NI's create calls as one table, and the scale of each measurement.

A create call differs from another in the measurement, in the property that holds its units, and in the sensor
whose sensitivity it gives; every other field has one property, whatever the call.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import numpy as np
from nidaqmx.constants import (
    AccelSensitivityUnits,
    AccelUnits,
    BridgeElectricalUnits,
    ForceIEPESensorSensitivityUnits,
    ForceUnits,
    RTDType,
    TemperatureUnits,
    UsageTypeAI,
    VelocityIEPESensorSensitivityUnits,
    VelocityUnits,
)

from .scales import Scale, linear, polynomial, tabulated

U = UsageTypeAI


@dataclass(frozen=True)
class Measurement:
    """One create call of analog inputs."""

    usage: UsageTypeAI
    units: str
    sensor: str = ""
    """Beginning of the properties `..._SENSITIVITY` and `..._SENSITIVITY_UNITS`."""


_BRIDGES = {"Force": U.FORCE_BRIDGE, "Pressure": U.PRESSURE_BRIDGE, "Torque": U.TORQUE_BRIDGE}

MEASUREMENTS: dict[str, Measurement] = {
    "Voltage": Measurement(U.VOLTAGE, "AI_VOLTAGE_UNITS"),
    "VoltageWithExcit": Measurement(U.VOLTAGE_CUSTOM_WITH_EXCITATION, "AI_VOLTAGE_UNITS"),
    "VoltageRMS": Measurement(U.VOLTAGE_ACRMS, "AI_VOLTAGE_ACRMS_UNITS"),
    "Current": Measurement(U.CURRENT, "AI_CURRENT_UNITS"),
    "CurrentRMS": Measurement(U.CURRENT_ACRMS, "AI_CURRENT_ACRMS_UNITS"),
    "FreqVoltage": Measurement(U.FREQUENCY_VOLTAGE, "AI_FREQ_UNITS"),
    "Resistance": Measurement(U.RESISTANCE, "AI_RESISTANCE_UNITS"),
    "Thrmcpl": Measurement(U.TEMPERATURE_THERMOCOUPLE, "AI_TEMP_UNITS"),
    "RTD": Measurement(U.TEMPERATURE_RTD, "AI_TEMP_UNITS"),
    "ThrmstrIex": Measurement(U.TEMPERATURE_THERMISTOR, "AI_TEMP_UNITS"),
    "ThrmstrVex": Measurement(U.TEMPERATURE_THERMISTOR, "AI_TEMP_UNITS"),
    "TempBuiltInSensor": Measurement(U.TEMPERATURE_BUILT_IN_SENSOR, "AI_TEMP_UNITS"),
    "StrainGage": Measurement(U.STRAIN_STRAIN_GAGE, "AI_STRAIN_UNITS"),
    "RosetteStrainGage": Measurement(U.ROSETTE_STRAIN_GAGE, "AI_STRAIN_UNITS"),
    "Bridge": Measurement(U.BRIDGE, "AI_BRIDGE_UNITS"),
    **{
        f"{quantity}Bridge{scaling}": Measurement(usage, f"AI_{quantity.upper()}_UNITS")
        for quantity, usage in _BRIDGES.items()
        for scaling in ("", "TwoPointLin", "Table", "Polynomial")
    },
    "Accel": Measurement(U.ACCELERATION_ACCELEROMETER_CURRENT_INPUT, "AI_ACCEL_UNITS", "AI_ACCEL"),
    "AccelCharge": Measurement(U.ACCELERATION_CHARGE, "AI_ACCEL_UNITS", "AI_ACCEL_CHARGE"),
    "Accel4WireDCVoltage": Measurement(
        U.ACCELERATION_4_WIRE_DC_VOLTAGE, "AI_ACCEL_UNITS", "AI_ACCEL_4_WIRE_DC_VOLTAGE"
    ),
    "ForceIEPE": Measurement(U.FORCE_IEPE_SENSOR, "AI_FORCE_UNITS", "AI_FORCE_IEPE_SENSOR"),
    "VelocityIEPE": Measurement(U.VELOCITY_IEPE_SENSOR, "AI_VELOCITY_UNITS", "AI_VELOCITY_IEPE_SENSOR"),
    "Microphone": Measurement(U.SOUND_PRESSURE_MICROPHONE, "AI_SOUND_PRESSURE_UNITS"),
    "Charge": Measurement(U.CHARGE, "AI_CHARGE_UNITS"),
    "PosLVDT": Measurement(U.POSITION_LINEAR_LVDT, "AI_LVDT_UNITS", "AI_LVDT"),
    "PosRVDT": Measurement(U.POSITION_ANGULAR_RVDT, "AI_RVDT_UNITS", "AI_RVDT"),
    "PosEddyCurrProxProbe": Measurement(
        U.POSITION_EDDY_CURRENT_PROX_PROBE, "AI_EDDY_CURRENT_PROX_PROBE_UNITS", "AI_EDDY_CURRENT_PROX_PROBE"
    ),
    "Power": Measurement(U.POWER, "AI_POWER_UNITS"),
    "CalculatedPower": Measurement(U.CALCULATED_POWER, "AI_POWER_UNITS"),
}
"""Create calls by what is between `CreateAI` (or `CreateTEDSAI`) and `Chan`."""

FIELDS: dict[str, str] = {
    "custom_scale_name": "AI_CUSTOM_SCALE_NAME",
    "current_excit_source": "AI_EXCIT_SRC",
    "current_excit_val": "AI_EXCIT_VAL",
    "voltage_excit_source": "AI_EXCIT_SRC",
    "voltage_excit_val": "AI_EXCIT_VAL",
    "voltage_excit_freq": "AI_AC_EXCIT_FREQ",
    "ac_excit_wire_mode": "AI_AC_EXCIT_WIRE_MODE",
    "use_excit_for_scaling": "AI_EXCIT_USE_FOR_SCALING",
    "shunt_resistor_loc": "AI_CURRENT_SHUNT_LOC",
    "ext_shunt_resistor_val": "AI_CURRENT_SHUNT_RESISTANCE",
    "thermocouple_type": "AI_THRMCPL_TYPE",
    "cjc_source": "AI_THRMCPL_CJC_SRC",
    "cjc_val": "AI_THRMCPL_CJC_VAL",
    "cjc_channel": "AI_THRMCPL_CJC_CHAN",
    "rtd_type": "AI_RTD_TYPE",
    "r0": "AI_RTD_R0",
    "resistance_config": "AI_RESISTANCE_CFG",
    "a": "AI_THRMSTR_A",
    "b": "AI_THRMSTR_B",
    "c": "AI_THRMSTR_C",
    "r1": "AI_THRMSTR_R1",
    "strain_config": "AI_STRAIN_GAGE_CFG",
    "gage_factor": "AI_STRAIN_GAGE_GAGE_FACTOR",
    "poisson_ratio": "AI_STRAIN_GAGE_POISSON_RATIO",
    "initial_bridge_voltage": "AI_BRIDGE_INITIAL_VOLTAGE",
    "nominal_gage_resistance": "AI_BRIDGE_NOM_RESISTANCE",
    "lead_wire_resistance": "AI_LEAD_WIRE_RESISTANCE",
    "rosette_type": "AI_ROSETTE_STRAIN_GAGE_ROSETTE_TYPE",
    "gage_orientation": "AI_ROSETTE_STRAIN_GAGE_ORIENTATION",
    "bridge_config": "AI_BRIDGE_CFG",
    "nominal_bridge_resistance": "AI_BRIDGE_NOM_RESISTANCE",
    "electrical_units": "AI_BRIDGE_ELECTRICAL_UNITS",
    "physical_units": "AI_BRIDGE_PHYSICAL_UNITS",
    "first_electrical_val": "AI_BRIDGE_TWO_POINT_LIN_FIRST_ELECTRICAL_VAL",
    "second_electrical_val": "AI_BRIDGE_TWO_POINT_LIN_SECOND_ELECTRICAL_VAL",
    "first_physical_val": "AI_BRIDGE_TWO_POINT_LIN_FIRST_PHYSICAL_VAL",
    "second_physical_val": "AI_BRIDGE_TWO_POINT_LIN_SECOND_PHYSICAL_VAL",
    "electrical_vals": "AI_BRIDGE_TABLE_ELECTRICAL_VALS",
    "physical_vals": "AI_BRIDGE_TABLE_PHYSICAL_VALS",
    "forward_coeffs": "AI_BRIDGE_POLY_FORWARD_COEFF",
    "reverse_coeffs": "AI_BRIDGE_POLY_REVERSE_COEFF",
    "threshold_level": "AI_FREQ_THRESH_VOLTAGE",
    "hysteresis": "AI_FREQ_HYST",
    "mic_sensitivity": "AI_MICROPHONE_SENSITIVITY",
    "max_snd_press_level": "AI_SOUND_PRESSURE_MAX_SOUND_PRESSURE_LVL",
    "voltage_min_val": "AI_CALCULATED_POWER_VOLTAGE_MIN",
    "voltage_max_val": "AI_CALCULATED_POWER_VOLTAGE_MAX",
    "current_min_val": "AI_CALCULATED_POWER_CURRENT_MIN",
    "current_max_val": "AI_CALCULATED_POWER_CURRENT_MAX",
    "voltage_setpoint": "PWR_VOLTAGE_SETPOINT",
    "current_setpoint": "PWR_CURRENT_SETPOINT",
    "output_enable": "PWR_OUTPUT_ENABLE",
}
"""Property that a field of any create call of analog inputs sets."""

_MAY_BE_MORE = {"RESISTANCE", "VOLTAGE_CUSTOM_WITH_EXCITATION"}
"""Measurements that others are made of (a thermistor): a list with one of them may not be complete."""
_OF_OTHERS = ("CHARGE", "ACCELERATION_CHARGE", "POWER", "CURRENT_ACRMS", "VOLTAGE_ACRMS")
"""Measurements that inputs of voltage do not make by computation."""


def measures(known: tuple[str, ...], name: str) -> bool:
    """Return True when inputs with the measurements `known`, or of voltage where it is empty, make `name`."""
    return name not in _OF_OTHERS if not known else name in known or bool(_MAY_BE_MORE & set(known))


_G = 9.80665
_INCH, _POUND = 0.0254, 4.4482216152605
_PER: dict[int, float] = {
    AccelUnits.G.value: 1.0,
    AccelUnits.METERS_PER_SECOND_SQUARED.value: _G,
    AccelUnits.INCHES_PER_SECOND_SQUARED.value: _G / _INCH,
    ForceUnits.NEWTONS.value: 1.0,
    ForceUnits.POUNDS.value: 1 / _POUND,
    ForceUnits.KILOGRAM_FORCE.value: 1 / _G,
    VelocityUnits.METERS_PER_SECOND.value: 1.0,
    VelocityUnits.INCHES_PER_SECOND.value: 1 / _INCH,
}
"""Number of a unit in 1 g, 1 N or 1 m/s."""
_VOLTS_PER: dict[int, float] = {
    AccelSensitivityUnits.MILLIVOLTS_PER_G.value: 1e-3,
    AccelSensitivityUnits.VOLTS_PER_G.value: 1.0,
    ForceIEPESensorSensitivityUnits.MILLIVOLTS_PER_NEWTON.value: 1e-3,
    ForceIEPESensorSensitivityUnits.MILLIVOLTS_PER_POUND.value: 1e-3 / _POUND,
    VelocityIEPESensorSensitivityUnits.MILLIVOLTS_PER_MILLIMETER_PER_SECOND.value: 1.0,
    VelocityIEPESensorSensitivityUnits.MILLIVOLTS_PER_INCH_PER_SECOND.value: 1e-3 / _INCH,
}
"""Volts per g, N or m/s of a sensitivity of 1 in a unit."""


_PLATINUM: dict[int, tuple[float, float, float]] = {
    RTDType.PT_3750.value: (3.81e-3, -6.02e-7, -6.0e-12),
    RTDType.PT_3851.value: (3.9083e-3, -5.775e-7, -4.183e-12),
    RTDType.PT_3911.value: (3.9692e-3, -5.8495e-7, -4.233e-12),
    RTDType.PT_3916.value: (3.9739e-3, -5.870e-7, -4.4e-12),
    RTDType.PT_3920.value: (3.9787e-3, -5.8686e-7, -4.167e-12),
    RTDType.PT_3928.value: (3.9888e-3, -5.915e-7, -3.85e-12),
}
"""A, B and C of the Callendar-Van Dusen equation by type of thermometer (NI-DAQmx help, "RTDs")."""
_CUSTOM = (3.81e-3, -6.02e-7, -6.0e-12)
"""Those of a custom type before a program sets them."""
_DEGREES: dict[int, tuple[float, float]] = {
    TemperatureUnits.DEG_C.value: (1.0, 0.0),
    TemperatureUnits.K.value: (1.0, 273.15),
    TemperatureUnits.DEG_F.value: (1.8, 32.0),
    TemperatureUnits.DEG_R.value: (1.8, 491.67),
}
"""Factor and zero of a unit, from degrees Celsius."""


_SENSED = {row.usage.value: row for row in reversed(MEASUREMENTS.values()) if row.sensor}
"""Measurements by a sensor's sensitivity, by what they measure."""


def measured_scale(values: Mapping[str, Any]) -> Scale | None:
    """Return the scale from volts at the terminal to the units of a channel with the properties `values`.

    None where it reports volts, or where the measurement has no scale here (thermocouples, thermistors,
    strain, position, frequency): such a channel shows its simulated signal in its own units.
    """
    usage = values.get("AI_MEAS_TYPE")
    if usage == U.VOLTAGE.value:
        return None
    row = _SENSED.get(usage or 0)
    if row is not None and values.get(f"{row.sensor}_SENSITIVITY_UNITS") in _VOLTS_PER:
        volts = values[f"{row.sensor}_SENSITIVITY"] * _VOLTS_PER[values[f"{row.sensor}_SENSITIVITY_UNITS"]]
        return linear(_PER.get(values.get(row.units, 0), 1.0) / volts, 0.0) if volts else None
    if usage == U.TEMPERATURE_RTD.value:
        return _thermometer(values)
    divisors = {
        U.CURRENT.value: values.get("AI_CURRENT_SHUNT_RESISTANCE"),
        U.RESISTANCE.value: values.get("AI_EXCIT_VAL"),
        U.SOUND_PRESSURE_MICROPHONE.value: values.get("AI_MICROPHONE_SENSITIVITY", 0.0) / 1e3,
    }
    if divisors.get(usage or 0):
        return linear(1 / divisors[usage or 0], 0.0)
    excitation = values.get("AI_EXCIT_VAL")
    if not excitation or usage not in (U.BRIDGE.value, *(bridge.value for bridge in _BRIDGES.values())):
        return None
    units = (values.get("AI_BRIDGE_UNITS"), values.get("AI_BRIDGE_ELECTRICAL_UNITS"))
    milli = BridgeElectricalUnits.MILLIVOLTS_PER_VOLT.value in units
    ratio = (1e3 if milli else 1.0) / excitation
    return linear(ratio, 0.0) if usage == U.BRIDGE.value else _physical(values, ratio)


def _thermometer(values: Mapping[str, Any]) -> Scale | None:
    """Return the scale of a resistance thermometer (RTD) whose current is known."""
    current, resistance = values.get("AI_EXCIT_VAL"), values.get("AI_RTD_R0")
    if not current or not resistance:
        return None
    custom = tuple(values.get(f"AI_RTD_{name}", own) for name, own in zip("ABC", _CUSTOM, strict=True))
    law = _PLATINUM.get(values.get("AI_RTD_TYPE", 0), custom)
    return _callendar(current * resistance, law, values.get("AI_TEMP_UNITS", 0))


@lru_cache(maxsize=64)
def _callendar(volts_at_zero: float, law: tuple[float, ...], units: int) -> Scale:
    """Return the scale of a thermometer that drops `volts_at_zero` at 0 degrees Celsius, by degrees."""
    a, b, c = law
    celsius = np.arange(-200.0, 851.0)
    below = np.where(celsius < 0, c * (celsius - 100) * celsius**3, 0.0)
    volts = volts_at_zero * (1 + a * celsius + b * celsius**2 + below)
    factor, zero = _DEGREES.get(units, (1.0, 0.0))
    return tabulated(volts.tolist(), (celsius * factor + zero).tolist())


def _physical(values: Mapping[str, Any], ratio: float) -> Scale | None:
    """Return the scale of a bridge in physical units; `ratio` is its electrical value per volt."""
    point = "AI_BRIDGE_TWO_POINT_LIN_{}_{}_VAL"
    if point.format("SECOND", "PHYSICAL") in values:
        e1, e2 = (values[point.format(which, "ELECTRICAL")] for which in ("FIRST", "SECOND"))
        p1, p2 = (values[point.format(which, "PHYSICAL")] for which in ("FIRST", "SECOND"))
        if e1 == e2 or p1 == p2:
            return None
        slope = (p2 - p1) / (e2 - e1)
        return linear(slope * ratio, p1 - slope * e1)
    if values.get("AI_BRIDGE_TABLE_ELECTRICAL_VALS"):
        before = [value / ratio for value in values["AI_BRIDGE_TABLE_ELECTRICAL_VALS"]]
        return tabulated(before, list(values["AI_BRIDGE_TABLE_PHYSICAL_VALS"]))
    if values.get("AI_BRIDGE_POLY_FORWARD_COEFF"):
        forward = [c * ratio**i for i, c in enumerate(values["AI_BRIDGE_POLY_FORWARD_COEFF"])]
        return polynomial(forward, [c / ratio for c in values["AI_BRIDGE_POLY_REVERSE_COEFF"]])
    return None
