"""SCPI as clients write it, asked of the generators' boxes."""

import re
import socket
from typing import Any

import numpy as np
import pytest

from haploop.base.clock import VirtualClock
from haploop.mocks.generator import DG1000Z, KEYSIGHT_33500, Box
from haploop.mocks.transport import LineServer
from haploop.nidaqmx_twin.nodes import Source


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


ERROR = "SYST:ERR?"
OPEN = "OUTP1:LOAD INF;:VOLT 2;:OUTP1 ON"
"""Of a DG1000Z: 1 V peak at an open input."""


def ask(box: Box, line: str) -> str | None:
    reply = box.answer(line)
    assert len(reply) <= 1
    return reply[0] if reply else None


BOTH = (KEYSIGHT_33500, DG1000Z)
FINE = '+0,"No error"'
UNDEFINED = '-113,"Undefined header"'
IGNORED = '-211,"Trigger ignored"'
DIALOGUES: list[tuple[str, Any]] = [
    *(
        (f"long and short forms: {header}", KEYSIGHT_33500, f"{header} 263.5", (f"{header}?", 263.5))
        for header in ("FREQ", ":FREQ", "freq", "FREQuency", "SOUR:FREQ", "SOURCE1:FREQUENCY:CW",
                       ":sour1:freq", "FREQ:CW")
    ),
    *(
        (f"not known: {header}", KEYSIGHT_33500, (f"{header}?", None), (ERROR, UNDEFINED), (ERROR, FINE))
        for header in ("FREQU", "FRE", "SOURC:FREQ", "FREQ:BW", "FREQ1X", "BANANA")
    ),
    ("several commands on a line", KEYSIGHT_33500, "FREQ:STAR 1;STOP 625;:SWE:TIME 20;*WAI",
     ("FREQ:STAR?;STOP?;:OUTP?", "+1.000000000000000E+00;+6.250000000000000E+02;0"),
     ('DISP:TEXT "a;b";*OPC?', "1")),
    *(
        (f"a number: {argument}", KEYSIGHT_33500, f"FREQ {argument}", (ERROR, FINE),
         ("FREQ?", pytest.approx([value])))
        for argument, value in (("1.5 kHz", 1500), ("2E2", 200), ("MIN", 1e-6), ("MAXimum", 30e6))
    ),
    *(
        (f"an error: {line}", KEYSIGHT_33500, line, ("SYSTem:ERRor:NEXT?", re.compile(f"{code},")),
         ("*ESR?", re.compile("32$|16$")))
        for line, code in (("FREQ", -109), ("FREQ x", -104), ("FREQ 1 furlong", -131), ("FUNC HEART", -224),
                           ("SOUR3:FREQ 1", -114))
    ),
    *(
        (f"an error: {line}", KEYSIGHT_33500, line, (ERROR, said))
        for line, said in (
            ("FREQ 20000 MHZ", '-222,"Data out of range; value clipped to upper limit"'),
            ("DATA:ARB x, #215abc", '-161,"Invalid block data"'),
            ("DATA:ARB x, #15abcde", '-161,"Invalid block data"'),
            ("DATA:ARB x, 1, 2, x, 4", '-104,"Data type error"'),
            ("DATA:ARB x, 0, 1", '-109,"Missing parameter"'),
            ("DATA:ARB x, 0,0,0,0,0,0,0,2", '-222,"Data out of range"'),
        )
    ),
    ("common commands", KEYSIGHT_33500, ("*idn?", re.compile("Agilent Technologies,33522B,")),
     "FREQ 5;*RST", ("FREQ?", 1000), "*ESE 32;BANANA", ("*ESE?;*STB?", "32;36"), (ERROR, UNDEFINED)),
    ("the load changes what is told", KEYSIGHT_33500, "OUTP:LOAD 50;:VOLT 1;:VOLT:OFFS 0.1", "OUTP:LOAD INF",
     ("VOLT?;:VOLT:OFFS?;:OUTP:LOAD?", [2, 0.2, 9.9e37]), "OUTP:LOAD 50;:VOLT:UNIT DBM;:VOLT 10",
     "VOLT:UNIT VPP", ("VOLT?", pytest.approx([2.0], rel=1e-3))),
    ("families write differently", DG1000Z, ":SOUR1:FREQ 263.5;:OUTP1:LOAD INF",
     (":SOUR1:FREQ?;:OUTP1?;:OUTP1:LOAD?;:SYST:ERR?", '2.635000E+02;OFF;INFINITY;0,"No error"')),
    *((f"not Rigol's: {line}", DG1000Z, line, (ERROR, UNDEFINED))
      for line in ("*TRG", "FREQ:MODE SWE", "TRIG:SOUR BUS")),
    ("apply sets everything and switches on", KEYSIGHT_33500, "FREQ:MODE SWE;:VOLT:OFFS 3",
     "APPL:SIN 5 KHZ, 3.0 VPP, -2.5 V", (ERROR, FINE),
     ("APPL?", '"SIN +5.000000000000000E+03,+3.000000000000000E+00,-2.500000000000000E+00"'),
     ("OUTP?", "1"), ("FREQ:MODE?", "CW"), ("BURS:STAT?", "0"), "APPLy:SQUare DEF, DEF", ("FUNC?", "SQU"),
     ("FREQ?", 1000), ("VOLT:OFFS?", 0), ("VOLT?", pytest.approx([0.1]))),
    ("apply of the other family has a phase", DG1000Z, ":SOUR1:APPL:SIN 500,2.5,0.5,90",
     (":SOUR1:APPL?", "SIN,5.000000E+02,2.500000E+00,5.000000E-01,9.000000E+01"), (":OUTP1?", "ON")),
    ("centre and span are start and stop", BOTH, "SOUR1:FREQ:CENT 3000;SPAN 600",
     ("SOUR1:FREQ:STAR?", 2700), ("SOUR1:FREQ:STOP?", 3300), "SOUR1:FREQ:STAR 100;STOP 500",
     ("SOUR1:FREQ:CENT?", 300), ("SOUR1:FREQ:SPAN?", 400)),
    ("states are recalled with the output off", BOTH, "SOUR1:FREQ 263.5;:OUTP1 ON;*SAV 2;*RST;*RCL 2",
     ("SOUR1:FREQ?", 263.5), ("OUTP1?", re.compile("(0|OFF)$")), "*CLS;*RCL 3", (ERROR, re.compile("810")),
     "*SAV 5", (ERROR, re.compile("-222"))),
    ("one trigger for each arming", KEYSIGHT_33500, "TRIG:SOUR BUS;:BURS:STAT ON;:INIT:CONT OFF;*TRG",
     (ERROR, IGNORED), "INIT;*TRG", (ERROR, FINE), "*TRG", (ERROR, IGNORED),
     "TRIG:COUN 2;:INIT;:ABOR;*TRG", (ERROR, IGNORED)),
    ("status registers and the front panel", BOTH, ("STAT:OPER:COND?", "0"), ("STAT:QUES?", "0"),
     ("STATus:QUEStionable:EVENt?", "0"), ("STAT:QUES:ENAB?", "0"),
     "STAT:QUES:ENAB 16;:SYST:REM;:SYST:LOC", ("STAT:QUES:ENAB?", "16"), "STAT:PRES",
     ("STAT:QUES:ENAB?", "0")),
    ("Rigol names its settings in its own way", DG1000Z, OPEN, "SOUR1:FREQ:FIX 2000", ("SOUR1:PER?", 5e-4),
     "SOUR1:PER 0.01;:SOUR1:PULS:HOLD WIDT;:SOUR1:PULS:WIDT 0.001",
     ("SOUR1:FREQ?", 100), ("SOUR1:PULS:DCYC?", 10),
     ":SOUR1:APPL:NOIS 1.5,0.25", ("SOUR1:VOLT?", 1.5), ("SOUR1:VOLT:OFFS?", 0.25),
     ":SOURCE1:APPLY:ARB 2MSa/s,1,0.5", ("SOUR1:FUNC:ARB:MODE?", "SRAT"), ("SOUR1:FUNC:ARB:SRAT?", 2e6),
     ("SOUR1:VOLT?", 1), ":SOUR1:APPL:USER 500", ("SOUR1:FUNC:ARB:MODE?", "FREQ"), ("SOUR1:FREQ?", 500)),
    *(
        (f"Rigol tells what is applied as QCoDeS reads it: {applied}", DG1000Z, OPEN,
         f":SOUR1:APPL:{applied}", (":SOUR1:APPL?", told))
        for applied, told in (
            ("PULS 500,1,0.5,90", "PULSE,5.000000E+02,1.000000E+00,5.000000E-01,9.000000E+01"),
            ("NOIS 500,1,0.5,0", "NOISE,DEF,1.000000E+00,5.000000E-01,DEF"),
            ("NOIS 1,0.5", "NOISE,DEF,1.000000E+00,5.000000E-01,DEF"),
            ("USER 500,1,0.5,0", "USER,5.000000E+02,1.000000E+00,5.000000E-01,0.000000E+00"),
            ("ARB 2000,1,0.5", "ARB,2.000000E+03,1.000000E+00,5.000000E-01"),
        )
    ),
    ("what pymeasure and QCoDeS ask of a 33500", KEYSIGHT_33500,
     "SOURce1:BURSt:NCYCles INF;:DISP:TEXT 'at work'", ("BURS:NCYC?", "+9.900000000000000E+37"),
     ("DISP:TEXT?", '"at work"'), "DISP:TEXT:CLE;:DISP OFF", ("DISP:TEXT?;:DISP?", '"";0'),
     "DATA:ARB one,0,0.1,0.2,0.3,0.4,0.5,0.6,0.7;:FUNC:ARB one;:FUNC:ARB:SRAT 4000",
     ("DATA:VOL:CAT?", '"INT:\\BUILTIN\\EXP_RISE.ARB","ONE"'), ("FUNC:ARB:POIN?", 8),
     ("FUNC:ARB:FREQ?", 500), ("DATA:VOL:FREE?", 1_000_000 - 8), "FUNC:ARB:PER 0.01",
     ("FUNC:ARB:SRAT?", 800)),
    *((f"{kind} can only be off", BOTH, f"SOUR1:{kind}:STAT OFF",
       (f"SOUR1:{kind}:STAT?", re.compile("(0|OFF)$"))) for kind in ("PM", "PWM")),
    ("PM is not simulated", BOTH, "SOUR1:PM:STAT ON",
     (ERROR, '-221,"Settings conflict; AM and FM only are simulated"')),
    ("angles", KEYSIGHT_33500, "PHAS 90;:UNIT:ANGL RAD", ("PHAS?", pytest.approx([np.pi / 2])), "PHAS 1",
     "UNIT:ANGL DEG", ("PHAS?", pytest.approx([180 / np.pi]))),
    ("the highest frequency of a 33522B", KEYSIGHT_33500, ("FREQ? MAX", 30e6), ("FUNC:NOIS:BAND?", 100e3),
     ("FUNC:NOIS:BAND? MAX", 30e6), "FUNC RAMP", ("FREQ? MAX", 200e3)),
]  # fmt: skip


