"""Units as people write them, and what one of them is in SI: the one table of units of all that comes in.

A text may name units of several quantities: `g` is the acceleration of gravity, or a gram. Which is meant,
the heading or the format says, or a person. Scales show a force in units of mass: of these nothing follows
before somebody says that the weight is meant (`gf`).

A file may state factors beside its numbers: a gain, a scale, a multiplier. What a format defines (CF's
`scale_factor`, NWB's `conversion`) its reader applies. Of any other factor nothing says whether it is in the
numbers already: that is a doubt of their unit, and asked. A factor with a unit of its own (`100 mV/g`, `0.05
V/div`) makes another quantity of a number, so it is no doubt of a column that states its unit.
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from ...base.errors import ConfigurationError
from .table import Column

SI = {"time": "s", "force": "N", "acceleration": "m/s^2", "displacement": "m", "voltage": "V"}
"""Unit of each quantity that a file's columns can have."""
_G = 9.80665
_POUND = 0.45359237


@dataclass(frozen=True)
class Unit:
    """A quantity, and how many SI units one of this unit is."""

    quantity: str
    factor: float


_UNITS: Mapping[tuple[str, float], str] = {
    ("time", 1.0): "s sec secs second seconds sekunde sekunden sek mm:ss",
    ("time", 1e-3): "ms msec msecs millisecond milliseconds milli millis millisekunden mseconds",
    ("time", 1e-6): "us usec usecs microsecond microseconds micro micros useconds",
    ("time", 1e-9): "ns nsec nsecs nanosecond nanoseconds nano nanos",
    ("time", 60.0): "min mins minute minutes hh:mm",
    ("time", 3600.0): "h hr hrs hour hours",
    ("time", 86_400.0): "day days datenum",
    ("rate", 1.0): "hz hertz 1/s /s s-1 s^-1 s/s sa/s smp/s smpl/s sps samples/s samples/sec samples/second "
    "samplespersecond samplespersec sample/s pts/s points/s persecond scans/s scans/sec rows/s",
    ("rate", 1e3): "k khz ks/s ksa/s ksps ksamples/s ksmp/s kilohertz",
    ("rate", 1e6): "mhz ms/s msa/s msps msamples/s megahertz",
    ("rate", 1e9): "ghz gs/s gsa/s gsps",
    ("rate", 1 / 60): "1/min /min samples/min samples/minute perminute permin",
    ("force", 1.0): "n newton newtons",
    ("force", 1e-6): "un micronewton micronewtons",
    ("force", 1e-3): "mn millinewton millinewtons",
    ("force", 1e-2): "cn centinewton centinewtons",
    ("force", 10.0): "dan decanewton",
    ("force", 1e3): "kn kilonewton kilonewtons",
    ("force", 1e-5): "dyn dyne dynes",
    ("force", 1e-3 * _G): "gf gram-force grams-force gramforce pond gforce-gram",
    ("force", _G): "kgf kilogram-force kilopond kp",
    ("force", _POUND * _G): "lbf pound-force poundforce",
    ("force", _POUND / 16 * _G): "ozf ounce-force",
    ("mass", 1e-6): "mg milligram milligrams",
    ("mass", 1e-3): "g gr gram grams gramm gms grammes",
    ("mass", 1.0): "kg kgs kilo kilos kilogram kilograms",
    ("mass", _POUND): "lb lbs pound pounds",
    ("mass", _POUND / 16): "oz ounce ounces",
    (
        "acceleration",
        1.0,
    ): "m/s^2 m/s2 m/s/s m/s**2 ms-2 ms^-2 ms^{-2} m/sec^2 m/sec2 mps2 m*s^-2 ms**-2 m.s-2 m*s-^2 ms-^2",
    ("acceleration", 1e-2): "cm/s^2 cm/s2 gal",
    ("acceleration", 1e-3): "mm/s^2 mm/s2 mm/s/s mm/sec^2",
    ("acceleration", 0.3048): "ft/s^2 ft/s2",
    ("acceleration", 0.0254): "in/s^2 in/s2",
    ("acceleration", _G): "g gn g_n gs g's g0 gee grav",
    ("acceleration", 1e-3 * _G): "mg milli-g",
    ("acceleration", 1e-6 * _G): "ug",
    ("displacement", 1.0): "m meter metre meters metres",
    ("displacement", 1e-2): "cm centimeter centimetre centimeters",
    ("displacement", 1e-3): "mm millimeter millimetre millimeters millimetres",
    ("displacement", 1e-6): "um micron microns micrometer micrometre micrometers",
    ("displacement", 1e-9): "nm nanometer nanometre nanometers",
    ("displacement", 0.0254): "in inch inches",
    ("displacement", 2.54e-5): "mil thou",
    ("voltage", 1.0): "v volt volts vdc vac vpk vrms",
    ("voltage", 1e-3): "mv millivolt millivolts",
    ("voltage", 1e-6): "uv microvolt microvolts",
    ("voltage", 1e3): "kv",
    # Of nothing that is imported: what is in one of these is none of the roles, whatever its heading.
    (
        "other",
        1.0,
    ): "% percent deg degree degrees degc °c degf °f c k kelvin rad deg/s rad/s m/s mm/s cm/s in/s "
    "a ma ua amp amps w mw kw pa kpa mpa hpa bar mbar psi nm*m nm/rad n*m nmm mnm n/m n/mm n/m^2 n/mm^2 "
    "j mj ohm kohm f pf nf h/m db lx lux t ut mt tesla mgauss rpm strain ue ustrain v/v mv/v g/l rh %rh m^2 "
    "mm^2 kg/m^3 l ml cps lm cd",
}
WEIGHTS = {1e-6: "0.001 gf", 1e-3: "gf", 1.0: "kgf", _POUND: "lbf", _POUND / 16: "ozf"}
"""Unit of the weight of a mass, by the kilograms of its unit."""
_KNOWN: dict[str, tuple[Unit, ...]] = {}
for (_quantity, _factor), _names in _UNITS.items():
    for _name in _names.split():
        _KNOWN[_name] = (*_KNOWN.get(_name, ()), Unit(_quantity, _factor))
