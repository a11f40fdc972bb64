"""Fixed properties of devices, their terminals and the system, independent of tasks.

Values that do not come from a product are estimates.
"""

from __future__ import annotations

import re
from collections.abc import Callable
from typing import Any

from nidaqmx import constants as c

from .devices import Inventory, NiDevice
from .errors import unserved
from .system import NiSystem

_BUS_OF_NAME = {
    "USB": c.BusType.USB, "PXIe": c.BusType.PXIE, "PXI": c.BusType.PXI, "PCI": c.BusType.PCI,
    "PCIe": c.BusType.PCIE, "cDAQ": c.BusType.USB, "NI": c.BusType.COMPACT_DAQ, "TS": c.BusType.USB,
}  # fmt: skip
"""Bus by the beginning of a product's name."""
_CATEGORY = {
    "E Series": c.ProductCategory.E_SERIES_DAQ,
    "M Series": c.ProductCategory.M_SERIES_DAQ,
    "X Series": c.ProductCategory.X_SERIES_DAQ,
    "AO Series": c.ProductCategory.AO_SERIES,
    "USB DAQ": c.ProductCategory.USBDAQ,
    "mioDAQ": c.ProductCategory.MIODAQ,
    "myDAQ": c.ProductCategory.NIELVIS,
    "DSA": c.ProductCategory.DSA,
    "SC Express": c.ProductCategory.SC_EXPRESS,
    "TestScale": c.ProductCategory.TEST_SCALE_MODULE,
    "TestScale Chassis": c.ProductCategory.TEST_SCALE_CHASSIS,
    "Digital I/O": c.ProductCategory.DIGITAL_IO,
    "C Series": c.ProductCategory.C_SERIES_MODULE,
    "CompactDAQ Chassis": c.ProductCategory.COMPACT_DAQ_CHASSIS,
}
_VOLTAGE_INPUTS = (
    "VOLTAGE", "CURRENT", "RESISTANCE", "TEMPERATURE_RTD", "TEMPERATURE_THERMOCOUPLE",
    "TEMPERATURE_THERMISTOR", "STRAIN_STRAIN_GAGE", "VOLTAGE_CUSTOM_WITH_EXCITATION",
)  # fmt: skip
"""What a plain voltage input measures, by computation."""
_BITS = {"PAUSE": 2, "REFERENCE": 4, "START": 8, "ARM_START": 32}
_ANALOG_TRIGGERS = ("PCIe-635", "PCIe-636", "PXIe-636", "USB-635", "USB-636", "PXIe-4331", "PCI-625")
"""Beginnings of the names of products with analog triggers (estimate)."""


def _triggers(*names: str) -> int:
    return sum(_BITS[name] for name in names)


def _bus(device: NiDevice) -> c.BusType:
    if device.product.name in ("cDAQ-9185", "cDAQ-9189"):
        return c.BusType.TCPIP
    if device.product.name == "NI myDAQ":
        return c.BusType.USB
    return _BUS_OF_NAME.get(re.split("[- ]", device.product.name)[0], c.BusType.PCIE)


def _measures(device: NiDevice) -> list[int]:
    names = device.product.ai_measures or _VOLTAGE_INPUTS
    return [c.UsageTypeAI[name].value for name in names] if device.ai else []


def _counted(device: NiDevice) -> list[int]:
    kinds = (
        ("COUNT_EDGES", "FREQUENCY", "DUTY_CYCLE", "VELOCITY_ANGULAR_ENCODER", "VELOCITY_LINEAR_ENCODER",
         "POSITION_ANGULAR_ENCODER", "POSITION_LINEAR_ENCODER", "PERIOD")
        if device.product.name == "NI 9361"
        else ("COUNT_EDGES",) if not device.product.puts_pulses
        else ("COUNT_EDGES", "FREQUENCY", "PERIOD", "PULSE_WIDTH_DIGITAL", "PULSE_WIDTH_DIGITAL_SEMI_PERIOD",
              "PULSE_FREQ", "PULSE_TIME", "PULSE_TICKS", "POSITION_ANGULAR_ENCODER",
              "POSITION_LINEAR_ENCODER", "PULSE_WIDTH_DIGITAL_TWO_EDGE_SEPARATION")
    )  # fmt: skip
    return [c.UsageTypeCI[name].value for name in kinds] if device.counters else []


def _ranges(values: tuple[float, ...]) -> list[float]:
    return [end for value in sorted(values) for end in (-value, value)]


def _names(names: list[str]) -> str:
    return ", ".join(names)