@pytest.mark.parametrize(
    ("family", "steps"),
    [
        pytest.param(family, steps, id=f"{name}-{'rigol' if family is DG1000Z else 'keysight'}")
        for name, families, *steps in DIALOGUES
        for family in (families if isinstance(families, tuple) else (families,))
    ],
)
def test_a_dialogue(family, steps):
    """Commands, which are not answered, and questions with their answers; nothing is wrong at the end."""
    box = Box(family, Bench(), "amplifier")
    for step in steps:
        asked, right = step if isinstance(step, tuple) else (step, None)
        told = ask(box, asked)
        if right is None or isinstance(right, str):
            assert told == right, asked
        elif isinstance(right, re.Pattern):
            assert told is not None and right.match(told), (asked, told)
        else:
            numbers = [float(part) for part in (told or "").split(";")]
            assert numbers == ([right] if isinstance(right, int | float) else right), asked
    assert (ask(box, ERROR) or "").endswith('"No error"')


def test_the_queue_overflows_and_is_cleared(box):
    for _ in range(30):
        ask(box, "BANANA")
    errors = [ask(box, "SYST:ERR?") for _ in range(20)]
    assert errors[-1] == '-350,"Queue overflow"'
    assert ask(box, "SYST:ERR?") == '+0,"No error"'
    ask(box, "BANANA")
    ask(box, "*CLS")
    assert ask(box, "SYST:ERR?;*ESR?;*STB?") == '+0,"No error";0;0'


