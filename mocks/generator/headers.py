"""Settings of the simulated function generators: headers as in manuals, what each may be, and the families.

Ranges and keywords are those of the product families. A limit that was not found is the usual one for this
type of instrument (estimate).
"""

from __future__ import annotations

import math
from dataclasses import dataclass

from . import modulation
from .modulation import AM, DEPTH, DEVIATION, FM, PACE, SUPPRESSED
from .scpi import Fail, ScpiError, unit_of
from .waveform import FREQUENCY, HOLD, SHAPES, Channel

# Families of function generators that can be simulated, described by their differences.


@dataclass(frozen=True)
class Product:
    """Externally visible properties of one family that differ from the other's."""

    identity: str
    number: str
    """Format specification of the numbers in its answers."""
    booleans: tuple[str, str]
    infinite: str
    """Its text for an infinite load (an open input)."""
    own: dict[str, tuple[float, float, float]]
    """Settings that only this family has, or has differently: header to (default, lowest, highest)."""
    highest: dict[str, float]
    """Highest frequency of each shape (Hz); that of "SIN" for any other."""
    memory: int
    """Points of the longest arbitrary waveform."""
    by_mode: bool
    """True for Keysight: the sweep is a frequency mode, and all functions share one trigger."""


KEYSIGHT_33500 = Product(
    identity="Agilent Technologies,33522B,MY00000001,5.00-1.19-2.00-58-00",
    number="+.15E",
    booleans=("0", "1"),
    infinite="+9.900000000000000E+37",
    own={
        "[:SOURce#]:SWEep:HTIMe": (0, 0, 3600),
        ":TRIGger#:DELay": (0, 0, 1000),
        ":TRIGger#:COUNt": (1, 1, 1e6),
        ":TRIGger#:TIMer": (1, 1e-6, 8e3),
        ":TRIGger#:LEVel": (1.65, 0.9, 3.8),
        "[:SOURce#]:FUNCtion:NOISe:BANDwidth": (100e3, 1e-3, 30e6),
        DEVIATION: (100, 1e-6, 15e6),
        PACE["FM"]: (10, 1e-6, 30e6),
    },
    # Data sheet 5991-0692 of the 33500B Series, 30 MHz models.
    highest={"SIN": 30e6, "RAMP": 200e3, "TRI": 200e3},
    memory=1_000_000,
    by_mode=True,
)
DG1000Z = Product(
    identity="Rigol Technologies,DG1062Z,DG1ZA000000001,03.01.12",
    number=".6E",
    booleans=("OFF", "ON"),
    infinite="INFINITY",
    own={
        "[:SOURce#]:SWEep:HTIMe[:STARt]": (0, 0, 500),
        "[:SOURce#]:SWEep:HTIMe:STOP": (0, 0, 500),
        DEVIATION: (1e3, 0, 60e6),
        PACE["AM"]: (100, 2e-3, 1e6),
        PACE["FM"]: (100, 2e-3, 1e6),
    },
    # Data sheet of the DG1000Z Series, DG1062Z.
    highest={"SIN": 60e6, "SQU": 25e6, "PULS": 25e6, "RAMP": 1e6, "TRI": 1e6, "ARB": 20e6},
    memory=8_388_608,
    by_mode=False,
)


ARB_MODE = "[:SOURce#]:FUNCtion:ARBitrary:MODE"
BURST_MODE = "[:SOURce#]:BURSt:MODE"
START, STOP = "[:SOURce#]:FREQuency:STARt", "[:SOURce#]:FREQuency:STOP"
LIMITED = "[:SOURce#]:VOLTage:LIMit:STATe"
SHAPE, UNIT = "[:SOURce#]:FUNCtion[:SHAPe]", "[:SOURce#]:VOLTage:UNIT"
SPACING = "[:SOURce#]:SWEep:SPACing"

