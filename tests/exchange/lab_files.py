"""Files as labs have them: the same presses, written as other programs write them, beside what was written.

Each is written by hand or by its own library, never by haploop. The kinds of preamble are those of the
programs that they name, shortened.
"""

import io
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import pytest
from scipy.io import savemat

G = 9.80665


@dataclass(frozen=True, eq=False)
class Written:
    """What was recorded: (samples,) each, at `rate_hz`."""

    rate_hz: float
    force: np.ndarray
    """N."""
    acceleration: np.ndarray
    """m/s^2, vertical, with gravity."""
    switch: np.ndarray
    """0 or 1."""
    presses: int

    @property
    def time(self) -> np.ndarray:
        return np.arange(len(self.force)) / self.rate_hz

    def columns(self, *more: np.ndarray) -> np.ndarray:
        """Time, force (N), acceleration (m/s^2), switch (V)."""
        return np.stack([self.time, self.force, self.acceleration, 5 * self.switch, *more], axis=1)


@dataclass(frozen=True)
class Kind:
    """One kind of file: how it is written, what must be told, and how exact its values are."""

    name: str
    write: Callable[[Path, Written], None]
    told: dict[str, Any] = field(default_factory=dict)
    """Entries of the mapping; what the file itself says is not told."""
    error: float = 1e-4
    """Largest difference of values, of their largest."""
    rate_error: float = 1e-6
    """Largest relative difference of the rate."""
    said: tuple[str, ...] = ()
    """Parts of the sentences on what was understood."""
    lacks: tuple[str, ...] = ()
    """Options that the refusal names when nothing is told."""


def text(
    values: np.ndarray, separator: str = ",", decimal: str = ".", digits: int = 9, first: str = ""
) -> str:
    made = io.StringIO()
    np.savetxt(made, values, fmt=f"%.{digits}g", delimiter=separator, newline=f"\n{first}")
    body = first + made.getvalue().removesuffix(first)
    return body.replace(".", decimal) if decimal != "." else body


def german(path: Path, w: Written) -> None:
    head = "Zeit [s];Kraft [N];Beschleunigung [m/s²];Schalter [V]\n"
    path.write_bytes((head + text(w.columns(), ";", ",")).replace("\n", "\r\n").encode("cp1252"))


def no_header(path: Path, w: Written) -> None:
    path.write_text(text(w.columns()))


def spreadsheet_labview(path: Path, w: Written) -> None:
    """`Write To Spreadsheet File`: tabs, the locale's comma, six digits behind it, nothing else."""
    made = io.StringIO()
    np.savetxt(made, w.columns(), fmt="%.6f", delimiter="\t")
    path.write_text(made.getvalue().replace(".", ","))


LVM = """LabVIEW Measurement\t
Writer_Version\t2
Reader_Version\t2
Separator\tTab
Decimal_Separator\t{decimal}
Multi_Headings\tNo
X_Columns\t{x}
Time_Pref\tRelative
Operator\tlab
Date\t2026/11/20
Time\t14:03:11{decimal}1237509
***End_of_Header***\t
\t
Channels\t3\t\t\t
Samples\t{n}\t{n}\t{n}\t
Date\t2026/11/20\t2026/11/20\t2026/11/20\t
Time\t14:03:11{decimal}12375\t14:03:11{decimal}12375\t14:03:11{decimal}12375\t
Y_Unit_Label\tN\tm/s^2\tVolts\t
X_Dimension\tTime\tTime\tTime\t
X0\t0{decimal}0000000000000000E+0\t0{decimal}0000000000000000E+0\t0{decimal}0000000000000000E+0\t
Delta_X\t2{decimal}000000E-4\t2{decimal}000000E-4\t2{decimal}000000E-4\t
***End_of_Header***\t\t\t\t
X_Value\tKraft\tBeschleunigung\tSchalter\tComment
"""


def lvm(path: Path, w: Written) -> None:
    path.write_text(LVM.format(decimal=",", x="One", n=len(w.force)) + text(w.columns(), "\t", ","))


def lvm_without_x(path: Path, w: Written) -> None:
    """Without X columns, LabVIEW leaves the first cell empty."""
    body = text(w.columns()[:, 1:], "\t", first="\t")
    path.write_text(LVM.format(decimal=".", x="No", n=len(w.force)) + body)