def test_shapes():
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


@pytest.fixture(params=[KEYSIGHT_33500, DG1000Z], ids=["keysight", "rigol"])
def each(request: pytest.FixtureRequest) -> Box:
    return Box(request.param, Bench(), "amplifier")


def number(box: Box, question: str) -> float:
    return float(ask(box, question) or "nan")


def test_nothing_beyond_a_voltage_limit_is_put_out(each):
    bench: Bench = each._advance.__self__
    ask(each, "OUTP1:LOAD INF;:SOUR1:VOLT:OFFS 0;:SOUR1:VOLT:LIM:HIGH 1.5;LOW -1.5;STAT ON;:SOUR1:VOLT 4")
    assert (ask(each, "SYST:ERR?") or "").startswith("-221")
    assert number(each, "SOUR1:VOLT?") == 3
    ask(each, "SOUR1:FUNC SIN;:SOUR1:FREQ 50;:OUTP1 ON")
    assert np.abs(bench.volts(0.1)).max() == pytest.approx(1.5, rel=1e-3)
    # A limit does not cut what is put out already.
    ask(each, "SOUR1:VOLT:LIM:HIGH 0.5")
    assert number(each, "SOUR1:VOLT:LIM:HIGH?") == 1.5


def test_a_burst_begins_at_its_phase_after_its_delay(box):
    bench: Bench = box._advance.__self__
    ask(box, "OUTP:LOAD INF;:VOLT 2;:FREQ 100;:BURS:NCYC 1;PHAS 90;STAT ON;:TRIG:SOUR BUS;DEL 0.01;:OUTP ON")
    ask(box, "*TRG")
    volts = bench.volts(0.03)
    assert volts[:400] == pytest.approx(1.0)  # 8 ms: it waits where it begins
    assert volts[500:1000] == pytest.approx(np.cos(2 * np.pi * 100 * np.arange(500) * 20e-6), abs=0.01)
    assert volts[1010:] == pytest.approx(1.0)


