"""The questions on each part of a rig, and the keys that their answers become."""

from __future__ import annotations

import json
from collections import Counter
from contextlib import suppress
from dataclasses import dataclass, field, replace

from .. import entry_points
from ..errors import ConfigurationError
from .found import Found, FoundCard
from .interview import Interview

_QUANTITIES = {
    "force": ("Force", "20 N/V, 0.25 V/N, -4.3 pC/N, 2 mV/V, or the .cal file of six gauges"),
    "acceleration": ("Vertical acceleration", "100 mV/g, 10 pC/g, or ADXL335"),
    "displacement": ("The cap's travel", "0.5 mm/V"),
    "velocity": ("The cap's velocity, of a laser aimed at it", "20 mm/s/V"),
}
"""What is asked, and answers that are understood."""
_DELTA_SIGMA = ("NI 9230", "NI 9231", "NI 9232", "NI 9233", "NI 9234", "NI 9250", "NI 9251", "USB-4431")
"""Inputs that convert at 51.2 kHz over whole numbers (docs/hardware.md, "Other NI products")."""


@dataclass
class Parts:
    """What has been said of a rig so far: values are TOML."""

    ask: Interview
    found: Found
    top: dict[str, str] = field(default_factory=dict)
    tables: dict[str, dict[str, str]] = field(default_factory=dict)
    driver: str = ""
    used: Counter[str] = field(default_factory=Counter)
    """Inputs and outputs of each card that have a name."""

    def table(self, name: str) -> dict[str, str]:
        """The keys of a table, to be filled."""
        return self.tables.setdefault(name, {})

    def channel(self, name: str, volts: str = "10", more: str = "") -> str:
        """Name a channel of the DAQ; its terminal, or its number on the card, is asked for."""
        if self.driver == "sound-card":
            number = self._next("input")
            where = self.ask.text(f"input {name}", f"Input of the card for {name}", str(number))
            scale = self.ask.text(f"scale {name}", f"Volts at full scale of input {where}", "1")
            self.table("daq.channels")[name] = f"{{ input = {where}, volts_per_full_scale = {scale} }}"
        else:
            where = self._terminal(name, "ai")
            self.table("daq.channels")[name] = f"{{ terminal = {_quoted(where)}, range = {volts}{more} }}"
        return name

    def output(self, name: str) -> str:
        """Name an output of the DAQ."""
        if self.driver == "sound-card":
            number = self.ask.text(
                f"output {name}", f"Output of the card for {name}", str(self._next("output"))
            )
            scale = self.ask.text(f"full {name}", f"Volts at full scale of output {number}", "1")
            keys = f"output = {number}, volts_per_full_scale = {scale}, highest = {scale}"
            self.table("daq.outputs")[name] = f"{{ {keys} }}"
            self.table("daq")["latency"] = "0    # `haploop doctor --loop` measures it"
        else:
            where = self._terminal(name, "ao")
            self.table("daq.outputs")[name] = f"{{ terminal = {_quoted(where)}, range = 10 }}"
        return name

    def _terminal(self, name: str, kind: str) -> str:
        free = [
            card.name
            for card in self.found.cards
            if self.used[f"{card.name}/{kind}"] < (card.inputs if kind == "ai" else card.outputs)
        ]
        place = f"{(free or ['Dev1'])[0]}/{kind}"
        return self.ask.text(f"terminal {name}", f"Terminal of {name}", f"{place}{self._next(place) - 1}")

    def _next(self, what: str) -> int:
        self.used[what] += 1
        return self.used[what]


def daq(parts: Parts) -> None:
    """What takes the samples."""
    cards = parts.found.cards
    listed = ", ".join(f"{card.product} ({card.name})" for card in cards)
    choices = [
        ("ni", listed or "an NI card or chassis; none was found"),
        ("sound-card", ", ".join(name for name, _ in parts.found.sounds) or "the system's"),
        *((name, "of an installed package") for name in _others()),
    ]
    kind = parts.ask.one_of("daq", "What takes the samples?", choices)
    parts.driver = "ni-daqmx" if kind == "ni" else kind
    table = parts.table("daq")
    table["driver"] = _quoted(parts.driver)
    if kind == "ni":
        if not cards:
            product = parts.ask.text("product", "Its product, as NI MAX names it", "USB-6211")
            name = parts.ask.text("device", "Its name in NI MAX", "Dev1")
            cards = (FoundCard(name, product, 16, 2),)
            parts.found = replace(parts.found, cards=cards)
        table["devices"] = f"{{ {', '.join(f'{card.name} = {_quoted(card.product)}' for card in cards)} }}"
    rate = parts.ask.number("rate", "Samples per second of recordings", _rate(parts))
    if rate is not None:
        parts.top["rate_hz"] = f"{rate:g}"


