"""What is packed here, the HDF5 library unpacks and verifies."""

import h5py
import numpy as np
import pytest

from haploop.base.hdf5 import write_packed


@pytest.mark.parametrize(("values", "chunks"), [
    (np.arange(30_000).reshape(3, 10_000).astype(np.int16), (3, 4096)),
    (np.zeros((2, 9000), np.int16), (2, 8192)),
    (np.linspace(-1, 1, 60_001, dtype=np.float32)[np.newaxis], True),
    (np.array([True, False, True]), True),
])  # fmt: skip
def test_the_library_refuses_a_flipped_bit(tmp_path, values, chunks):
    path = tmp_path / "packed.h5"
    with h5py.File(path, "w") as file:
        write_packed(file, "a/b", values, chunks, fletcher32=True)
    with h5py.File(path) as file:
        read = file["a/b"]
        assert read.dtype == values.dtype and read.shuffle and read.fletcher32 and read.compression == "gzip"
        np.testing.assert_array_equal(read[()], values)
        at = read.id.get_chunk_info(0)
    flipped = bytearray(path.read_bytes())
    flipped[at.byte_offset + at.size // 2] ^= 1
    path.write_bytes(flipped)
    with h5py.File(path) as file, pytest.raises(OSError, match="read"):
        file["a/b"][()]


def test_the_checksum_is_the_librarys_for_any_bytes(tmp_path):
    rng = np.random.default_rng(0)
    for size in (1, 2, 359, 720, 721, 5000):
        for values in (rng.integers(0, 256, size).astype(np.uint8), np.full(size, 255, np.uint8)):
            path = tmp_path / "one.h5"
            with h5py.File(path, "w") as file:
                write_packed(file, "a", values, (size,), fletcher32=True)
            with h5py.File(path) as file:
                np.testing.assert_array_equal(file["a"][()], values)