def test_an_abort_ends_a_sweep(box):
    bench: Bench = box._advance.__self__
    ask(
        box,
        "OUTP:LOAD INF;:VOLT 2;:FREQ:STAR 10;STOP 1000;:SWE:TIME 1;:FREQ:MODE SWE;:TRIG:SOUR BUS;:OUTP ON",
    )
    ask(box, "*TRG")
    bench.volts(0.9)
    ask(box, "ABOR")
    assert np.abs(np.diff(bench.volts(0.05))).max() < 0.01  # 10 Hz again, not 900


def block(values: bytes) -> bytes:
    length = str(len(values))
    return f"#{len(length)}{length}".encode() + values


def test_a_million_points_come_as_a_block_of_binary_data(box):
    """With line feeds, semicolons and number signs in it, over the wire and in pieces."""
    samples = (np.arange(1_000_000) % 65_535 - 32_767).astype(">i2")
    with LineServer(box.answer) as server, socket.create_connection(("127.0.0.1", server.port), 30) as link:
        link.sendall(
            b"DATA:ARB:DAC big," + block(samples.tobytes()) + b"\nFUNC:ARB big;:FUNC ARB;:SYST:ERR?\n"
        )
        assert link.makefile().readline() == '+0,"No error"\n'
        floats = np.array([0.1, 2560.0, 59.0, 35.0, -0.5, 0.0, 1.0, 10.0]) / 2560
        link.sendall(b"FORM:BORD SWAP\n")
        link.sendall(b"DATA:ARB little," + block(floats.astype("<f4").tobytes()) + b"\nSYST:ERR?\n")
        assert link.makefile().readline() == '+0,"No error"\n'
    channel = box._channels[1]
    assert np.array_equal(channel.points['"BIG"'].values, samples / 32767.0)
    assert channel.points['"LITTLE"'].values == pytest.approx(floats, abs=1e-7)


@pytest.fixture
def wired() -> tuple[Box, Bench]:
    """A DG1000Z whose channel 1 puts out 1 V peak at an open input."""
    bench = Bench()
    box = Box(DG1000Z, bench, "amplifier")
    ask(box, OPEN)
    return box, bench


