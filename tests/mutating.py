"""Random changes of a file's bytes or of its HDF5 structure, and the memory that reading one takes."""

import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

import h5py
import numpy as np

from haploop.base.checksum import NAME, add_checksum
from haploop.base.errors import HaploopError

MOST_MEMORY = 200 << 20
"""Bytes that reading a changed file may take above what reading the file itself takes."""
_HEAD = 8192
"""Bytes at the beginning of an HDF5 file in which most of the structure lies."""


def mutations(raw: bytes, count: int, seed: int) -> Iterator[bytes]:
    """Bits, bytes, runs and lengths of a file changed; half of them near its beginning."""
    random = np.random.default_rng(seed)
    for number in range(count):
        changed = bytearray(raw)
        end = len(raw) if number % 2 else min(len(raw), _HEAD)
        place, length = int(random.integers(end)), int(random.integers(1, 64))
        match number % 10:
            case 0 | 1 | 2:
                changed[place] ^= 1 << int(random.integers(8))
            case 3 | 4:
                changed[place] ^= int(random.integers(1, 256))
            case 5:
                changed[place : place + 8] = random.bytes(8)
            case 6:
                changed[place : place + 8] = random.choice([b"\xff" * 8, b"\0" * 8, b"\0\0\0\0\0\0\0\x7f"])
            case 7:
                del changed[place : place + length]
            case 8:
                changed[place:place] = raw[place : place + length] or b"0"
            case _:
                del changed[int(random.integers(len(raw))) :]
        yield bytes(changed)


def restructure(path: Path, seed: int, kind: str) -> None:
    """Change one thing of the structure of an HDF5 file, and give it the checksum of what it is now."""
    random = np.random.default_rng(seed)
    with h5py.File(path, "r+", locking=False) as file:
        names: list[str] = []
        file.visit(names.append)
        datasets = [name for name in names if isinstance(file[name], h5py.Dataset) and name != NAME]
        groups = ["/", *(name for name in names if isinstance(file[name], h5py.Group))]
        dataset = datasets[int(random.integers(len(datasets)))]
        group = groups[int(random.integers(len(groups)))]
        attributes = sorted(file[group].attrs) or ["none"]
        attribute = attributes[int(random.integers(len(attributes)))]
        match seed % 10:
            case 0:
                del file[dataset]
            case 1:
                file[group].attrs.pop(attribute, None)
            case 2:
                file[group].attrs[attribute] = random.choice([1.5, -1, 2**31])
            case 3:
                file[group].attrs[attribute] = np.zeros(3)
            case 4:
                file[group].attrs[attribute] = "[" * 5000
            case 5:  # a terabyte, of which there is nothing
                dtype = file[dataset].dtype
                del file[dataset]
                file.create_dataset(dataset, (10**12 // dtype.itemsize,), dtype)
            case 6:  # the same in chunks
                dtype = file[dataset].dtype
                del file[dataset]
                file.create_dataset(dataset, (4, 10**11), dtype, chunks=(4, 8192), compression="gzip")
            case 7:
                content = np.zeros(3, "S5") if random.integers(2) else np.zeros((2, 2, 2), ">f4")
                del file[dataset]
                file[dataset] = content
            case 8:
                del file[dataset]
                file[dataset] = h5py.SoftLink("/" + dataset)
            case _:
                del file[dataset]
                file.create_dataset(dataset, (1000,), "u1", external=[("/etc/passwd", 0, 1000)])
    add_checksum(path, kind)


def refused(use: Callable[[], object]) -> bool:
    """Use a file: True when it was refused in one sentence, and not for its memory only then."""
    with within_memory():
        try:
            use()
        except HaploopError as error:
            assert "\n" not in str(error).strip() and len(str(error)) < 1000, error
            return True
    return False


@contextmanager
def within_memory() -> Iterator[None]:
    """Fails when what is done within takes more than 200 MB."""
    before = _resident()
    yield
    assert _peak() - before < MOST_MEMORY


def _resident() -> int:
    if sys.platform != "linux":
        return 0
    Path("/proc/self/clear_refs").write_text("5", encoding="ascii")  # the peak begins anew
    return _status("VmRSS")


def _peak() -> int:
    return _status("VmHWM") if sys.platform == "linux" else 0


def _status(what: str) -> int:
    lines = Path("/proc/self/status").read_text(encoding="ascii").splitlines()
    return next(int(line.split()[1]) << 10 for line in lines if line.startswith(what))
