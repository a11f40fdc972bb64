"""What a file states of its start is read: in UTC with its time zone, as it stands there without one."""

import datetime as dt
import json
import os
import struct
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any
from zoneinfo import ZoneInfo

import h5py
import numpy as np
import pytest
import scipy

import haploop
from haploop.exchange import FileMapping, understand
from tests.exchange.other_programs import function58, write_xdf

T = np.arange(2500) / 5000
F = np.round(2 * np.exp(-(((T - 0.25) / 0.05) ** 2)), 6)
AT = "2026-05-01T10:00:00"
UTC = f"{AT}+00:00"
"""Of the files below, unless they say otherwise."""
UNIX = int(dt.datetime.fromisoformat(UTC).timestamp())
TEXT = "Time (s),Force (N)"
SECTIONS = ("Devices", "Trajectories")


def rows(*columns: Any, separator: str = ",") -> str:
    return "".join(separator.join(map(str, row)) + "\n" for row in zip(*columns, strict=True))


def table(head: str, *, begins: float = 0.0, separator: str = ",") -> str:
    heading = TEXT.replace(",", separator)
    return f"{head}\n{heading}\n" + rows(np.round(T + begins, 7), np.round(F, 5), separator=separator)


def lvm(x0: float = 0.0, segments: int = 1, columns: str = "One") -> str:
    """A LabVIEW measurement whose segments begin a minute apart."""
    text = (
        "LabVIEW Measurement\t\nWriter_Version\t2\nSeparator\tTab\nDecimal_Separator\t.\n"
        f"Multi_Headings\tYes\nX_Columns\t{columns}\nTime_Pref\tAbsolute\nDate\t2026/05/01\n"
        "Time\t09:59:58.25\n***End_of_Header***\t\n\t\n"
    )
    for number in range(segments):
        text += (
            "Channels\t1\t\nSamples\t2500\t\nDate\t2026/05/01\t\n"
            f"Time\t10:0{number}:00.5000000000001\t\nY_Unit_Label\tN\t\nX_Dimension\tTime\t\nX0\t{x0:E}\t\n"
            "Delta_X\t0.000200\t\n***End_of_Header***\t\t\nX_Value\tForce\tComment\n"
        )
        text += rows(T + x0 if columns == "One" else [""] * 2500, F, separator="\t") + "\n"
    return text


@dataclass(frozen=True)
class Case:
    """A file, and what is right: the start in UTC, or on its own clock, or neither; a part of its words."""

    name: str
    file: str | Callable[[Path], None]
    words: str = ""
    utc: str = ""
    local: str = ""
    suffix: str = "csv"
    told: dict[str, Any] = field(default_factory=dict)
    rate_hz: float = 5000


def stamped(first: str, *, zone: str = "", form: str = "%Y-%m-%d %H:%M:%S.%f", heading: str = "Time") -> str:
    times = (dt.datetime.fromisoformat(first) + dt.timedelta(seconds=t) for t in T.tolist())
    return f"{heading},Force (N)\n" + rows([t.strftime(form) + zone for t in times], F)


def tdms(segments: int = 1, gap_ms: int = 0, **said: Any) -> Callable[[Path], None]:
    """A waveform written piece by piece, with the start of each, `gap_ms` after the end of the one before."""

    def write(path: Path) -> None:
        nptdms = pytest.importorskip("nptdms")
        own = {"unit_string": "N", "wf_increment": 2e-4, **said}
        with nptdms.TdmsWriter(str(path)) as file:
            for part in np.split(F, segments):
                file.write_segment([nptdms.ChannelObject("group", "Force", part, properties=own)])
                if segments > 1:
                    own["wf_start_time"] += np.timedelta64(200 * len(part) + 1000 * gap_ms, "us")

    return write


def nwb(path: Path) -> None:
    with h5py.File(path, "w") as file:
        file.attrs["nwb_version"] = "2.7"
        file["session_start_time"] = f"{AT}+02:00"
        file["timestamps_reference_time"] = f"{AT}+02:00"
        group = file.create_group("acquisition/force")
        group.attrs["neurodata_type"] = "TimeSeries"
        group["data"] = F
        group["data"].attrs["unit"] = "N"
        group["starting_time"] = 1.5
        group["starting_time"].attrs["rate"] = 5000.0


