"""What a text states is used, what it does not state is asked for, and what contradicts itself is, too.

One table of inputs in the shape of files that people post, each with what is right.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
import pytest

import haploop
from haploop.exchange import FileMapping, understand
from tests.raising import raises

T = np.arange(2500) / 5000
F = 2 * np.exp(-(((T - 0.25) / 0.05) ** 2))
"""N: one press, whose first derivative is smooth."""


def rows(*columns: Sequence[Any] | np.ndarray, form: str = "{}", separator: str = ",") -> str:
    return "".join(
        separator.join(form.format(cell) for cell in row) + "\n" for row in zip(*columns, strict=True)
    )


def timed(head: str, *more: Any, scale: float = 1.0) -> str:
    """A table of time, force and more; time in units of 1/scale s."""
    return head + "\n" + rows(np.round(T * scale, 7), np.round(F, 5), *more)


def cells(values: np.ndarray, unit: str) -> list[str]:
    return [f"{value:.4f}{unit}" for value in values]


BARE = rows(np.round(F, 5), np.round(0.01 * F, 6))
"""Force and acceleration without a time."""
LVM = (
    "LabVIEW Measurement\t\nWriter_Version\t2\nSeparator\tTab\nDecimal_Separator\t.\nMulti_Headings\tYes\n"
    "X_Columns\t{x}\nDate\t2026/05/01\nTime\t10:00:00.5\n***End_of_Header***\t\n\t\n"
)
SEGMENT = (
    "Channels\t2\t\nSamples\t2500\t2500\t\nY_Unit_Label\tNewtons\tg\t\nX_Dimension\tTime\tTime\t\n"
    "X0\t0.0E+0\t0.0E+0\t\nDelta_X\t0.000200\t0.000200\t\n***End_of_Header***\t\t\n"
)
LVM_ROWS = rows(T, np.round(F, 6), np.round(0.1 * F, 6), separator="\t")
MULTI_ROWS = rows(T, np.round(F, 6), T, np.round(0.1 * F, 6), separator="\t")


def in_segments(number: int) -> str:
    return LVM.format(x="One") + (SEGMENT + "X_Value\tForce\tAcc\tComment\n" + LVM_ROWS + "\n") * number


NONE = [""] * 2500
CLOCK = np.array([f"10:00:{1 + t:07.4f}" for t in T])


@dataclass(frozen=True)
class Case:
    """A text, and what is right: a rate, roles with their heading and peak, what is asked or refused."""

    name: str
    text: str
    rate_hz: float | None = None
    """None where it must be asked for, or refused."""
    told: dict[str, Any] = field(default_factory=dict)
    asks: tuple[str, ...] = ()
    """Parts of questions, or of the refusal; none other may be open."""
    peaks: dict[str, float] = field(default_factory=dict)
    """Largest magnitude by role, in SI; a role that is not here is not taken."""
    notes: tuple[str, ...] = ()


G = 9.80665
SURE = {"force": 2.0}
BOTH = {"force": 2, "acceleration": 0.2 * G}
N = {"units": {"force": "N"}}


def read(name: str, text: str, rate_hz: float = 5000, **right: Any) -> Case:
    """A text of which nothing is asked: F is its force, unless `peaks` are others."""
    return Case(name, text, rate_hz, **{"peaks": SURE, **right})


def asked(name: str, text: str, *parts: str, told: dict[str, Any] | None = None) -> Case:
    return Case(name, text, told=told or {}, asks=parts)


CASES = (
    # Units of time
    read("milliseconds by heading", timed("Millis,Force (N)", scale=1e3)),
    read("microseconds by heading", timed("micros(),Force (N)", scale=1e6)),
    read("milliseconds in a name", timed("t_ms,Force (N)", scale=1e3)),
    read("a camel's unit", timed("timestampMillis,Force (N)", scale=1e3)),
    read("a word before", timed("seconds_elapsed,Force (N)")),
    read("Unix seconds", "Unix Timestamp,Force (N)\n" + rows(1.7e9 + T, F)),
    asked("Unix milliseconds are no seconds", "Unix Timestamp,Force (N)\n" + rows(1.7e12 + 1e3 * T, F),
        "the unit of its time"),
    asked("no unit", timed("time,Force (N)"), "the unit of its time (time rises by 0.0002 a sample)"),
    asked("no unit at 50/s", "time,Force (N)\n" + rows(20 * np.arange(200), F[:200]), "the unit of its time"),
    read("a stated rate gives the unit", "Sample rate: 5000 Hz\n" + timed("time,Force (N)", scale=1e3)),
    read("a time with another", "time,seconds_elapsed,Force (N)\n" + rows(1e9 * T, T, F)),
    asked("two times that differ", "Time (s),Elapsed (ms),Force (N)\n" + rows(T, 2e3 * T, F), "which of"),
    asked("heading against units", "Time (s),Force (N)\nms,N\n" + rows(1e3 * T, F),
        "its heading says s, the row of units ms"),
    # Stated rates
    *(
        read(f"header {line}", f"{line}\nForce (N),Acc (g)\n{BARE}", rate,
            peaks={"force": 2, "acceleration": 0.02 * G})
        for line, rate in (
            ("Sample rate (kHz),5", 5000),
            ("Sampling interval (us),200", 5000),
            ("Sample rate: 5 kSa/s", 5000),
            ("Samples per second: 5000", 5000),
            ("Sampling rate: 0.2 ms", 5000),
            ("Sample Rate 5k", 5000),
            ("Baud rate: 115200 Sample rate: 5000 Hz", 5000),
        )
    ),
    *(
        asked(f"header {line}", f"{line}\nForce (N),Acc (g)\n{BARE}", "sample rate")
        for line in (
            "Baud rate,115200", "Bit rate: 5000", "Slew rate 5000 mm/s", "Press rate: 5000", "Heart rate 72",
            "Recording rate = 0.0002", "Sampling interval: 0.0002", "Max sample rate: 1 MHz",
            "Sample rate: 5000 Hz\nRecording rate: 1000 Hz", "Sample rate: 100,000 Hz",
        )
    ),
    asked("rate against stamps", "Sample rate: 1000 Hz\n" + timed("time (s),Force (N)"),
        "which is right, its stamps of 5000 samples/s or 1000"),
    # Roles
    *(
        read(f"a column {name}", timed(f"time (s),Force (N),{name}", (T > 0.4).astype(int)))
        for name in ("judge", "valid", "LED", "trigger")
    ),
    read("a switch", timed("time (s),Force (N),switch", (T > 0.4).astype(int)),
        peaks={**SURE, "activation": 1}),
    Case("a switch that rests high", timed("time (s),Force (N),switch", (T < 0.4).astype(int)), 5000,
        asks=("switch is high at the start",), peaks={**SURE, "activation": 1}),
    asked("kilograms with a stray value", "time (s),Acc (g),Value [kg]\n"
        + rows(T, 0.01 * F, np.where(np.arange(2500) == 3, 711, 0.01 * F)), "force or mass? kg is of both"),
    asked("a scale in grams", timed("time (s),Scale (grams)"), "force or mass?"),
    read("grams, answered", timed("time (s),Scale (grams)"), told={"units": {"force": "gf"}},
        peaks={"force": 2e-3 * G}),
    read("grams-force are stated", timed("time (s),Force (gf)"), peaks={"force": 2e-3 * G}),
    read("pounds-force are stated", timed("time (s),Load [lbf]"), peaks={"force": 2 * 4.4482216152605}),
    asked("g of nothing", timed("time (s),CH1 (g)"), "may be gravity or grams"),
    asked("heading against unit", timed("time (s),Force (mm)"),
        "its heading says force, its unit mm does not"),
    asked("an acceleration sideways", timed("time (s),Acceleration x (m/s^2)"),
        "is the vertical acceleration"),
    asked("three accelerations", "time (s),Acc x (g),Acc y (g),Acc z (g)\n" + rows(T, F, F, F),
        "which of Acc x [g], Acc y [g], Acc z [g]"),
    # Several measurements in one table
    asked("two sensors under each other", "Time (s),Sensor,Force (N)\n"
        + rows(np.repeat(T, 2), np.tile(["left", "right"], 2500), np.repeat(F, 2)),
        "which rows are one measurement (column 'Sensor' has left, right"),
    read("one of two sensors", "Time (s),Sensor,Force (N)\n"
        + rows(np.repeat(T, 2), np.tile(["left", "right"], 2500), np.stack([F, 3 * F], axis=1).ravel()),
        told={"where": {"Sensor": "right"}}, peaks={"force": 6}, notes=("2500 of 5000",)),
    asked("trials by number", "Trial,Time (s),Force (N)\n"
        + rows(np.repeat([1, 2], 2500), np.tile(T, 2), np.tile(F, 2)), "column 'Trial' has 1, 2"),
    read("one trial", "Trial,Time (s),Force (N)\n"
        + rows(np.repeat([1, 2], 2500), np.tile(T, 2), np.tile(F, 2)), told={"where": {"Trial": "2"}}),
    asked("LabVIEW's segments", in_segments(2), "column 'segment' has 1, 2"),
    asked("all of LabVIEW's segments by --each", in_segments(2), "--each segment"),
    read("one of LabVIEW's segments", in_segments(2), told={"where": {"segment": "2"}}, peaks=BOTH),
    read("torn in LabVIEW's second segment", "\n?\t".join(in_segments(2).rsplit("\n0.4974\t", 1)),
        told={"where": {"segment": "2"}, "skip_damaged": True}, peaks=BOTH, notes=("1 gap of 1 samples",)),
    read("LabVIEW's X_Columns Multi", LVM.format(x="Multi") + SEGMENT
        + "X_Value\tForce\tX_Value\tAcc\tComment\n" + MULTI_ROWS, peaks=BOTH),
    # Rows
    *(
        read(f"a note in row {place}",
            timed("time (s),force (N),note", ["pressed by hand" if k == place else "" for k in range(2500)]),
            notes=("note is text",))
        for place in (3, 100, 1250, 2499)
    ),
    read("a quoted note", timed("time (s),force (N),note", ['"latch, blue"'] * 2500)),
    read("quoted decimal commas", "time (s),force (N)\n"
        + rows(*([f'"{x:.5f}"'.replace(".", ",") for x in one] for one in (T, F)))),
    *(
        asked(f"torn in row {place}",
            timed("time (s),force (N)").replace(f"\n{np.round(T[place], 7)},", f"\n{line}", 1),
            "--skip-damaged")
        for place, line in ((2, "Booting..."), (1200, "0.24"), (1200, "0.24,0.1,0.2,"))
    ),
    read("torn and left out",
        timed("time (s),force (N)").replace(f"\n{np.round(T[1200], 7)},", "\nBooting... ", 1),
        told={"skip_damaged": True}, notes=("row 1202 ('Booting...", "1 gap of 1 samples")),
    read("cut in its last number", "time (s),force (N)\n" + rows(T, [f"{f:.5f}" for f in F])[:-4],
        notes=("cut in the middle of a number",)),
    read("a spike",
        timed("time (s),force (N)").replace(f"{np.round(T[7], 7)},", f"{np.round(T[7], 7)},5000", 1),
        peaks={"force": float(f"5000{np.round(F[7], 5)}")}, notes=("a spike?",)),
    # Shapes of programs
    read("Arduino's monitor",
        "".join(f"{c} -> {f:.3f},{int(f > 1)}\n" for c, f in zip(CLOCK, F, strict=True)),
        told={"force": 1, **N}),
    read("a recorder's header", '"Model","X"\n"TraceName","Force","Acc",\nBlockSize,2500,2500,\nVUnit,N,g,\n'
        "HResolution,2.0e-04,2.0e-04,\nHOffset,-1.0e+00,-1.0e+00,\nHUnit,s,s,\n" + rows(NONE, F, 0.1 * F),
        peaks=BOTH),
    read("channels that begin apart", '"TraceName","Force","Acc",\nVUnit,N,g,\nHResolution,2.0e-04,2.0e-04,\n'
        "HOffset,0.0,0.1,\nHUnit,s,s,\n" + rows(NONE, F, 0.1 * F), peaks=BOTH,
        notes=("begins 0.1 s before",)),
    read("a tester's units", "UNIT = gf,mm\nDATA COUNT = 2500,\nCOMMENT = ,\n2ND PEAK FORCE = ---,---\n"
        + rows(F, 20 * T), told={"rate_hz": 5000, "rest": {"displacement": "start"}},
        peaks={"force": 2e-3 * G, "displacement": 9.996e-3}),
    read("units over all columns", "Units,s,N\nname,Time,Force\n,,\n" + rows(NONE, T, F)),
    read("pandas' timedelta", ",force [N]\n" + rows([f"0 days 00:00:0{t:.6f}" for t in T], F)),
    read("pandas' two rows of headings", ",force,acc\n,N,m/s^2\ntime [s],,\n" + rows(T, F, F),
        peaks={"force": 2, "acceleration": 2}),
    asked("sensor over side", ",Force,Force\n,left [N],right [N]\ntime [s],,\n" + rows(T, F, F),
        "which of Force left [N], Force right [N]"),
    read("a switch in words", timed("time (s),Force (N),contact", np.where(T > 0.4, "closed", "open")),
        peaks={**SURE, "activation": 1}),
    read("one sample lost between stamps of one digit", "time (s),Force (N)\n"
        + rows(*(np.delete(one, 900) for one in (np.arange(2500) / 1000, F))), 1000,
        notes=("1 gap of 1 samples",)),
    read("thousands apart", "time (s);Force (mN)\n"
        + rows(T, [f"{1000 * f:,.2f}" for f in F], separator=";")),
    asked("thousands, or decimal commas", "time (s);Force (mN)\n"
        + rows(T, [f"{1000 * f:,.0f}" for f in np.roll(F, 800)], separator=";"), "Look at the decimal sign",
        told={"skip_damaged": True}),
    asked("a duration is no time", "press duration (ms),Force (N)\n" + rows(np.arange(2500), F),
        "its sample rate, or which column is the time"),
    asked("trials named once each", "trial,time (s),Force (N)\n"
        + rows(["A", *[""] * 1249, "B", *[""] * 1249], T, F), "column 'trial' has A, B"),
    *(
        asked(f"sideways: {name}", timed(f"time (s),{name}"), "does not say that it is the vertical one")
        for name in ("accelerationX (m/s^2)", "acc_y [g]", "aT (m/s^2)", "X-Acceleration (m/s^2)", "Fx (N)")
    ),
    read("Graphtec's recorder",
        "Model,GL840\nSampling interval,1ms\nData\nNumber,Date&Time,ms,Force,CH2,Alarm\nNO.,Time,ms,N,V,A12\n"
        + rows(np.arange(2500), [f"2026/05/01 10:00:0{k // 1000}" for k in range(2500)],
        [k % 1000 for k in range(2500)], [f"+ {f:.4f}" for f in F], F, ["LLL"] * 2500), 1000,
        notes=("Alarm is 'LLL' in all rows",)),
    read("Siglent's preamble",
        "Record Length,Analog:2500\nSample Rate,5000.0\nHorizontal Scale, 0.1\nSecond,Volt\n" + rows(T, F),
        told={"force": "Volt", "units": {"force": "1 V/N"}}),
    read("Rigol's increment", "CH1V,CH2V,t0 =-0.25, tInc = 2e-04,\n" + rows(F, F, NONE),
        told={"force": 0, "units": {"force": "1 V/N"}}),
    asked("a word before headings between spaces", "% Fs = 5000 Hz\n% columns: travel force\n"
        + rows(0.1 * F, F, separator=" "), "is force, acceleration or displacement"),
    asked("force in percent", timed("time (s),Force (%)"), "its heading says force, its unit % does not"),
    read("a first row that numbers the columns", "0,1,2\n" + rows(T, F, F),
        told={"time": 0, "force": 1, "units": {"time": "s", "force": "N"}}, notes=("numbers its columns",)),
    read("seconds and a column of milliseconds", "Date&Time,ms,Force (N)\n"
        + rows([f"2026-05-01 10:00:0{k // 1000}" for k in range(2500)], [k % 1000 for k in range(2500)], F),
        1000),
    # Units in rows, times in other forms, headings that contradict themselves
    *(
        read(name, head + "\n" + rows(*columns, separator=";"), notes=notes)
        for name, head, columns, notes in (
            ("cells with their unit", "Time;Force", (cells(1e3 * T, " ms"), cells(F, " N")), ()),
            ("close to it", "Time;Force", (cells(1e3 * T, "ms"), cells(F, "N")), ()),
            ("with decimal commas", "Zeit;Kraft",
             ([c.replace(".", ",") for c in one] for one in (cells(T, " s"), cells(F, " N"))), ()),
            ("in two units", "Time (s);Force",
             (cells(T, ""), [f"{f:.4f} N" if f > 1 else f"{1e3 * f:.4f} mN" for f in F]),
             ("Rows in mN, N were all brought to mN.",)),
            ("columns of units", "Time;Unit;Force;Unit",
             (cells(1e3 * T, ""), ["ms"] * 2500, cells(1e3 * F, ""), ["mN"] * 2500), ()),
            ("a column of two units", "Time (s);Force;Force unit",
             (cells(T, ""), [f"{f if f > 1 else 1e3 * f:.4f}" for f in F], np.where(F > 1, "N", "mN")),
             ("brought to mN",)),
            ("mm:ss.mmm", "Time;Force (N)", ([f"02:{1 + t:07.4f}" for t in T], cells(F, "")), ()),
            ("mm:ss,mmm", "Zeit;Kraft (N)",
             ([f"02:{1 + t:07.4f}".replace(".", ",") for t in T],
             [c.replace(".", ",") for c in cells(F, "")]), ()),
            ("mm:ss.mmm over an hour", "Time;Force (N)",
             ([f"{'59' if t < 0.1 else '00'}:{(59.9 + t) % 60:07.4f}" for t in T], cells(F, "")), ()),
            ("hh:mm:ss.mmm", "Time;Force (N)", ([f"01:00:{1 + t:07.4f}" for t in T], cells(F, "")), ()),
        )
    ),
    *(
        asked(name, head + "\n" + rows(*columns), asks)
        for name, head, columns, asks in (
            ("cells against their heading", "Time (s),Force (N)", (T, cells(1e3 * F, " mN")),
             "its heading says N, each of its rows mN"),
            ("a unit in some rows", "Time (s),Force", (T, [f"{f:.3f} N" if f > 0.01 else "0" for f in F]),
             "some of its rows say N, others nothing"),
            ("two quantities", "Time (s),Force", (T, [f"{f:.3f} {'N' if f > 1 else 'mm'}" for f in F]),
             "in mm in some rows and in N in others"),
            ("two units in a heading", "Time (s),Force (kN) [N]", (T, F),
             "it is called 'Force (kN)', and its unit is given as N"),
            ("two units of time", "Time (s) [ms],Force (N)", (T, F), "it is called 'Time (s)'"),
            ("names of trials that look like units", "Time (s),Force (N),Trial",
             (T, F, np.where(T < 0.2, "1A", "2A")), "column 'Trial' has 1A, 2A"),
            ("hh:mm:ss is too coarse", "Time,Force (N)", ([f"01:00:{int(t + 1):02d}" for t in T], F),
             "--rate"),
        )
    ),
    asked("a time among numbers", "Time (s),Force (N)\n"
        + rows(T, [*cells(F[:300], ""), "10:00:01", *cells(F[301:], "")]), "more than numbers in Force"),
    *(
        read(f"a unit in the middle: {name}", timed(f"Time (s),{name}"))
        for name in ("Force [N] (filtered)", "Force (N) left", "Force [N]_1", "Force (N) CH1")
    ),
    *(
        asked(f"two units: {name}", timed(f"Time (s),{name}"), "its unit is given as N")
        for name in ("Force (kN) left [N]", "Force (N) in mN", "Force/kN [N]", "Kraft in kN (N)")
    ),
    read("m·s⁻²", timed("Time (s),Acc z (m·s⁻²)"), peaks={"acceleration": 2.0}),
    *(
        read(f"--force {told!r}", "Time (s),Force (N),Force (N).1\n" + rows(T, 3 * F, F),
            told={"force": told})
        for told in ("Force (N).1", "Force 1 [N]", "Force 1")
    ),
    read("minus signs and thousands of a language", "Zeit (s);Kraft (mN)\n"
        + rows(T, [f"{1000 * f - 0.5:,.2f}".replace(",", "\u202f").replace(".", ",").replace("-", "\u2212")
        for f in F], separator=";").replace(".", ","), peaks={"force": 1.9995}),
    read("a tester's verdicts and marks",
        timed("Time (s),Force (N),Judge,Position", np.where(F > 1, "+NG", "OK"),
        np.where(T == 0.1, "P1", "--")), notes=("Judge is text", "Position is text")),
    read("a range is no unit", timed("Time (s),Load cell 10 kg (N)")),
    read("(L) is no litre", timed("Time (s) [s],Force (L) [N]")),
    # Times of minutes, factors, thousands, errors of spreadsheets
    *(
        Case(f"12:04, {name}", f"{head}\n" + rows([f"12:{4 + k // 1000:02d}" for k in range(2500)], F), *more)
        for name, head, *more in (
            ("in minutes or hours", "Time,Force (N)", None, {}, ("12:04 may be mm:ss or hh:mm",)),
            ("asked for, with a rate", "Sample rate: 1000 Hz\nTime,Force (N)", None, {},
             ("--unit time=mm:ss or --unit time=hh:mm",)),
            ("told", "Sample rate: 1000 Hz\nTime,Force (N)", 1000, {"units": {"time": "mm:ss"}}, (), SURE,
             ("rounded to 1 s",)),
            ("stated", "Sample rate: 1000 Hz\nTime (mm:ss),Force (N)", 1000, {}, (), SURE),
            ("of hours, which tell no rate", "Sample rate: 1000 Hz\nTime (hh:mm),Force (N)", None, {},
             ("stamps rounded to 60 s",)),
        )
    ),
    asked("12:04 names a trial", "Trial,Time (s),Force (N)\n"
        + rows(np.where(T < 0.2, "12:04", "12:07"), T, F), "column 'Trial' has 12:04, 12:07"),
    *(
        asked(f"a factor: {head!r}", timed(head), asks)
        for head, asks in (
            ("Time (s),Force/100 (N)", "/100 may be in its numbers or not"),
            ("Time (s),Force x10 (N)", "x10 may be in its numbers or not"),
            ("Force scale factor: 0.001\nTime (s),Force (N)",
             "'Force scale factor: 0.001' may be in its numbers"),
            ("Skalierungsfaktor: 2\nTime (s),Force (N)",
             "(Force [N]): 'Skalierungsfaktor: 2' may be in its numbers"),
            *(
                (f"{line}\nTime (s),Force (N)", f"(Force [N]): '{said}' may be in its numbers already")
                for line, said in (
                    ("Gain,100", "Gain 100"),
                    ("# gain=100", "gain=100"),
                    ("Gain (dB),40", "Gain (dB) 40"),
                    ("Gain setting 3", "Gain setting 3"),
                    ("a gain of 100 was used", "a gain of 100 was used"),
                    ("Amplification: 100x", "Amplification: 100x"),
                    ("Scale factor 0,01", "Scale factor 0 01"),
                    ("Amplifier gain: 1,000", "Amplifier gain: 1 000"),
                    ("scaleFactor,0.01", "scaleFactor 0.01"),
                    ("Sensitivity,100", "Sensitivity 100"),
                    ("Multiplier,10", "Multiplier 10"),
                    ("Verstärkung: 100", "Verstärkung: 100"),
                    ("Load cell calibration factor = 420.5", "Load cell calibration factor = 420.5"),
                    ("Scaled by 0.5", "Scaled by 0.5"),
                    ("Gain,Range\n100,5000", "Gain 100"),
                    ("Gain,1,100", "Gain 100"),
                )
            ),
        )
    ),
    *(
        read(f"no factor: {line}", timed(f"{line}\nTime (s),Force (N)"), notes=notes)
        for line, *notes in (
            ("Scale factor: 1.0",),
            ("Gain: 0 dB",),
            ("Gain,1,1,1",),
            ("Vertical Scale,0.2",),
            ("Probe Attenuation,10",),
            ("Full scale: 500",),
            ("Range,10",),
            ("Sensitivity: 100 mV/g", "'Sensitivity: 100 mV/g' is stated, and was not applied"),
        )
    ),
    *(
        Case(f"a column of factors {factors}", timed("Time (s),Force (N),Gain", np.resize(factors, 2500)),
            None if asks else 5000, asks=asks, peaks=SURE)
        for factors, asks in (
            ((100,), ("'Gain = 100' may be in its numbers already",)),
            ((10, 1000), ("'Gain = 1000' may be in",)),
            ((1,), ()),
        )
    ),
    read("a factor, answered", timed("Gain: 100\nTime (s),Force (mN)"), told={"units": {"force": "0.01 mN"}},
        peaks={"force": 2e-5}),
    asked("a factor, answered in the question's words", timed("Gain: 100\nTime (s),Force (mN)"),
        "--unit force=mN where it is in them, or what one of its units is (--unit 'force=0.01 mN')"),
    asked("factors by column", timed("Gain,1,1,100\nTime (s),Force (N),Travel (mm)", F),
        "(Travel [mm]): 'Gain 100'"),
    read("a factor of another column", timed("Travel scale factor: 2\nTime (s),Force (N),Travel (mm)", F),
        told={"units": {"displacement": "2 mm"}}, peaks={**SURE, "displacement": 4e-3}),
    read("thousands of a language with decimal commas", "Zeit (ms);Kraft (mN)\n"
        + rows([f"{1000 * t + 1000:,.1f}".translate(str.maketrans(",.", ".,")) for t in T],
        [f"{1000 * f:,.2f}".translate(str.maketrans(",.", ".,")) for f in F], separator=";")),
    read("an error in the first row", timed("Zeit (s),Kraft (N),Rate", np.where(T == 0, "#DIV/0!", "1"))),
    *(
        read(f"a sketch's words: {line}", "".join(line.format(500 * f) for f in F), 1000, told=told,
            peaks={"force": 1.0})
        for line, told in (
            ("one reading:\t{0:.1f}\t| average:\t{0:.5f}\n",
             {"rate_hz": 1000, "force": "one reading", "units": {"force": "mN"}}),
            ("Reading: {:.4f} mN\n", {"rate_hz": 1000, "force": 0}),
            ("Load_cell output val: {:.4f}\n", {"rate_hz": 1000, "force": 0, "units": {"force": "mN"}}),
        )
    ),
    asked("a sketch's factor", "".join(f"Reading: {f:.4f} mN calibration_factor: -7050.00\n" for f in F),
        "'calibration_factor = -7050' may be in its numbers", told={"rate_hz": 1000, "force": "Reading"}),
    *(
        asked(f"a clock {name}", "Time,Force (N)\n" + rows(map(form, range(2500)), F), asks)
        for name, form, asks in (
            ("with milliseconds behind minutes", lambda k: f"12:{k // 1000:02d}:{k % 1000:03d}",
             "Write 12:01:"),
            ("with frames", lambda k: f"01:{k // 1500:02d}:{k // 30 % 50:02d}:{k % 30:02d}",
             "as hh:mm:ss.mmm, or in seconds"),
        )
    ),
    asked("accountants' negatives", "Time (s),Force (N)\n"
        + rows(T, [f"{f - 0.5:.4f}" if f > 0.5 else f"({0.5 - f:.4f})" for f in F]),
        "numbers in brackets, like (0.5000)"),
    read("an axis that is only a unit", timed("in s,Force in N")),
    asked("kilograms are asked as kgf", timed("time (s),Load (kg)"), "--unit force=kgf"),
    asked("milligrams", timed("time (s),Load (mg)"), "--unit 'force=0.001 gf'"),
    # Of other people's instruments
    read("a logger's row of headers, with its key", ";SampleRate, 5000,Hz\n;Headers, time,Ax,Fz\n"
        + rows(T, 3 * F, F), told={"units": {"force": "N"}}),
    read("units under a third row of headings",
        '"sep=\t"\nUnix_CAL\tForce_CAL\tA1_UNCAL\tA2_UNCAL\nms\tN\tno_units\tno_units\n'
        + rows(1e3 * T + 1.6e12, F, F, F, separator="\t"), told={"force": "Force_CAL"}),
    read("units under all but the counts", "Devices\n5000\n,,Plate - Force,\nFrame,Sub Frame,Fx,Fz\n,,N,N\n"
        + rows(T, T, 3 * F, F)),
    *(
        read(f"a preamble beside the numbers: {keys[0]}", head + rows(*columns), rate,
            told={"force": 1, "units": {"force": "0.5 V/N"}}, peaks={"force": 4})
        for keys, rate, head, columns in (
            (("Sample Interval,2.0E-4", "Vertical Units,V", "Horizontal Units,s"), 5000, "",
             (["Sample Interval", "Vertical Units", "Horizontal Units", *[""] * 2497],
             ["2.0E-4", "V", "s", *[""] * 2497], NONE, np.round(T - 0.25, 7), np.round(F, 5))),
            (("Sampling Period", "stamps of three digits"), 50_000, "col 1,col 2,,,\n",
             ([f"{t:.2E}" for t in T / 10], np.round(F, 5), NONE,
             ["Vertical Units", "Horizontal Units", "Sampling Period", *[""] * 2497],
             ["V", "S", "2.0E-5", *[""] * 2497])),
        )
    ),
    read("a start and an increment without a sequence",
        "CH1,CH2,Start,Increment,\nVolt,Volt,-2.5e-01,2.0e-04\n" + rows(F, F, NONE),
        told={"force": "CH1", "units": {"force": "1 V/N"}}),
    read("keys with := and one unit for all",
        "# Simple Text\n# Sampling Rate (Hz):= 5000.00\n# Units:= N\n# Labels:= Fx\tFz\n"
        + rows(3 * F, F, separator="\t")),
    read("a rate in JSON",
        '# {"a": {"column": ["I1", "A1"], "sampling rate": 5000, "label": ["A1"]}}\n# EndOfHeader\n'
        + rows([0] * 2500, F, separator="\t"), told={"force": 1, **N}),
    read("a line below headings", timed("Time (s),Force (N)\n--------------------")),
    read("words in brackets before a row of units", "Time,Force (Trigger),Travel (filtered)\ns,N,mm\n"
        + rows(T, F, F), peaks={**SURE, "displacement": 2e-3}),
    read("an old scale of the screen", timed("Horizontal Old Scale,0.05\nTime (s),Force (N)")),
    read("headings in quotes between spaces", 'Time "Force left" "Travel of it"\ns N mm\n'
        + rows(T, F, F, separator=" "), peaks={"displacement": 2e-3, **SURE}),
    asked("counts in the place of volts",
        "Source,CH1,\nVertical Units,V,\nVertical Scale,5.0E-01,\nHorizontal Units,s,\n"
        "Sampling Period,2.0E-4,\nWaveform Data,\n" + rows(np.rint(40 * F).astype(int), NONE),
        "0.5 V a division are stated, and it spans 80, as counts do", told={"force": 0}),
    asked("samples beside each other", "ACCELERATION IN UNITS OF G\nNPTS=   2500, DT=   .0002 SEC\n"
        + rows(*np.round(F.reshape(-1, 5), 5).T, separator="  "),
        "'NPTS= 2500' and has 500 rows of 5: its samples stand beside each other"),
    asked("a table that lies on its side",
        "\n".join(" ".join(f"{value:.5f}" for value in one) for one in (T, F)) + "\n",
        "has 2 rows of 2500 numbers: samples stand below each other"),
    read("fewer rows than are stated", timed("#Samples: 8192\nTime (s),Force (N)"),
        notes=("'Samples: 8192' is stated, and there are 2500 rows",)),
    asked("two plates with the same headings", "abs time (s),Fx,Fz,Fx,Fz\ns,N,N,N,N\n" + rows(T, F, F, F, F),
        "which of Fz [N] (column 2), Fz [N] (column 4) is force"),
    read("a clock that drifts", "Time (s),Force (N)\n"
        + rows(np.round(T + 0.02 * T * (T - 0.5) / 0.25, 6), F), notes=("from which its clock strays by ",)),
    asked("a clock that is set while it records", "Time (s),Force (N)\n"
        + rows(np.round(T + np.where(T < 0.3, 0, 1.7e9), 4), F),
        "lacks more samples than it has, in steps of up to 1.7e+09 s"),
    asked("a remark in brackets over one column", "Sample rate: 5000 Hz\n,,(4=vigorous)\n" + rows(F, F, F),
        "which of its columns (column 0, column 1, column 2)"),
    asked("a short table of many columns",
        "\n".join(" ".join(f"{k + n:.1f}" for n in range(80)) for k in range(60)) + "\n",
        "and 50 more) is force", "its sample rate"),
    asked("pairs of equal stamps", "Time (s),Force (N)\n"
        + rows(np.round(np.repeat(0.0012 * np.arange(10_000), 2), 4), np.tile(F, 8)), "stamps too coarse"),
    *(
        asked(f"over frequency: {name}", text, asks)
        for name, text, asks in (
            ("an axis unit", "AxisUnit;Hz\nName;a;b\n'; a (Real);b (Real)\n" + rows(T, F, F, separator=";"),
             "an axis of Hz"),
            ("LabVIEW's dimension", LVM.format(x="No").replace("Multi_Headings\tYes", "Multi_Headings\tNo")
             + SEGMENT.replace("X_Dimension\tTime\tTime", "X_Dimension\tFrequency\tFrequency")
             + "X_Value\tForce\tAcc\tComment\n" + rows(NONE, F, F, separator="\t"), "an axis of Frequency"),
            ("a rising column in Hz", timed("f (Hz),Force (N)"), "is over frequency"),
            ("a rising Frequenz", timed("Frequenz,Force (N)"), "is over frequency"),
        )
    ),
    read("a frequency that does not rise is a column",
        timed("Time (s),Force (N),Frequency (Hz)", [50] * 2500)),
    read("names of specimens, one of which looks like a number with its unit",
        '"Units, Load",N\ntime (s),spec,Force (N),n,m\n'
        + rows(T, np.resize(["RZFE4", "5SDKT", "L8M6B", "V5SNQ", "898MA"], 2500), F, [564] * 2500, [9]
        * 2500), told={"where": {"spec": "*"}}),
    read("a phone at 99.87/s", "Time (s),Force (N)\n" + rows(np.arange(300) / 99.8667, F[::8][:300]),
        99.8667),
)  # fmt: skip


@pytest.mark.parametrize("case", CASES, ids=lambda case: case.name)
def test_what_is_stated(case, tmp_path):
    path = tmp_path / "a.csv"
    path.write_text(case.text, encoding="utf-8")
    try:
        found = understand(path, FileMapping(**case.told))
    except (haploop.ConfigurationError, haploop.DataError) as error:
        asked, found = [str(error)], None
    else:
        asked = [f"{question.what} {question.option}" for question in found.questions]
    assert len(asked) >= len(case.asks) and all(any(part in a for a in asked) for part in case.asks), asked
    if not case.asks:
        assert not asked
    if found is None or case.rate_hz is None:
        assert case.asks
        return
    assert found.rate_hz == pytest.approx(case.rate_hz, rel=1e-4)
    peaks = {role: np.abs(s.values).max() for role, s in found.signals.items() if role != "time"}
    assert peaks == pytest.approx(case.peaks, rel=1e-3)
    notes = " ".join(found.notes)
    assert all(part in notes for part in case.notes), notes


def test_a_damaged_row_is_a_gap_in_the_recording(tmp_path):
    """Also where no column of time shows it."""
    path = tmp_path / "a.csv"
    lines = (f"{f:.5f}" for f in F)
    path.write_text(
        "Sample rate: 5000 Hz\nForce (N)\n" + "\n".join(lines).replace("\n1.0", "\nx1.0", 1) + "\n"
    )
    raises(haploop.DataError, r"stops being a table in row .*--skip-damaged", understand, path)
    found = understand(path, FileMapping(skip_damaged=True))
    assert len(found.signals["force"].values) == 2500 and len(found.holes) == 1
    assert found.holes[0].end - found.holes[0].first == 1


def test_a_table_that_is_far_too_wide_is_refused_at_once(tmp_path):
    path = tmp_path / "a.csv"
    path.write_text(",".join(["1"] * 300_000) + "\n")
    raises(haploop.DataError, "more than 4096 cells", understand, path)


def test_each_measurement_of_a_table_becomes_a_file_of_its_own(run, tmp_path):
    segments = tmp_path / "run.lvm"
    segments.write_text(in_segments(3))
    out = tmp_path / "out"
    run("import", segments, "--each", "segment", "--button", "push", "-o", out, ends=0)
    assert sorted(path.name for path in out.iterdir()) == ["run-1.h5", "run-2.h5", "run-3.h5"]
    people = tmp_path / "people.csv"
    people.write_text(
        "participant,time (s),Force (N)\n"
        + rows(np.repeat(["P01", "P02"], 2500), np.tile(T, 2), np.concatenate([F, 3 * F]))
    )
    told = ("--each", "participant", "--button", "push", "--as", "recording")
    said = run.json("import", people, *told, "-o", out)["files"]
    assert [haploop.Recording.open(one["out"]).participant for one in said] == ["P01", "P02"]
    peaks = [haploop.Recording.open(one["out"]).force.max() for one in said]
    assert peaks == pytest.approx([2, 6], rel=0.01)
    for wrong, part in (
        (("--each", "person", "-o", out), "no column 'person' that tells rows apart (it has participant)"),
        (("--each", "participant"), "Name the folder for what participant tells apart"),
    ):
        run("import", people, *wrong, says=part)


@pytest.mark.parametrize(
    ("column", "values", "files", "said"),
    [
        ("hand", ["Left", "left"], None, "two values of hand that would be one file, a-left.h5"),
        ("hand", ["a/b", "a:b"], None, "two values of hand that would be one file, a-a_b.h5"),
        ("hand", ["", "left"], ["a-left.h5"], "2500 rows without a value of hand"),
        ("trial", ["nan", "2"], ["a-2.h5"], "2500 rows without a value of trial"),
        ("session", ["20261127", "20261128"], ["a-20261127.h5", "a-20261128.h5"], ""),
    ],
)
def test_values_that_name_files_name_as_many(run, tmp_path, column, values, files, said):
    path, out = tmp_path / "a.csv", tmp_path / "out"
    several = rows(np.repeat(values, 2500), np.tile(T, 2), np.concatenate([F, 3 * F]))
    path.write_text(f"{column},time (s),Force (N)\n{several}")
    told = ("--each", column, "--button", "push", "-p", "P01", "--as", "recording", "-o", out)
    made = run("import", path, *told)
    assert made.exit_code == (2 if files is None else 0), made.output
    assert said in " ".join(made.stderr.split()), made.output
    assert sorted(one.name for one in out.glob("*")) == (files or [])


def test_a_role_that_no_column_is(tmp_path):
    path, saved = tmp_path / "a.csv", tmp_path / "lab.toml"
    path.write_text(timed("time (s),Force (N),switch", (T < 0.4).astype(int)))
    found = understand(path, FileMapping(activation="none"))
    assert not found.questions and "activation" not in found.signals
    found.mapping.save(saved)
    assert understand(path, FileMapping.load(saved)).mapping == found.mapping