def _terminals(device: NiDevice) -> list[str]:
    product = device.product
    kinds = [k for k, n in (("ai", device.ai), ("ao", device.ao)) if n]
    kinds += ["di", "do"] if product.ports and product.family != "E Series" else []
    own = [f"PFI{i}" for i in range(product.pfi_lines or 0)]
    own += [f"{kind}/{signal}" for kind in kinds for signal in ("SampleClock", "StartTrigger")]
    own += [f"Ctr{i}InternalOutput" for i in range(product.counters)]
    return [f"/{device.name}/{name}" for name in own]


_SLOWEST_HZ = 100e6 / 2**32
"""Lowest sample rate: a 100 MHz timebase divided by a 32-bit counter (estimate)."""
_SAMPLE_MODES = [c.AcquisitionType.FINITE.value, c.AcquisitionType.CONTINUOUS.value]

DEVICE_FACTS: dict[str, Callable[[Inventory, NiDevice], Any]] = {
    "PRODUCT_TYPE": lambda i, d: d.product.name,
    "PRODUCT_NUM": lambda i, d: d.number or d.product.number,
    "PRODUCT_CATEGORY": lambda i, d: _CATEGORY[d.product.family].value,
    "SERIAL_NUM": lambda i, d: d.serial or 0,
    "IS_SIMULATED": lambda i, d: d.simulated,
    "BUS_TYPE": lambda i, d: _bus(d).value,
    "PXI_CHASSIS_NUM": lambda i, d: 1,
    "PXI_SLOT_NUM": lambda i, d: 1,
    "TCPIP_HOSTNAME": lambda i, d: "",
    "TCPIP_ETHERNET_IP": lambda i, d: "0.0.0.0",
    "TCPIP_WIRELESS_IP": lambda i, d: "",
    "PCI_BUS_NUM": lambda i, d: 0,
    "PCI_DEV_NUM": lambda i, d: 0,
    "AI_PHYSICAL_CHANS": lambda i, d: _names(d.ai),
    "AO_PHYSICAL_CHANS": lambda i, d: _names(d.ao),
    "DI_LINES": lambda i, d: _names(d.ways("in")[1]),
    "DI_PORTS": lambda i, d: _names(d.ways("in")[0]),
    "DO_LINES": lambda i, d: _names(d.ways("out")[1]),
    "DO_PORTS": lambda i, d: _names(d.ways("out")[0]),
    "CI_PHYSICAL_CHANS": lambda i, d: _names(d.counters),
    "CO_PHYSICAL_CHANS": lambda i, d: _names(d.counters if d.product.puts_pulses else []),
    "TERMINALS": lambda i, d: _names(_terminals(d)),
    "CHASSIS_MODULE_DEV_NAMES": lambda i, d: _names([m.name for m in i.modules(d.name)]),
    "COMPACT_DAQ_CHASSIS_DEV_NAME": lambda i, d: d.chassis or "",
    "COMPACT_DAQ_SLOT_NUM": lambda i, d: d.slot,
    "ACCESSORY_PRODUCT_TYPES": lambda i, d: "RM-24999" if d.product.name == "PXIe-4331" else "",
    "ACCESSORY_PRODUCT_NUMS": lambda i, d: [0x7992] if d.product.name == "PXIe-4331" else [],
    "ACCESSORY_SERIAL_NUMS": lambda i, d: [0] if d.product.name == "PXIe-4331" else [],
    "ANLG_TRIG_SUPPORTED": lambda i, d: d.product.name.startswith(_ANALOG_TRIGGERS),
    "DIG_TRIG_SUPPORTED": lambda i, d: True,
    "TIME_TRIG_SUPPORTED": lambda i, d: d.product.name in ("cDAQ-9185", "cDAQ-9189"),
    "TEDS_HWTEDS_SUPPORTED": lambda i, d: False,
    "AI_SIMULTANEOUS_SAMPLING_SUPPORTED": lambda i, d: d.product.ai_simultaneous,
    "AI_MAX_SINGLE_CHAN_RATE": lambda i, d: d.product.ai_rate_single_hz,
    "AI_MAX_MULTI_CHAN_RATE": lambda i, d: d.product.ai_rate_hz,
    "AI_MIN_RATE": lambda i, d: d.product.ai_rate_least_hz or _SLOWEST_HZ,
    "AO_MAX_RATE": lambda i, d: d.product.ao_rate_hz,
    "AO_MIN_RATE": lambda i, d: _SLOWEST_HZ,
    "DI_MAX_RATE": lambda i, d: 10e6,
    "DO_MAX_RATE": lambda i, d: 10e6,
    "AO_SAMP_CLK_SUPPORTED": lambda i, d: bool(d.product.ao_channels and d.product.ao_rate_hz),
    "CI_SAMP_CLK_SUPPORTED": lambda i, d: d.product.family == "X Series",
    "CO_SAMP_CLK_SUPPORTED": lambda i, d: d.product.family == "X Series",
    "CI_MAX_SIZE": lambda i, d: d.product.counter_bits,
    "CO_MAX_SIZE": lambda i, d: d.product.counter_bits,
    "CI_MAX_TIMEBASE": lambda i, d: 100e6,
    "CO_MAX_TIMEBASE": lambda i, d: 100e6,
    "NUM_DMA_CHANS": lambda i, d: 8,
    "AI_VOLTAGE_RNGS": lambda i, d: _ranges(d.product.ai_ranges),
    "AI_CURRENT_RNGS": lambda i, d: [],
    "AI_FREQ_RNGS": lambda i, d: [],
    "AI_GAINS": lambda i, d: [],
    "AI_BRIDGE_RNGS": lambda i, d: [-0.025, 0.025, -0.1, 0.1] if d.product.ai_bridge_excitation else [],
    "AI_CHARGE_RNGS": lambda i, d: [],
    "AI_RESISTANCE_RNGS": lambda i, d: [],
    "AO_VOLTAGE_RNGS": lambda i, d: (
        ([0.0, d.product.ao_range] if d.product.ao_unipolar else _ranges((d.product.ao_range,)))
        if d.product.ao_channels
        else []
    ),
    "AO_CURRENT_RNGS": lambda i, d: [],
    "AO_GAINS": lambda i, d: [],
    "AI_COUPLINGS": lambda i, d: (
        sum({"ac": 1, "dc": 2}[way] for way in d.product.ai_couplings) if d.ai else 0
    ),
    "AI_TRIG_USAGE": lambda i, d: (
        0
        if not d.ai
        else _triggers("REFERENCE", "START")
        if d.product.family == "SC Express"
        else _triggers("START")
        if d.product.family == "USB DAQ"
        else _triggers("PAUSE", "REFERENCE", "START")
    ),
    "AO_TRIG_USAGE": lambda i, d: 0b1010 if d.ao else 0,
    "DI_TRIG_USAGE": lambda i, d: 0b1110 if d.product.ports else 0,
    "DO_TRIG_USAGE": lambda i, d: 0b1010 if d.product.ports else 0,
    "CI_TRIG_USAGE": lambda i, d: 0b101010 if d.counters else 0,
    "CO_TRIG_USAGE": lambda i, d: 0b1010 if d.counters else 0,
    "AI_SUPPORTED_MEAS_TYPES": lambda i, d: _measures(d),
    "AO_SUPPORTED_OUTPUT_TYPES": lambda i, d: [c.UsageTypeAO.VOLTAGE.value] if d.ao else [],
    "CI_SUPPORTED_MEAS_TYPES": lambda i, d: _counted(d),
    "CO_SUPPORTED_OUTPUT_TYPES": lambda i, d: (
        [kind.value for kind in c.UsageTypeCO] if d.counters and d.product.puts_pulses else []
    ),
    "AI_SAMP_MODES": lambda i, d: _SAMPLE_MODES if d.ai else [],
    "AO_SAMP_MODES": lambda i, d: _SAMPLE_MODES if d.ao else [],
    "CI_SAMP_MODES": lambda i, d: _SAMPLE_MODES if d.counters else [],
    "CO_SAMP_MODES": lambda i, d: _SAMPLE_MODES if d.counters else [],
    "AI_NUM_SAMP_TIMING_ENGINES": lambda i, d: 1 if d.ai else 0,
    "AO_NUM_SAMP_TIMING_ENGINES": lambda i, d: 1 if d.ao else 0,
    "DI_NUM_SAMP_TIMING_ENGINES": lambda i, d: 1 if d.product.ports else 0,
    "DO_NUM_SAMP_TIMING_ENGINES": lambda i, d: 1 if d.product.ports else 0,
    "NUM_TIMESTAMP_ENGINES": lambda i, d: 0,
    "AI_DIG_FLTR_TYPES": lambda i, d: [],
    "AI_DIG_FLTR_LOWPASS_CUTOFF_FREQ_DISCRETE_VALS": lambda i, d: [],
    "AI_DIG_FLTR_LOWPASS_CUTOFF_FREQ_RANGE_VALS": lambda i, d: [],
    "AI_LOWPASS_CUTOFF_FREQ_DISCRETE_VALS": lambda i, d: [],
    "AI_LOWPASS_CUTOFF_FREQ_RANGE_VALS": lambda i, d: [],
    "AI_CURRENT_INT_EXCIT_DISCRETE_VALS": lambda i, d: list(d.product.ai_excitation),
    "AI_VOLTAGE_INT_EXCIT_DISCRETE_VALS": lambda i, d: list(d.product.ai_bridge_excitation),
    "AI_VOLTAGE_INT_EXCIT_RANGE_VALS": lambda i, d: [],
}
SYSTEM_FACTS: dict[str, Callable[[NiSystem], Any]] = {
    # As new as NI's own tests want: those of waveforms are skipped below 25.8.
    "NIDAQ_MAJOR_VERSION": lambda s: 26,
    "NIDAQ_MINOR_VERSION": lambda s: 0,
    "NIDAQ_UPDATE_VERSION": lambda s: 0,
    "DEV_NAMES": lambda s: _names(list(s.inventory.devices)),
    "GLOBAL_CHANS": lambda s: _names(list(s.saved_channels)),
    "SCALES": lambda s: _names(list(s.scales)),
    "TASKS": lambda s: _names(list(s.saved_tasks)),
}