# Header: default, lowest, highest. Settings without an effect on the plant are stored and reported only.
NUMBERS: dict[str, tuple[float, float, float]] = {
    FREQUENCY: (1e3, 1e-6, 60e6),
    START: (100, 1e-6, 60e6),
    STOP: (1e3, 1e-6, 60e6),
    "[:SOURce#]:PHASe[:ADJust]": (0, -360, 360),
    "[:SOURce#]:SWEep:TIME": (1, 1e-3, 500),
    "[:SOURce#]:SWEep:RTIMe": (0, 0, 500),
    "[:SOURce#]:MARKer:FREQuency": (500, 1e-6, 60e6),
    "[:SOURce#]:FUNCtion:SQUare:DCYCle": (50, 0.01, 99.99),
    "[:SOURce#]:FUNCtion:RAMP:SYMMetry": (100, 0, 100),
    "[:SOURce#]:FUNCtion:PULSe:TRANsition[:BOTH]": (10e-9, 8.4e-9, 1e-6),
    "[:SOURce#]:FUNCtion:ARBitrary:SRATe": (40e3, 1e-6, 250e6),
    "[:SOURce#]:BURSt:INTernal:PERiod": (10e-3, 1e-6, 8e3),
    "[:SOURce#]:BURSt:NCYCles": (1, 1, 1e8),
    "[:SOURce#]:BURSt:PHASe": (0, -360, 360),
    "[:SOURce#]:BURSt:TDELay": (0, 0, 85),
    "[:SOURce#]:SWEep:STEP": (2, 2, 1024),
    DEPTH: (100, 0, 120),
    PACE["AM"]: (100, 1e-6, 30e6),
}
BOOLEANS = {
    "[:SOURce#]:BURSt:STATe": False,
    "[:SOURce#]:SWEep:STATe": False,
    "[:SOURce#]:MARKer[:STATe]": False,
    ":OUTPut#[:STATe]": False,
    ":OUTPut#:SYNC[:STATe]": True,
    ":OUTPut#:TRIGger": False,
    LIMITED: False,
    AM: False,
    FM: False,
    SUPPRESSED: False,
    ":INITiate#:CONTinuous": True,
}
WORDS: dict[str, tuple[str, ...]] = {
    SHAPE: SHAPES,
    UNIT: ("VPP", "VRMS", "DBM"),
    SPACING: ("LINear", "LOGarithmic"),
    "[:SOURce#]:BURSt:IDLE": ("FPT", "TOP", "CENTER", "BOTTOM"),
    "[:SOURce#]:FUNCtion:ARBitrary:ADVance": ("SRATe", "TRIGger"),
    "[:SOURce#]:FUNCtion:ARBitrary:FILTer": ("NORMal", "STEP", "OFF"),
    ":OUTPut#:POLarity": ("NORMal", "INVerted"),
    ":OUTPut#:MODE": ("NORMal", "GATed"),
    ":OUTPut#:GATe:POLarity": ("POSITIVE", "NEGATIVE"),
    ":OUTPut#:SYNC:MODE": ("NORMal", "CARRier", "MARKer"),
    ":OUTPut#:SYNC:POLarity": ("NORMal", "INVerted"),
    ":OUTPut#:SYNC:SOURce": ("CH1", "CH2"),
    ":OUTPut#:TRIGger:SLOPe": ("POSitive", "NEGative"),
    "[:SOURce#]:BURSt:GATE:POLarity": ("NORMal", "INVerted"),
    ":TRIGger#:SLOPe": ("POSitive", "NEGative"),
    ":FORMat:BORDer": ("NORMal", "SWAPped"),
    ":UNIT:ANGLe": ("DEGree", "RADian", "SECond"),
    "[:SOURce#]:ROSCillator:SOURce": ("INTernal", "EXTernal"),
    **modulation.WORDS,
}
TRIGGERS: dict[bool, dict[str, tuple[str, ...]]] = {
    True: {":TRIGger#:SOURce": ("IMMediate", "EXTernal", "TIMer", "BUS")},
    False: {
        f"[:SOURce#]:{mode}:TRIGger:SOURce": ("INTernal", "EXTernal", "MANual") for mode in ("SWEep", "BURSt")
    }
    | {
        f"[:SOURce#]:{mode}:TRIGger:{what}": words
        for mode in ("SWEep", "BURSt")
        for what, words in (("SLOPe", ("POSitive", "NEGative")), ("TRIGOut", ("OFF", "POSitive", "NEGative")))
    },
}
"""Sources of the trigger: of a sweep first, and of a burst last."""
OWN_WORDS: dict[bool, dict[str, tuple[str, ...]]] = {
    True: {BURST_MODE: ("TRIGgered", "GATed"), HOLD: ("WIDTh", "DCYCle")},
    False: {
        BURST_MODE: ("TRIGgered", "INFinity", "GATed"),
        HOLD: ("WIDTh", "DUTY"),
        ARB_MODE: ("SRATe", "FREQ"),
    },
}
"""Words that the families have in different forms: those of a family by mode, and the other's."""


