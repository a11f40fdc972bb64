"""A rig file for each NI product, and what runs on it: doctor, record, calibrate, check, on twin and wire."""

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import haploop
from haploop.base.errors import HaploopError
from haploop.calibration.self_test import examine
from haploop.nidaqmx_twin.products import PRODUCTS, Product

__all__ = ["Mode", "Pressed", "Rig", "of", "pressed", "run"]

Mode = Literal["twin", "wire"]
Pressed = Callable[[float], Path]
"""Returns the file of a press that was recorded at a rate (Hz)."""
_LEAST = 20e3
"""Lowest rate at which a table is calibrated here (Hz): below it a sweep does not end near zero."""
_MODULES = ("C Series", "TestScale")
_RATES = (50e3, 25e3, 20e3, 10e3, 5e3)


@dataclass(frozen=True)
class Rig:
    """A generated rig file, and what its product can do in it."""

    product: str
    text: str
    steps: tuple[str, ...]
    partner: str = ""
    """Product that has the terminals that it lacks."""


def of(name: str) -> Rig:
    """Generate the rig of a product: its inputs and outputs, and a partner's where it has none."""
    product = PRODUCTS[name]
    if product.slots:
        return _in_chassis(name)
    module = product.family in _MODULES
    own, other = ("cDAQ1Mod1", "cDAQ1Mod2") if module else ("Dev1", "Dev2")
    volts = _volts(product)
    inputs = own if volts >= 1 else other
    outputs = own if product.ao_rate_hz >= _LEAST and product.ao_channels else other
    wanted = _partner(product, inputs == other, outputs == other)
    reads = product if inputs == own else PRODUCTS[wanted]
    puts = product if outputs == own else PRODUCTS[wanted]
    devices = {own: name} | ({other: wanted} if other in (inputs, outputs) else {})
    lines = [f'name = "{name}"', f"rate_hz = {_rate(reads, 5):g}", "[daq]", 'driver = "ni-daqmx"']
    listed = ", ".join(f'{device} = "{kind}"' for device, kind in devices.items())
    lines.append(f"devices = {{ {listed} }}")
    table = _volts(reads) >= 2 and _rate(reads, 2, puts) >= _LEAST and volts + product.ao_channels > 0
    presses = inputs == own and _volts(reads) >= 10 and _rate(reads, 10) >= 1000
    names = [*(f"gauge{i}" for i in range(6)), "acceleration_x", "acceleration_y", "acceleration_z", "switch"]
    lines.append("[daq.channels]")
    if presses:
        spans = dict.fromkeys(names, 10.0) | dict.fromkeys(names[6:9], 5.0)
        lines += [_channel(n, inputs, i, reads, spans[n]) for i, n in enumerate(names)]
    first = len(names) if presses and _volts(reads) >= len(names) + 2 else 0
    if table and not (presses and first == 0):
        lines.append(_channel("drive", inputs, first, reads, 1.0))
        lines.append(_channel("laser", inputs, first + 1, reads, 5.0))
    elif not presses and volts:
        lines.append(_channel("signal", inputs, 0, reads, min(5.0, reads.ai_ranges[0])))
    table = table and not (presses and first == 0)
    if table:
        lines += [
            "[daq.outputs]",
            f'amplifier = {{ terminal = "{outputs}/ao0", range = {min(10.0, puts.ao_range)} }}',
        ]
        lines.append(_TABLE.replace("RATE", f"{_rate(reads, 2, puts):.10g}"))
    if presses:
        lines.append(_SENSORS)
    steps = ["doctor"] + ["record"] * presses + ["calibrate", "check"] * table
    return Rig(name, "\n".join(lines), tuple(steps), wanted if other in (inputs, outputs) else "")


def _in_chassis(name: str) -> Rig:
    """Generate the rig of a chassis: that of an NI 9205 in its first slot."""
    inside = of("NI 9205")
    devices = f'devices = {{ cDAQ1 = "{name}", cDAQ1Mod1 = "NI 9205" }}'
    kept = "\n".join(devices if line.startswith("devices") else line for line in inside.text.splitlines())
    table = kept.index("[daq.outputs]")
    return Rig(name, kept[:table] + _SENSORS, ("doctor", "record"), "NI 9205")


def _volts(product: Product) -> int:
    """Number of inputs that read volts."""
    if (product.ai_measures and "VOLTAGE" not in product.ai_measures) or not product.ai_ranges:
        return 0
    return max(product.ai_single_ended, product.ai_differential) if product.ai_ranges[0] >= 1 else 0


def _partner(product: Product, reads: bool, puts: bool) -> str:
    if product.family not in _MODULES:
        return "PCIe-6321"
    return "NI 9263" if puts and not reads else "NI 9205"


def _rate(reads: Product, count: int, puts: Product | None = None) -> float:
    """Highest usual rate at which `count` inputs, and the outputs, run."""
    most = reads.ai_rate_hz / (1 if reads.ai_simultaneous else count)
    most = min(most, puts.ao_rate_hz if puts is not None else 5000.0)
    usual = next((rate for rate in _RATES if rate <= most), most)
    own = reads.sample_rate(usual)
    return own if own <= most * (1 + 1e-9) else reads.sample_rate(usual / 2)