def dewesoft(path: Path, w: Written) -> None:
    head = """Data information:
File name:\tPress_0007.dxd
Start time:\t11/20/2026 14:03:11.123
Number of channels:\t3
Sample rate:\t5000 Hz
Store type:\talways fast

Time\tForce\tAcc Z\tSwitch
(s)\t(N)\t(g)\t(V)
"""
    values = w.columns()
    values[:, 2] /= G
    path.write_text(head + text(values, "\t"))


def excel(path: Path, w: Written) -> None:
    """Title, date, blank line, headings, units, and a separator behind each row."""
    head = "Messung Taster 3;;;;\n20.11.2026;;;;\n;;;;\nZeit;Kraft;Beschleunigung;Schalter;\ns;N;m/s²;V;\n"
    body = text(w.columns(), ";", ",").replace("\n", ";\n")
    path.write_bytes(("﻿" + head + body).encode())


def picoscope(path: Path, w: Written) -> None:
    """Time in ms, and as many digits as PicoScope writes."""
    values = w.columns() * [1e3, 0.1, 1e3 / G / 10, 1.0]
    made = io.StringIO()
    np.savetxt(made, values, fmt="%.8f", delimiter=",")
    path.write_text("Time,Channel A,Channel B,Channel C\n(ms),(V),(mV),(V)\n\n" + made.getvalue())


def tektronix(path: Path, w: Written) -> None:
    head = (
        "Model,MSO54\nFirmware Version,1.30\nPoint Format,Y\nHorizontal Units,s\nHorizontal Scale,1\n"
        f"Sample Interval,2E-4\nRecord Length,{len(w.force)}\nGating,0.0%\nProbe Attenuation,1,1,1\n"
        "Vertical Units,V,V,V\nVertical Offset,0,0,0\nVertical Scale,1,1,1\nVertical Position,0,0,0\n,,,\n"
        ",,,\nLabel,Force,Accel,Switch\nTIME,CH1,CH2,CH3\n"
    )
    path.write_text(head + text(w.columns() * [1, 0.1, 0.1 / G, 1]))


def old_tektronix(path: Path, w: Written) -> None:
    """TDS series: the preamble stands in the first three columns, beside the samples."""
    told = [
        "Record Length,2.5e+03,", "Sample Interval,2.000000e-04,", "Trigger Point,1.25e+03,", ",,", ",,",
        "Source,CH1,", "Vertical Units,V,", "Vertical Scale,1.0e+00,", "Vertical Offset,0.0e+00,",
        "Horizontal Units,s,", "Horizontal Scale,1.0e+00,", "Pt Fmt,Y,", "Yzero,0.0e+00,",
        "Probe Atten,1.0e+00,", "Model Number,TDS2014,", "Serial Number,C0,", "Firmware Version,FV:v1,",
    ]  # fmt: skip
    rows = text(w.columns()[:, [0, 1]] * [1, 0.1]).splitlines()
    rows = [f"{told[k] if k < len(told) else ',,'},{row}," for k, row in enumerate(rows)]
    path.write_text("\n".join(rows) + "\n")


def rigol(path: Path, w: Written) -> None:
    """A sequence number instead of a time; start and increment stand in the rows of headings and units."""
    values = w.columns() * [0, 0.1, 0.1 / G, 1]
    values[:, 0] = np.arange(len(values))
    path.write_text(
        "X,CH1,CH2,CH3,Start,Increment,\nSequence,Volt,Volt,Volt,-6.000000e-01,2.000000e-04\n"
        + text(values).replace("\n", ",\n")
    )


def tdms(path: Path, w: Written, **properties: Any) -> None:
    from nptdms import ChannelObject, GroupObject, RootObject, TdmsWriter

    channels = [
        ChannelObject("Messung", name, values, {"unit_string": unit, **properties})
        for name, unit, values in (
            ("Kraft", "N", w.force), ("Beschleunigung", "m/s^2", w.acceleration), 
            ("Taster", "V", 5 * w.switch),
        )
    ]  # fmt: skip
    with TdmsWriter(path) as writer:
        writer.write_segment([RootObject({"title": "Taster 3"}), GroupObject("Messung"), *channels])


def tdms_waveform(path: Path, w: Written) -> None:
    tdms(path, w, wf_increment=1 / w.rate_hz, wf_start_offset=0.0, wf_samples=len(w.force))


