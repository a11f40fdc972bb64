"""Recordings for xarray and pandas, where those are installed, and in one sentence where they are not."""

import sys

import numpy as np
import pytest

from haploop.acquisition import Recording, record
from haploop.base.errors import ConfigurationError
from tests.acquisition.presses.pressworld import world_rig


@pytest.fixture(scope="module")
def recording(tmp_path_factory: pytest.TempPathFactory) -> Recording:
    return record(world_rig(seed=4), "push", "P01", 1, tmp_path_factory.mktemp("export"))


def test_xarray_has_every_quantity_with_its_unit_and_its_source(recording):
    pytest.importorskip("xarray")
    data = recording.to_xarray()
    assert data.acceleration.dims == ("axis", "time")
    assert np.array_equal(data.acceleration.sel(axis="z"), recording.acceleration[2])
    assert np.array_equal(data.force, recording.force)
    assert (data.force.units, data.time.units) == ("N", "s")
    assert data.activation.delay == pytest.approx(42e-6)
    assert float(data.time[5000]) == 1.0
    assert data.attrs["content_hash"] == recording.content_hash


def test_pandas_has_a_column_for_each_quantity(recording):
    pytest.importorskip("pandas")
    table = recording.to_pandas()
    assert list(table) == ["force", *(f"acceleration_{axis}" for axis in "xyz"), "activation", "saturated"]
    assert np.array_equal(table["acceleration_y"], recording.acceleration[1])
    assert table.index[5000] == 1.0
    units = ["s", "N", *3 * ["m/s^2"], "1", "1"]
    assert table.attrs["units"] == dict(zip(["time", *table], units, strict=True))
    assert table.attrs["source"] == "P01-push.h5"


@pytest.mark.parametrize("name", ["xarray", "pandas"])
def test_what_is_not_installed_is_named(recording, monkeypatch, name):
    monkeypatch.setitem(sys.modules, name, None)
    with pytest.raises(
        ConfigurationError, match=f"{name} is not installed: install it with `pip install {name}`"
    ):
        {"xarray": recording.to_xarray, "pandas": recording.to_pandas}[name]()


def test_lengths_and_shapes_say_what_they_are_and_a_figure_is_at_hand(recording):
    channels, samples = recording.shape
    assert (channels, samples) == recording.volts.shape
    assert len(recording) == samples == len(recording.force) == len(recording.to_pandas())
    assert recording.plot(columns=1).axes
