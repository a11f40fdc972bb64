"""A press that was recorded elsewhere becomes a representative press here."""

import json
import shutil
import struct
import subprocess
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.io import savemat, wavfile

import haploop
from haploop.acquisition import Recording, Representative, high_pass
from haploop.exchange import FileMapping, understand
from haploop.exchange.importing.press import resampled
from tests.exchange.other_programs import function58
from tests.raising import raises


def press(path: Path, button: str | None = None, at: float | None = None, **told: Any) -> Representative:
    return haploop.exchange.import_press(path, FileMapping(button=button, **told), activation=at)


def like(found: Representative, press: Representative, most: float = 0.02) -> None:
    # The contact of this press closes one sample after its activation.
    assert found.rate_hz == 5000 and 0 <= found.activation_index - press.activation_index <= 1
    own = high_pass(press.acceleration, 5000)  # the press made for tests is not high-passed
    error = np.linalg.norm(found.acceleration - own) / np.linalg.norm(own)
    assert len(found.acceleration) == len(own) and error < most


@pytest.mark.usefixtures("read_here")
@pytest.mark.parametrize(
    ("format", "suffix"),
    [
        ("csv", ".csv"), ("wav", ".wav"), ("wav48", ".wav"), ("mat", ".mat"), ("mat", ".signals"),
        ("uff", ".uff"),
    ],
)  # fmt: skip
def test_a_press_goes_out_and_comes_back(files, tmp_path, format, suffix):
    """With no word on channel, unit, rate, button or activation: the file has them."""
    out = tmp_path / f"press{suffix}"
    haploop.export_file(files.representative, format, out)
    found = press(out, format=format if suffix == ".signals" else None)
    like(found, files.press, 0.04 if format == "wav48" else 0.02)
    assert found.simulated and found.sources[0][0] == out.name
    assert found.button == ("imported" if format == "uff" else "push")


def _by_xarray(engine: str) -> Callable[[Recording, Path], None]:
    def write(recording: Recording, path: Path) -> None:
        pytest.importorskip("xarray")
        pytest.importorskip(engine)
        recording.to_xarray().to_netcdf(path, engine=engine)

    return write


def _by_pandas(recording: Recording, path: Path) -> None:
    pytest.importorskip("pandas")
    pytest.importorskip("pyarrow")
    recording.to_pandas().to_parquet(path)


@pytest.mark.usefixtures("read_here")
@pytest.mark.parametrize(
    ("write", "name"),
    [(_by_pandas, "a.parquet"), (_by_xarray("scipy"), "a.nc"), (_by_xarray("h5netcdf"), "a.nc")],
)
def test_a_recording_by_pandas_or_xarray_says_what_it_is(files, tmp_path, write, name):
    """Units, button and participant, and that it is simulated."""
    write(files.presses, tmp_path / name)
    three = name == "a.nc"  # axes, of which the file does not say that z is vertical
    if three:
        assert "acceleration z" in str(understand(tmp_path / name).questions)
    told = FileMapping(acceleration="acceleration z") if three else None
    haploop.import_file(understand(tmp_path / name, told), tmp_path / "back.h5")
    found = Recording.open(tmp_path / "back.h5")
    assert (found.button, found.participant, found.simulated) == ("push", "P01", True)
    np.testing.assert_allclose(found.force, files.presses.force, atol=2e-3)  # from the file's own rest
    np.testing.assert_allclose(found.acceleration[0], files.presses.acceleration[2], atol=2e-3)


@pytest.mark.usefixtures("read_here")
@pytest.mark.parametrize("format", ["mat", "uff"])
def test_one_press_of_an_exported_recording_is_imported(files, tmp_path, format):
    """The one that is named: of several none is taken without a word."""
    out = tmp_path / f"presses.{format}"
    haploop.export_file(files.recording, format, out)
    raises(haploop.ConfigurationError, "holds 2 presses", press, out)
    first = round(files.presses.accepted[1].activation)
    found = press(out, at=first / 5000)
    assert "where the operator said" in found.reason
    cut = slice(first - 750, first - 750 + len(found.acceleration))
    assert found.activation_index == 750
    np.testing.assert_allclose(found.force, files.presses.force[cut], atol=1e-3)  # from the file's own rest