def hdf5(**said: Any) -> Callable[[Path], None]:
    def write(path: Path) -> None:
        with h5py.File(path, "w") as file:
            file["force"] = F
            file["force"].attrs["units"] = "N"
            file.attrs.update(sample_rate=5000.0, **said)

    return write


def xdf(path: Path) -> None:
    write_xdf(path, 5000, {"force": ("N", F)}, begun=f"{AT}+0200")


def netcdf(since: str = "2026-05-01 10:00:00", calendar: str = "") -> Callable[[Path], None]:
    def write(path: Path) -> None:
        with scipy.io.netcdf_file(path, "w") as file:
            file.createDimension("time", 2500)
            for name, unit, values in (("time", f"seconds since {since}", T + 2), ("force", "N", F)):
                one = file.createVariable(name, "d", ("time",))
                one[:], one.units = values, unit
                if calendar and name == "time":
                    one.calendar = calendar

    return write


def broadcast(
    day: bytes = b"2026-05-01", clock: bytes = b"10:00:00", samples: int = 0
) -> Callable[[Path], None]:
    """As a field recorder writes one."""

    def write(path: Path) -> None:
        scipy.io.wavfile.write(path, 5000, F.astype(np.float32))
        plain = path.read_bytes()[8:]
        said = struct.pack("<256s64x10s8sQH", b"a press", day, clock, samples, 1).ljust(602)
        chunk = b"bext" + struct.pack("<I", len(said)) + said
        riff = b"RIFF" + struct.pack("<I", len(plain) + len(chunk))
        path.write_bytes(riff + plain[:4] + chunk + plain[4:])

    return write


def counted(calendar: str) -> Callable[[Path], None]:
    def write(path: Path) -> None:
        with h5py.File(path, "w") as file:
            file["force"], file["time"] = F, T + 2
            file["force"].attrs["units"] = "N"
            file["time"].attrs.update(units="seconds since 2026-05-01 10:00:00", calendar=calendar)

    return write


def workbook(path: Path) -> None:
    """A column of dates and one of times of day."""
    book = pytest.importorskip("openpyxl").Workbook()
    first = dt.datetime.fromisoformat(AT)
    book.active.append(["Date", "Time", "Force (N)"])
    for n, force in enumerate(F.tolist()):
        book.active.append([first.date(), (first + dt.timedelta(milliseconds=n)).time(), force])
    book.save(path)


def matlab(path: Path) -> None:
    scipy.io.savemat(path, {"force_N": F, "sample_rate": 5000.0, "StartTime": f"{AT}+02:00"})


def parquet(zone: str | None) -> Callable[[Path], None]:
    def write(path: Path) -> None:
        arrow = pytest.importorskip("pyarrow")
        parquet_file = pytest.importorskip("pyarrow.parquet")
        stamps = np.datetime64(AT, "us") + (1e6 * T).astype("timedelta64[us]")
        column = arrow.array(stamps, arrow.timestamp("us", tz=zone))
        parquet_file.write_table(arrow.table({"time": column, "force [N]": F}), path)

    return write


def uff(path: Path) -> None:
    import pyuff

    one = function58("force", T, F, 13, "N", id3="01-May-2026 10:00:00")
    pyuff.UFF(str(path)).write_sets([one], mode="overwrite")


def sep005(*starts: str) -> str:
    return json.dumps([
        {"name": f"force {n}", "unit_str": "N", "fs": 5000, "data": F.tolist(), "start_timestamp": start}
        for n, start in enumerate(starts)
    ])  # fmt: skip


def empatica(hz: float = 5000.0, columns: int = 3) -> str:
    first = [f"{UNIX}.000000"] * columns, [f"{hz:f}"] * columns
    return "".join(", ".join(row) + "\n" for row in first) + rows(*[np.round(F, 5)] * columns)


def over_the_hour(t: float) -> str:
    """The time in Berlin from 0.1 s before its clocks are set on, with the offset."""
    first = dt.datetime.fromisoformat("2026-03-29T01:59:59.9+01:00")
    at = (first + dt.timedelta(seconds=t)).astimezone(ZoneInfo("Europe/Berlin"))
    return at.isoformat(timespec="microseconds")