def test_a_pulse_is_as_long_as_is_said(each):
    bench: Bench = each._advance.__self__
    ask(each, "OUTP1:LOAD INF;:SOUR1:VOLT 2;:SOUR1:FUNC PULS;:SOUR1:FUNC:PULS:PER 10 ms;:OUTP1 ON")
    assert number(each, "SOUR1:FREQ?") == pytest.approx(100)
    ask(each, "SOUR1:FUNC:PULS:WIDT 2 ms")
    assert number(each, "SOUR1:FUNC:PULS:DCYC?") == pytest.approx(20)
    pulses = bench.volts(0.1)
    assert set(np.round(pulses, 9)) == {-1, 1}
    assert np.mean(pulses > 0) == pytest.approx(0.2, abs=0.01)
    ask(each, "SOUR1:FREQ 200")  # the width is held
    assert np.mean(bench.volts(0.1) > 0) == pytest.approx(0.4, abs=0.01)
    ask(each, f"SOUR1:FUNC:PULS:HOLD {'DUTY' if each.get('*IDN?').startswith('Rigol') else 'DCYC'}")
    ask(each, "SOUR1:FREQ 50")  # and now its share
    assert number(each, "SOUR1:FUNC:PULS:WIDT?") == pytest.approx(8e-3)
    assert np.mean(bench.volts(0.1) > 0) == pytest.approx(0.4, abs=0.01)
    assert "No error" in (ask(each, "SYST:ERR?") or "")


@pytest.mark.parametrize(
    "line",
    [
        "SOUR1:DATA VOLATILE, 0, 1, 0, -1, -1, -1, -1, -1",
        ":DATA:DAC VOLATILE,8192,16383,8192,0,0,0,0,0",
        "TRAC:DATA:DAC16 VOLATILE,CON,#18{};:DATA:DAC16 VOLATILE,END,#18{}",
    ],
)
def test_rigol_plays_what_is_sent_to_its_volatile_memory(wired, line):
    box, bench = wired
    halves = [np.array(h, "<u2").tobytes().decode("latin-1") for h in ([8192, 16383, 8192, 0], [0] * 4)]
    ask(box, "FUNC:ARB:MODE FREQ;:FREQ 100")
    ask(box, line.format(*halves))
    assert ask(box, "SYST:ERR?") == '0,"No error"'
    assert ask(box, "FUNC?") == "ARB"
    cycle = bench.volts(0.01)
    assert len(cycle) == pytest.approx(500, abs=1)
    assert cycle[[20, 80, 150, 220, 480]] == pytest.approx([0, 1, 0, -1, -1], abs=1e-3)


def test_an_infinite_burst_begins_with_a_trigger_and_does_not_end(each):
    bench: Bench = each._advance.__self__
    ask(each, "OUTP1:LOAD INF;:SOUR1:FREQ 100;:SOUR1:VOLT 2;:OUTP1 ON")
    if each.get("*IDN?").startswith("Rigol"):
        ask(each, "SOUR1:BURS:TRIG:SOUR MAN;:SOUR1:BURS:MODE INFINITY;:SOUR1:BURS ON")
        fire = "SOUR1:BURS:TRIG"
    else:
        ask(each, "TRIG1:SOUR BUS;:SOUR1:BURS:NCYC INF;:SOUR1:BURS:STAT ON")
        assert number(each, "SOUR1:BURS:NCYC?") == 9.9e37
        fire = "*TRG"
    assert not bench.volts(0.1).any()
    ask(each, fire)
    assert "No error" in (ask(each, "SYST:ERR?") or "")
    bench.volts(5.0)
    assert np.abs(bench.volts(0.1)).max() == pytest.approx(1, rel=1e-3)


TIMES = np.arange(5000) * 20e-6


def modulated(kind: str, amount: float, pace: float, times: np.ndarray = TIMES) -> np.ndarray:
    """A sine of 1 V peak and 500 Hz, modulated by a sine of `pace` (Hz)."""
    if kind == "AM":
        return (1 + amount * np.sin(2 * np.pi * pace * times)) / 2 * np.sin(2 * np.pi * 500 * times)
    if kind == "DSSC":
        return amount * np.sin(2 * np.pi * pace * times) * np.sin(2 * np.pi * 500 * times)
    beyond = amount / pace * (1 - np.cos(2 * np.pi * pace * times))
    return np.sin(2 * np.pi * 500 * times + beyond)