def mat_struct(path: Path, w: Written) -> None:
    data = {"fs": w.rate_hz, "acc": w.acceleration[:, None], "t": w.time[:, None], "force": w.force}
    savemat(path, {"data": data | {"unit": "SI"}, "comment": "latch 3, finger 2"})


def mat_matrix(path: Path, w: Written) -> None:
    savemat(path, {"Fs": 5000, "X": w.columns()})


def mat_7_3(path: Path, w: Written) -> None:
    """As MATLAB writes it: a struct is a group, a vector is (1, n), a text is numbers."""
    with h5py.File(path, "w", userblock_size=512) as file:
        group = file.create_group("data")
        group.attrs["MATLAB_class"] = np.bytes_("struct")
        for name, values in (("fs", [w.rate_hz]), ("acc", w.acceleration), ("t", w.time), ("force", w.force)):
            made = group.create_dataset(name, data=np.atleast_2d(np.asarray(values, dtype=np.float64)))
            made.attrs["MATLAB_class"] = np.bytes_("double")
        note = file.create_dataset("note", data=np.array([[ord(c)] for c in "latch"], dtype=np.uint16))
        note.attrs["MATLAB_class"] = np.bytes_("char")
    with path.open("r+b") as raw:
        raw.write(b"MATLAB 7.3 MAT-file, Platform: PCWIN64, Created on: Fri Nov 20 14:03:11 2026")


def npy_named(path: Path, w: Written) -> None:
    kinds = [("time", "f8"), ("force", "f4"), ("acc", "f4"), ("switch", "?")]
    values = np.zeros(len(w.force), dtype=kinds)
    values["time"], values["force"], values["acc"], values["switch"] = (
        w.time, w.force, w.acceleration, w.switch,
    )  # fmt: skip
    np.save(path, values)


def npz(path: Path, w: Written) -> None:
    np.savez(path, fs=5000, force_N=w.force, acc=w.acceleration, contact=w.switch.astype(bool))


def hdf5(path: Path, w: Written) -> None:
    with h5py.File(path, "w") as file:
        file.attrs["sample_rate"] = w.rate_hz
        for name, unit, values in (("force", "N", w.force), ("acc", "g", w.acceleration / G)):
            file.create_dataset(f"run 1/{name}", data=values.astype(np.float32)).attrs["units"] = unit
        file.create_dataset("run 1/switch", data=w.switch.astype(np.uint8))


def hdf5_matrix(path: Path, w: Written) -> None:
    with h5py.File(path, "w") as file:
        made = file.create_dataset("data", data=w.columns().T)
        made.attrs["columns"] = ["t", "F", "a", "S"]
        made.attrs["units"] = ["s", "N", "m/s^2", "V"]


def wav(path: Path, w: Written) -> None:
    soundfile = pytest.importorskip("soundfile")

    both = np.stack([w.force / 40, w.acceleration / (10 * G), w.switch * 0.5], axis=1)
    soundfile.write(path, both, 5000, subtype="PCM_24")


def xlsx(path: Path, w: Written) -> None:
    import openpyxl

    book = openpyxl.Workbook(write_only=True)
    sheet = book.create_sheet("Messung")
    for row in (["Taster 3"], [], ["Zeit", "Kraft", "Beschleunigung", "Schalter"], ["s", "N", "g", "V"]):
        sheet.append(row)
    values = w.columns()[:8_000] * [1, 1, 1 / G, 1]
    for row in values.tolist():
        sheet.append(row)
    book.save(path)


def blanks(path: Path, w: Written) -> None:
    """Single samples that a logger lost, as it and Excel write them."""
    rows = [line.split(",") for line in text(w.columns()).splitlines()]
    for k, word in ((700, ""), (1500, "NaN"), (1501, "NaN"), (2300, "-"), (3100, "#N/A"), (4000, "n/a")):
        rows[k][1 + k % 2] = word
    path.write_text("time [s],force [N],acc [m/s^2],switch\n" + "\n".join(map(",".join, rows)) + "\n")