def _term_configs(device: NiDevice, tail: str) -> int:
    bits = {"rse": 1, "nrse": 2, "diff": 4, "pseudodiff": 8}
    number = device.ai_number(tail)
    if number is None:
        return bits["diff"]
    return sum(bits[config] for config in device.product.configurations(number))


def _port_width(device: NiDevice, tail: str) -> int:
    if not tail.startswith("port"):
        raise unserved(f"{device.name}/{tail} is not a digital port.")
    return int(device.product.ports[int(tail.partition("/")[0].removeprefix("port"))])


def _clocked(device: NiDevice, tail: str) -> bool:
    return device.product.family != "E Series" and tail.startswith("port0")


CHANNEL_FACTS: dict[str, Callable[[NiDevice, str], Any]] = {
    "PHYSICAL_CHAN_AI_TERM_CFGS": _term_configs,
    "PHYSICAL_CHAN_AO_TERM_CFGS": lambda d, p: 1,
    "PHYSICAL_CHAN_AI_SUPPORTED_MEAS_TYPES": lambda d, p: _measures(d),
    "PHYSICAL_CHAN_AO_SUPPORTED_OUTPUT_TYPES": lambda d, p: [c.UsageTypeAO.VOLTAGE.value],
    "PHYSICAL_CHAN_CI_SUPPORTED_MEAS_TYPES": lambda d, p: _counted(d),
    "PHYSICAL_CHAN_CO_SUPPORTED_OUTPUT_TYPES": lambda d, p: [kind.value for kind in c.UsageTypeCO],
    "PHYSICAL_CHAN_AO_SUPPORTED_POWER_UP_OUTPUT_TYPES": lambda d, p: [
        c.AOPowerUpOutputBehavior.VOLTAGE.value,
        c.AOPowerUpOutputBehavior.HIGH_IMPEDANCE.value,
    ],
    "PHYSICAL_CHAN_AO_MANUAL_CONTROL_ENABLE": lambda d, p: False,
    "PHYSICAL_CHAN_AO_MANUAL_CONTROL_SHORT_DETECTED": lambda d, p: False,
    "PHYSICAL_CHAN_DIG_PORT_LOGIC_FAMILY": lambda d, p: c.LogicFamily.FIVE_V.value,
    "PHYSICAL_CHAN_AI_INPUT_SRCS": lambda d, p: "",
    "PHYSICAL_CHAN_DI_PORT_WIDTH": _port_width,
    "PHYSICAL_CHAN_DO_PORT_WIDTH": _port_width,
    "PHYSICAL_CHAN_DI_SAMP_CLK_SUPPORTED": _clocked,
    "PHYSICAL_CHAN_DO_SAMP_CLK_SUPPORTED": _clocked,
    "PHYSICAL_CHAN_DI_CHANGE_DETECT_SUPPORTED": lambda d, p: d.product.family != "E Series",
    "PHYSICAL_CHAN_DI_SAMP_MODES": lambda d, p: _SAMPLE_MODES if _clocked(d, p) else [],
    "PHYSICAL_CHAN_DO_SAMP_MODES": lambda d, p: _SAMPLE_MODES if _clocked(d, p) else [],
}
