"""Families of function generators that can be simulated, described by their differences."""

from __future__ import annotations

from dataclasses import dataclass

from .modulation import DEVIATION, PACE


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
