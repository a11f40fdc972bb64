"""Families of function generators that can be simulated, described by their differences."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class Product:
    """Externally visible properties of one family that differ from the other's."""

    identity: str
    number: str
    """Format specification of the numbers in its answers."""
    booleans: tuple[str, str]
    infinite: str
    """Its text for an infinite load (an open input)."""
    sweep: dict[str, tuple[float, float, float]]
    """Settings that only this family has: header to (default, lowest, highest)."""
    memory: int
    """Points of the longest arbitrary waveform."""
    by_mode: bool
    """True for Keysight: the sweep is a frequency mode, and all functions share one trigger."""


KEYSIGHT_33500 = Product(
    identity="Agilent Technologies,33522B,MY00000001,5.00-1.19-2.00-58-00",
    number="+.15E",
    booleans=("0", "1"),
    infinite="+9.900000000000000E+37",
    sweep={
        "[:SOURce#]:SWEep:HTIMe": (0, 0, 3600),
        ":TRIGger#:DELay": (0, 0, 1000),
        ":TRIGger#:COUNt": (1, 1, 1e6),
        ":TRIGger#:TIMer": (1, 1e-6, 8e3),
        ":TRIGger#:LEVel": (1.65, 0.9, 3.8),
    },
    memory=1_000_000,
    by_mode=True,
)
DG1000Z = Product(
    identity="Rigol Technologies,DG1062Z,DG1ZA000000001,03.01.12",
    number=".6E",
    booleans=("OFF", "ON"),
    infinite="INFINITY",
    sweep={
        "[:SOURce#]:SWEep:HTIMe[:STARt]": (0, 0, 500),
        "[:SOURce#]:SWEep:HTIMe:STOP": (0, 0, 500),
    },
    memory=8_388_608,
    by_mode=False,
)
