"""A disk that refuses any call of writer, committer or finishing: one sentence, and samples kept."""

import errno
import os
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

import numpy as np
import pytest

from haploop.acquisition import Recording, record, recover, verify
from haploop.acquisition.recording.salvage import finish
from haploop.acquisition.recording.writer import Writer
from haploop.base import hdf5
from haploop.base.errors import ConfigurationError, DataError, HaploopError, InstrumentError
from haploop.base.json_files import append_json, write_json
from tests.acquisition.presses.pressworld import world_rig
from tests.acquisition.recording.pattern import block_of, header, kept, unfinished

pytestmark = pytest.mark.skipif(not hasattr(os, "pwrite"), reason="refusals are simulated at POSIX calls")

NUMBERS = [errno.ENOSPC, errno.EIO]


@contextmanager
def refused(monkeypatch: pytest.MonkeyPatch, call: str, number: int, after: int = 0) -> Iterator[list[str]]:
    """Every `call` of the operating system after the first `after` fails; yields the calls that did."""
    fired: list[str] = []
    with monkeypatch.context() as patch:
        # Without hard links, a name is claimed and replaced.
        for name in ("link", "replace") if call == "link" else (call,):
            owner = Path if name == "replace" else os
            real: Callable[..., object] = getattr(owner, name)
            left = [after]

            def fail(*arguments: object, name: str = name, real=real, left=left, **more: object) -> object:
                if left[0] > 0 or (name == "close" and fired):
                    left[0] -= 1
                    return real(*arguments, **more)
                if name == "close":  # a descriptor is closed whatever is said of it
                    real(*arguments)
                fired.append(name)
                raise OSError(number, os.strerror(number))

            patch.setattr(owner, name, fail)
        yield fired


def one_sentence(error: BaseException, number: int) -> None:
    assert os.strerror(number) in str(error) and "\n" not in str(error), error
    assert str(error).endswith("."), error


@pytest.mark.parametrize("number", NUMBERS, ids=errno.errorcode.get)
@pytest.mark.parametrize(("call", "after"), [
    (call, after) for call in ("open", "posix_fallocate", "fsync") for after in (0, 1)] + [("link", 0),
])  # fmt: skip
def test_while_a_file_is_laid_out(tmp_path, monkeypatch, call, after, number):
    path = tmp_path / "P01-push.h5"
    with (
        refused(monkeypatch, call, number, after) as fired,
        pytest.raises(ConfigurationError) as told,
    ):
        Writer(path, header(), 250, 20)
    assert fired
    one_sentence(told.value, number)
    assert list(tmp_path.iterdir()) == []


@pytest.mark.long
@pytest.mark.parametrize("number", NUMBERS, ids=errno.errorcode.get)
@pytest.mark.parametrize("call", ["pwrite", "fdatasync", "fsync", "close"])
def test_while_recording(tmp_path, monkeypatch, call, number):
    path = tmp_path / "P01-push.h5"
    writer = Writer(path, header(), 250, 5000)
    for i in range(4):
        writer.write(block_of(250 * i), 0.0)
    with refused(monkeypatch, call, number) as fired, pytest.raises(InstrumentError) as told:
        for i in range(4, 4000):
            writer.write(block_of(250 * i), 0.0)
            if call in ("fsync", "close"):
                break
            time.sleep(0.001)
        writer.close()
    assert fired
    one_sentence(told.value, number)
    written = writer.written
    with pytest.raises(InstrumentError):
        writer.close()
        writer.write(block_of(written), 0.0)
    assert kept(path) == written >= 1000
    assert verify(recover(path)) == ()


@pytest.mark.parametrize("number", NUMBERS, ids=errno.errorcode.get)
@pytest.mark.parametrize(("call", "after"), [("open", 0), ("fsync", 0), ("fsync", 1), ("replace", 0)])
def test_while_a_file_is_finished(tmp_path, monkeypatch, call, after, number):
    path = unfinished(tmp_path / "P01-push.h5")
    with refused(monkeypatch, call, number, after) as fired, pytest.raises(InstrumentError) as told:
        finish(path)
    assert fired
    one_sentence(told.value, number)
    assert list(tmp_path.iterdir()) == [path] and kept(path) == 2000
    if Recording.open(path).state == "recording":
        finish(path)
    assert verify(path) == () and kept(path) == 2000


@contextmanager
def largest_file(size: int) -> Iterator[None]:
    """As `ulimit -f`, or a quota."""
    if sys.platform == "win32":
        pytest.skip("Windows limits no file")
    import resource

    soft, hard = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (size, hard))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, (soft, hard))


@pytest.mark.parametrize("size", [0, 512, 1000, 8000, 12_000, 100_000])
def test_a_quota_is_a_full_disk(tmp_path, size, capfd):
    path = unfinished(tmp_path / "P02-push.h5")
    values = {"a": np.arange(20_000.0), "b": 1.5}
    attempts: dict[type[HaploopError], list[Callable[[], object]]] = {
        ConfigurationError: [lambda: Writer(tmp_path / "P01-push.h5", header(), 250, 20)],
        DataError: [
            lambda: hdf5.write(tmp_path / "a.h5", "drive", values),
            lambda: write_json(tmp_path / "a.json", "map", list(range(30_000))),
            lambda: append_json(tmp_path / "b.json", "looks", [{"a": list(range(30_000))}]),
        ],
        InstrumentError: [lambda: finish(path)] if size < 12_000 else [],
    }
    for kind, calls in attempts.items():
        for call in calls:
            with largest_file(size), pytest.raises(kind) as told:
                call()
            one_sentence(told.value, errno.EFBIG)
    assert list(tmp_path.iterdir()) == [path] and kept(path) == 2000
    assert capfd.readouterr().err == ""  # the HDF5 library tells nothing of its own


def test_a_session_under_a_quota_is_refused_before_the_first_sample(tmp_path):
    rig = world_rig()
    with largest_file(200_000), pytest.raises(ConfigurationError, match="File too large"):
        record(rig, "push", "P01", 10, tmp_path)
    assert rig.daq.given == [] and list(tmp_path.iterdir()) == []