def sensors(parts: Parts) -> None:
    """What is measured of a press."""
    for quantity, (what, examples) in _QUANTITIES.items():
        said = parts.ask.text(quantity, f"{what}: its sensitivity or scale ({examples}); empty without")
        if said:
            _sensor(parts, quantity, said)
    if not any(f"sensors.{q}" in parts.tables for q in _QUANTITIES):
        parts.ask.tell("Without any of these no press can be recorded; a table can be calibrated.")
    volts = parts.ask.number("switch", "The button's contact: volts that separate its states; empty without")
    if volts is not None:
        parts.table("sensors.activation").update(
            {"channels": _list([parts.channel("switch")]), "threshold": f"{volts:g}"}
        )


def _sensor(parts: Parts, quantity: str, said: str) -> None:
    ask, table = parts.ask, parts.table(f"sensors.{quantity}")
    if said.lower().endswith(".cal"):
        names = [parts.channel(f"gauge{n}") for n in range(6)]
        table.update({"channels": _list(names), "calibration": _quoted(said)})
        return
    if said.upper() == "ADXL335":
        names = [parts.channel(f"acceleration_{axis}", "5") for axis in "xyz"]
        supply = ask.text("supply", "Its supply (V)", "3.3")
        table.update({"channels": _list(names), "supply": supply})
        table["capacitor"] = ask.text("capacitor", "Its filter capacitors (F; 0.1e-6 as sold)", "0.1e-6")
        return
    volts = ask.text(
        f"range {quantity}", f"Largest volts of {quantity}", "5" if quantity != "force" else "10"
    )
    alone, more = said.rsplit(maxsplit=1)[-1], ""
    if "pC" in alone or "C/" in alone:
        table["sensitivity"] = _quoted(said)
        table["amplifier"] = _quoted(ask.text("charge", "Its charge amplifier", "10 mV/pC"))
        table["high_pass_hz"] = ask.text("charge hz", "Its high-pass (Hz)", "0.16")
    elif alone in ("mV/V", "V/V", "uV/V"):
        table["sensitivity"] = _quoted(said)
        for key, question, default in (
            ("excitation", "Its excitation (V)", "10"), ("rated", "Its rated load (N)", "50"),
            ("gain", "Gain of its amplifier", "100"),
        ):  # fmt: skip
            table[key] = ask.text(f"bridge {key}", question, default)
    elif alone.endswith("/V"):
        table["scale"] = _quoted(said)
    else:
        table["sensitivity"] = _quoted(said)
        if quantity == "acceleration":
            corner = ask.text("iepe hz", "Its high-pass (Hz), as IEPE has; empty without", "0.5")
            if corner:
                table["high_pass_hz"] = corner
                supply = ask.text("iepe", "Current (A) that the card supplies; empty for none")
                more = f', coupling = "ac", excitation = {supply}' if supply else ""
    table["channels"] = _list([parts.channel(quantity, volts, more)])
    parts.tables[f"sensors.{quantity}"] = {"channels": table.pop("channels"), **table}


def driven(parts: Parts) -> None:
    """The table, if there is one: actuator, amplifier, relay, pick-up, limits."""
    ask = parts.ask
    if (
        ask.one_of(
            "drives", "Does it play buttons on a touch table?", [("yes", ""), ("no", "it records only")]
        )
        == "no"
    ):
        return
    table = parts.table("table")
    table["rows"] = ask.text("rows", "Rows of measuring points on the table", "1")
    table["columns"] = ask.text("columns", "Columns of measuring points", "1")
    table["button_point"] = ask.text("point", "Number of the button's point, from 0", "0")
    table["patches"] = _list(["A"])
    if (rate := ask.text("table rate", "Samples per second of drives", _table_rate(parts))) != "50000":
        table["rate_hz"] = rate
    _amplifier(parts)
    _actuator(parts)
    _relay(parts)
    _pick_up(parts)
    _generator(parts)
    limit = ask.number("limit", "Largest drive (V, of either sign); empty: 50 V")
    if limit is not None:
        parts.table("limits").update(
            {"peak_to_peak": f"{2 * limit:g}", "min": f"{-limit:g}", "max": f"{limit:g}"}
        )


def _amplifier(parts: Parts) -> None:
    ask, table = parts.ask, parts.table("amplifier")
    table["driver"] = '"analog-amplifier"'
    table["name"] = _quoted(ask.needed("amplifier", "Amplifier: its product"))
    table["source"] = _quoted(ask.text("amplifier source", "Where its figures are from", "its data sheet"))
    table["input"] = _quoted(parts.output("amplifier"))
    for key, question, default in (
        ("gain", "Gain (V per V)", "10"), ("min", "Lowest output (V)", "-100"),
        ("max", "Highest output (V)", "100"),
        ("current_peak", "Peak current (A)", "0.1"), ("current_average", "Average current (A)", "0.05"),
        ("bandwidth_hz", "Bandwidth (Hz)", "5000"),
    ):  # fmt: skip
        table[key] = ask.figure(f"amplifier {key}", f"Amplifier: {question}, such as {default}")
    ratio = ask.figure("monitor", "Its monitor or a divider: volts there per volt at the DAQ, such as 100")
    parts.table("sensors.drive").update({"channels": _list([parts.channel("drive", "5")]), "ratio": ratio})


