"""Every number of a rig file has bounds: a list generated from the models, and no key is left out."""

import types
from collections.abc import Iterator
from importlib import metadata
from typing import Annotated, Any, Union, get_args, get_origin

import numpy as np
import pytest
from pydantic import BaseModel, TypeAdapter, ValidationError
from pydantic.fields import FieldInfo

from haploop.base.errors import ConfigurationError
from haploop.calibration.self_test import examine
from haploop.commands.cli import cli
from haploop.instruments import load_rig_file, open_rig
from haploop.instruments.config.rig_file import AbortLimits, RigFile
from haploop.instruments.sensors import Described
from haploop.mocks.faults import OWN
from tests.raising import raises

GROUPS = ("haploop.drivers", "haploop.plants")
NO_NUMBERS = [True, "1", "1e9", 1e308, -1e308, 10**30, -(10**30), float("nan"), float("inf"), float("-inf")]


def models() -> list[type[BaseModel]]:
    """Everything that describes a table of a rig file."""
    loaded = [entry.load() for group in GROUPS for entry in metadata.entry_points(group=group)]
    return [RigFile, *(getattr(kind, "Settings", kind) for kind in (*loaded, *OWN.values()))]


def numbers(model: type[BaseModel], seen: set[Any]) -> Iterator[tuple[str, Any]]:
    """(model.key, annotation) of every number of a model and of those below it."""
    if model in seen:
        return
    seen.add(model)
    for name, field in model.model_fields.items():
        key = f"{model.__module__.removeprefix('haploop.')}.{model.__qualname__}.{name}"
        yield from leaves(key, field.annotation, field.metadata, seen)


def leaves(key: str, kind: Any, checks: list[Any], seen: set[Any]) -> Iterator[tuple[str, Any]]:
    if get_origin(kind) is Annotated:
        inner, *more = get_args(kind)
        own = [one for x in more for one in (x.metadata if isinstance(x, FieldInfo) else [x])]
        yield from leaves(key, inner, [*checks, *own], seen)
        return
    for check in checks:
        if isinstance(check, Described):
            yield from numbers(check.table, seen)
    if isinstance(kind, type) and issubclass(kind, BaseModel):
        yield from numbers(kind, seen)
    elif kind in (float, int):
        yield key, Annotated[(kind, *checks)] if checks else kind
    else:
        shared = checks if get_origin(kind) in (Union, types.UnionType) else []
        for inner in get_args(kind):
            yield from leaves(key, inner, shared, seen)


SEEN: set[Any] = set()
EVERY = [found for model in models() for found in numbers(model, SEEN)]


@pytest.mark.parametrize(("key", "kind"), EVERY, ids=[key for key, _ in EVERY])
def test_every_number_of_a_rig_file_has_bounds(key, kind):
    adapter = TypeAdapter(kind)
    for value in NO_NUMBERS:
        with pytest.raises(ValidationError):
            print(key, "takes", adapter.validate_python(value))


def test_the_list_is_whole():
    assert len(EVERY) > 300
    assert {
        "instruments.config.rig_file.AbortLimits.drive",
        "instruments.relay.yocto.Yocto.Settings.rating",
    } <= {key for key, _ in EVERY}


@pytest.mark.parametrize(("drive", "says"), [
    ("1e9", r"abort.*drive = 1e\+09 V stops no play .* the limits are 50 V: .* 62.5 or less, .*drive_source"),
    ("62.6", "stops no play"),
    ("1e308", "must be 1e.12 or less"),
    ("true", "must be a number"),
    ('"1e9"', "must be a number"),
    ("nan", "number"),
    ("0", "must be above 0"),
    ("1e-30", "smaller than anything"),
])  # fmt: skip
def test_a_trip_level_that_switches_the_monitor_off_is_refused(tmp_path, drive, says, capsys):
    path = tmp_path / "loose.toml"
    path.write_text(f'base = "simulated"\n[abort]\ndrive = {drive}\n')
    raises(ConfigurationError, says, load_rig_file, path)
    with pytest.raises(SystemExit) as ended:
        cli.main(["doctor", "--rig", str(path)])
    assert ended.value.code == 2
    assert "drive" in capsys.readouterr().err


def test_with_its_source_it_is_taken_and_doctor_says_so(tmp_path):
    path = tmp_path / "loose.toml"
    why = "The divider reads 1.6 times too much, measured by K. L."
    path.write_text(f'base = "simulated"\n[abort]\ndrive = 80\ndrive_source = "{why}"\n')
    with open_rig(path) as rig:
        found = next(f for f in examine(rig) if f.instrument == "abort")
    assert found.status == "yellow" and "80 V" in found.sentence and why in found.sentence


def test_what_a_part_takes_less_than_the_limits_counts_before_a_play():
    """The amplifier's own rails are known once it is open."""
    file = load_rig_file("simulated")
    file = file.model_copy(update={"abort": AbortLimits(drive=80.0)})
    with open_rig(file) as rig:
        with pytest.raises(ConfigurationError, match=r"plays nothing: \[abort\] drive = 80 V"):
            rig.excite(np.zeros(1000), ["A"], ["drive"])
        assert rig.simulation.truth.peak == 0.0