_NUMBER = re.compile(r"\s*(?P<number>[-+]?\d*\.?\d+(?:[eE][-+]?\d+)?)?\s*(?P<unit>\D.*)?\s*\Z")
_BRACKETS = re.compile(r"\s*[\[({](?P<unit>[^\[\](){}]*(?:\([^()]*\)[^\[\](){}]*)?)[\])}]\s*\Z")
_WITHIN = re.compile(r"\s*[\[({](?P<unit>[^\[\](){}]{1,20})[\])}]")
_SINCE = re.compile(r"(?P<unit>[A-Za-z]+?)[ _]?(elapsed|since|from|after|passed)(?![a-z])", re.I)
"""`seconds_elapsed`, `ms since start`."""
_HUMP = re.compile(r"(?<=[a-z])(?=[A-Z][a-z]*(\(\))?\Z)")
"""Before the last word of `timestampMillis`."""
_LETTERS = {
    "": {"a", "c", "k", "f", "t", "j", "l", "w"},
    "_": {"min", "h"},
    " ": {"min", "h", "m", "g", "in", "n", "v", "s"},
}
"""Units that are words of another meaning at the end of a name, by the sign before them; "": of any sign."""
_PLAIN = {
    0xB5: "u",
    0x3BC: "u",
    0xB2: "^2",
    0x20: None,
    0x207B: "-",
    0xB7: "*",
    0x22C5: "*",
    0x2F1: None,
    0x2032: "'",
}
_TIMES = re.compile(r"([/×*]|(?<![a-z])x) ?10+(?!\w)|10\^-?\d+", re.I)
"""A factor in a heading: `Force/100`, `Force x10`."""
_TIMED = re.compile(r"(time|zeit|uhrzeit|temps|clock|elapsed|t)(?![a-z])", re.I)
_MEGA = ("MN", "MV", "MS")
"""Not taken for milli."""


def units_of(text: str) -> tuple[Unit, ...]:
    """The units that a text may name, of different quantities; none for another text."""
    plain = text.strip().strip("[]{}").strip()
    if plain.startswith("(") and plain.endswith(")"):
        plain = plain[1:-1]
    plain = plain.translate(_PLAIN)
    if len(plain) > 2:
        plain = plain.rstrip(".")  # sec.
    if plain in _MEGA:
        return ()
    if plain in ("G", "Gs"):  # no gram
        return (Unit("acceleration", _G),)
    if plain in ("mHz",):
        return (Unit("rate", 1e-3),)
    return _KNOWN.get(plain.lower(), ())


def unit_of(text: str, quantity: str | None = None) -> Unit | None:
    """The unit of a quantity that a text names; without `quantity`, the unit if the text names one only."""
    found = units_of(text)
    if quantity is not None:
        return next((unit for unit in found if unit.quantity == quantity), None)
    return found[0] if len(found) == 1 else None


def is_time(name: str, unit: str) -> bool:
    """True for a column of times, by its unit or its name."""
    return unit_of(unit, "time") is not None or _TIMED.match(name) is not None


def _inner(heading: str) -> re.Match[str] | None:
    """The only brackets in a heading that hold a unit, where words follow them: `Force [N] (filtered)`."""
    if len(heading) > 200:
        return None
    found = [one for one in _WITHIN.finditer(heading) if one.end() < len(heading) and one.start()]
    known = [one for one in found if (units := units_of(one["unit"])) and units[0].quantity != "other"]
    last = _BRACKETS.search(heading)
    return known[0] if len(known) == 1 and not (last and units_of(last["unit"])) else None