def _actuator(parts: Parts) -> None:
    ask, table = parts.ask, parts.table("actuator")
    kind = ask.one_of(
        "actuator",
        "What drives the table?",
        [("piezo", "patch, bender, stack"), ("coil", "voice coil, exciter")],
    )
    table["kind"] = _quoted(kind)
    questions = {
        "piezo": (("capacitance", "Capacitance (F)", "90e-9"), ("min", "Lowest voltage (V)", "-100"),
                  ("max", "Highest voltage (V)", "100")),
        "coil": (("resistance", "Resistance (ohm)", "8"), ("volts", "Largest voltage (V peak)", "4"),
                 ("watts", "Power that it takes for ever (W)", "1"),
                 ("thermal_time", "Thermal time constant (s)", "2")),
    }  # fmt: skip
    for key, question, default in questions[kind]:
        table[key] = ask.figure(f"actuator {key}", f"{question}, such as {default}")


def _relay(parts: Parts) -> None:
    ask = parts.ask
    kind = ask.one_of("relay", "What connects the actuator?", [
        ("none", "it is always connected: read docs/explanation/safety.md"),
        ("yocto-maxicoupler", "a Yoctopuce relay box, which opens by itself"),
        ("serial-relay", "a relay board on a serial port"),
    ])  # fmt: skip
    if kind == "none":
        parts.top["wiring"] = '"direct"'
        guard = ask.text("guard", "What protects it from all that the amplifier can put out; empty: nothing")
        if guard:
            parts.table("actuator")["protected_by"] = _quoted(guard)
        return
    table = parts.table("relay")
    table["driver"] = _quoted(kind)
    if kind == "serial-relay":
        ports = [*parts.found.ports, ("another", "")]
        port = ask.one_of("relay port", "On which port?", ports)
        table["port"] = _quoted(port if port != "another" else ask.text("relay name", "Its name", "COM5"))
        table["patches"] = "{ A = 0 }"
    else:
        table["hub"] = _quoted(ask.text("hub", "Address of its VirtualHub", "http://127.0.0.1:4444"))
        table["patches"] = "{ A = 1 }"
    table["rating"] = ask.text("rating", "Volts that its contacts switch", "48")


def _pick_up(parts: Parts) -> None:
    ask, table = parts.ask, parts.table("vibrometer")
    quantity = ask.one_of("pick-up", "What measures the table's motion?", [
        ("velocity", "a laser vibrometer"), ("displacement", "a displacement laser"),
        ("acceleration", "an accelerometer glued to it"),
    ])  # fmt: skip
    unit = {"velocity": "m/s", "displacement": "m", "acceleration": "m/s^2"}[quantity]
    table["driver"] = '"analog-vibrometer"'
    table["name"] = _quoted(ask.needed("pick-up name", "Its product"))
    table["source"] = _quoted(ask.text("pick-up source", "Where its figures are from", "its data sheet"))
    table["channel"] = _quoted(parts.channel("laser", "5"))
    table["quantity"] = _quoted(quantity)
    defaults = {
        "velocity": ("0.005", "0.02"),
        "displacement": ("1e-4", "5e-4"),
        "acceleration": ("98.07", "490"),
    }
    for key, question, default in (
        ("scale", f"Scale ({unit} per V)", defaults[quantity][0]),
        ("range", f"Full scale ({unit})", defaults[quantity][1]),
        ("bandwidth_hz", "Bandwidth (Hz)", "20000"),
        ("delay", "Delay (s)", "0"),
    ):  # fmt: skip
        table[key] = ask.figure(f"pick-up {key}", f"{question}, such as {default}")
    if quantity == "acceleration":
        table["mass"] = ask.figure("pick-up mass", "Its mass (kg), such as 0.002")


def _generator(parts: Parts) -> None:
    if not parts.found.visa:
        return
    choices = [("none", "the DAQ plays"), ("keysight-33500", ""), ("rigol-dg1000z", "")]
    kind = parts.ask.one_of("generator", "A function generator for calibration sweeps?", choices)
    if kind != "none":
        table = parts.table("generator")
        resource = parts.ask.one_of("resource", "Which?", parts.found.visa)
        # Until somebody says that it is wired to the amplifier, the DAQ's output is.
        table.update({"driver": _quoted(kind), "resource": _quoted(resource), "output": '"generator"'})


def _others() -> list[str]:
    """DAQs of installed packages other than this one."""
    own = {"ni-daqmx", "sound-card", "serial-adc"}
    found = []
    for name in entry_points.installed(entry_points.DRIVERS):
        with suppress(ConfigurationError):  # the driver of another role
            if name not in own:
                entry_points.driver_class(name, "daq")
                found.append(name)
    return sorted(found)


def _rate(parts: Parts) -> str:
    if parts.driver == "sound-card":
        return "48000"
    # Delta-sigma modules divide 51.2 kHz.
    return "5120" if any(card.product in _DELTA_SIGMA for card in parts.found.cards) else "5000"


def _table_rate(parts: Parts) -> str:
    return {"5120": "51200", "48000": "48000"}.get(_rate(parts), "50000")


def _list(names: list[str]) -> str:
    return json.dumps(names)


def _quoted(text: str) -> str:
    return json.dumps(text, ensure_ascii=False)
