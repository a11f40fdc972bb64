import errno
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import pyuff

from haploop.base.errors import ConfigurationError, DataError
from haploop.calibration import Calibration, Response, read_uff, write_uff
from haploop.instruments import load_rig_file
from tests.calibration.model.test_model import plate
from tests.raising import raises


@pytest.fixture
def response() -> Response:
    measured, _, _ = plate(5, lines=401)
    # What an odd multisine leaves is not evenly spaced.
    kept = np.arange(401) % 5 > 0
    return replace(
        measured,
        frequencies=measured.frequencies[kept],
        velocity=measured.velocity[kept],
        coherence=np.full(kept.sum(), 0.99),
        deviation=np.full(kept.sum(), 1e-7),
        point="20",
    )


def test_a_full_disk_leaves_nothing(tmp_path, response, monkeypatch):
    def full(*_arguments: Any, **_settings: Any) -> None:
        try:
            raise OSError(errno.ENOSPC, "No space left on device")
        except OSError:
            raise Exception("Error writing data-set #58") from None

    monkeypatch.setattr("pyuff.UFF.write_sets", full)
    with pytest.raises(DataError, match=r"full\.uff cannot be written: No space left on device"):
        write_uff(tmp_path / "full.uff", [response])
    assert list(tmp_path.iterdir()) == []


def test_what_is_written_is_read(response, tmp_path):
    other = replace(
        response, patch="B", point="button", velocity=2j * response.velocity, coherence=np.zeros(0)
    )
    path = tmp_path / "two.uff"
    write_uff(path, [response, other])
    back = read_uff(path)
    assert [(r.patch, r.point) for r in back] == [("A", "20"), ("B", "button")]
    for before, after in zip((response, other), back, strict=True):
        assert after.velocity == pytest.approx(before.velocity, rel=1e-10)
        # The format has six digits.
        assert after.frequencies == pytest.approx(before.frequencies, rel=5e-6)
        assert after.source.startswith("imported from two.uff, sha256 ")
        assert after.simulated and after.created == before.created and after.excitation == before.excitation
    assert back[0].coherence == pytest.approx(0.99) and len(back[0].deviation)
    assert not len(back[1].coherence) and not len(back[1].deviation)
    raises(DataError, "not overwritten", write_uff, path, [response])
    raises(DataError, "no response", write_uff, tmp_path / "none.uff", [])
    assert [p.name for p in tmp_path.iterdir()] == ["two.uff"]


def exported(path: Path, **change: Any) -> Path:
    """As a scanning vibrometer's software writes it: evenly spaced, nodes for points, its own units."""
    f = np.arange(10.0, 1000.0, 2.5)
    values = {
        "binary": 0, "func_type": 4, "rsp_node": 17, "rsp_dir": 3, "ref_node": 999, "ref_dir": 0,
        "abscissa_spacing": 1, "abscissa_min": 10.0, "abscissa_inc": 2.5, "abscissa_spec_data_type": 18,
        "ordinate_spec_data_type": 8, "ordinate_axis_units_lab": "m", "orddenom_spec_data_type": 0,
        "orddenom_axis_units_lab": "V", "id1": "Scan", "data": 1e-9 / (1 + 1j * f / 300), "x": f,
    }  # fmt: skip
    sets = [pyuff.prepare_58(**{**values, **change})]
    pyuff.UFF(str(path)).write_sets(sets, mode="overwrite")
    return path


@pytest.mark.parametrize(("kind", "unit", "power"), [(8, "m", 1), (11, "m/s", 0), (12, "m/s^2", -1)])
def test_a_vibrometers_export_is_velocity(tmp_path, kind, unit, power):
    told = {"ordinate_spec_data_type": kind, "ordinate_axis_units_lab": unit}
    (one,) = read_uff(exported(tmp_path / "scan.uff", **told), patch="A")
    f = one.frequencies
    assert one.velocity == pytest.approx(1e-9 / (1 + 1j * f / 300) * (2j * np.pi * f) ** power, rel=1e-5)
    assert (one.patch, one.point, one.simulated) == ("A", "17", False)
    said = exported(tmp_path / "label.uff", ordinate_spec_data_type=0, ordinate_axis_units_lab=unit)
    assert read_uff(said)[0].velocity == pytest.approx(one.velocity)
    upside_down = exported(tmp_path / "down.uff", **told, rsp_dir=-3)
    assert read_uff(upside_down)[0].velocity == pytest.approx(-one.velocity)


@pytest.mark.parametrize(("change", "said"), [
    ({"func_type": 1, "data": np.ones(396)}, r"types \[1\]"),
    ({"rsp_dir": 1}, "out of the plane"),
    ({"ordinate_spec_data_type": 13}, "its type is excitation force, and its label says 'm'"),
    ({"ordinate_spec_data_type": 0, "ordinate_axis_units_lab": "dB"}, "'dB'"),
    ({"orddenom_spec_data_type": 13, "orddenom_axis_units_lab": "N"},
     "is per N, and a patch is driven by volts"),
])  # fmt: skip
def test_what_is_no_response_per_volt_is_refused(tmp_path, change, said):
    raises(DataError, said, read_uff, exported(tmp_path / "scan.uff", **change))


def test_files_that_are_none_say_so(response, tmp_path):
    raises(DataError, "cannot be read", read_uff, tmp_path / "missing.uff")
    text = tmp_path / "text.uff"
    text.write_text("hello")
    raises(DataError, "no data set 58", read_uff, text)
    write_uff(tmp_path / "whole.uff", [response])
    lines = (tmp_path / "whole.uff").read_text().splitlines(keepends=True)
    for name, kept in (
        ("short", lines[:100] + lines[-1:]),
        ("garbled", [*lines[:40], "x y z\n", *lines[41:]]),
    ):
        cut = tmp_path / f"{name}.uff"
        cut.write_text("".join(kept))
        raises(DataError, r"damaged|no data set", read_uff, cut)


def test_an_imported_response_is_fitted_and_needs_a_rig(response, tmp_path):
    path = tmp_path / "scan.uff"
    write_uff(path, [response])
    (alone,) = read_uff(path)
    raises(ConfigurationError, "which rig", Calibration.of, alone)
    (one,) = read_uff(path, rig=load_rig_file("simulated"))
    calibration = Calibration.of(one)
    assert calibration.rate_hz == 50e3 and calibration.model.stable
    calibration.save(tmp_path / "calibration.h5")
    assert Calibration.load(tmp_path / "calibration.h5").digest == calibration.digest