def split_heading(heading: str) -> tuple[str, str]:
    """Name and unit in a heading: `Kraft [N]`, `a (g)`, `Weg/mm`, `Kraft in N`, `force_N`; "" without one.

    A heading may be a unit itself, or end in one of time: `Volt`, `Millis`, `t_ms`, `seconds_elapsed`.
    """
    heading = " ".join(heading.split()).strip("\"'")
    if match := _inner(heading):
        name = f"{heading[: match.start()]} {heading[match.end() :].lstrip(' _.')}"
        return " ".join(name.split()), match["unit"].strip()
    if match := _BRACKETS.search(heading[-200:]):
        cut = len(heading) - len(match[0])
        name, unit = heading[:cut].rstrip(" /"), match["unit"].strip()
        if name and unit and not unit.isdecimal():  # time[0] is one of several
            return (name, unit)
        if name and not unit:  # millis()
            heading = name
    for sign in ("/", " in ", "_", ",", " ", "-", ":"):
        name, found, unit = heading.partition(sign) if sign == "/" else heading.rpartition(sign)
        word = unit.strip().lower()
        if not (found and name.strip() and units_of(unit)):
            continue
        if unit.strip() == "n":  # a count
            continue
        if sign in ("_", " ", "-", ":") and word in _LETTERS[""] | _LETTERS["_" if sign == "_" else " "]:
            continue
        return name.strip(), unit.strip()
    for text in (heading, *(m["unit"] for m in [_SINCE.match(heading)] if m), *_HUMP.split(heading)[-1:]):
        if len(text) > 1 and unit_of(text, "time") is not None and text.lower() not in ("min", "mins"):
            return heading, text
    of_axis = heading.lower().startswith("in ") and unit_of(heading[3:], "time")  # in s
    whole = unit_of(heading)
    if of_axis or (whole and whole.quantity in ("voltage", "force", "displacement") and len(heading) > 2):
        return heading, heading[3:] if of_axis else heading  # Volt
    return heading, ""


def contradiction(name: str, unit: str) -> str:
    """What a name with a factor or another unit says against `unit`: `Force/100`, `Force (kN)`, in N."""
    if unit and (factor := _TIMES.search(name[-200:])):
        return f"it is called {name!r}, and {factor[0].strip()} may be in its numbers or not"
    before, own = split_heading(name)
    inner = ["" if before[-1:].isdigit() else own]  # a cell for 10 kg may show N
    inner += [one["unit"] for one in _WITHIN.finditer(name[-200:])]
    inner += [found[2] for sign in (" in ", "/") if (found := name.rpartition(sign))[1]]
    for text in inner:
        known = units_of(text)
        # (L) is left, and no litre.
        meant = known and (len(text.strip()) > 1 or known[0].quantity != "other")
        if unit and meant and known != units_of(unit):
            return f"it is called {name!r}, and its unit is given as {unit}"
    return ""


def per_unit(role: str, quantity: str, text: str, unit: str) -> tuple[float, str]:
    """SI units of `quantity` per unit of a column in `unit`, of which `text` says what it is; and the words.

    `text` is a unit (`mN`), what one of the file's units stands for (`40 N`), or a sensitivity (`100 mV/g`).
    Raises ConfigurationError.
    """
    match = _NUMBER.fullmatch(text)
    number = float(match["number"]) if match and match["number"] else 1.0
    named = ((match and match["unit"]) or "").strip()
    if not match or not named or not 1e-12 < number < 1e12:
        raise ConfigurationError(_unknown(role, quantity, text))
    whole = unit_of(named, quantity)
    if whole is None and quantity == "force" and (mass := unit_of(named, "mass")) is not None:
        whole = Unit("force", mass.factor * _G)  # a person who calls it a force means the weight
    if whole is not None:
        return number * whole.factor, f"one of the file is {text.strip()}" if match[
            "number"
        ] else text.strip()
    for place in (k for k, sign in enumerate(named) if sign == "/"):
        above, below = unit_of(named[:place], "voltage"), unit_of(named[place + 1 :], quantity)
        if above and below:
            if unit and (own := unit_of(unit, "voltage")) is None and units_of(unit):
                raise ConfigurationError(
                    f"The column of {role} is in {unit}, so it needs no sensitivity: leave {text!r} out."
                )
            own = unit_of(unit, "voltage")
            per_volt = below.factor / (number * above.factor)
            return per_volt * (own or above).factor, f"{text.strip()}, of {unit or named[:place].strip()}"
    raise ConfigurationError(_unknown(role, quantity, text))