FIRST, SECOND = ({"force": column, "units": {"force": "N"}} for column in (0, 1))
EIGHT = "2026-05-01T08:00:00+00:00"
CASES = (
    # Of programs, in the shape of their headers
    Case("LabVIEW", lvm(), "Date 2026/05/01, Time 10:00:00.5", local=f"{AT}.500000", suffix="lvm"),
    Case("LabVIEW's X0", lvm(0.25), "X0 0.25 s", local=f"{AT}.750000", suffix="lvm"),
    Case("LabVIEW without a time", lvm(0.25, columns="No"), "X0", local=f"{AT}.750000", suffix="lvm"),
    Case("LabVIEW's second segment", lvm(segments=2), "Time 10:01:00.5", local="2026-05-01T10:01:00.500000",
        suffix="lvm", told={"where": {"segment": "2"}}),
    Case("TDMS", tdms(wf_start_time=np.datetime64(AT, "us")), "wf_start_time", UTC, suffix="tdms"),
    Case("TDMS's offset", tdms(wf_start_time=np.datetime64(AT, "us"), wf_start_offset=0.25), "wf_start_time",
        "2026-05-01T10:00:00.250000+00:00", suffix="tdms"),
    Case("TDMS in pieces", tdms(5, wf_start_time=np.datetime64(AT, "us")), "wf_start_time", UTC,
        suffix="tdms"),
    Case("TDMS in pieces, by the system's clock", tdms(5, 1, wf_start_time=np.datetime64(AT, "us")),
         "wf_start_time", UTC, suffix="tdms"),
    Case("TDMS's zero", tdms(wf_start_time=np.datetime64("1904-01-01", "us")), suffix="tdms"),
    Case("NWB", nwb, f"{AT}+02:00", "2026-05-01T08:00:01.500000+00:00", suffix="nwb"),
    Case("XDF", xdf, f"{AT}+0200", EIGHT, suffix="xdf"),
    Case("netCDF", netcdf(), "seconds since", "2026-05-01T10:00:02+00:00", suffix="nc"),
    *(
        Case(f"netCDF since {since}", netcdf(since), since, utc, suffix="nc")
        for since, utc in (
            ("2026-5-1 10:0:0", "2026-05-01T10:00:02+00:00"),
            ("2026-05-01 10:00:00 -6:30", "2026-05-01T16:30:02+00:00"),
            ("2026-05-01 10:00:00 +2", "2026-05-01T08:00:02+00:00"),
            ("2026-05-01T10:00:00.5+02:00", "2026-05-01T08:00:02.500000+00:00"),
            ("2026-05-01", "2026-05-01T00:00:02+00:00"),
            ("2026-05-01 10:00:00 CET", ""),
        )
    ),
    *(
        Case(f"a broadcast WAV of {name}", write, words, local=local, suffix="wav",
            told={"force": 0, "units": {"force": "N"}})
        for name, write, words, local in (
            ("a second", broadcast(), "2026-05-01 10:00:00", AT),
            ("a sample", broadcast(samples=36_000 * 5000 + 2500), "2026-05-01 10:00:00.5", f"{AT}.500000"),
            ("another clock's samples", broadcast(samples=12), "2026-05-01 10:00:00", AT),
            ("other marks", broadcast(b"2026_05_01", b"10.00.00"), "2026-05-01 10:00:00", AT),
            ("no date", broadcast(bytes(10), bytes(8)), "", ""),
            ("a clock that was never set", broadcast(b"0000-00-00", b"00:00:00"), "", ""),
        )
    ),
    *(
        Case(f"{form} in the calendar {name}", write(calendar=name), "seconds since", utc, suffix=suffix)
        for form, write, suffix in (("netCDF", netcdf, "nc"), ("HDF5", counted, "h5"))
        for name, utc in (
            ("standard", "2026-05-01T10:00:02+00:00"),
            ("Gregorian", "2026-05-01T10:00:02+00:00"),
            ("360_day", ""),
            ("julian", ""),
            ("noleap", ""),
        )
    ),
    Case("Excel", workbook, "2026-05-01 10:00:00", local=AT, suffix="xlsx", rate_hz=1000),
    Case("HDF5", hdf5(recording_start="2026-05-01 10:00:00 UTC"), "UTC", UTC, suffix="h5"),
    Case("HDF5's own clock", hdf5(recorded_at=AT), "recorded", local=AT, suffix="h5"),
    Case("MATLAB", matlab, "Start Time", EIGHT, suffix="mat"),
    Case("Parquet", parquet(None), AT, local=AT, suffix="parquet"),
    Case("Parquet of a zone", parquet("Europe/Berlin"), AT, UTC, suffix="parquet"),
    Case("UFF", uff, "01-May-2026 10:00:00", local=AT, suffix="uff"),
    Case("SEP-005", sep005(f"{AT}+00:00"), AT, UTC, suffix="sep005", told={"force": 0}),
    Case("Digilent WaveForms", table("#Device Name: X\n#Date Time: 2026-05-01 10:00:00.250.500.750"),
        "10:00:00.250.500.750", local=f"{AT}.250500"),
    Case("Digilent WaveForms before its trigger", table("#Date Time: 2026-05-01 10:00:00", begins=-0.1),
        "2026-05-01 10:00:00"),
    Case("Empatica's start and rate", empatica(), f"{UNIX} in its first row", UTC, told=FIRST),
    Case("Empatica's one column", empatica(1000, 1), f"{UNIX} in its first row", UTC, told=FIRST,
        rate_hz=1000),
    *(
        Case(f"Vicon's rate of {name}", f"{name}\n5000\n,,Plate,\nFrame,Sub Frame,Fx,Fz\n,,N,N\n"
            + rows(np.arange(2500), [0] * 2500, 3 * F, F))
        for name in SECTIONS
    ),
    Case("Vicon's older rate", "ANALOG\n5000,Hz\nSample #,Fz\nUnits:,N\n" + rows(np.arange(2500), F)),
    Case("AcqKnowledge",
        "Recording on: 2026-05-01 10:00:00.125\n0.2 msec/sample\n1 channels\nForce [N]\tEMG\n"
        + rows(F, [1] * 2500, separator="\t"), "Recording on 2026-05-01 10:00:00.125", local=f"{AT}.125000"),
    Case("AcqKnowledge's row of counts",
        "run.acq\n0.2 msec/sample\n2 channels\nForce\nN\nEMG\nmV\nsec\tCH1\tCH2\n\t2500\t2497\n"
        + rows(np.round(T, 7), F, [1] * 2500, separator="\t"), told=SECOND),
    Case("AcqKnowledge's row of counts without a time",
        "run.acq\n0.2 msec/sample\n2 channels\nForce\nN\nEMG\nmV\nCH1\tCH2\n2500\t2497\n"
        + rows(F, [1] * 2500, separator="\t"), told=FIRST),
    Case("LabChart, whose number of the day says what 01/05/26 is",
        "Interval=\t0.0002 s\nExcelDateTime=\t4.6143416666666664e+04\t01/05/26 10:00:00.5\n"
        "TimeFormat=\tStartOfBlock\nDateFormat=\t\nChannelTitle=\tForce\nRange=\t10.0 N\nUnitName=\tN\n"
        + rows(T, F, separator="\t"), "ExcelDateTime 01/05/26", local=f"{AT}.500000",
        told={"time": 0, "force": 1, "units": {"time": "s", "force": "N"}}),
    Case("Trigno Discover", table("Application:, Trigno Discover (2.1)\nDate/Time:, 2026/05/01 10:00:00"),
        "Date/Time 2026/05/01 10:00:00", local=AT),
    Case("ActiGraph",
        table("--- Data File Created By ActiGraph ActiLife v6 date format M/d/yyyy at 5000 Hz ---\n"
        "Start Time 10:00:00\nStart Date 5/1/2026\nDownload Time 11:00:00\nDownload Date 6/1/2026"),
        "Start Date 5/1/2026, Start Time 10:00:00", local=AT),
    Case("GCDC", table(";Start_time, 2026-05-01, 10:00:00.125"), "10:00:00.125", local=f"{AT}.125000"),
    Case("OpenSignals",
        '# {"00:07": {"time": "10:00:0.5", "sampling rate": 5000, "date": "2026-5-1"}}\n# EndOfHeader\n'
        + rows(F, [0] * 2500, separator="\t"), "date 2026-5-1, time 10:00:0.5", local=f"{AT}.500000",
        told=FIRST),
    Case("LeCroy's trigger",
        table("LECROY,1,Waveform\nSegment,TrigTime,TimeSince\n#1,01-May-2026 10:00:00,0"),
        "TrigTime 01-May-2026 10:00:00"),
    Case("Keysight", table("Date:,01 MAY 2026\nTime:,10:00:00"), "Date 01 MAY 2026", local=AT),
    Case("catman", table("T0 = 01.05.2026 10:00:00"), "T0 01.05.2026", local=AT),
    Case("Dewesoft", table("Start time: 5/13/2026 1:02:03 PM"), "PM", local="2026-05-13T13:02:03"),
    # Columns of dates
    Case("dates with an offset", stamped(AT, zone="+02:00"), "+02:00", EIGHT),
    Case("dates in UTC", stamped(AT, zone="Z"), f"{AT[:10]} 10", UTC),
    Case("dates alone", stamped(AT), "2026-05-01 10", local=AT),
    *(
        Case(f"over midnight: {form}", stamped(f"{day}T23:59:59.9", form=form), words, local=local)
        for day, form, words, local in (
            ("2026-05-12", "%d/%m/%Y %H:%M:%S.%f", "12/05/2026", ""),
            ("2026-05-31", "%d/%m/%Y %H:%M:%S.%f", "31/05/2026", "2026-05-31T23:59:59.900000"),
            ("2026-05-01", "%d/%m/%Y %H:%M:%S.%f", "01/05/2026", ""),
            ("2026-05-31", "%m/%d/%Y %I:%M:%S.%f %p", "05/31/2026", "2026-05-31T23:59:59.900000"),
            ("2026-12-31", "%d-%b-%Y %H:%M:%S.%f", "31-Dec-2026", "2026-12-31T23:59:59.900000"),
        )
    ),
    Case("offsets in the hour in which clocks are set",
        "Time,Force (N)\n" + rows([over_the_hour(t) for t in T.tolist()], F),
        "01:59:59.900000+01:00", "2026-03-29T00:59:59.900000+00:00"),
    Case("dates with a told rate", stamped(AT, zone="Z"), AT[:10], UTC, told={"rate_hz": 5000}),
    Case("dates of either order", stamped(AT, form="%d/%m/%Y %H:%M:%S.%f"), "01/05/2026 10:00:00"),
    Case("a date and a time of day", "Date,Time,Force (N)\n"
        + rows([AT[:10]] * 2500, [f"10:00:0{t:.4f}" for t in T], F), "2026-05-01 10:00:00.0000", local=AT),
    Case("Unix seconds", "Unix Timestamp,Force (N)\n" + rows(UNIX + T, F), "Unix", UTC),
    Case("Unix nanoseconds", "Unix time (ns),Force (N)\n"
        + rows([10**9 * UNIX + 200_000 * n for n in range(2500)], F), "Unix", UTC),
    Case("Unix milliseconds", "Unix time (ms),Force (N)\n" + rows(1e3 * (UNIX + T), F), "Unix", UTC),
    Case("no unit of Unix", "Timestamp (ms),Force (N)\n" + rows(1e3 * (UNIX + T), F)),
    Case("the second trial's own dates", "Trial,Time,Force (N)\n"
        + rows(["1"] * 10 + ["2"] * 2500,
        [*[f"{AT}.{n}00" for n in range(10)],
        *((dt.datetime(2026, 5, 1, 11) + dt.timedelta(seconds=t)).isoformat(timespec="microseconds")
        for t in T.tolist())], [*F[:10], *F]), "and 3600 s", local="2026-05-01T11:00:00",
        told={"where": {"Trial": "2"}}),
    # Zones
    Case("an offset in a header", table("Start: 2026-05-01T10:00:00+0200"), "+0200", EIGHT),
    Case("a zone in a key", table("Start time (UTC): 2026-05-01 10:00:00"), "(UTC)", UTC),
    Case("Unix in a key", table(f"Start time (unix): {UNIX}"), str(UNIX), UTC),
    Case("a zone in another row", table("Date: 2026-05-01\nTime: 10:00:00\nTime zone: Europe/Berlin"),
        "Europe/Berlin", EIGHT),
    *(
        Case(f"a zone: {words}", table(f"Start: 2026-05-01 10:00:00{words}"), words, utc)
        for words, utc in (
            (" UTC+2", EIGHT),
            (" GMT-5", "2026-05-01T15:00:00+00:00"),
            (" (UTC+02:00)", EIGHT),
        )
    ),
    Case("an offset in a key", table("Start (UTC+2): 2026-05-01 10:00:00"), "UTC+2", EIGHT),
    *(
        Case(f"a zone that a file states yields no told one: {heading}", head + stamped(AT, heading=heading),
            AT[:10], utc, told={"zone": "America/New_York"})
        for head, heading, utc in (
            ("", "Timestamp (UTC)", UTC),
            ("", "time_utc", UTC),
            ("", '"Date Time, GMT+02:00"', EIGHT),
            ("Time zone: +02:00\n", "Time", EIGHT),
        )
    ),
    Case("from and to", table("Date: 2026-05-01\nTime: 10:00-10:30"), "Time 10:00", local=AT),
    *(
        Case(f"half a day: {clock!r}", table(f"Start: 5/13/2026 {clock}"), clock, local=f"2026-05-13T{local}")
        for clock, local in (
            ("1:02:03 PM", "13:02:03"),
            ("1:02:03\u202fPM", "13:02:03"),
            ("1:02:03 p.\u00a0m.", "13:02:03"),
            ("12:02:03 a. m.", "00:02:03"),
        )
    ),
    Case("seconds in a key", table("Start epoch: 999999999"), "999999999", "2001-09-09T01:46:39+00:00"),
    Case("milliseconds in a key", table(f"Start epoch: {UNIX}250"), f"{UNIX}250", f"{AT}.250000+00:00"),
    # Two statements
    *(
        Case(f"two starts that differ: {one}", table(one), one.split("\n")[0].replace(":", "", 1))
        for one in (
            "Date: 2026-05-01 10:00:00\nDate: 2020-01-01 00:00:01",
            "Session start: 2026-05-01 09:00:00\nRecording start: 2026-05-01 10:00:00",
        )
    ),
    Case("a workbook's midnight", table("Date: 2026-05-01 00:00:00\nTime: 10:00:00"), "Time 10:00:00",
        local=AT),
    *(
        Case(f"times of day from {begins}", "Date: 2026-05-01\nStart time: 10:00:00\nTime,Force (N)\n"
            + rows([f"{begins}{t:.4f}" for t in T], F), "10:00:00", local=local)
        for begins, local in (("10:00:0", AT), ("00:00:0", AT), ("10:20:0", ""), ("00:20:0", ""))
    ),
    *(
        Case(f"a clock that nobody set: {at}", table(f"Start: {at}"), at)
        for at in ("1970-01-01 00:00:00Z", "1904-01-01 00:00:00")
    ),
    Case("letters of several zones", table("Date: 2026-05-01 10:00:00 IST"), "IST", local=AT),
    Case("a told zone", table("Date: 2026-05-01 10:00:00"), "in Europe/Berlin as told", EIGHT,
        told={"zone": "Europe/Berlin"}),
    Case("a told offset", lvm(), "as told", "2026-05-01T15:30:00.500000+00:00", suffix="lvm",
        told={"zone": "-05:30"}),
    Case("a told zone yields", table("Date: 2026-05-01 10:00:00Z"), "Z", UTC, told={"zone": "-05:00"}),
    # What states no start
    *(
        Case(f"no start: {line}", table(line))
        for line in (
            "Exported: 2026-05-01 10:00:00", "Download Time 10:00:00", "Calibration date: 2026-05-01 10:00",
            "Date of birth: 2000-05-01", "Start: 1000 Hz", "Time step: 10:00", "Saved 2026-05-01 10:00:00",
        )
    ),
    *(
        Case(f"words: {line}", table(line), line.replace(":", "", 1))
        for line in ("Date: 01/05/2026 10:00:00", "Test date: 2026-05-01", "Start time: 10:00:00")
    ),
    Case("a test time is no time of day", table("Test date: 2026-05-01\nTest time: 00:05:30"),
        "Test date 2026-05-01"),
    Case("a part of a table", "Sensor,Time (s),Force (N)\n"
        + rows(["left"] * 10 + ["right"] * 2500, [*T[:10], *T], [*F[:10], *F]),
        told={"where": {"Sensor": "right"}}),
    Case("a part of a dated table", "Date: 2026-05-01 10:00:00\nSensor,Time (s),Force (N)\n"
        + rows(["left"] * 10 + ["right"] * 2500, [*T[:10], *T], [*F[:10], *F]), "of the whole file",
        told={"where": {"Sensor": "right"}}),
)  # fmt: skip