@pytest.mark.parametrize(
    ("commands", "right"),
    [
        ("AM:DEPT 50;INT:FREQ 20;:AM:STAT ON", modulated("AM", 0.5, 20)),
        ("AM:INT:FREQ 20;:AM:STAT ON", modulated("AM", 1, 20)),
        ("AM:DEPT 0;STAT ON", modulated("AM", 0, 20)),
        ("AM:SOUR EXT;STAT ON", modulated("AM", 0, 20)),
        ("AM:DEPT 80;DSSC ON;INT:FREQ 20;:AM:STAT ON", modulated("DSSC", 0.8, 20)),
        ("FM:DEV 30;INT:FREQ 20;:FM:STAT ON", modulated("FM", 30, 20)),
        ("FM:DEV 100;SOUR EXT;STAT ON", modulated("FM", 0, 20)),
    ],
)
def test_a_modulated_sine_is_what_theory_says(each, commands, right):
    bench: Bench = each._advance.__self__
    ask(each, "OUTP1:LOAD INF;:SOUR1:VOLT 2;:SOUR1:FREQ 500;:OUTP1 ON")
    ask(each, commands)
    assert bench.volts(0.1)[:5000] == pytest.approx(right, abs=1e-4)
    assert "No error" in (ask(each, "SYST:ERR?") or "")


@pytest.mark.parametrize(
    ("wave", "right"),
    [("SQU", [1, 1, 0, 0]), ("RAMP", [0.125, 0.375, 0.625, 0.875]), ("NRAM", [0.875, 0.625, 0.375, 0.125]),
     ("TRI", [0.25, 0.75, 0.75, 0.25])],
)  # fmt: skip
def test_what_modulates_has_a_shape(each, wave, right):
    """The largest about the middle of each quarter of a wave of 2 Hz."""
    bench: Bench = each._advance.__self__
    ask(each, "OUTP1:LOAD INF;:SOUR1:VOLT 2;:SOUR1:FREQ 10000;:OUTP1 ON")
    ask(each, f"AM:INT:FREQ 2;FUNC {wave};:AM:STAT ON")
    volts = bench.volts(0.5)
    middles = [
        np.abs(volts[round(part * 25_000) + np.arange(-10, 10)]).max()
        for part in (1 / 8, 3 / 8, 5 / 8, 7 / 8)
    ]
    assert middles == pytest.approx(np.array(right) * np.sin(2 * np.pi / 5), abs=5e-3)


def test_no_modulation_goes_beyond_a_limit(each):
    bench: Bench = each._advance.__self__
    ask(each, "OUTP1:LOAD INF;:SOUR1:VOLT 20;:SOUR1:FREQ 500;:AM:DEPT 120;STAT ON;:OUTP1 ON")
    assert np.abs(bench.volts(0.1)).max() == 10  # DG1000Z guide, 2-117: 10 Vpp at 50 Ohm
    ask(each, "SOUR1:VOLT 2;:SOUR1:VOLT:LIM:HIGH 1;LOW -1;STAT ON")
    assert np.abs(bench.volts(0.1)).max() == 1


def test_rigol_has_modulations_by_another_name_too(wired):
    box, _ = wired
    ask(box, ":SOUR1:MOD:AM 50;:SOUR1:MOD:FM:DEV 200;:SOUR1:AM 60")
    assert [number(box, f"SOUR1:{q}?") for q in ("AM", "MOD:AM:DEPT", "FM")] == [60, 60, 200]


def test_every_voltage_is_that_at_the_load_which_is_set(box):
    """50 Ohm in the instrument: half at a load of 50 Ohm, a third at 25, all of it without."""
    ask(box, "OUTP:LOAD INF;:VOLT 3;:VOLT:OFFS 0.6;:VOLT:LIM:HIGH 6;LOW -9")
    asked = ("VOLT?", "VOLT:OFFS?", "VOLT:HIGH?", "VOLT:LOW?", "VOLT:LIM:HIGH?", "VOLT:LIM:LOW?")
    without = np.array([3, 0.6, 2.1, -0.9, 6, -9])
    rms = 3 / 2 / 2**0.5
    for load, share in (("INF", 1.0), ("50", 1 / 2), ("25", 1 / 3)):
        ask(box, f"OUTP:LOAD {load}")
        np.testing.assert_allclose([number(box, one) for one in asked], share * without, rtol=1e-9)
        ask(box, "VOLT:UNIT VRMS")
        assert number(box, "VOLT?") == pytest.approx(share * rms)
        if load != "INF":
            ask(box, "VOLT:UNIT DBM")
            watts = (share * rms) ** 2 / float(load)
            assert number(box, "VOLT?") == pytest.approx(10 * np.log10(watts / 1e-3))
        ask(box, "VOLT:UNIT VPP")