def jitter(path: Path, w: Written) -> None:
    """A microcontroller's stamps in us: 12 us rms late, and 40 samples lost while it wrote to its card."""
    rng = np.random.default_rng(5)
    late = np.abs(rng.normal(0, 12e-6, len(w.force)))
    stamps = w.time + late
    values = np.stack(
        [np.rint(1e6 * stamps), *(np.interp(stamps, w.time, v) for v in (w.force, w.acceleration, w.switch))],
        axis=1,
    )
    kept = np.delete(values, slice(1200, 1240), axis=0)
    path.write_text("micros,force [N],acc [m/s^2],switch\n" + text(kept))


def iso_stamps(path: Path, w: Written) -> None:
    start = np.datetime64("2026-11-20T23:59:58.500000")
    stamps = start + np.rint(1e6 * w.time).astype("timedelta64[us]")
    rows = text(w.columns()[:, 1:]).splitlines()
    body = "".join(f"{str(s).replace('T', ' ')},{row}\n" for s, row in zip(stamps, rows, strict=True))
    path.write_text("timestamp,force (N),acc (m/s2),switch\n" + body)


def german_stamps(path: Path, w: Written) -> None:
    """Date and time in a column each, as LabVIEW and many loggers write them."""
    stamps = np.datetime64("2026-11-20T23:59:58") + np.rint(1e6 * w.time).astype("timedelta64[us]")
    rows = text(w.columns()[:, 1:], ";", ",").splitlines()
    lines = ["Datum;Uhrzeit;Kraft in N;Beschleunigung in m/s²;Schalter"]
    for s, row in zip(stamps.astype(str), rows, strict=True):
        day, clock = s.split("T")
        year, month, date = day.split("-")
        lines.append(f"{date}.{month}.{year};{clock.replace('.', ',')};{row}")
    path.write_text("\n".join(lines) + "\n", encoding="utf-8")


def coarse_stamps(path: Path, w: Written) -> None:
    """A time with three digits at 5000 samples/s."""
    made = io.StringIO()
    np.savetxt(made, w.columns(), fmt=["%.3f", "%.6f", "%.6f", "%.1f"], delimiter=";")
    path.write_text("t [s];F [N];a [m/s^2];S\n" + made.getvalue())


def numpy_text(path: Path, w: Written) -> None:
    np.savetxt(path, w.columns(), header="rate: 5000 Hz\nt F a s", fmt="%.9g")


def din(path: Path, w: Written) -> None:
    """Quantity over unit, as DIN 1313 has it, and the travel in mm."""
    travel = 0.2 * w.force
    path.write_text(
        "t/ms\tF/mN\ta/(m/s²)\tWeg/mm\tS\n"
        + text(np.stack([1e3 * w.time, 1e3 * w.force, w.acceleration, travel, w.switch], axis=1), "\t")
    )


def millivolts(path: Path, w: Written) -> None:
    """Volts of the conditioners, upside down, with a line of comments before."""
    values = w.columns() * [1, 250.0, -100.0 / G, 1]
    path.write_text(
        "# amplifier: 0.25 V/N, 100 mV/g\nTime (sec), Force (mV), Accel (mV), Trigger (V)\n"
        + text(values, ", ")
    )


def utf_16(path: Path, w: Written) -> None:
    body = "Time (s)\tForce (N)\tAcceleration (g)\tSwitch (V)\r\n" + text(
        w.columns() * [1, 1, 1 / G, 1], "\t"
    )
    path.write_bytes(b"\xff\xfe" + body.replace("\n", "\r\n").encode("utf-16-le"))


def sigrok(path: Path, w: Written) -> None:
    head = "; CSV generated by libsigrok 0.5.2\n; Channels (3/8): A0, A1, D0\n; Samplerate: 5 kHz\nA0,A1,D0\n"
    path.write_text(head + text(np.stack([w.force, w.acceleration, w.switch], axis=1)))


def plotter(path: Path, w: Written) -> None:
    """Arduino's serial plotter."""
    rows = np.stack([1e6 * w.time, w.force, w.acceleration, w.switch], axis=1).tolist()
    line = "micros:{:.0f} force:{:.5f} acc:{:.5f} switch:{:.0f}\n".format
    path.write_text("".join(line(*row) for row in rows))


