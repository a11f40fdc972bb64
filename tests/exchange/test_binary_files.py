"""What files of other programs say of their numbers: unit, scale, rate, start, direction, what is missing.

Each row writes the same press with a library that is not ours, and has what is right: values in SI, or words
of the question or the refusal.
"""

import datetime as dt
import shutil
from collections.abc import Callable, Mapping
from decimal import Decimal
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import pytest
import scipy

import haploop
from haploop.exchange import FileMapping, understand
from tests.exchange.other_programs import function58, write_xdf

pytestmark = pytest.mark.usefixtures("read_here")

RATE, N = 5000, 2500
T = np.arange(N) / RATE
F = 2 * np.exp(-(((T - 0.25) / 0.04) ** 2))
A = 5 * np.exp(-(((T - 0.25) / 0.006) ** 2)) * np.sin(400 * np.pi * (T - 0.2501))
LATE = 0.1


def _uff(
    *functions: dict[str, Any], length: float = 0.0, force: float = 1.0, padding: str = ""
) -> Callable[[Path], None]:
    def write(path: Path) -> None:
        pyuff = pytest.importorskip("pyuff")
        sets = []
        if length:
            sets.append(pyuff.prepare_164(
                units_code=9, units_description="", temp_mode=1, length=length, force=force, temp=1.0,
                temp_offset=273.15))  # fmt: skip
        for number, one in enumerate(functions, 1):
            sets.append(function58(**{"x": T, "rsp_node": number} | one))
        pyuff.UFF(str(path)).write_sets(sets, mode="overwrite")
        if padding:
            lines = path.read_text(encoding="utf-8").splitlines()
            last = [n for n, line in enumerate(lines) if line.strip() == "-1"]
            for n in last[1::2]:
                lines[n - 1] = lines[n - 1] + padding * ((80 - len(lines[n - 1])) // len(padding))
            path.write_text("\n".join(lines) + "\n", encoding="utf-8")

    return write


def force(data: np.ndarray = F, kind: int = 13, unit: str = "N", **more: Any) -> dict[str, Any]:
    return {"name": "force", "data": data, "kind": kind, "unit": unit} | more


def acc(data: np.ndarray = A, kind: int = 12, unit: str = "m/s^2", **more: Any) -> dict[str, Any]:
    return {"name": "acc", "data": data, "kind": kind, "unit": unit} | more


def _tdms(*channels: tuple[str, np.ndarray, dict[str, Any]], **options: Any) -> Callable[[Path], None]:
    def write(path: Path) -> None:
        nptdms = pytest.importorskip("nptdms")
        with nptdms.TdmsWriter(str(path), **options) as file:
            file.write_segment([nptdms.ChannelObject("run", *one) for one in channels])

    return write


STEP = {"wf_increment": 1 / RATE}
NEWTON, METRE = {**STEP, "unit_string": "N"}, {**STEP, "unit_string": "m/s^2"}
LINEAR = {
    "NI_Scaling_Status": "unscaled", "NI_Number_Of_Scales": 1, "NI_Scale[0]_Scale_Type": "Linear",
    "NI_Scale[0]_Linear_Slope": 2.0, "NI_Scale[0]_Linear_Y_Intercept": 0.0,
    "NI_Scale[0]_Linear_Input_Source": 0xFFFFFFFF,
}  # fmt: skip
"""As NI's driver logs: numbers of the converter, and how to scale them."""
BEGIN = np.datetime64("2026-01-01T00:00:00", "us")
LATER = BEGIN + np.timedelta64(100, "ms")


def stale(path: Path) -> None:
    """Appended to after its index was written."""
    half = N // 2
    index = path.with_name(path.name + "_index")
    _tdms(("Force", F[:half], NEWTON), index_file=True)(path)
    shutil.copy(index, path.with_name("old"))
    _tdms(("Force", F[half:], NEWTON), mode="a")(path)
    shutil.copy(path.with_name("old"), index)


def _hdf5(fill: Callable[[Any], None]) -> Callable[[Path], None]:
    def write(path: Path) -> None:
        with h5py.File(path, "w") as file:
            fill(file)

    return write


def array_of_units(file: Any) -> None:
    """As MATLAB and LabVIEW write attributes: an array of one text."""
    file["force"] = F * 1000
    file["force"].attrs.create("units", ["mN"], dtype=h5py.string_dtype())
    file["time"] = T * 1000
    file["time"].attrs["Units"] = np.array([b"ms"])


def packed(file: Any) -> None:
    counts = np.rint(F / 1e-3).astype(np.int16) - 500
    counts[100:105] = -32768
    file["force"] = counts
    file["force"].attrs.update(scale_factor=1e-3, add_offset=0.5, _FillValue=np.int16(-32768), units="N")
    file["time"] = T
    file["time"].attrs["units"] = "seconds since 2026-01-01 00:00:00"


def _valid(file: Any) -> None:
    values = F.copy()
    values[100:105] = 1e30
    file["force"], file["time"] = values, T
    file["force"].attrs.update(valid_range=np.array([-10.0, 10.0]), units="N")
    file["time"].attrs["units"] = "s"


def two_rates(file: Any) -> None:
    file["force"], file["acceleration"] = F, A[::2]
    file["force"].attrs.update(unit="N", sample_rate=5000.0)
    file["acceleration"].attrs.update(unit="g", sample_rate=2500.0)


def scaled(file: Any) -> None:
    two_units(file, "N", "N")
    file["force"].attrs["scale"] = 1e-3


def _factor(holder: str, name: str, value: object) -> Callable[[Path], None]:
    """A file with a factor at another place than the array's own."""

    def fill(file: Any) -> None:
        group = file.create_group("data")
        two_units(group, "N", "N")
        group["other"] = F
        file.require_group(holder) if holder not in file else None
        file[holder].attrs[name] = value

    return _hdf5(fill)


def two_units(file: Any, one: str = "N", other: str = "mN", name: str = "force") -> None:
    file[name], file["time"] = F, T
    file[name].attrs.update(unit=one, units=other)
    file["time"].attrs.update(units="s", gain=1.0)


def _external(file: Any) -> None:
    file.create_dataset("force", shape=(N,), dtype="f8", external=[("outside.bin", 0, 8 * N)])


def _virtual(file: Any) -> None:
    layout = h5py.VirtualLayout((N,), "f8")
    layout[:] = h5py.VirtualSource("outside.h5", "force", (N,))
    file.create_virtual_dataset("force", layout)


def _linked(file: Any) -> None:
    file["force"] = h5py.ExternalLink("outside.h5", "/force")


def _nwb(*series: dict[str, Any]) -> Callable[[Path], None]:
    def write(path: Path) -> None:
        pynwb = pytest.importorskip("pynwb")
        file = pynwb.NWBFile("presses", "id", dt.datetime(2026, 1, 1, tzinfo=dt.UTC))
        for one in series:
            file.add_acquisition(pynwb.TimeSeries(**one))
        with pynwb.NWBHDF5IO(path, "w") as out:
            out.write(file)

    return write


def counts(name: str, data: np.ndarray, unit: str, step: float, **more: Any) -> dict[str, Any]:
    return {"name": name, "data": np.rint(data / step).astype("i2"), "unit": unit, "conversion": step,
            "rate": float(RATE), "starting_time": 0.0} | more  # fmt: skip


def _xarray(engine: str, coordinates: bool = True, **encoding: Any) -> Callable[[Path], None]:
    def write(path: Path) -> None:
        xarray = pytest.importorskip("xarray")
        holes = np.where((T > 0.02) & (T < 0.021), np.nan, F)
        xarray.Dataset(
            {"force": ("time", holes, {"units": "N"})},
            coords={"time": ("time", 1e3 * T, {"units": "ms"})} if coordinates else {},
        ).to_netcdf(path, engine=engine, encoding={"force": encoding})

    return write


def netcdf_of_bytes(path: Path) -> None:
    with scipy.io.netcdf_file(path, "w", version=1) as file:
        file.createDimension("sample", N)
        for name, values, units in (("force", F * 1000, b"mN"), ("elapsed", T, b"s")):
            variable = file.createVariable(name, "f8", ("sample",))
            variable[:] = values
            variable.units = units


def _parquet(**more: Any) -> Callable[[Path], None]:
    """A table of pandas, some of whose columns are others."""

    def write(path: Path) -> None:
        pandas = pytest.importorskip("pandas")
        pytest.importorskip("pyarrow")
        pandas.DataFrame({"t [ms]": 1e3 * T, "force (mN)": 1e3 * F} | more).to_parquet(path)

    return write


NO_START = np.datetime64("2026-05-01") + np.round(1e6 * T).astype("timedelta64[us]")
NO_START[0] = np.datetime64("NaT", "us")


def _workbook(
    forms: str | tuple[str, str], force: np.ndarray = F, head: str = "Force", time: np.ndarray = T
) -> Callable[[Path], None]:
    """Of a number format of the time, in seconds unless it says, and one of the force."""

    def write(path: Path) -> None:
        openpyxl = pytest.importorskip("openpyxl")
        book = openpyxl.Workbook()
        of_time, of_force = ("General", forms) if isinstance(forms, str) else forms
        book.active.append(["Time (s)" if of_time == "General" else "Time", head])
        for row in zip(time.tolist(), force.tolist(), strict=True):
            book.active.append(row)
            book.active.cell(book.active.max_row, 1).number_format = of_time
            book.active.cell(book.active.max_row, 2).number_format = of_force
        book.save(path)

    return write


def _texts(path: Path) -> None:
    openpyxl = pytest.importorskip("openpyxl")
    book = openpyxl.Workbook()
    book.active.append(["Zeit (s)", "Kraft (mN)"])
    for t, f in zip(T, F, strict=True):
        book.active.append(
            [f"{t:.4f}".replace(".", ","), f"{1e3 * f:,.3f}".translate(str.maketrans(",.", ".,"))]
        )
    book.save(path)


def _lines(path: Path) -> None:
    """With texts of several lines, as a cell's Alt-Enter makes them."""
    openpyxl = pytest.importorskip("openpyxl")
    book = openpyxl.Workbook()
    book.active.append(["Time (s)", "Force (N)", "step"])
    for t, f in zip(T.tolist(), F.tolist(), strict=True):
        book.active.append([t, f, "press\nonce" if t < 0.1 else "rest"])
    book.save(path)


def electrical(file: Any) -> None:
    """A factor for each channel, as NWB's ElectricalSeries has it."""
    file.attrs["nwb_version"] = "2.7.0"
    series = file.create_group("acquisition/force")
    series.attrs["neurodata_type"] = "ElectricalSeries"
    series["data"] = F[:, None] / 6e-3
    series["data"].attrs.update(conversion=2e-3, offset=0.0, unit="N")
    series["channel_conversion"] = np.array([3.0])
    series["starting_time"] = 0.0
    series["starting_time"].attrs["rate"] = float(RATE)


def _sides(write: Callable[[Any, Path], None]) -> Callable[[Path], None]:
    """A long table: two sensors below each other, told apart by a column of text."""

    def made(path: Path) -> None:
        pandas = pytest.importorskip("pandas")
        pytest.importorskip("pyarrow")
        sides = np.repeat(["left", "right"], N)
        write(pandas.DataFrame({"time (s)": np.tile(T, 2), "side": sides, "force (N)": np.tile(F, 2)}), path)

    return made


def _sides_in_hdf5(table: Any, path: Path) -> None:
    with h5py.File(path, "w") as file:
        for name in table.columns:
            text = table[name].dtype.kind not in "f"
            file.create_dataset(name, data=table[name], dtype=h5py.string_dtype() if text else "f8")


def _sides_in_netcdf(table: Any, path: Path) -> None:
    with scipy.io.netcdf_file(path, "w") as file:
        file.createDimension("row", len(table))
        file.createDimension("letters", 5)
        for name in table.columns:
            text = table[name].dtype.kind not in "f"
            variable = file.createVariable(
                name.split(" ")[0], "c" if text else "f8", ("row", "letters") if text else ("row",)
            )
            variable[:] = np.array(table[name], dtype="S5").view("S1").reshape(-1, 5) if text else table[name]
            variable.units = {"time (s)": "s", "force (N)": "N"}.get(name, "")


def _testlab(unit: str, step: float) -> dict[str, Any]:
    """As Simcenter Testlab exports a function: an axis of its own, with its unit."""
    axis = {"start_value": 0.0, "increment": step, "number_of_values": N, "quantity": {"label": unit}}
    return {
        "x_values": axis,
        "y_values": {"values": F, "quantity": {"label": "N"}, "unit": "N", "name": "force"},
    }


def _matlab(**values: Any) -> Callable[[Path], None]:
    return lambda path: scipy.io.savemat(path, values)


def _xdf(path: Path) -> None:
    write_xdf(path, RATE, {"force": ("mN", 1e3 * F), "acceleration": ("g", A / 9.80665)})


Right = Mapping[str, np.ndarray] | str
HELD = {"force": F, "acceleration": A}
CUT = round(LATE * RATE)
SHIFTED = {"force": F[CUT:], "acceleration": A[:-CUT]}
ROWS: list[tuple[str, Callable[[Path], None], Right]] = [
    ("si.uff", _uff(force(), acc()), HELD),
    ("label in g.uff", _uff(acc(A / 9.80665, unit="g")), {"acceleration": A}),
    ("label in mN.uff", _uff(force(F * 1e3, unit="mN"), acc()), HELD),
    ("label and 164 in mm.uff", _uff(acc(A * 1e3, unit="mm/s^2"), length=1e3), {"acceleration": A}),
    ("164 alone in mm.uff", _uff(acc(A * 1e3, unit="NONE"), length=1e3), {"acceleration": A}),
    ("164 alone in inch.uff", _uff(acc(A / 0.0254, unit="NONE"), length=1 / 0.0254), {"acceleration": A}),
    ("164 alone in mN.uff", _uff(force(F * 1e3, unit="NONE"), length=1e3, force=1e3), {"force": F}),
    ("no unit.uff", _uff(force(unit="NONE")), "neither a label nor data set 164"),
    ("label against 164.uff", _uff(acc(unit="g"), length=1.0),
     "label says 'g', and data set 164 a unit of 1 m/s"),
    ("label against type.uff", _uff(acc(unit="N")), "type is acceleration, and its label says 'N'"),
    ("label of nothing.uff", _uff(acc(unit="EU")), "'EU' is no unit of acceleration"),
    ("volts.uff", _uff(force(kind=1, unit="V")), "what a volt of force is"),
    ("downwards.uff", _uff(force(), acc(-A, rsp_dir=-3)), HELD),
    ("later.uff", _uff(force(), acc(x=T + LATE)), SHIFTED),
    ("in ms.uff", _uff(force(x=T * 1e3, abscissa_axis_units_lab="ms"), acc()), HELD),
    ("over speed.uff", _uff(force(abscissa_spec_data_type=19, abscissa_axis_units_lab="rpm")),
     "which is no time"),
    ("padded with blanks.uff", _uff(force(F[:-1], x=T[:-1]), padding=" "), {"force": F[:-1]}),
    ("padded with zeros.uff", _uff(force(F[:-1], x=T[:-1]), padding=f"{0:20.11e}"), {"force": F[:-1]}),
    ("uneven.uff",
     _uff(force(np.delete(F, slice(700, 750)), x=np.delete(T, slice(700, 750)), abscissa_spacing=0)),
     "gap of 50 samples"),
    ("a.tdms", _tdms(("Force", F, NEWTON), ("Acc", A, METRE)), HELD),
    ("one rate.tdms", _tdms(("Force", F, {"unit_string": "N"}), ("Other", A, STEP)), {"force": F}),
    ("stale index.tdms", stale, {"force": F}),
    ("empty channel.tdms", _tdms(("Force", F, NEWTON), ("Marks", np.zeros(0, "M8[us]"), {})), {"force": F}),
    ("comments.tdms", _tdms(("Force", F, NEWTON), ("Notes", np.array(["a"] * N), {})),
     "Notes are neither vectors nor matrices"),
    ("later.tdms", _tdms(("Force", F, NEWTON | {"wf_start_time": BEGIN}),
                         ("Acc", A, METRE | {"wf_start_time": LATER})), SHIFTED),
    ("offset.tdms", _tdms(("Force", F, NEWTON), ("Acc", A, METRE | {"wf_start_offset": LATE})), SHIFTED),
    ("another start.tdms", _tdms(("Force", F, NEWTON | {"wf_start_time": BEGIN}),
                                 ("Acc", A, METRE | {"wf_start_time": BEGIN + np.timedelta64(9, "s")})),
     "ends before"),
    ("spectrum.tdms", _tdms(("Force", F, NEWTON | {"wf_xname": "Frequency"})), "over frequency"),
    ("array of units.h5", _hdf5(array_of_units), {"force": F}),
    ("packed.h5", _hdf5(packed), "5 values are missing"),
    ("valid range.h5", _hdf5(_valid), "5 values are missing"),
    ("scaled.h5", _hdf5(scaled), "scale = 0.001' may be in its numbers already, or not"),
    ("of the file.h5", _factor("/", "Gain", "100"), "'Gain = 100' may be in"),
    ("of the group.h5", _factor("data", "ampGain", 100), "'data/ampGain = 100' may be in"),
    ("of settings.h5", _factor("settings", "gains", [1.0, 100.0]), "'settings/gains = 100' may be in"),
    ("of another.h5", _factor("data/other", "gain", 100), {"force": F}),
    ("two units.h5", _hdf5(two_units), "says both 'N' and 'mN'"),
    ("name against unit.h5", _hdf5(lambda file: two_units(file, "mN", "mN", "force_N")),
     "is called 'force_N', and its unit is given as mN"),
    ("scaled.mat", _matlab(force=F, Fs=5000.0, scale=1e-3, units={"force": "N"}), "'scale = 0.001' may"),
    ("daqmx.tdms", _tdms(("Force", F, NEWTON | LINEAR)), {"force": 2 * F}),
    ("of a map.tdms", _tdms(("Force", F, NEWTON | LINEAR | {"NI_Scale[0]_Scale_Type": "Map"})),
     "_Scale_Type = Map) was not applied"),
    ("testlab.mat", _matlab(Signal=_testlab("s", 1 / RATE)), {"force": F}),
    ("testlab spectrum.mat", _matlab(Signal=_testlab("Hz", 1.0)), "over frequency"),
    ("scaled.tdms", _tdms(("Force", F, NEWTON | {"Scale factor": 1e-3})), "Scale factor = 0.001' may be in"),
    ("sides.parquet", _sides(lambda table, path: table.to_parquet(path)), "column 'side' has left, right"),
    ("sides.h5", _sides(_sides_in_hdf5), "column 'side' has left, right"),
    ("sides.nc", _sides(_sides_in_netcdf), "column 'side' has left, right"),
    ("external.h5", _hdf5(_external), "has its values in another file"),
    ("virtual.h5", _hdf5(_virtual), "has its values in another file"),
    ("linked.h5", _hdf5(_linked), "is a link to another file"),
    ("external.mat", _hdf5(_external), "has its values in another file"),
    ("linked.nwb", _hdf5(lambda file: (_linked(file), file.attrs.update(nwb_version="2.7"))),
     "a link to another"),
    ("a.nwb", _nwb(counts("force", F, "N", 1e-4), counts("acceleration", A, "m/s^2", 2e-4)), HELD),
    ("later.nwb", _nwb(counts("force", F, "N", 1e-4),
                       counts("acceleration", A, "m/s^2", 2e-4, starting_time=LATE)), SHIFTED),
    ("stamps.nwb", _nwb({"name": "force", "data": F, "unit": "N", "timestamps": T}), {"force": F}),
    ("netcdf4.nc", _xarray("h5netcdf", dtype="int16", scale_factor=1e-4, _FillValue=-32768),
     "4 values are missing"),
    ("classic.nc", _xarray("scipy", dtype="int16", scale_factor=1e-4, _FillValue=-32768),
     "4 values are missing"),
    ("no coordinates.nc", _xarray("h5netcdf", coordinates=False), "sample rate"),
    ("classic named.h5", netcdf_of_bytes, {"force": F}),
    ("channels.nwb", _hdf5(electrical), {"force": F}),
    ("format in N.xlsx", _workbook('0.00" N"'), {"force": F}),
    ("formats in ms and mN.xlsx", _workbook(("0.0\\ \\m\\s", '#,##0.0" mN";[Red]-#,##0.0" mN"'), 1e3 * F,
                                            time=1e3 * T), {"force": F}),
    ("format with a locale.xlsx", _workbook("0.00 [$mN-407]", 1e3 * F), {"force": F}),
    ("shown in kN.xlsx", _workbook('0.00,"kN"'), {"force": F}),
    ("shown divided.xlsx", _workbook("0.00,", head="Force (N)"), "without a unit that says so"),
    ("two formats.xlsx", _workbook('[<1]0.00" mN";0.00" N"'), "shows several units"),
    ("numbers as text.xlsx", _texts, "say what their comma is (--decimal , or --decimal .)"),
    ("told numbers as text.xlsx", _texts, {"force": F}),
    ("lines in cells.xlsx", _lines, "column 'step' has press once, rest"),
    ("percent.xlsx", _workbook("0.0%", head="Force (N)"), "its heading says N, each of its rows %"),
    ("format against heading.xlsx", _workbook('0.00" mN"', head="Force (N)"),
     "its heading says N, each of its rows mN"),
    ("unit unknown.xlsx", _workbook('"F = "0.00" EU"', head="Force (N)"), {"force": F}),
    *((f"{n}.xlsx", _workbook((form, "General"), head="Force (N)", time=start + T / 86_400), {"force": F})
      for n, (form, start) in enumerate((("mm:ss.0", 0), ("[h]:mm:ss.000", 0.4), ("hh:mm:ss.000", 0.5),
                                         ("dd.mm.yyyy hh:mm:ss.000", 46_000)))),
    ("a.xdf", _xdf, HELD),
    ("a.parquet", _parquet(), {"force": F}),
    ("decimals.parquet", _parquet(**{"force (mN)": [Decimal(f"{1e3 * f:.3f}") for f in F]}), {"force": F}),
    ("gaps in a contact.parquet", _parquet(contact=[None, *(T > 0.1)[1:].tolist()]),
     {"force": F, "activation": T > 0.1}),
    ("lists.parquet", _parquet(marks=[[n] for n in range(N)]), "marks is text ('[0]' in row 1)"),
    ("no first time.parquet", _parquet(**{"t [ms]": NO_START}), "no time in sample 1:"),
    ("structures.mat", _matlab(
        press={"force": {"data": 1e3 * F, "unit": "mN", "dt_s": 1 / RATE},
               "acc": {"values": A, "units": "m/s^2", "SampleRate": float(RATE)}}), HELD),
    *((f"{name}.mat", _matlab(force_N=F, fs=RATE, more=more), "more are neither vectors nor matrices")
      for name, more in (("cells", np.array([F, A, T[:9]], dtype=object)), ("pages", np.zeros((N, 2, 3))),
                         ("spectrogram", np.zeros((N, 65))))),
    ("two rates.h5", _hdf5(two_rates), "several rates"),
    ("oscilloscope.mat", _matlab(force=F[:, None], Tinterval=1 / RATE), {"force": F}),
]  # fmt: skip


@pytest.mark.parametrize(("name", "write", "right"), ROWS, ids=[row[0] for row in ROWS])
def test_it_means_what_the_file_says(tmp_path, name, write, right):
    (tmp_path / "outside.bin").write_bytes(F.tobytes())
    with h5py.File(tmp_path / "outside.h5", "w") as outside:
        outside["force"] = F
    write(tmp_path / name)
    told: dict[str, Any] = {"oscilloscope.mat": {"units": {"force": "N"}}}.get(name, {})
    told |= {"decimal": ","} if name.startswith("told") else {}
    try:
        found = understand(tmp_path / name, FileMapping(**told))
    except haploop.HaploopError as refused:
        assert isinstance(right, str) and right in str(refused)
        return
    asked = "; ".join(question.what for question in found.questions)
    if isinstance(right, str):
        assert right in asked + "".join(found.notes)
    if asked:
        assert isinstance(right, str), asked
        return
    assert found.rate_hz == pytest.approx(RATE, rel=1e-6)
    truth = {"force": F} if isinstance(right, str) else right
    for role, values in truth.items():
        got = found.signals[role].values
        assert len(got) == len(values)
        kept = np.ones(N, bool) if len(values) == N else slice(None)
        if isinstance(right, str):
            kept = (T > 0.03) & ((T < 0.13) | (T > 0.16))
        np.testing.assert_allclose(got[kept], values[kept], atol=2e-3)