def _unknown(role: str, quantity: str, text: str) -> str:
    examples = {
        "force": "N, mN, gf, '40 N' (what one of the file's units is) or '0.25 V/N'",
        "acceleration": "m/s^2, g, '9.81 m/s^2' (what one of the file's units is) or '100 mV/g'",
        "displacement": "mm, um or '2 V/mm'",
        "time": "s, ms or us",
    }
    return f"{text!r} is no unit of {role}: write {examples.get(quantity, 'a unit')}."


_FACTOR = re.compile(
    r"(?<![a-z])((scal(e|es|ing)|calibration|cal|conversion|conv)[ .]{0,2}(factors?|constant|coefficient)|"
    r"(skalierungs|skalen|umrechnungs|kalibrier|verst[aä]rkungs|teiler)?faktor(en)?|factors?|scal(e|es|ing)|"
    r"skalierung|gains?|verst[aä]rkung|amplification|(?<!probe )attenuation|multipliers?|"
    r"(multiplied|multiply|scaled|amplified|divided) (by|with)|divisor|slope|sensitivity|sensitivities|"
    r"empfindlichkeit|kennwert)(?![a-z])"
    r"[^a-z0-9+-]{0,12}( ?(setting|value|of|is|was|set to|used) )?"
    r"((in )?(?P<unit>[a-z%][a-z%/]{0,9}) ?[)\]}]|[x×](?=[ \d]))?[^a-z0-9+-]{0,12}"
    r"(?P<number>[-+]?(\d+([.,]\d+)?|[.,]\d+)(e[-+]?\d+)?)(?![\d:])(?P<rest>( +[-+]?[\d.]+)*)"
    r"[ \"']*(?P<after>[a-z%µ][^\s\"',;)]{0,15}|/\w+)?",
    re.I)  # fmt: skip
_NOT_OURS = re.compile(
    r"(?<![a-z])((horizontal|vertical)( \w+)?|time|full|gr[ae]y|colou?r|temperature|trigger|gauge|gage|k|q|"
    r"crest|power|duty|form|safety|quality|over ?sampling|decimation|down ?sampling|damping|interpolation|"
    r"zoom|loop|control|[pid]|pid|feedback|proportional|integral|derivative|ramp)[ :]{0,3}\Z",
    re.I)  # fmt: skip
"""Words before a factor of something else.."""
_PURE = ("db", "%")
"""Units of a number that changes no quantity."""
_WORD = re.compile(r"(?<=[a-z])(?=[A-Z])|[\s_.-]+")
_MOST = 16
"""Values of a column that is a factor: a gain may be switched."""


@dataclass(frozen=True)
class Factor:
    """A factor other than 1."""

    words: str
    """As the file states it."""
    pure: bool
    """False for one with a unit of its own."""

    @property
    def doubt(self) -> str:
        """For a question about the columns beside it; "" for one with a unit."""
        return f"{self.words!r} may be in its numbers already, or not" if self.pure else ""


def factor_in(line: str) -> Factor | None:
    """The first factor other than 1 that a line states."""
    for match in _FACTOR.finditer(line):
        number = float(match["number"].replace(",", "."))
        unit = (match["after"] or match["unit"] or "").strip()
        none = number == (0 if unit.lower() == "db" else 1) and set(match["rest"].split()) <= {"1", "1.0"}
        if none or _NOT_OURS.search(line[: match.start()]):
            continue
        return Factor(
            line.strip(" ,;#%\"'")[:60],
            "/" not in unit and not (units_of(unit) and unit.lower() not in _PURE),
        )
    return None


def is_factor(name: str) -> bool:
    """True for the name of a factor: `scaleFactor`, `Gain (dB)`, `Verstärkung CH1`."""
    return factor_in(f"{_words(name)} : 2") is not None


def doubt_beside(entries: Mapping[str, object]) -> str:
    """The doubt of numbers beside which entries of a file stand: numbers, texts, or arrays of these."""
    for name, value in entries.items():
        if not is_factor(name) or not (each := np.ravel(np.asarray(value)).tolist()):
            continue
        numbers = [one for one in each if isinstance(one, int | float)]
        said = f"{max(numbers, key=lambda one: abs(one - 1)):g}" if numbers else str(each[0])[:20]
        if found := factor_in(f"{_words(name)} = {said}"):
            return replace(found, words=f"{name} = {said}").doubt
    return ""


def doubt_among(columns: Sequence[Column]) -> str:
    """The doubt that a column of a factor, constant or of a few values, leaves of those beside it."""
    for column in columns:
        if not column.unit and is_factor(column.name):
            values = np.unique(column.values[np.isfinite(column.values)])
            if len(values) <= _MOST and (doubt := doubt_beside({column.name: values})):
                return doubt
    return ""


def _words(name: str) -> str:
    return " ".join(filter(None, _WORD.split(name)))