def indexed(path: Path, w: Written) -> None:
    """pandas: numbers of rows under an empty heading, dates and times with an offset."""
    stamps = np.datetime64("2026-11-20T10:00:00") + np.rint(1e6 * w.time).astype("timedelta64[us]")
    rows = zip(stamps.astype(str), text(w.columns()[:, 1:]).splitlines(), strict=True)
    lines = [f"{k},{stamp.replace('T', ' ')}+01:00,{row}" for k, (stamp, row) in enumerate(rows)]
    path.write_text("\n".join([",timestamp,force_N,acc [m/s^2],switch", *lines]) + "\n")


SI = {"force": "N", "acceleration": "m/s^2"}
VOLTS = {"force": "0.1 V/N", "acceleration": "0.1 V/g"}
THREE = {"force": "CH1", "acceleration": "CH2", "activation": "CH3", "units": VOLTS}
"""Of an oscilloscope, also where a label stands above the channel."""

KINDS: Sequence[Kind] = (
    Kind("german.csv", german),
    Kind("none.csv", no_header,
         {"time": 0, "force": 1, "acceleration": 2, "activation": 3, "units": {"time": "s", **SI}},
         lacks=("--time", "--force")),
    Kind("labview.txt", spreadsheet_labview,
         {"time": 0, "force": 1, "acceleration": 2, "activation": 3, "units": {"time": "s", **SI}},
         lacks=("--time", "--force")),
    Kind("one.lvm", lvm),
    Kind("no.lvm", lvm_without_x),
    Kind("dewesoft.txt", dewesoft),
    Kind("excel.csv", excel),
    Kind("pico.csv", picoscope,
         {"force": "Channel A", "acceleration": "Channel B", "activation": "Channel C",
          "units": {"force": "0.1 V/N", "acceleration": "100 mV/g"}}, lacks=("--force",)),
    Kind("tek.csv", tektronix, THREE, lacks=("what a volt of force",)),
    Kind("tds.csv", old_tektronix, {"time": 0, "force": 1, "units": {"time": "s", "force": "0.1 V/N"}},
         lacks=("--force",)),
    Kind("rigol.csv", rigol, THREE, lacks=("--force",)),
    Kind("wave.tdms", tdms_waveform),
    Kind("plain.tdms", tdms, {"rate_hz": 5000.0}, lacks=("--rate",)),
    Kind("struct.mat", mat_struct, {"units": SI}, lacks=("--unit",)),
    Kind("matrix.mat", mat_matrix,
         {"time": 0, "force": 1, "acceleration": 2, "activation": 3, "units": {"time": "s", **SI}},
         lacks=("--force",)),
    Kind("new.mat", mat_7_3, {"units": SI}, lacks=("--unit",)),
    Kind("named.npy", npy_named, {"units": {"time": "s", **SI}}, lacks=("--unit", "the unit of its time")),
    Kind("several.npz", npz, {"units": SI}, lacks=("--unit",)),
    Kind("plain.h5", hdf5),
    Kind("matrix.hdf5", hdf5_matrix),
    Kind("three.wav", wav,
         {"force": "channel 1", "acceleration": "channel 2", "activation": "channel 3",
          "units": {"force": "40 N", "acceleration": "10 g"}}, lacks=("--force",)),
    Kind("sheet.xlsx", xlsx),
    Kind("blanks.csv", blanks, said=("5 values are missing", "at most 0.2 ms")),
    Kind("jitter.csv", jitter, error=0.01, rate_error=1e-4, said=("1 gap of 40 samples", "jitter of 7")),
    Kind("iso.csv", iso_stamps),
    Kind("datum.csv", german_stamps),
    Kind("coarse.csv", coarse_stamps, rate_error=1e-3, said=("rounded to 1 ms",)),
    Kind("plotter.txt", plotter, {"units": SI}, lacks=("--unit",)),
    Kind("indexed.csv", indexed),
    Kind("numpy.txt", numpy_text,
         {"time": 0, "force": 1, "acceleration": 2, "activation": 3, "units": {"time": "s", **SI}},
         lacks=("--unit",)),
    Kind("din.txt", din),
    Kind("millivolts.csv", millivolts,
         {"flip": ["acceleration"], "activation": "Trigger",
          "units": {"force": "0.25 V/N", "acceleration": "100 mV/g"}}, lacks=("--unit",)),
    Kind("utf16.txt", utf_16),
    Kind("sigrok.csv", sigrok, {"force": "A0", "acceleration": "A1", "activation": "D0", "units": SI},
         lacks=("--force",)),
)  # fmt: skip