def written(case: Case, folder: Path) -> Path:
    path = folder / f"a.{case.suffix}"
    if isinstance(case.file, str):
        path.write_text(case.file, encoding="utf-8")
    else:
        case.file(path)
    return path


@pytest.mark.usefixtures("read_here")
@pytest.mark.parametrize("case", CASES, ids=lambda case: case.name)
def test_the_start_that_a_file_states(case, tmp_path):
    found = understand(written(case, tmp_path), FileMapping(**case.told))
    assert not found.questions
    assert found.rate_hz == pytest.approx(case.rate_hz, rel=1e-6)
    assert len(found.signals["force"].values) == 2500
    assert np.abs(found.signals["force"].values).max() == pytest.approx(2, rel=1e-3)
    said = {} if found.start is None else found.start.contents
    assert case.words in said.pop("stated", ""), found.start
    assert bool(case.words) == (found.start is not None)
    assert said == ({"utc": case.utc} if case.utc else {"local": case.local} if case.local else {})


@pytest.mark.parametrize(
    ("text", "suffix", "told", "asked"),
    [
        (empatica(64), "csv", FIRST, "would have 64 samples/s"),
        (sep005(UTC, AT), "sep005", {}, "channels that begin at different times"),
        (table("Date: 2026-10-25 02:30:00"), "csv", {"zone": "Europe/Berlin"},
         "which Europe/Berlin has twice or never"),
        *((tdms(5, gap, wf_start_time=np.datetime64(AT, "us")), "tdms", {},
           f"last one begins at {0.4 + 4e-3 * gap:g} s, and the samples before it end at 0.4 s")
          for gap in (-10, 2, 25, 1000)),
    ],
)  # fmt: skip
def test_what_is_refused(text, suffix, told, asked, tmp_path):
    path = written(Case("", text, suffix=suffix), tmp_path)
    with pytest.raises((haploop.ConfigurationError, haploop.DataError), match=asked):
        understand(path, FileMapping(**told))


