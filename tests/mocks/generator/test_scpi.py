"""SCPI as clients write it, asked of the generators' boxes."""

from __future__ import annotations

import numpy as np
import pytest

from haploop.mocks.clock import VirtualClock
from haploop.mocks.generator import DG1000Z, KEYSIGHT_33500, Box
from haploop.mocks.plant import Source


class Bench:
    def __init__(self) -> None:
        self.clock = VirtualClock()
        self.source: Source | None = None

    def drive(self, node: str, source: Source) -> None:
        self.source = source

    def advance(self, until: float) -> None:
        pass

    def volts(self, duration: float) -> np.ndarray:
        """What is put out in the next `duration` seconds."""
        assert self.source is not None
        self.source.take(self.clock.now() - 1e-9)
        self.clock.sleep(duration)
        return np.concatenate([run.values for run in self.source.take(self.clock.now())])


@pytest.fixture
def box() -> Box:
    return Box(KEYSIGHT_33500, Bench(), "amplifier")


def ask(box: Box, line: str) -> str | None:
    reply = box.answer(line)
    assert len(reply) <= 1
    return reply[0] if reply else None


@pytest.mark.parametrize(
    "header",
    ["FREQ", ":FREQ", "freq", "FREQuency", "SOUR:FREQ", "SOURCE1:FREQUENCY:CW", ":sour1:freq", "FREQ:CW"],
)
def test_long_and_short_forms(box: Box, header: str) -> None:
    assert ask(box, f"{header} 263.5") is None
    assert float(ask(box, f"{header}?") or "nan") == 263.5


@pytest.mark.parametrize("header", ["FREQU", "FRE", "SOURC:FREQ", "FREQ:BW", "FREQ1X", ""])
def test_other_forms_are_not_known(box: Box, header: str) -> None:
    assert ask(box, f"{header or 'BANANA'}?") is None
    assert ask(box, "SYST:ERR?") == '-113,"Undefined header"'
    assert ask(box, "SYST:ERR?") == '+0,"No error"'


def test_several_commands_on_a_line(box: Box) -> None:
    assert ask(box, "FREQ:STAR 1;STOP 625;:SWE:TIME 20;*WAI") is None
    assert ask(box, "FREQ:STAR?;STOP?;:OUTP?") == "+1.000000000000000E+00;+6.250000000000000E+02;0"
    assert ask(box, 'DISP:TEXT "a;b";*OPC?') == "1"


@pytest.mark.parametrize(
    ("argument", "value"),
    [("1.5 kHz", 1500), ("2E2", 200), ("20000 MHZ", None), ("MIN", 1e-6), ("MAXimum", 60e6)],
)
def test_numbers(box: Box, argument: str, value: float | None) -> None:
    ask(box, f"FREQ {argument}")
    error = ask(box, "SYST:ERR?")
    if value is None:
        assert error == '-222,"Data out of range; value clipped to upper limit"'
    else:
        assert error == '+0,"No error"'
        assert float(ask(box, "FREQ?") or "nan") == pytest.approx(value)


@pytest.mark.parametrize(
    ("line", "number"),
    [
        ("FREQ", -109),
        ("FREQ x", -104),
        ("FREQ 1 furlong", -131),
        ("FUNC HEART", -224),
        ("SOUR3:FREQ 1", -114),
    ],
)
def test_errors_are_queued(box: Box, line: str, number: int) -> None:
    ask(box, line)
    assert (ask(box, "SYSTem:ERRor:NEXT?") or "").startswith(f"{number},")
    assert ask(box, "*ESR?") in ("32", "16")


def test_the_queue_overflows_and_is_cleared(box: Box) -> None:
    for _ in range(30):
        ask(box, "BANANA")
    errors = [ask(box, "SYST:ERR?") for _ in range(20)]
    assert errors[-1] == '-350,"Queue overflow"'
    assert ask(box, "SYST:ERR?") == '+0,"No error"'
    ask(box, "BANANA")
    ask(box, "*CLS")
    assert ask(box, "SYST:ERR?;*ESR?;*STB?") == '+0,"No error";0;0'


def test_common_commands(box: Box) -> None:
    assert (ask(box, "*idn?") or "").startswith("Agilent Technologies,33522B,")
    ask(box, "FREQ 5;*RST")
    assert float(ask(box, "FREQ?") or "nan") == 1000
    ask(box, "*ESE 32;BANANA")
    assert ask(box, "*ESE?;*STB?") == "32;36"


def test_the_load_changes_what_is_told_and_not_what_is_put_out(box: Box) -> None:
    ask(box, "OUTP:LOAD 50;:VOLT 1;:VOLT:OFFS 0.1")
    ask(box, "OUTP:LOAD INF")
    assert [float(x) for x in (ask(box, "VOLT?;:VOLT:OFFS?;:OUTP:LOAD?") or "").split(";")] == [
        2,
        0.2,
        9.9e37,
    ]
    ask(box, "OUTP:LOAD 50;:VOLT:UNIT DBM;:VOLT 10")
    ask(box, "VOLT:UNIT VPP")
    assert float(ask(box, "VOLT?") or "nan") == pytest.approx(2.0, rel=1e-3)


def test_families_write_differently() -> None:
    rigol = Box(DG1000Z, Bench(), "amplifier")
    assert ask(rigol, ":SOUR1:FREQ 263.5;:OUTP1:LOAD INF") is None
    assert ask(rigol, ":SOUR1:FREQ?;:OUTP1?;:OUTP1:LOAD?;:SYST:ERR?") == (
        '2.635000E+02;OFF;INFINITY;0,"No error"'
    )
    for line in ("*TRG", "FREQ:MODE SWE", "TRIG:SOUR BUS"):
        ask(rigol, line)
        assert ask(rigol, "SYST:ERR?") == '-113,"Undefined header"'


def test_shapes() -> None:
    bench = Bench()
    box = Box(KEYSIGHT_33500, bench, "amplifier")
    ask(box, "OUTP:LOAD INF;:VOLT 2;:FREQ 100;:FUNC SQU;:FUNC:SQU:DCYC 25;:OUTP ON")
    square = bench.volts(0.1)
    assert set(np.round(square, 9)) == {-1, 1}
    assert np.mean(square > 0) == pytest.approx(0.25, abs=0.01)
    ask(box, "FUNC TRI")
    assert np.abs(bench.volts(0.1)).mean() == pytest.approx(0.5, abs=0.01)
    ask(box, "FUNC DC;:VOLT:OFFS 1.5")
    assert set(bench.volts(0.1)) == {1.5}
    ask(box, "VOLT:OFFS 0;:DATA:ARB ramp, 0,0.1,0.2,0.3,0.4,0.5,0.6,0.7;:FUNC:ARB ramp;:FUNC ARB")
    ask(box, "FUNC:ARB:SRAT 1000")
    assert sorted(set(np.round(bench.volts(0.1), 9))) == pytest.approx(np.arange(8) / 10)
    ask(box, "FUNC SIN;:BURS:NCYC 3;STAT ON;:TRIG:SOUR BUS")
    assert not bench.volts(0.1).any()
    ask(box, "*TRG")
    burst = bench.volts(0.1)
    assert np.flatnonzero(np.abs(burst) > 1e-9).max() == pytest.approx(0.03 / 20e-6, abs=2)
    assert ask(box, "SYST:ERR?") == '+0,"No error"'