# What a setting may be: highest frequencies by shape, units of angles, modes that exclude each other.

SWEEP, BURST = "[:SOURce#]:SWEep:STATe", "[:SOURce#]:BURSt:STATe"
TIME, BURST_PHASE = "[:SOURce#]:SWEep:TIME", "[:SOURce#]:BURSt:PHASe"
_FREQUENCIES = (FREQUENCY, START, STOP, "[:SOURce#]:MARKer:FREQuency")
_MODES = {SWEEP: "sweep", BURST: "burst", AM: "AM", FM: "FM"}
_ANGLES = ("[:SOURce#]:PHASe[:ADJust]", BURST_PHASE)
_KINDS = {
    **dict.fromkeys((*_FREQUENCIES, DEVIATION, *PACE.values()), "HZ"),
    **dict.fromkeys(_ANGLES, "DEG"),
    TIME: "S",
}
_RADIAN = 180 / math.pi


def kind_of(header: str) -> str:
    """Return the kind of a setting's units, for `number_of`."""
    return _KINDS.get(header, "")


def highest(product: Product, channel: Channel, header: str, high: float) -> float:
    """Return the upper limit of a setting: of a frequency that of the product and the shape (Hz)."""
    if header not in _FREQUENCIES:
        return high
    return product.highest.get(channel.words.get(SHAPE, "SIN"), product.highest["SIN"])


def degrees(header: str, unit: str) -> float:
    """Return the degrees in the `unit` of angles that is set; 1 of any other setting."""
    return _RADIAN if header in _ANGLES and unit == "RAD" else 1.0


def in_degrees(header: str, argument: str, value: float, unit: str) -> float:
    """Return the `value` of an argument in degrees, where the setting is an angle."""
    own = unit_of(argument)
    if argument[:1].upper() == "M" or header not in _ANGLES or own not in ("", "RAD"):
        return value
    return value * (_RADIAN if own else degrees(header, unit))


def exclude(values: dict[str, float], header: str, fail: Fail) -> None:
    """Switch the other modes off for one: of sweep, burst and the modulations, one is on."""
    for other, name in _MODES.items():
        if header in _MODES and other != header and values[other]:
            values[other] = 0.0
            fail(ScpiError(-221, f"Settings conflict; {name} turned off by selection of other mode"))


def keep_deviation(product: Product, channel: Channel, fail: Fail) -> None:
    """Reduce the deviation of a frequency modulation to what carrier and shape allow."""
    carrier = channel.values[FREQUENCY]
    most = min(carrier, highest(product, channel, FREQUENCY, math.inf) - carrier)
    if channel.values[FM] and channel.values[DEVIATION] > most:
        channel.values[DEVIATION] = most
        fail(ScpiError(-221, "Settings conflict; FM deviation limited by frequency"))