def click_of(rate: int = 10_000) -> np.ndarray:
    """0.5 s, switched at 0.15 s, of which the largest acceleration is 2 m/s^2."""
    since = np.maximum(np.arange(rate // 2) / rate - 0.15, 0)
    wave = np.exp(-since / 0.01) * np.sin(2 * np.pi * 235 * since)
    return np.asarray(2 * wave / np.abs(wave).max())


def by_soundfile(path: Path, values: np.ndarray) -> None:
    pytest.importorskip("soundfile").write(path, values / 4, 10_000, subtype="PCM_24")


def by_pandas(path: Path, values: np.ndarray) -> None:
    pandas = pytest.importorskip("pandas")
    pandas.DataFrame({"t [s]": np.arange(len(values)) / 10_000, "acc [m/s^2]": values}).to_csv(
        path, index=False
    )


def by_octave(path: Path, values: np.ndarray) -> None:
    octave = shutil.which("octave")
    if octave is None:
        pytest.skip("no octave")
    np.savetxt(path.with_suffix(".txt"), values, fmt="%.17g")
    code = f"acc = load('{path.with_suffix('.txt')}'); fs = 10000; save('-v7', '{path}', 'acc', 'fs')"
    subprocess.run([octave, "--no-gui", "--norc", "--eval", code], check=True, timeout=100)


def by_pyuff(path: Path, values: np.ndarray) -> None:
    import pyuff

    x = np.arange(len(values)) / 10_000
    one = function58("acc", x, values, 12, "m/s^2", abscissa_axis_units_lab="NONE")
    pyuff.UFF(str(path)).write_sets([one], mode="overwrite")


def by_sdypy(path: Path, values: np.ndarray) -> None:
    sep005 = pytest.importorskip("sdypy_sep005")
    one = sep005.Sep005Data(data=values.tolist(), name="acc", unit_str="m/s²", fs=10_000.0)
    path.write_text(f"[{one.model_dump_json()}]", encoding="utf-8")


@pytest.mark.parametrize("rate_hz", [800, 1000, 4807.3, 20_000])
def test_a_force_that_is_cut_in_a_press_does_not_ring(rate_hz):
    """1 N where it begins, and more where it ends."""
    truth = [1 + np.sin(np.arange(round(0.5 * r)) / (0.19 * r)) for r in (rate_hz, 5000)]
    found = resampled(truth[0], rate_hz)
    length = min(map(len, (found, truth[1])))
    np.testing.assert_allclose(found[:length], truth[1][:length], atol=0.02)


@pytest.mark.usefixtures("read_here")
@pytest.mark.parametrize(
    ("write", "name", "scale"),
    [
        (by_soundfile, "a.wav", 4.0),
        (by_pandas, "a.csv", None),
        (by_octave, "a.mat", 1.0),
        (by_pyuff, "a.uff", None),
        (by_sdypy, "a.sep005", None),
        (by_sdypy, "a.json", None),
    ],
)
def test_a_file_that_another_library_wrote_alone(tmp_path, write, name, scale):
    values = click_of()
    write(tmp_path / name, values)
    found = press(tmp_path / name, "latch", units={} if scale is None else {"acceleration": f"{scale} m/s^2"})
    assert not found.simulated and found.button == "latch" and len(found.acceleration) == 2500
    assert found.activation_index == pytest.approx(750, abs=6)
    own = high_pass(values[::2], 5000)  # what is below 1 kHz needs no other filter
    assert np.linalg.norm(found.acceleration - own) < 0.05 * np.linalg.norm(own)


def recorded(seconds: float = 3.0, rate: int = 44_100, at: float = 1.7) -> np.ndarray:
    t = np.arange(round(seconds * rate)) / rate
    since = np.maximum(t - at, 0)
    return np.asarray(1.0 + 0.4 * np.exp(-since / 0.01) * np.sin(2 * np.pi * 235 * since))


def test_a_stranger_s_wav_needs_its_scale(tmp_path):
    """44.1 kHz, 24 dB of gravity beneath it: what is longer than a second is cut about the click."""
    path = tmp_path / "click.wav"
    wavfile.write(path, 44_100, (recorded() / 2 * 32767).astype(np.int16))
    raises(haploop.ConfigurationError, "--acceleration", press, path, "latch")
    found = press(path, "latch", units={"acceleration": "2 g"})
    assert found.duration == pytest.approx(0.5, abs=0.001) and not found.simulated
    assert found.activation_index == pytest.approx(750, abs=6)
    assert np.abs(found.acceleration).max() == pytest.approx(0.4 * 0.9 * 9.81, rel=0.1)
    power = np.abs(np.fft.rfft(found.acceleration))
    assert np.fft.rfftfreq(2500, 1 / 5000)[power.argmax()] == pytest.approx(235, abs=5)


def uff(kind: int, step: float) -> str:
    """A time response of six values, of a data type, with a step of its own."""
    lines = ["    -1", "    58", *["NONE"] * 5]
    lines.append("    1         0    1         0 NONE          1   3 NONE          1   3")
    lines.append(f"{kind:10d}{6:10d}{1:10d}{0:13.5e}{step:13.5e}{0:13.5e}")
    lines += ["        17    0    0    0 NONE NONE"] * 4
    return "\n".join([*lines, *[f"{1:13.5e}" * 6] * (2 if kind == 5 else 1), "    -1", ""])


@pytest.mark.parametrize(
    ("separator", "encoding"), [(";", "utf-8-sig"), (";", "cp1252"), ("\t", "utf-16"), ("\t", "utf-16-be")]
)
def test_a_spreadsheet_with_decimal_commas(tmp_path, separator, encoding):
    """As a spreadsheet saves CSV in most of Europe, or as Unicode text."""
    values = np.sin(np.arange(5000) / 10)
    rows = [f"{k / 10_000:.4f}{separator}{value:.9e}" for k, value in enumerate(values)]
    text = f"t [s]{separator}Beschl. für z [m/s²]\r\n" + "\r\n".join(rows).replace(".", ",") + "\r\n"
    mark = b"\xfe\xff" if encoding == "utf-16-be" else b""
    (tmp_path / "a.csv").write_bytes(mark + text.encode(encoding))
    (tmp_path / "b.csv").write_text(text.replace(separator, "|").replace(",", ".").replace("|", ","), "utf-8")
    found, same = (press(tmp_path / name).acceleration for name in ("a.csv", "b.csv"))
    np.testing.assert_array_equal(found, same)
    assert np.ptp(found) > 1


def wav(channels: int, bits: int, bytes_each: int, chunk: bytes) -> bytes:
    """A header that contradicts itself: scipy's reader divides by zero, and uses what it has not read."""
    kind = struct.pack("<IHHIIHH", 16, 1, channels, 48_000, 96_000, bytes_each, bits)
    sized = struct.pack("<I", 0xFFFFFFFF)
    return b"RIFF" + sized + b"WAVEfmt " + kind + chunk + sized + bytes(100)


def silent_wav(rate_hz: int) -> bytes:
    kind = struct.pack("<IHHIIHH", 16, 1, 1, rate_hz, 2 * rate_hz, 2, 16)
    data = b"data" + struct.pack("<I", 200) + bytes(200)
    return b"RIFF" + struct.pack("<I", 28 + len(data)) + b"WAVEfmt " + kind + data


WAVE = "a\n" + "".join(f"{value:.9g}\n" for value in np.sin(np.arange(5000.0)))


@pytest.mark.usefixtures("read_here")
@pytest.mark.parametrize(
    ("name", "content", "sentence", "told"),
    [
        ("a.xyz", "", "unknown file type", ""),
        ("missing.wav", None, "There is no file", ""),
        ("a.csv", "t,a\n0,1\n1,x\n", "no table of numbers", ""),
        ("a.csv", "t [ms],a [g]\n" + "".join(f"{k / 5000},{k % 3}\n" for k in range(2500)),
         "lasts 0.5 ms", ""),
        ("a.csv", "a\n1\n2\n", "--rate", ""),
        ("a.csv", "time [s],a\n0,1\n1,1\n2,3\n9,3\n", "constant rate", ""),
        ("a.csv", "frequency [Hz],a\n1,1\n2,1\n", "over frequency", ""),
        *(("a.csv", WAVE, "--scale", f"--rate 5000 --scale {scale}") for scale in ("0.0", "nan", "1e+300")),
        ("a.wav", silent_wav(0), "its sample rate is 0", ""),
        ("a.json", "{}", "SEP-005", ""),
        ("a.sep005", "", "SEP-005", ""),
        ("a.sep005", '{"name": "a", "unit_str": "g", "fs": 5000, "data": []}', "empty", ""),
        ("a.json", "[]", "several rates or lengths", ""),
        ("a.uff", "no", "no time responses", ""),
        ("a.sep005", '{"name": "a", "unit_str": "g", "fs": 5000, "data": [1' + 400 * "0" + "]}",
         "SEP-005", ""),
        ("a.uff", uff(2, 0.0), "constant rate", ""),
        ("a.uff", uff(5, 2e-4), "no real values", ""),
        *(("a.wav", wav(*header), "is no WAV file that can be read", "")
          for header in ((65535, 16, 2, b"data"), (1, 16, 2, b"JUNK"), (0, 16, 0, b"data"),
                         (1, 65535, 1, b"data"))),
    ],
)  # fmt: skip
def test_what_cannot_be_read_is_one_sentence(run, tmp_path, name, content, sentence, told):
    if content is not None:
        (tmp_path / name).write_bytes(content if isinstance(content, bytes) else content.encode())
    result = run("import", tmp_path / name, *told.split(), "--out", tmp_path / "out.h5", says=sentence)
    assert result.stderr.count("\n") == 1 and not (tmp_path / "out.h5").exists()


def test_a_time_in_milliseconds_is_not_taken_for_seconds(tmp_path):
    time = np.arange(5000) / 5000
    wave = np.exp(-(((time - 0.5) / 0.01) ** 2)) * np.sin(2 * np.pi * 200 * time)
    made = []
    for name, scale in (("s", 1.0), ("ms", 1e3), ("us", 1e6)):
        path = tmp_path / f"{name}.csv"
        table = np.stack([time * scale, wave], axis=1)
        np.savetxt(path, table, header=f"Time ({name}),a [g]", comments="", delimiter=",")
        made.append(press(path, "b").acceleration)
    assert np.allclose(made[1], made[0]) and np.allclose(made[2], made[0])
    path.write_text("time [fortnights],a [g]\n0,1\n1,2\n")
    raises(haploop.ConfigurationError, "fortnights", press, path, "b")


@pytest.mark.usefixtures("read_here")
def test_an_uneven_time_is_refused_in_every_kind_of_file(tmp_path):
    time = np.sort(np.random.default_rng(0).random(5000))
    wave = np.sin(2 * np.pi * 200 * time)
    savemat(tmp_path / "a.mat", {"a": wave, "time_s": time})
    one = {"name": "a", "unit_str": "g", "data": wave.tolist(), "time": time.tolist()}
    (tmp_path / "a.json").write_text(json.dumps([one]))
    for name in ("a.mat", "a.json"):
        with pytest.raises(haploop.DataError, match="constant rate"):
            press(tmp_path / name, "b", units={"acceleration": "m/s^2"})


@pytest.mark.parametrize(
    "beside",
    [
        {"channels": [{}]},
        {"channels": 5},
        {"channels": [{"name": "a", "unit": "g"}], "unit_per_count": ["x"]},
        {"channels": [{"name": "a", "unit": "g"}], "unit_per_count": []},
        {"about": 5},
        {"about": {"activation_s": "x"}},
        {"about": {"bandwidth_hz": []}},
    ],
)
def test_a_sidecar_of_another_shape_is_one_sentence(tmp_path, beside):
    path = tmp_path / "a.wav"
    wavfile.write(path, 5000, np.sin(np.arange(5000.0)).astype(np.float32))
    path.with_name("a.wav.json").write_text(json.dumps(beside))
    raises(haploop.DataError, "", press, path, "b", units={"acceleration": "m/s^2"})


@pytest.mark.parametrize("rate_hz", [-5.0, 1e12, np.nan])
def test_a_rate_that_no_press_has_is_one_sentence(tmp_path, rate_hz):
    path = tmp_path / "a.csv"
    np.savetxt(path, np.sin(np.arange(5000.0)), header="a [g]", comments="")
    raises(haploop.ConfigurationError, "samples/s", press, path, "b", rate_hz=rate_hz)
    raises(haploop.ConfigurationError, "is a folder", press, tmp_path)
    path.write_text("a" + " " * 50_000 + "[q\n1\n2\n")  # a heading that takes no time
    raises(haploop.ConfigurationError, "the unit of", press, path, "b", rate_hz=5000.0)


def test_a_reader_that_dies_is_one_sentence(run, tmp_path, monkeypatch):
    """scipy 1.17 dies of a segmentation fault on some damaged files of level 5; here it just dies."""
    savemat(tmp_path / "a.mat", {"acceleration": np.sin(np.arange(5000.0))})
    dies = "import os; import scipy; scipy.io.loadmat = lambda *a, **b: os.abort()\n"
    (tmp_path / "sitecustomize.py").write_text(dies, encoding="utf-8")
    monkeypatch.setenv("PYTHONPATH", str(tmp_path))
    result = run(
        "import", tmp_path / "a.mat", "--acceleration", "acceleration", "-o", tmp_path / "back.h5",
        says="is damaged, or larger than the memory",
    )  # fmt: skip
    assert result.stderr.count("\n") == 1


@pytest.mark.parametrize(
    ("columns", "told", "by"),
    [
        pytest.param("t,a", {}, "acceleration", id="acceleration alone"),
        pytest.param("t,a,f", {}, "acceleration", id="with force"),
        pytest.param("t,a,x", {}, "acceleration", id="with travel"),
        pytest.param("t,a,s", {}, "activation", id="with a contact"),
        pytest.param("t,a", {"at": 0.3}, "stated", id="a person says when"),
    ],
)
def test_what_was_not_measured_is_absent(run, tmp_path, columns, told, by):
    """In what is shown, in JSON, in the report and in the files."""
    t = np.arange(3000) / 5000
    of = {
        "t": ("time [s]", t),
        "a": ("acc z [m/s^2]", np.exp(-(((t - 0.3) / 0.01) ** 2)) * np.sin(2 * np.pi * 200 * t)),
        "f": ("force [N]", 2 * np.exp(-(((t - 0.3) / 0.05) ** 2))),
        "x": ("travel [mm]", np.exp(-(((t - 0.3) / 0.05) ** 2))),
        "s": ("switch", (t > 0.3).astype(float)),
    }
    names = columns.split(",")
    text = ",".join(of[name][0] for name in names) + "\n"
    text += "\n".join(",".join(f"{v:.6f}" for v in r) for r in zip(*(of[n][1] for n in names), strict=True))
    source, out, page = tmp_path / "a.csv", tmp_path / "a.h5", tmp_path / "a.html"
    source.write_text(text)
    run("import", source, "--as", "press", "-o", out, *(f"--{k}={v}" for k, v in told.items()), ends=0)
    found = Representative.load(out)
    shown, said = run("show", out), run.json("show", out)
    run("report", out, "-o", page, ends=0)
    table = tmp_path / "back.csv"
    run("export", out, "--to", "csv", "-o", table, ends=0)
    for measured, value, name, key in (
        ("f" in names, found.force, "Force at activation", "activation_force_n"),
        ("x" in names, found.travel, "Travel at activation", "activation_travel_m"),
    ):
        assert (value is not None) is measured
        assert (name in shown.stdout) is measured and (name in page.read_text("utf-8")) is measured
        assert (said[key] is not None) is measured
        word = name.split()[0].lower()
        heading = next(one for one in table.read_text().splitlines() if "acceleration" in one and "," in one)
        assert (word in heading) is measured, heading
    assert found.activated_by == by
    assert ("by the contact" in shown.stdout) is (by == "activation")


@pytest.mark.usefixtures("read_here")
@pytest.mark.parametrize("bound", ["columns", "cells"])
def test_a_workbook_of_too_many_cells_is_refused(tmp_path, monkeypatch, bound):
    """While it is read: at the row in which it becomes too large."""
    from haploop.exchange.columns import workbook

    openpyxl = pytest.importorskip("openpyxl")
    book = openpyxl.Workbook()
    sheet = book.active
    if bound == "columns":
        sheet.cell(1, workbook.MOST_COLUMNS + 1, 1.0)
    else:
        monkeypatch.setattr(workbook, "_MOST_CELLS", 20)
        for _ in range(11):
            sheet.append([1.0, 2.0])
    book.save(tmp_path / "a.xlsx")
    with pytest.raises(haploop.HaploopError, match=r"sheet 'Sheet' has over 1000 columns or \d+ cells"):
        press(tmp_path / "a.xlsx")