def _channel(name: str, device: str, number: int, product: Product, wanted: float) -> str:
    span = min(wanted, product.ai_ranges[0])
    single = ', config = "rse"' if product.ai_single_ended else ""
    return f'{name} = {{ terminal = "{device}/ai{number}", range = {span:g}{single} }}'


_TABLE = """
[amplifier]
driver = "e413-d2"
input = "amplifier"
gain = 50

[relay]
driver = "yocto-maxicoupler"
hub = "http://127.0.0.1:4444"
patches = { A = 1, B = 2, C = 3, D = 4 }
rating = 48
dead_man = 2.0

[vibrometer]
driver = "pdv-100"
channel = "laser"
range = 0.02
low_pass_hz = 5000

[table]
rows = 7
columns = 12
button_point = 20
patches = ["A", "B", "C", "D"]
patch_places = { A = [0.20, 0.15], B = [0.62, 0.93], C = [0.08, 0.45], D = [0.92, 0.55] }
rate_hz = RATE

[actuator]
kind = "piezo"
capacitance = 90e-9
min = -100
max = 400

[sensors.drive]
channels = ["drive"]
ratio = 100

[limits]
peak_to_peak = 100
"""
_SENSORS = """
[sensors.force]
channels = ["gauge0", "gauge1", "gauge2", "gauge3", "gauge4", "gauge5"]
matrix = [
    [0.0, -0.02, 0.0, 3.15, 0.0, -3.15],
    [0.0, -3.70, 0.0, 1.85, 0.0, 1.85],
    [5.20, 0.0, 5.20, 0.0, 5.20, 0.0],
    [0.0, -0.04, 0.0779, 0.02, -0.0779, 0.02],
    [-0.09, 0.0, 0.045, -0.035, 0.045, 0.035],
    [0.0, -0.046, 0.0, -0.046, 0.0, -0.046],
]
range = [40, 40, 120, 2, 2, 2]

[sensors.acceleration]
channels = ["acceleration_x", "acceleration_y", "acceleration_z"]
supply = 3.3
capacitor = 10e-9
low_pass_hz = 500

[sensors.activation]
channels = ["switch"]
threshold = 2.5
"""


# What runs


def run(rig: Rig, simulate: Mode, folder: Path, press: Pressed) -> dict[str, str]:
    """Run each step of a rig; return "yes", or the sentence that says why not, by step.

    `press` returns the file of a press that was recorded at a rate (Hz), for checks.
    """
    file = folder / "rig.toml"
    file.write_text(rig.text, encoding="utf-8")
    done: dict[str, str] = {}
    steps = {
        "doctor": lambda: _doctor(file, simulate),
        "record": lambda: _record(file, simulate, folder),
        "calibrate": lambda: _calibrate(file, simulate, folder),
        "check": lambda: _check(file, simulate, folder, press),
    }
    for step in rig.steps:
        try:
            done[step] = steps[step]()
        except HaploopError as error:
            done[step] = str(error)
    return done


def _doctor(file: Path, simulate: Mode) -> str:
    with haploop.open_rig(file, simulate=simulate) as rig:
        red = [finding for finding in examine(rig) if finding.status == "red"]
    return "; ".join(f"{finding.name}: {finding.sentence}" for finding in red) or "yes"


def _record(file: Path, simulate: Mode, folder: Path) -> str:
    with haploop.open_rig(file, simulate=simulate) as rig:
        recording = haploop.record(rig, button="latch", participant="P01", presses=2, out=folder)
    return "yes" if len(recording.accepted) >= 2 else f"{len(recording.accepted)} presses"


def _calibrate(file: Path, simulate: Mode, folder: Path) -> str:
    with haploop.open_rig(file, simulate=simulate) as rig:
        haploop.calibrate(rig, patch="A", point="button").save(folder / "calibration.h5")
    return "yes"


def _check(file: Path, simulate: Mode, folder: Path, press: Pressed) -> str:
    calibration = haploop.Calibration.load(folder / "calibration.h5")
    with haploop.open_rig(file, simulate=simulate) as rig:
        recorded = press(5000.0 if rig.table.rate_hz % 5000 == 0 else 5120.0)
        drive = haploop.drive_for(haploop.Representative.load(recorded), calibration, limits=rig.limits)
        result = haploop.check(rig, drive)
    return "yes" if result.verdict == "pass" else str(result.verdict)


def pressed(folder: Path) -> Pressed:
    """Return what records a press on the simulated rig at a rate (Hz), once, and returns its file."""

    def press(rate_hz: float) -> Path:
        file, rig = folder / f"press-{rate_hz:g}.h5", folder / f"rig-{rate_hz:g}.toml"
        if not file.exists():
            rig.write_text(f'base = "simulated"\nname = "presses"\nrate_hz = {rate_hz:g}\n', encoding="utf-8")
            with haploop.open_rig(rig) as opened:
                recording = haploop.record(opened, "latch", "P01", 5, folder / f"{rate_hz:g}")
            haploop.representative([recording]).save(file)
        return file

    return press
