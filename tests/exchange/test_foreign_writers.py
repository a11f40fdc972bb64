"""What libraries of other people write comes in as it went out, or is asked about: never silently wrong.

With HAPLOOP_FOREIGN=1 in the environment 2,000 files are drawn.
"""

import datetime as dt
import os
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
import pytest
import scipy
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

import haploop
from haploop.exchange import understand
from tests.exchange.other_programs import function58

settings.register_profile("foreign", max_examples=2000)

FORCES = {"N": 1.0, "mN": 1e-3, "gf": 9.80665e-3, "kgf": 9.80665}
ACCELERATIONS = {"m/s^2": 1.0, "g": 9.80665, "mm/s^2": 1e-3, "": 1.0}


@dataclass(frozen=True)
class Made:
    """One measurement, and how its writer is to state it."""

    rate: float
    samples: int
    force_unit: str
    acceleration_unit: str
    step: float
    """SI units of the file that one count is, in a packed file."""
    late: int
    """Samples by which acceleration begins after force, where a format can say so."""
    gap: int
    """Samples that are missing amid the file, where a format has stamps."""
    sign: int
    force_first: bool
    states_rate: bool
    begins: float = 0.0
    """Stamp (s) of the first sample, in a format that has stamps of its own."""
    shown: bool = False
    """Whether a workbook states units by number formats, and not in its headings."""

    @property
    def force(self) -> np.ndarray:
        return 2 * np.exp(-(((self.time / self.time[-1] - 0.5) / 0.1) ** 2))

    @property
    def acceleration(self) -> np.ndarray:
        since = self.time / self.time[-1] - 0.501
        return 5 * np.exp(-((since / 0.05) ** 2)) * np.sin(2 * np.pi * 30 * since)

    @property
    def time(self) -> np.ndarray:
        return np.arange(self.samples) / self.rate

    @property
    def stamps(self) -> np.ndarray:
        """Instants (s) of the samples that a file with stamps holds."""
        return self.begins + self.time[self.kept]

    @property
    def kept(self) -> np.ndarray:
        """Samples that a file with stamps holds."""
        lost = np.arange(self.samples // 5, self.samples // 5 + self.gap)
        return np.delete(np.arange(self.samples), lost)

    def written(self, late: bool = False, gap: bool = False) -> dict[str, tuple[str, np.ndarray]]:
        """Unit and values by name, in the file's order."""
        kept = self.kept if gap else np.arange(self.samples)
        force = self.force[kept] / FORCES[self.force_unit]
        acceleration = self.sign * self.acceleration[kept] / ACCELERATIONS[self.acceleration_unit]
        columns = {
            "force": (self.force_unit, force[: len(force) - self.late] if late and self.late else force),
            "acceleration": (self.acceleration_unit, acceleration[self.late :] if late else acceleration),
        }
        return columns if self.force_first else dict(reversed(columns.items()))


def heading(name: str, unit: str) -> str:
    return f"{name} [{unit}]" if unit else name


def by_pandas(path: Path, made: Made) -> None:
    import pandas

    table = {"time (s)": made.stamps} if made.states_rate else {}
    table |= {heading(name, unit): v for name, (unit, v) in made.written(gap=made.states_rate).items()}
    pandas.DataFrame(table).to_csv(path, index=False)


def by_parquet(path: Path, made: Made) -> None:
    import pandas

    pytest.importorskip("pyarrow")
    table = {"time (ms)": 1e3 * made.stamps} if made.states_rate else {}
    table |= {heading(name, unit): v for name, (unit, v) in made.written(gap=made.states_rate).items()}
    pandas.DataFrame(table).to_parquet(path)


def by_openpyxl(path: Path, made: Made) -> None:
    openpyxl = pytest.importorskip("openpyxl")

    book = openpyxl.Workbook()
    columns = made.written(gap=made.states_rate)
    if made.states_rate:
        columns = {"time": ("ms", 1e3 * made.stamps), **columns}
    book.active.append([name if made.shown else heading(name, unit) for name, (unit, _) in columns.items()])
    for row in np.stack([values for _, values in columns.values()], axis=1).tolist():
        book.active.append(row)
    for cell, (unit, _) in zip(book.active.iter_cols(min_row=2), columns.values(), strict=True):
        for one in cell if made.shown and unit else ():
            one.number_format = f'0.000" {unit}"'
    book.save(path)


def _by_xarray(engine: str) -> Callable[[Path, Made], None]:
    def write(path: Path, made: Made) -> None:
        xarray = pytest.importorskip("xarray")
        pytest.importorskip(engine)

        columns = made.written(gap=made.states_rate)
        variables = {
            name: ("time", values, {"units": unit} if unit else {})
            for name, (unit, values) in columns.items()
        }
        time = {"time": ("time", 1e3 * made.stamps, {"units": "ms"})} if made.states_rate else {}
        step = {"acceleration": {"dtype": "int32", "scale_factor": made.step, "_FillValue": -(2**31)}}
        xarray.Dataset(variables, coords=time).to_netcdf(path, engine=engine, encoding=step)

    return write


def by_nptdms(path: Path, made: Made) -> None:
    nptdms = pytest.importorskip("nptdms")

    begin = np.datetime64("2026-01-01T00:00:00", "us")
    channels = []
    for name, (unit, values) in made.written(late=made.states_rate).items():
        said: dict[str, object] = {"unit_string": unit} if unit else {}
        if made.states_rate:
            later = made.late / made.rate if name == "acceleration" else 0.0
            said |= {"wf_increment": 1 / made.rate, "wf_start_time": begin, "wf_start_offset": later}
        channels.append(nptdms.ChannelObject("group", name, values, properties=said))
    with nptdms.TdmsWriter(str(path)) as file:
        file.write_segment(channels)


def by_pyuff(path: Path, made: Made) -> None:
    import pyuff

    sets = []
    for name, (unit, values) in made.written(late=True).items():
        begins = made.late if name == "acceleration" else 0
        x = (np.arange(len(values)) + begins) / made.rate
        kind, turned = (12, made.sign) if name == "acceleration" else (13, 1)
        sets.append(function58(name, x, values, kind, unit or "NONE", rsp_dir=3 * turned))
    if not made.states_rate:
        sets.insert(0, pyuff.prepare_164(
            units_code=1, units_description="SI", temp_mode=1, length=1.0, force=1.0, temp=1.0,
            temp_offset=273.15))  # fmt: skip
    pyuff.UFF(str(path)).write_sets(sets, mode="overwrite")


def by_pynwb(path: Path, made: Made) -> None:
    pynwb = pytest.importorskip("pynwb")

    file = pynwb.NWBFile("presses", "id", dt.datetime(2026, 1, 1, tzinfo=dt.UTC))
    for name, (unit, values) in made.written(late=made.states_rate, gap=not made.states_rate).items():
        counts = np.rint(values / made.step).astype("i4")
        said = {"rate": made.rate, "starting_time": made.late / made.rate if name == "acceleration" else 0.0}
        if not made.states_rate:
            said = {"timestamps": made.stamps}
        one = pynwb.TimeSeries(name=name, data=counts, unit=unit or "unknown", conversion=made.step, **said)
        file.add_acquisition(one)
    with pynwb.NWBHDF5IO(path, "w") as out:
        out.write(file)


def by_scipy(path: Path, made: Made) -> None:
    columns = made.written()
    values = {name: values for name, (_, values) in columns.items()}
    units = {name: unit for name, (unit, _) in columns.items() if unit}
    rate = {"fs": made.rate} if made.states_rate else {"time": made.begins + made.time}
    scipy.io.savemat(path, {**values, **rate, "units": units})


def by_soundfile(path: Path, made: Made) -> None:
    soundfile = pytest.importorskip("soundfile")
    values = np.stack([values for _, values in made.written().values()], axis=1)
    soundfile.write(path, values / np.abs(values).max() / 2, round(made.rate), subtype="DOUBLE")


WRITERS: dict[str, Callable[[Path, Made], None]] = {
    "a.csv": by_pandas, "a.parquet": by_parquet, "a.xlsx": by_openpyxl, "a.nc": _by_xarray("scipy"),
    "b.nc": _by_xarray("h5netcdf"), "a.tdms": by_nptdms, "a.uff": by_pyuff, "a.nwb": by_pynwb,
    "a.mat": by_scipy, "a.wav": by_soundfile,
}  # fmt: skip
MADE = st.builds(Made, rate=st.sampled_from([1000.0, 2000.0, 2048.0, 5000.0, 5120.0, 8000.0]),
    samples=st.integers(800, 1400), force_unit=st.sampled_from(sorted(FORCES)),
    acceleration_unit=st.sampled_from(sorted(ACCELERATIONS)), step=st.sampled_from([1e-4, 1e-3, 2.5e-5]),
    late=st.sampled_from([0, 0, 7, 100]), gap=st.sampled_from([0, 0, 5, 40]),
    sign=st.sampled_from([1, 1, -1]), force_first=st.booleans(), states_rate=st.booleans(),
    begins=st.sampled_from([0.0, 0.0, -0.25, 3600.0]), shown=st.booleans())  # fmt: skip


@pytest.mark.usefixtures("read_here")
@pytest.mark.timeout(3600)
@given(name=st.sampled_from(sorted(WRITERS)), made=MADE)
@settings(
    settings.get_profile("foreign") if os.environ.get("HAPLOOP_FOREIGN") else settings(max_examples=30),
    deadline=None,
    suppress_health_check=[
        HealthCheck.function_scoped_fixture,
        HealthCheck.too_slow,
        HealthCheck.data_too_large,
    ],
)
def test_it_comes_in_as_it_went_out_or_is_asked_about(name, made):
    with TemporaryDirectory() as folder:
        path = Path(folder) / name
        WRITERS[name](path, made)
        try:
            found = understand(path)
        except haploop.HaploopError:
            return
    if found.questions:
        return
    assert found.rate_hz == pytest.approx(made.rate, rel=1e-4)
    whole = {"force": made.force, "acceleration": (1 if name == "a.uff" else made.sign) * made.acceleration}
    for role, values in whole.items():
        if role not in found.signals:
            assert role == "acceleration" and not made.acceleration_unit
            continue
        got = found.signals[role].values
        # Force begins first and ends first: both are there from `late` to `late` before the end.
        both = slice(made.late, made.samples - made.late) if len(got) < made.samples else slice(None)
        there = np.ones(made.samples, bool)
        there[made.samples // 5 - 2 : made.samples // 5 + made.gap + 2] = made.gap == 0
        np.testing.assert_allclose(
            got[there[both]], values[both][there[both]], atol=0.02 * np.abs(values).max()
        )


@pytest.mark.usefixtures("read_here")
@pytest.mark.parametrize("name", sorted(set(WRITERS) - {"a.wav"}))
def test_what_states_everything_is_not_asked_about(name, tmp_path):
    made = Made(5000.0, 2500, "mN", "g", 1e-4, 100, 0, 1, False, name != "a.uff")
    WRITERS[name](tmp_path / name, made)
    if name == "a.uff":  # in which mN and g contradict a data set 164 of SI units
        with pytest.raises(haploop.ConfigurationError, match="data set 164"):
            understand(tmp_path / name).require()
        return
    understand(tmp_path / name).require()