@pytest.mark.parametrize(
    ("line", "asked", "without"),
    [
        ("VOLT 1", "VOLT?", 3),
        ("VOLT MIN", "VOLT?", 2e-3),
        ("VOLT:OFFS 0;:VOLT MAX", "VOLT?", 20),
        ("VOLT:OFFS 0.2", "VOLT:OFFS?", 0.6),
        ("VOLT:HIGH 1", "VOLT:HIGH?", 3),
        ("VOLT:LOW -1", "VOLT:LOW?", -3),
        ("VOLT:LIM:HIGH 2", "VOLT:LIM:HIGH?", 6),
        ("VOLT:LIM:LOW -2", "VOLT:LIM:LOW?", -6),
        ("VOLT:LIM:HIGH 2;HIGH MAX", "VOLT:LIM:HIGH?", 10),
        ("VOLT:LIM:LOW -2;LOW MIN", "VOLT:LIM:LOW?", -10),
    ],
)
def test_what_is_set_at_a_load_is_three_times_as_much_without(box, line, asked, without):
    ask(box, f"OUTP:LOAD 25;:{line}")
    assert ask(box, "SYST:ERR?") == '+0,"No error"'
    ask(box, "OUTP:LOAD INF")
    assert number(box, asked) == pytest.approx(without)


@pytest.mark.parametrize(
    ("commands", "asked", "value", "number"),
    [
        ("FUNC SQU;VOLT 2;VOLT:UNIT VRMS", "VOLT?", 1.0, 0),
        ("FUNC RAMP;VOLT 2;VOLT:UNIT VRMS", "VOLT?", 2 / 12**0.5, 0),
        ("VOLT:UNIT VRMS;VOLT 1;VOLT:UNIT VPP", "VOLT?", 8**0.5, 0),
        ("FUNC RAMP;FREQ 1E7", "FREQ?", None, -222),
        ("FREQ 1E7;FUNC RAMP", "FREQ?", None, -221),
        ("BURS:STAT ON;SWE:STAT ON", "BURS:STAT?", 0.0, -221),
        ("SWE:STAT ON;BURS:STAT ON", "SWE:STAT?", 0.0, -221),
        ("AM:STAT ON;:SWE:STAT ON", "AM:STAT?", 0.0, -221),
        ("BURS:STAT ON;:FM:STAT ON", "BURS:STAT?", 0.0, -221),
        ("AM:STAT ON;:FM:STAT ON", "AM:STAT?", 0.0, -221),
        ("FUNC DC;:AM:STAT ON", "AM:STAT?", 0.0, -221),
        ("AM:STAT ON;:FUNC NOIS", "AM:STAT?", 1.0, 0),
        ("FM:STAT ON;:FUNC NOIS", "FUNC?", None, -221),
        ("AM:DEPT 130", "AM:DEPT?", 120.0, -222),
        ("FREQ 1000;:FM:DEV 2000;STAT ON", "FM:DEV?", 1000.0, -221),
        ("FM:DEV 1000;STAT ON;:FREQ 100", "FM:DEV?", 100.0, -221),
        ("AM:INT:FUNC HEART", "AM:INT:FUNC?", None, -224),
        ("AM:STAT ON;:APPL:SIN 1000,1", "AM:STAT?", 0.0, 0),
        ("VOLT 1 VRMS;VOLT:UNIT VPP", "VOLT?", 8**0.5, 0),
        ("VOLT 500 MVPP", "VOLT?", 0.5, 0),
        ("VOLT 300 MVRMS", "VOLT?", 0.3 * 8**0.5, 0),
        ("APPL:SIN 1000, 1 VRMS;:VOLT:UNIT VPP", "VOLT?", 8**0.5, 0),
        ("FREQ 1 V", "FREQ?", 1000.0, -131),
        ("VOLT 1 HZ", "VOLT?", None, -131),
        ("VOLT:LIM:HIGH 1;LOW -1;:VOLT:LIM:STAT ON;:OUTP:LOAD INF", "OUTP:LOAD?", 50.0, -221),
        ("FREQ\t200", "FREQ?", 200.0, 0),
    ],
)  # fmt: skip
def test_units_limits_and_modes_of_both_families(each, commands, asked, value, number):
    """The manuals of both families; frequencies by shape: their data sheets."""
    each.answer("*RST;*CLS")
    each.answer(commands)
    told = (ask(each, asked) or "nan").replace("OFF", "0").replace("ON", "1")
    if value is not None:
        assert float(told) == pytest.approx(value, rel=1e-3)
    assert int((ask(each, "SYST:ERR?") or "0").partition(",")[0]) == number
