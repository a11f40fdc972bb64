"""Settings of the simulated function generators: headers as in manuals, with what each may be.

Ranges and keywords are those of the product families. A limit that was not found is the usual one for this
type of instrument (estimate).
"""

from __future__ import annotations

from . import modulation
from .coupling import COUPLED, MODE, OFFSET, RATIO
from .modulation import AM, DEPTH, FM, PACE, SUPPRESSED
from .pulses import FREQUENCY, HOLD
from .waveform import SHAPES

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
    OFFSET: (0, -60e6, 60e6),
    RATIO: (1, 1e-3, 1e3),
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
    COUPLED: False,
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
        for what, words in (
            ("SLOPe", ("POSitive", "NEGative")),
            ("TRIGOut", ("OFF", "POSitive", "NEGative")),
        )
    },
}
"""Sources of the trigger: of a sweep first, and of a burst last."""
OWN_WORDS: dict[bool, dict[str, tuple[str, ...]]] = {
    True: {
        BURST_MODE: ("TRIGgered", "GATed"),
        HOLD: ("WIDTh", "DCYCle"),
        MODE: ("OFFSet", "RATio"),
    },
    False: {
        BURST_MODE: ("TRIGgered", "INFinity", "GATed"),
        HOLD: ("WIDTh", "DUTY"),
        ARB_MODE: ("SRATe", "FREQ"),
        MODE: ("RATio", "OFFSet"),
    },
}
"""Words that the families have in different forms: those of a family by mode, and the other's."""