def test_two_samples_that_look_like_a_start_are_kept_in_a_table_with_headings(tmp_path):
    text = "Sample rate: 5000 Hz\nForce (mN)\n" + rows([UNIX, 5000, *np.round(F, 5)])
    path = written(Case("", text), tmp_path)
    with pytest.raises(haploop.ConfigurationError, match="would reach"):
        understand(path)


def test_a_recording_is_dated_by_the_start_that_its_file_states(run, tmp_path):
    """Without a time zone by the file's last change, and the clock time stands beside it."""
    path, saved = tmp_path / "a.csv", tmp_path / "lab.toml"
    path.write_text(table("Start: 2026-05-01T10:00:00"), encoding="utf-8")
    os.utime(path, (1.6e9, 1.6e9))
    told = ("import", path, "--button", "push", "-p", "P01", "--as", "recording")
    for name, more, started, kept, shown in (
        ("plain", (), "2020-09-13T12:26:40+00:00", {"local": AT}, f"{AT} of a clock whose time zone is not"),
        ("zoned", ("--zone", "+02:00", "--save-mapping", saved), EIGHT,
         {"utc": EIGHT}, "It began at 2026-05-01T08:00:00+00:00"),
        ("mapped", ("--mapping", saved), EIGHT,
         {"utc": EIGHT}, "It began at 2026-05-01T08:00:00+00:00"),
    ):  # fmt: skip
        out = tmp_path / f"{name}.h5"
        run(*told, *more, "-o", out, ends=0)
        recording = haploop.Recording.open(out)
        assert recording.header.started == started
        assert {k: v for k, v in recording.imported["started"].items() if k != "stated"} == kept
        said = " ".join(run("show", out).stdout.split())
        assert shown in said and ("last change" in said) == (name == "plain")
        listed = run.json("import", path, *more[:2] if name == "zoned" else ())
        assert listed["started"]["stated"].startswith("Start 2026-05-01T10:00:00")
    run(*told, "--zone", "Berlin", "-o", tmp_path / "no.h5", says="is no time zone")


@pytest.mark.usefixtures("read_here")
@pytest.mark.parametrize("format", ["csv", "wav", "mat", "uff"])
def test_an_own_export_brings_its_start_back(format, run, tmp_path):
    path, first = tmp_path / "a.csv", tmp_path / "first.h5"
    path.write_text(table(f"Start: {UTC}"), encoding="utf-8")
    told = ("--button", "push", "-p", "P01", "--as", "recording")
    run("import", path, *told, "-o", first, ends=0)
    out, again = tmp_path / f"b.{format}", tmp_path / "again.h5"
    run("export", first, "--to", format, "-o", out, ends=0)
    run("import", out, *told, "-o", again, ends=0)
    assert haploop.Recording.open(again).header.started == UTC
